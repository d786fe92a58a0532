use std::io::{self, BufRead, ErrorKind, Read};
use std::net::UdpSocket;
use std::time::{Duration, Instant};

/// Longest line that is accepted \[bytes\].
pub const MAX_LINE: usize = 64 * 1024;

/// What a [`Source`] received.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Received {
    /// A line, without its line end.
    Line,
    /// A line longer than [`MAX_LINE`], which was skipped.
    TooLong,
    /// Nothing yet. Returned so that the caller can end the stream.
    Nothing,
    /// The end of the stream.
    End,
}

/// A source of lines.
pub trait Source {
    /// Waits for the next line and writes it to `line`.
    ///
    /// # Errors
    /// An input that cannot be read.
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
                    n if n - usize::from(ended) > MAX_LINE => Received::TooLong,
                    _ => {
                        line.truncate(line.len() - usize::from(ended));
                        Received::Line
                    }
                });
            }
        }
    }
}

/// Datagrams with one line each. An empty datagram ends the stream.
#[derive(Debug)]
pub struct Datagrams {
    socket: UdpSocket,
    idle: Option<Duration>,
    /// When the last one came.
    last: Instant,
}

impl Datagrams {
    /// So long a read waits.
    const POLL: Duration = Duration::from_millis(100);

    /// Receives the datagrams of a socket. A silence of `idle` ends the stream, too.
    ///
    /// # Errors
    /// A socket that does not allow a read timeout.
    pub fn new(socket: UdpSocket, idle: Option<Duration>) -> io::Result<Self> {
        socket.set_read_timeout(Some(Self::POLL))?;
        Ok(Self {
            socket,
            idle,
            last: Instant::now(),
        })
    }
}

impl Source for Datagrams {
    fn receive(&mut self, line: &mut Vec<u8>) -> io::Result<Received> {
        line.resize(MAX_LINE, 0);
        let received = loop {
            match self.socket.recv(line) {
                // A process that was stopped and goes on is interrupted.
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                received => break received,
            }
        };
        match received {
            Ok(0) => Ok(Received::End),
            Ok(length) => {
                line.truncate(length);
                self.last = Instant::now();
                Ok(Received::Line)
            }
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                let is_over = self.idle.is_some_and(|idle| self.last.elapsed() >= idle);
                Ok(if is_over {
                    Received::End
                } else {
                    Received::Nothing
                })
            }
            Err(e) => Err(e),
        }
    }
}
