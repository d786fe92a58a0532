//! A recording as a stream.

use std::io;
use std::vec::IntoIter;
use vsf::data::Sequence;
use vsf::pipeline::live::{Received, Sample, Source};

/// Samples of sequences, one after the other.
pub struct Played {
    sequences: IntoIter<Sequence>,
    now: Option<Sequence>,
    row: usize,
    sequence: u64,
    touch: u64,
}

impl Played {
    pub fn new(sequences: &[&Sequence]) -> Self {
        let all: Vec<Sequence> = sequences.iter().map(|s| (*s).clone()).collect();
        Self {
            sequences: all.into_iter(),
            now: None,
            row: 0,
            sequence: 0,
            touch: 0,
        }
    }
}

impl Source for Played {
    fn receive(&mut self, line: &mut Vec<u8>) -> io::Result<Received> {
        loop {
            if let Some(now) = self.now.as_ref().filter(|s| self.row < s.len()) {
                let row = self.row;
                // The first row begins a touch of its own accord.
                self.touch += u64::from(row > 0 && now.touch_starts.binary_search(&row).is_ok());
                let sample = Sample {
                    t: now.time[row],
                    q: now.angles[row].to_vec(),
                    tau: now.torques[row].to_vec(),
                    qd: now.velocities.as_ref().map(|v| v[row].to_vec()),
                    touch: self.touch,
                    sequence: self.sequence,
                };
                line.clear();
                serde_json::to_writer(line, &sample)?;
                self.row += 1;
                return Ok(Received::Line);
            }
            let Some(next) = self.sequences.next() else {
                return Ok(Received::End);
            };
            self.sequence += u64::from(self.now.is_some());
            self.row = 0;
            self.now = Some(next);
        }
    }
}
