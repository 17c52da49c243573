//! The options that have a search's children judged by other processes.

use std::ffi::OsString;
use std::num::NonZeroU32;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use crate::cli::backend::{LanesArgs, Processor};
use crate::cli::error::Error;
use crate::evolve::programs::{Launch, Terms};

/// Most workers of a search: each takes three threads of the coordinator.
const MOST: usize = 1024;

/// Who judges.
#[derive(Debug, Args)]
pub(super) struct WorkersArgs {
    /// Have children judged by N other processes, which are started anew when they are lost;
    /// with --worker-command, N for each command. No result depends on it [default: 0, or 1 with
    /// --worker-command]
    #[arg(long, value_name = "N")]
    workers: Option<usize>,

    /// A command that starts `tamis worker`, here or on another machine, and passes standard
    /// input and output on, such as "ssh node7 tamis worker"; may be given several times.
    /// Without it workers run here and share the threads
    #[arg(long, value_name = "COMMAND")]
    worker_command: Vec<String>,

    /// A worker of which nothing was heard for so many seconds, also while it starts, is lost;
    /// 0 for never
    #[arg(long, value_name = "SECONDS", default_value_t = 600)]
    worker_timeout: u32,
}

impl WorkersArgs {
    /// Whether there are any.
    pub(super) fn are_given(&self) -> bool {
        self.workers.is_some() || !self.worker_command.is_empty()
    }

    /// How to start each worker; nothing if there are to be none.
    ///
    /// # Errors
    /// If that makes no sense.
    pub(super) fn places(
        &self,
        backend: Processor,
        lanes: LanesArgs,
    ) -> Result<Vec<Launch>, Error> {
        match (&*self.worker_command, self.workers) {
            ([], None | Some(0)) => Ok(Vec::new()),
            ([], Some(count)) => local(bounded(count)?, backend, lanes),
            (_, Some(0)) => {
                let text = "--workers 0 starts none; leave --worker-command out".to_owned();
                Err(Error::Usage(text))
            }
            (commands, count) => {
                let each = count.unwrap_or(1);
                bounded(each.saturating_mul(commands.len()))?;
                commanded(commands, each)
            }
        }
    }

    /// On which terms to employ workers at these places, to judge on these scenes.
    pub(super) fn terms(&self, places: Vec<Launch>, scenes: &[PathBuf]) -> Terms {
        // Of a name that is no text, workers say that it is not there.
        let text = |path: &PathBuf| path.to_string_lossy().into_owned();
        let timeout = NonZeroU32::new(self.worker_timeout);
        Terms {
            places,
            scenes: scenes.iter().map(text).collect(),
            timeout: timeout.map(|seconds| Duration::from_secs(seconds.get().into())),
        }
    }
}

fn bounded(count: usize) -> Result<usize, Error> {
    match count > MOST {
        true => Err(Error::Usage(format!("--workers: {count} in all, and at most {MOST} can be"))),
        false => Ok(count),
    }
}

/// Workers on this machine, which share its threads.
fn local(count: usize, backend: Processor, lanes: LanesArgs) -> Result<Vec<Launch>, Error> {
    let program = std::env::current_exe().map_err(|source| Error::NoProgram {
        option: "--workers",
        program: "tamis".to_owned(),
        source,
    })?;
    let threads = rayon::current_num_threads();
    let launch = |k: usize| {
        let share = (threads / count + usize::from(k < threads % count)).max(1);
        let mut arguments = vec!["worker".to_owned(), "--threads".to_owned(), share.to_string()];
        arguments.extend(["--backend".to_owned(), backend.name()]);
        if backend == Processor::Jit {
            arguments.extend(["--lanes".to_owned(), lanes.lanes.name()]);
        }
        Launch {
            name: format!("worker {}", k + 1),
            program: program.clone().into(),
            arguments: arguments.into_iter().map(OsString::from).collect(),
        }
    };
    Ok((0..count).map(launch).collect())
}

/// Workers that commands start, `each` of them so often.
fn commanded(commands: &[String], each: usize) -> Result<Vec<Launch>, Error> {
    let mut places = Vec::new();
    for command in commands {
        let words = shlex::split(command).filter(|words| !words.is_empty()).ok_or_else(|| {
            Error::Usage(format!(
                "--worker-command `{command}`: it must be a command, split into words as a shell \
                 does, with quotes closed"
            ))
        })?;
        for _ in 0..each {
            places.push(Launch {
                name: format!("worker {} (`{command}`)", places.len() + 1),
                program: (&words[0]).into(),
                arguments: words[1..].iter().map(OsString::from).collect(),
            });
        }
    }
    Ok(places)
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::cli::backend::Lanes;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        workers: WorkersArgs,
    }

    fn terms(arguments: &[&str]) -> Result<Terms, String> {
        let line = Line::parse_from([&["tamis"], arguments].concat());
        let lanes = LanesArgs { lanes: Lanes::Auto };
        let places = line.workers.places(Processor::Interp, lanes);
        let places = places.map_err(|error| error.to_string())?;
        Ok(line.workers.terms(places, &["a b".into()]))
    }

    #[test]
    fn commands_are_split_as_a_shell_does_and_started_so_often() {
        let given = ["--worker-command", "ssh n7 'cd \"a b\" && tamis worker'", "--workers", "2"];
        let terms = terms(&[&given[..], &["--worker-command", "tamis worker"]].concat());
        let terms = terms.expect("it makes sense");
        assert_eq!(terms.places.len(), 4);
        assert_eq!(terms.places[1].program, "ssh");
        assert_eq!(terms.places[1].arguments, ["n7", "cd \"a b\" && tamis worker"]);
        assert!(terms.places[1].name.starts_with("worker 2 (`ssh n7"));
        assert_eq!(terms.places[3].arguments, ["worker"]);
        assert_eq!(terms.scenes, ["a b"]);
        assert_eq!(terms.timeout, Some(Duration::from_secs(600)));
    }

    #[test]
    fn none_are_started_unless_asked_for() {
        let count = |arguments: &[&str]| terms(arguments).expect("it makes sense").places.len();
        assert_eq!(count(&[]), 0);
        assert_eq!(count(&["--workers", "0"]), 0);
        assert_eq!(count(&["--worker-command", "x"]), 1);
        let three = terms(&["--workers", "3", "--worker-timeout", "0"]);
        let three = three.expect("it makes sense");
        assert_eq!((three.places.len(), three.timeout), (3, None));
        assert!(three.places.iter().all(|place| place.arguments[0] == "worker"));
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        let refused = |arguments: &[&str]| terms(arguments).expect_err("it makes no sense");
        assert!(refused(&["--worker-command", "ssh 'n7"]).contains("quotes"));
        assert!(refused(&["--worker-command", " "]).contains("a command"));
        assert!(refused(&["--worker-command", "x", "--workers", "0"]).contains("--workers 0"));
        assert!(refused(&["--workers", "1025"]).contains("1024"));
        let many = ["--worker-command", "x", "--worker-command", "y", "--workers", "1000"];
        assert!(refused(&many).contains("2000"));
    }
}
