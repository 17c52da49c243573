//! What signals leave behind: nothing.

use std::fs;
use std::io::Write;
use std::os::unix::process::ExitStatusExt;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::place::{EDGE_AWARE, Place};

const DENOISE: [&str; 6] = ["denoise", "-", "-o", "out.exr", "--filter", EDGE_AWARE];

fn temporary(place: &Place) -> Vec<PathBuf> {
    let entries = fs::read_dir(place.path("tmp")).expect("a folder");
    entries.map(|entry| entry.expect("readable").path()).collect()
}

/// A run that waits for the rest of its input, which it keeps in a temporary file.
fn waiting(place: &Place, mut command: Command) -> Child {
    let _ = fs::create_dir(place.path("tmp"));
    let before = temporary(place);
    command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
    let mut child = command.env("TMPDIR", place.path("tmp")).spawn().expect("it starts");
    let input = child.stdin.as_mut().expect("it is piped");
    input.write_all(&place.bytes("room/4spp.exr")).expect("somebody reads");
    let start = Instant::now();
    while temporary(place).iter().all(|path| before.contains(path)) {
        assert!(start.elapsed() < Duration::from_secs(60), "no temporary file appears");
        thread::sleep(Duration::from_millis(10));
    }
    child
}

fn send(signal: &str, child: &Child) {
    let kill = Command::new("kill").args([signal, &child.id().to_string()]).status();
    assert!(kill.expect("there is a kill command").success());
}

/// Whether this process was started to ignore SIGHUP, as its children then do.
fn ignores_hangups() -> bool {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    ignored.is_some_and(|mask| mask & 1 != 0)
}

#[test]
fn a_signal_that_ends_the_program_takes_the_temporary_files() {
    let place = Place::new();
    let mut signals = vec![("-INT", 130), ("-TERM", 143)];
    // Whoever starts the tests with `nohup` wants none of its children to end by it.
    if cfg!(target_os = "linux") && !ignores_hangups() {
        signals.push(("-HUP", 129));
    }
    for (signal, status) in signals {
        let mut child = waiting(&place, place.program(&DENOISE));
        send(signal, &child);
        assert_eq!(child.wait().expect("it ends").code(), Some(status), "{signal}");
        assert!(temporary(&place).is_empty(), "{signal}");
    }
    assert!(!place.path("out.exr").exists());
}

#[cfg(target_os = "linux")]
#[test]
fn the_next_run_removes_what_a_killed_one_left() {
    let place = Place::new();
    let mut killed = waiting(&place, place.program(&DENOISE));
    let working = waiting(&place, place.program(&DENOISE));
    send("-KILL", &killed);
    assert_eq!(killed.wait().expect("it ends").signal(), Some(9));
    assert_eq!(temporary(&place).len(), 2);
    // It finds the one, and leaves that of the run that is at work.
    let mut next = waiting(&place, place.program(&DENOISE));
    let mut left: Vec<String> = temporary(&place)
        .iter()
        .map(|path| path.file_name().expect("a name").to_string_lossy().into_owned())
        .collect();
    left.sort_by_key(|name| !name.contains(&format!("-{}-", working.id())));
    assert_eq!(left.len(), 2, "{left:?}");
    for (name, run) in left.iter().zip([&working, &next]) {
        assert!(name.starts_with(&format!(".tamis-{}-", run.id())), "{left:?}");
    }
    drop(next.stdin.take());
    assert!(next.wait().expect("it ends").success());
    let output = working.wait_with_output().expect("it ends");
    assert!(output.status.success());

    fs::write(place.path(".tamis-4294967295-Xyz123"), "left").expect("writable");
    place.done(&["denoise", "room/4spp.exr", "-o", "out.exr", "--filter", "1"]);
    assert!(!place.path(".tamis-4294967295-Xyz123").exists());
}

/// `nohup` starts programs so.
#[cfg(target_os = "linux")]
#[test]
fn a_signal_that_is_to_be_ignored_is() {
    let place = Place::new();
    let mut command = Command::new("sh");
    command.args(["-c", "trap '' HUP; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_tamis")]);
    command.args(DENOISE).current_dir(place.path(""));
    let child = waiting(&place, command);
    send("-HUP", &child);
    let output = child.wait_with_output().expect("it ends");
    assert!(output.status.success());
    assert!(place.path("out.exr").is_file());
}
