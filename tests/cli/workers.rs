//! Searches whose children other processes judge.

use std::fs;
use std::io::Write;
use std::process::{Output, Stdio};

use crate::place::{NOISY, Place, stderr, write_exr};
use crate::search::programs;

const TAMIS: &str = env!("CARGO_BIN_EXE_tamis");

/// The command of a worker, with more behind it.
fn worker(more: &str) -> String {
    format!("'{TAMIS}' worker {more}")
}

/// The command of a worker whose output goes through another.
#[cfg(unix)]
fn filtered(filter: &str) -> String {
    format!("sh -c \"'{TAMIS}' worker --threads 1 | {filter}\"")
}

/// The command of what says something and then listens to the end.
#[cfg(unix)]
fn saying(line: &str) -> String {
    let quoted = line.replace('"', "\\\"");
    format!("sh -c \"echo '{quoted}'; cat > /dev/null\"")
}

/// A search for programs of a few seconds, with other options than usual.
fn search<'a>(out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let mut arguments = programs(out, &[]);
    for option in more.iter().filter(|word| word.starts_with("--")) {
        if let Some(at) = arguments.iter().position(|word| word == option) {
            arguments.drain(at..at + 2);
        }
    }
    arguments.extend(more);
    arguments
}

/// Everything that a search writes.
fn files(place: &Place, out: &str) -> Vec<(String, Vec<u8>)> {
    let root = place.path(out);
    let named = |path: &std::path::PathBuf| {
        let name = path.strip_prefix(&root).ok()?.to_string_lossy().into_owned();
        Some((name, fs::read(path).expect("readable")))
    };
    let files: Vec<_> = place.files().iter().filter_map(named).collect();
    for name in ["best.toml", "history.csv", "checkpoint.json", "front/front-01.toml"] {
        assert!(files.iter().any(|(file, _)| file == name), "{out}: no {name}");
    }
    files
}

fn assert_same(place: &Place, one: &str, other: &str) {
    let read = |out: &str| {
        let mut files = files(place, out);
        // The page has the command that repeats the search, and its folder.
        let page = files.iter_mut().find(|(name, _)| name == "report.html").expect("a page");
        let text = String::from_utf8(std::mem::take(&mut page.1)).expect("pages are text");
        let repeat = format!("--out {out}");
        assert!(text.contains(&repeat), "{out}: no {repeat}");
        page.1 = text.replace(&repeat, "--out").into_bytes();
        files
    };
    let (one, others) = (read(one), read(other));
    let names = |files: &[(String, Vec<u8>)]| {
        files.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>()
    };
    assert_eq!(names(&one), names(&others), "{other}");
    for ((name, bytes), (_, others)) in one.iter().zip(&others) {
        assert!(bytes == others, "{other}/{name}");
    }
}

/// A search whose children these commands' workers judge.
fn judged_by(place: &Place, out: &str, commands: &[&str], more: &[&str]) -> Output {
    let commands = commands.iter().flat_map(|command| ["--worker-command", command]);
    let more: Vec<&str> = more.iter().copied().chain(commands).collect();
    place.run(&search(out, &more))
}

#[test]
fn a_search_finds_the_same_programs_with_any_number_of_workers() {
    let place = Place::new();
    let more = ["--generations", "3"];
    place.done(&search("alone", &more));
    for count in ["0", "1", "4"] {
        place.done(&search(count, &[&more[..], &["--workers", count]].concat()));
        assert_same(&place, "alone", count);
    }

    // Other machine code, other threads, another folder.
    fs::create_dir(place.path("there")).expect("a writable folder");
    fs::create_dir(place.path("there/room")).expect("a writable folder");
    for file in ["room/4spp.exr", "room/reference.exr"] {
        fs::copy(place.path(file), place.path("there").join(file)).expect("readable");
    }
    let commands = [
        worker("--threads 2 --backend interp"),
        worker("--threads 1 --lanes 128 --scenes there/room"),
    ];
    let commands = commands.each_ref().map(String::as_str);
    let output = judged_by(&place, "commanded", &commands, &more);
    let said = stderr(&output);
    assert!(output.status.success(), "{said}");
    assert!(said.contains("worker 1 (`") && said.contains("is ready, with 2 threads"), "{said}");
    assert_same(&place, "alone", "commanded");

    // What one began others go on with.
    place.done(&search("resumed", &["--generations", "1", "--workers", "2"]));
    let resume = ["evolve", "--out", "resumed", "--resume", "--generations", "3"];
    place.done(&[&resume[..], &["--workers", "3"]].concat());
    assert_same(&place, "alone", "resumed");
}

#[test]
fn workers_whose_pictures_differ_are_refused_by_name() {
    let place = Place::new();
    fs::create_dir_all(place.path("there/room")).expect("a writable folder");
    let mut noisy = NOISY;
    noisy[3].1 = |x, _| if x < 12 { 0.999 } else { 0.0 };
    write_exr(&place.path("there/room/4spp.exr"), &noisy);
    fs::copy(place.path("room/reference.exr"), place.path("there/room/reference.exr"))
        .expect("readable");
    let other = worker("--scenes there/room");
    let more = ["--generations", "1"];
    for (out, command, named) in [
        ("other", other.clone(), "the noisy image of `room` at 4 samples is not the same there"),
        ("none", worker("--scenes nowhere"), "nowhere: no such file or folder"),
        ("extra", worker("--scenes room there"), "the noisy image of `room`"),
    ] {
        let output = judged_by(&place, out, &[&command], &more);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{said}");
        for part in ["worker 1 (`", "refuses", named, "no worker could be employed", "--resume"] {
            assert!(said.contains(part), "no `{part}` in: {said}");
        }
        assert!(!said.contains("panicked"), "{said}");
        // Nothing is lost by that.
        place.done(&["evolve", "--out", out, "--resume"]);
    }
    // Others do the work.
    let output = judged_by(&place, "both", &[&other, &worker("")], &more);
    assert!(output.status.success(), "{}", stderr(&output));
    for out in ["none", "both"] {
        assert_same(&place, "other", out);
    }
}

#[test]
fn scenes_in_another_order_are_refused() {
    let place = Place::new();
    for name in ["a", "b"] {
        fs::create_dir(place.path(name)).expect("a writable folder");
        let mut noisy = NOISY;
        if name == "b" {
            noisy[3].1 = |x, _| if x < 12 { 0.999 } else { 0.0 };
        }
        write_exr(&place.path(&format!("{name}/4spp.exr")), &noisy);
        fs::copy(place.path("room/reference.exr"), place.path(name).join("reference.exr"))
            .expect("readable");
    }
    let run = |order: &str| {
        let command = worker(&format!("--scenes {order}"));
        judged_by(&place, order, &[&command], &["--generations", "0", "--scenes", "a", "b"])
    };
    let (refused, taken) = (run("b a"), run("a b"));
    assert!(stderr(&refused).contains("in another order"), "{}", stderr(&refused));
    assert!(taken.status.success(), "{}", stderr(&taken));
}

#[test]
fn what_makes_no_sense_about_workers_is_refused() {
    let place = Place::new();
    let weights = ["evolve", "--preset", "weights", "--scenes", "room"];
    for option in ["--workers", "--worker-command"] {
        let arguments = [&weights[..], &[option, "2"]].concat();
        place.fails(2, &arguments, &["--worker-command", "programs"]);
    }
    for (more, named) in [
        (["--worker-command", "ssh 'node7", "--workers", "2"], "quotes closed"),
        (["--worker-command", "ssh node7", "--workers", "0"], "--workers 0"),
        (["--worker-command", "ssh node7", "--workers", "1025"], "1024"),
    ] {
        place.fails(2, &search("out", &more), &[named]);
    }

    // Whoever starts one by hand learns what it is for.
    place.done(&["worker"]);
    let mut command = place.program(&["worker"]);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("it starts");
    // As long as that is open, nothing else ends it.
    let mut input = child.stdin.take().expect("it is piped");
    input.write_all(b"help\n").expect("somebody reads");
    let output = child.wait_with_output().expect("it ends");
    assert_eq!(output.status.code(), Some(1));
    let said = stderr(&output);
    assert!(said.contains("`help`") && said.contains("--worker-command"), "{said}");
}

#[cfg(unix)]
#[test]
fn what_is_no_worker_is_given_up_and_told() {
    let place = Place::new();
    let newer = r#"{"hello":{"program":"tamis 9.0.0","protocol":9,"threads":4}}"#;
    let impatient = ["--generations", "0", "--worker-timeout", "1"];
    for (command, named) in [
        (saying("Welcome to node7"), "wrote `Welcome to node7`, which is no message"),
        (saying(newer), "tamis 9.0.0 with protocol 9"),
        ("no-such-launcher node7".to_owned(), "cannot be started"),
        ("false".to_owned(), "ended (exit status: 1) (3 times in a row)"),
        ("sleep 1000".to_owned(), "gave no sign of life for 1 s"),
        ("head -c 100000 /dev/zero".to_owned(), "no message"),
        (filtered("sed -u s/:2}/:3}/"), "computes other results"),
        (filtered("sed -u s/ready/unready/"), "no message"),
    ] {
        let more = [&impatient[..], &["--overwrite"]].concat();
        let output = judged_by(&place, "out", &[&command], &more);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{command}: {said}");
        assert!(said.contains(named), "{command}: no `{named}` in: {said}");
        assert!(said.contains("no worker could be employed"), "{command}: {said}");
        assert!(said.contains("out/checkpoint.json") && !said.contains("panicked"), "{said}");
    }
}

#[cfg(unix)]
#[test]
fn a_search_that_loses_its_last_worker_goes_on_by_itself() {
    let place = Place::new();
    let more = ["--generations", "2"];
    place.done(&search("alone", &more));
    // Two verdicts, and whoever comes next is of another version.
    let newer = r#"{\"hello\":{\"program\":\"tamis 9.0.0\",\"protocol\":9,\"threads\":4}}"#;
    let command = format!(
        "sh -c \"if mkdir once; then '{TAMIS}' worker --threads 1 | sed -u 4q; else echo \
         '{}'; fi\"",
        newer
    );
    let output = judged_by(&place, "deserted", &[&command], &more);
    let said = stderr(&output);
    assert!(output.status.success(), "{said}");
    for part in ["is ready, with 1 thread", "started anew", "9.0.0", "no worker is left"] {
        assert!(said.contains(part), "no `{part}` in: {said}");
    }
    assert_same(&place, "alone", "deserted");
}

#[cfg(unix)]
#[test]
fn what_workers_are_lost_with_again_and_again_is_judged_by_the_search() {
    let place = Place::new();
    let more = ["--generations", "0", "--population", "4"];
    place.done(&search("alone", &more));
    // They end as soon as there is work.
    let command = filtered("sed -u 2q");
    let commands = [&*command; 4];
    let output = judged_by(&place, "spoilt", &commands, &more);
    let said = stderr(&output);
    assert!(output.status.success(), "{said}");
    assert!(said.contains("lost three times with the same work"), "{said}");
    assert_same(&place, "alone", "spoilt");
}

/// Processes as Linux lists them.
#[cfg(target_os = "linux")]
mod processes {
    use std::collections::BTreeSet;
    use std::io::{BufRead, BufReader, Read};
    use std::process::{Child, Command};
    use std::sync::mpsc::{self, Receiver};
    use std::thread;
    use std::time::{Duration, Instant};

    use super::*;

    /// What keeps a test that fails from going on for ever.
    const LONG: Duration = Duration::from_secs(120);

    /// A process's state and parent.
    fn status(process: u32) -> Option<(char, u32)> {
        let stat = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
        // The name, which stands in brackets, may have any characters.
        let mut fields = stat.rsplit_once(") ")?.1.split(' ');
        Some((fields.next()?.chars().next()?, fields.next()?.parse().ok()?))
    }

    /// Whether it runs: one that nobody waited for does not.
    fn runs(process: u32) -> bool {
        status(process).is_some_and(|(state, _)| state != 'Z')
    }

    /// The processes that one started and that run, in their order.
    fn children(parent: u32) -> BTreeSet<u32> {
        let entries = fs::read_dir("/proc").expect("it is Linux").flatten();
        let numbers = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
        let own = |&process: &u32| {
            status(process).is_some_and(|(state, of)| of == parent && state != 'Z')
        };
        numbers.filter(own).collect()
    }

    fn signal(signal: &str, process: u32) -> bool {
        let mut kill = Command::new("kill");
        let status = kill.args([signal, &process.to_string()]).stderr(Stdio::null()).status();
        status.expect("there is a kill command").success()
    }

    fn wait_until(what: &str, mut is_so: impl FnMut() -> bool) {
        let start = Instant::now();
        while !is_so() {
            assert!(start.elapsed() < LONG, "{what}");
            thread::sleep(Duration::from_millis(10));
        }
    }

    /// A search with four workers, and its remarks line by line.
    fn started(place: &Place, arguments: &[&str]) -> (Child, Receiver<String>) {
        let mut command = place.program(arguments);
        let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
        let mut child = child.expect("the program starts");
        let remarks = BufReader::new(child.stderr.take().expect("it is piped"));
        let (sender, receiver) = mpsc::channel();
        thread::spawn(move || {
            remarks.lines().map_while(Result::ok).try_for_each(|line| sender.send(line))
        });
        (child, receiver)
    }

    /// The next remark that has some words in it.
    fn await_remark(remarks: &Receiver<String>, words: &str) {
        let mut said = String::new();
        while !said.lines().next_back().is_some_and(|line| line.contains(words)) {
            let line = remarks.recv_timeout(LONG);
            said += &(line.unwrap_or_else(|_| panic!("no `{words}` in: {said}")) + "\n");
        }
    }

    #[test]
    fn killed_workers_change_nothing() {
        const GENERATIONS: u32 = 12;
        let place = Place::new();
        let generations = GENERATIONS.to_string();
        let more = ["--generations", &generations, "--tune-steps", "16", "--crop", "16"];
        place.done(&search("alone", &more));

        let more = [&more[..], &["--workers", "4"]].concat();
        let (mut child, remarks) = started(&place, &search("killed", &more));
        let search = child.id();
        let generation = || {
            let history = fs::read_to_string(place.path("killed/history.csv")).unwrap_or_default();
            history.lines().count().saturating_sub(1) as u32
        };
        let (mut killed, mut seen, mut latest) = (0, 0, Instant::now());
        let mut random = 5u64;
        while child.try_wait().expect("it can be asked").is_none() {
            // Every second, and once a generation: a fast machine has few seconds.
            let reached = generation();
            if (reached > seen || latest.elapsed() >= Duration::from_secs(1))
                && reached <= GENERATIONS
            {
                let workers: Vec<u32> = children(search).into_iter().collect();
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                let chosen = workers.get((random >> 33) as usize % workers.len().max(1));
                if chosen.is_some_and(|&worker| signal("-KILL", worker)) {
                    killed += 1;
                }
                (seen, latest) = (reached, Instant::now());
            }
            thread::sleep(Duration::from_millis(5));
        }
        assert!(child.wait().expect("it ended").success());
        let said: Vec<String> = remarks.iter().collect();
        let lost = said.iter().filter(|line| line.contains("signal: 9")).count();
        assert!(killed >= 4 && lost >= 3, "{killed} killed, {lost} noticed: {said:#?}");
        assert_same(&place, "alone", "killed");
    }

    /// Workers that judge for hours, and their search.
    fn busy(place: &Place) -> (Child, BTreeSet<u32>) {
        let long = ["--workers", "4", "--tune-steps", "100000"];
        let (child, remarks) = started(place, &search("out", &long));
        (0..4).for_each(|_| await_remark(&remarks, "is ready"));
        let workers = children(child.id());
        assert_eq!(workers.len(), 4, "{workers:?}");
        // They are at it: they take the processor's time by and by.
        let ticks = |worker: u32| -> u64 {
            let stat = fs::read_to_string(format!("/proc/{worker}/stat")).expect("it runs");
            let fields = stat.rsplit_once(") ").expect("its name").1;
            fields.split(' ').nth(11).and_then(|ticks| ticks.parse().ok()).expect("a number")
        };
        for &worker in &workers {
            let begun = ticks(worker);
            wait_until("a worker idles", || ticks(worker) > begun + 2);
        }
        // Somebody has to go on reading.
        thread::spawn(move || remarks.iter().for_each(drop));
        (child, workers)
    }

    #[test]
    fn no_worker_outlives_its_search() {
        for how in ["-INT", "-TERM", "-KILL"] {
            let place = Place::new();
            let (mut child, workers) = busy(&place);
            assert!(signal(how, child.id()));
            let mut text = String::new();
            child.stdout.take().expect("piped").read_to_string(&mut text).expect("UTF-8");
            let ended = child.wait().expect("it ends");
            if how == "-KILL" {
                wait_until("a worker goes on", || !workers.iter().any(|&worker| runs(worker)));
            } else {
                assert!(ended.success() && text.contains("stopped by the user"), "{text}");
                assert!(!workers.iter().any(|&worker| runs(worker)), "{how}");
            }
        }
    }

    #[test]
    fn a_launcher_that_lives_on_is_ended_with_what_it_started() {
        let place = Place::new();
        // It waits for nothing that its worker does, and its child would sleep on.
        let command = format!("sh -c \"'{TAMIS}' worker; sleep 1000 & echo $! > left; wait\"");
        let arguments = ["--generations", "0", "--worker-command", &command];
        let (mut child, remarks) = started(&place, &search("out", &arguments));
        thread::spawn(move || remarks.iter().for_each(drop));
        child.stdout.take().expect("piped").read_to_string(&mut String::new()).expect("UTF-8");
        assert!(child.wait().expect("it ends").success());
        let left = String::from_utf8(place.bytes("left")).expect("UTF-8");
        assert!(!runs(left.trim().parse().expect("a number")));
    }
}
