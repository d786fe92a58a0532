use std::io::{self, BufRead, ErrorKind, Read};
use std::net::UdpSocket;

/// Longest line that is taken \[bytes\].
pub const MAX_LINE: usize = 64 * 1024;

/// What a [`Source`] has next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Received {
    /// A line, without its end.
    Line,
    /// A line longer than [`MAX_LINE`], which was left out.
    TooLong,
    /// Nothing more.
    End,
}

/// Where lines come from.
pub trait Source {
    /// Waits for the next line and writes it to `line`.
    ///
    /// # Errors
    /// What cannot be read.
    fn receive(&mut self, line: &mut Vec<u8>) -> io::Result<Received>;
}

/// The lines of a file, a pipe or standard input.
#[derive(Debug)]
pub struct Lines<R>(pub R);

impl<R: BufRead> Source for Lines<R> {
    fn receive(&mut self, line: &mut Vec<u8>) -> io::Result<Received> {
        let mut length = 0;
        loop {
            line.clear();
            let mut part = (&mut self.0).take(MAX_LINE as u64 + 1);
            length += part.read_until(b'\n', line)?;
            let ended = line.ends_with(b"\n");
            if ended || line.len() <= MAX_LINE {
                return Ok(match length {
                    0 => Received::End,
                    n if n > MAX_LINE => Received::TooLong,
                    _ => {
                        line.truncate(line.len() - usize::from(ended));
                        Received::Line
                    }
                });
            }
        }
    }
}

/// Datagrams, one line each. An empty one ends the stream, and so does a read that times out
/// ([`UdpSocket::set_read_timeout`]).
#[derive(Debug)]
pub struct Datagrams(pub UdpSocket);

impl Source for Datagrams {
    fn receive(&mut self, line: &mut Vec<u8>) -> io::Result<Received> {
        line.resize(MAX_LINE, 0);
        match self.0.recv(line) {
            Ok(0) => Ok(Received::End),
            Ok(length) => {
                line.truncate(length);
                Ok(Received::Line)
            }
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                Ok(Received::End)
            }
            Err(e) => Err(e),
        }
    }
}
