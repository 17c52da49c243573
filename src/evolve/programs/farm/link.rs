//! A worker's process and the pipes to it.

use std::ffi::OsString;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::thread;
use std::time::{Duration, Instant};

/// Most bytes of a line: far more than any verdict has.
const LONGEST: u64 = 1 << 26;

/// How long a worker has to end by itself, and then to end because it is told to: launchers take
/// what they started along.
const GRACE: Duration = Duration::from_millis(500);

/// How to start a worker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Launch {
    /// What messages call it.
    pub name: String,
    /// The program.
    pub program: OsString,
    /// Its arguments.
    pub arguments: Vec<OsString>,
}

/// What happens at a place.
#[derive(Debug)]
pub(super) enum Event {
    /// The process of that number wrote a line.
    Line(u64, String),
    /// Nothing more comes from it.
    Closed(u64),
    /// There may be work, or the end.
    Wake,
}

/// A worker's process.
pub(super) struct Link {
    child: Child,
    input: Option<Sender<Arc<str>>>,
    /// Nobody listens any more.
    deaf: Arc<AtomicBool>,
}

impl Link {
    /// Starts one; what it writes becomes events with its number.
    pub(super) fn start(launch: &Launch, number: u64, events: &Sender<Event>) -> io::Result<Self> {
        let mut command = Command::new(&launch.program);
        command.args(&launch.arguments).stdin(Stdio::piped()).stdout(Stdio::piped());
        // A group of its own: Ctrl-C is the coordinator's to hear, and a launcher is ended with
        // what it started.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn()?;
        let (stdin, stdout) = (child.stdin.take(), child.stdout.take());
        let (input, lines) = mpsc::channel();
        let deaf = Arc::new(AtomicBool::new(false));
        let link = Self { child, input: Some(input), deaf: Arc::clone(&deaf) };
        let started = (|| {
            let stdin = stdin.expect("it is piped");
            let stdout = stdout.expect("it is piped");
            let named = |name: &str| thread::Builder::new().name(name.to_owned());
            named("to worker").spawn(move || write(stdin, &lines))?;
            let events = events.clone();
            named("from worker").spawn(move || read(stdout, number, &events, &deaf))
        })();
        match started {
            Ok(_) => Ok(link),
            Err(error) => {
                link.end();
                Err(error)
            }
        }
    }

    /// Sends a line, some time.
    pub(super) fn send(&self, line: Arc<str>) {
        if let Some(input) = &self.input {
            // That it reads no more is told by the end of its output.
            let _ = input.send(line);
        }
    }

    /// How the process ended, as far as it does so within a moment.
    pub(super) fn ending(&mut self) -> String {
        match self.wait(GRACE) {
            Some(status) => format!("ended ({status})"),
            None => "closed its standard output".to_owned(),
        }
    }

    /// Ends it: closes its input, and sees to it that it goes.
    pub(super) fn end(mut self) {
        self.deaf.store(true, Ordering::Relaxed);
        self.input = None;
        if self.wait(GRACE).is_some() {
            // A launcher may be gone before what it started; that ends with its input.
            return;
        }
        #[cfg(unix)]
        {
            self.signal(rustix::process::Signal::TERM);
            if self.wait(GRACE).is_some() {
                return;
            }
            self.signal(rustix::process::Signal::KILL);
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// Sends a signal to it and all that it started.
    #[cfg(unix)]
    fn signal(&self, signal: rustix::process::Signal) {
        // It was not waited for yet, so that the number is still its own.
        let group = rustix::process::Pid::from_child(&self.child);
        let _ = rustix::process::kill_process_group(group, signal);
    }

    /// Waits for its end, so long at most.
    fn wait(&mut self, limit: Duration) -> Option<std::process::ExitStatus> {
        let start = Instant::now();
        loop {
            match self.child.try_wait() {
                Ok(Some(status)) => return Some(status),
                Ok(None) if start.elapsed() < limit => thread::sleep(Duration::from_millis(5)),
                Ok(None) | Err(_) => return None,
            }
        }
    }
}

/// Writes what is sent. On a thread of its own: a worker that reads nothing must hold up nobody.
fn write(mut stdin: ChildStdin, lines: &Receiver<Arc<str>>) {
    for line in lines {
        if stdin.write_all(line.as_bytes()).and_then(|()| stdin.flush()).is_err() {
            return;
        }
    }
}

/// Reads until there is no more, or nobody listens.
fn read(stdout: ChildStdout, number: u64, events: &Sender<Event>, deaf: &AtomicBool) {
    let mut stdout = BufReader::new(stdout);
    loop {
        let mut line = Vec::new();
        let read = stdout.by_ref().take(LONGEST).read_until(b'\n', &mut line);
        let is_end = !matches!(read, Ok(1..)) || deaf.load(Ordering::Relaxed);
        // Of a line that is cut off, or too long, its reader says that it makes no sense.
        let event = match is_end {
            true => Event::Closed(number),
            false => Event::Line(number, String::from_utf8_lossy(&line).into_owned()),
        };
        if events.send(event).is_err() || is_end {
            return;
        }
    }
}
