//! Joint states from CSV files.

use super::joint_log::{Clock, JointLog, Sample, Source};
use crate::DataError;
use crate::csv_log::CsvLog;
use std::path::PathBuf;

impl JointLog {
    /// Reads CSV files, one after the other.
    pub(super) fn read_texts(
        &mut self,
        files: &[PathBuf],
        topic: Option<&str>,
        clock: Clock,
    ) -> Result<Source, DataError> {
        let refused = |what, problem: &str| {
            let problem = problem.to_owned();
            Err(DataError::Argument { what, problem })
        };
        match (topic, clock) {
            (Some(_), _) => return refused("topic", "CSV files have no topics"),
            (_, Clock::Log) => return refused("clock", "CSV files have no times of logging"),
            (None, Clock::Header) => {}
        }
        let columns = files.iter().enumerate().map(|(file, path)| {
            let log = CsvLog::open(path)?;
            let whole = |problem| DataError::Csv {
                path: path.clone(),
                problem,
            };
            let names = self.list(log.columns.names()).map_err(whole)?;
            let (columns, ends) = log.read(|line| {
                let sample = Sample {
                    file,
                    place: line.number,
                    stamp: line.stamp,
                    names,
                    position: line.position,
                    velocity: line.velocity,
                    effort: line.effort,
                };
                self.push(sample).map_err(whole)
            })?;
            if !ends {
                self.open_ended.push(file);
            }
            Ok(columns)
        });
        columns.collect::<Result<_, _>>().map(Source::Csv)
    }
}
