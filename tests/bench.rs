//! `tamis bench`: a table, figures and a chart that agree, of everybody who takes
//! part.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use serde_json::Value;

/// A run of the program on one scene of the project: a round, small windows.
struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().expect("a temporary folder") }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A program of shell, for what is not installed everywhere.
    #[cfg(unix)]
    fn script(&self, name: &str, text: &str) -> PathBuf {
        use std::os::unix::fs::PermissionsExt;

        let path = self.path(name);
        fs::write(&path, format!("#!/bin/sh\n{text}")).expect("writable");
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).expect("it is ours");
        path
    }

    fn run(&self, arguments: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tamis"));
        command.args(["bench", "--scenes", "data/test/courtyard", "--rounds", "1"]);
        command.args(["--filters", "bilateral", "gaussian"]);
        command.arg("-o").arg(self.path("bench")).args(arguments);
        // Nothing but what the arguments name takes part.
        command.env("PATH", self.folder.path()).stdin(Stdio::null());
        command.output().expect("the program starts")
    }

    /// Runs what must work; returns stdout and stderr.
    fn done(&self, arguments: &[&str]) -> (String, String) {
        let output = self.run(arguments);
        let [out, err] =
            [output.stdout, output.stderr].map(|text| String::from_utf8(text).expect("UTF-8"));
        assert!(output.status.success(), "{arguments:?}: {err}");
        (out, err)
    }

    fn figures(&self) -> Value {
        let text = fs::read_to_string(self.path("bench/bench.json")).expect("it is written");
        serde_json::from_str(&text).expect("JSON")
    }
}

fn text(path: &Path) -> &str {
    path.to_str().expect("temporary folders have names in UTF-8")
}

/// The rows of a table.
fn rows(table: &str) -> Vec<&str> {
    table.lines().skip_while(|line| !line.starts_with("---")).skip(1).collect()
}

#[test]
fn table_figures_and_chart_have_the_same_rows() {
    let bench = Bench::new();
    let (table, _) = bench.done(&["--radii", "1", "2"]);
    // Two filters, two radii, two back ends.
    assert_eq!(rows(&table).len(), 8, "{table}");
    let figures = bench.figures();
    let entries = figures["entries"].as_array().expect("a list");
    assert_eq!(entries.len(), 8);
    for entry in entries {
        let number = |name: &str| entry[name].as_f64().unwrap_or_else(|| panic!("{name}: {entry}"));
        assert!(number("ms_per_megapixel") > 0.0 && number("compile_ms") > 0.0, "{entry}");
        let noisy = figures["scenes"][0]["noisy"]["rel_mse"].as_f64().expect("a number");
        // The other one spreads fireflies.
        assert!(entry["filter"] != "bilateral" || number("rel_mse") < noisy, "{entry}");
        assert!(number("difference_from_f64") < 1e-5, "{entry}");
    }
    // Both back ends give the same bits.
    for pair in entries.chunks_exact(2) {
        assert_ne!(pair[0]["run_by"], pair[1]["run_by"]);
        assert_eq!(pair[0]["rel_mse"], pair[1]["rel_mse"]);
    }
    assert!(entries.iter().any(|entry| entry["on_the_front"] == true));

    let chart = fs::read_to_string(bench.path("bench/pareto.svg")).expect("it is written");
    let chart = roxmltree::Document::parse(&chart).expect("well-formed XML");
    let marks = chart.descendants().filter(|node| node.attribute("class") == Some("mark"));
    assert_eq!(marks.count(), 8);
    let markdown = fs::read_to_string(bench.path("bench/table.md")).expect("it is written");
    assert_eq!(markdown.lines().filter(|line| line.starts_with("| ")).count(), 10);
}

#[test]
fn a_program_that_is_not_there_is_named() {
    for option in ["--oidn", "--cc"] {
        let bench = Bench::new();
        let output = bench.run(&["--radii", "1", option, "no/such/program"]);
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{message}");
        assert!(message.contains(option) && message.contains("no/such/program"), "{message}");
        assert!(!bench.path("bench").exists());
    }
}

/// A program that gives back what it gets is a filter that does nothing.
#[cfg(unix)]
#[test]
fn what_copies_its_input_errs_as_the_noisy_image_does() {
    const COPY: &str = "while [ $# -gt 0 ]; do case $1 in
        --hdr) from=$2;; -o) to=$2;; --help) exit 0;;
        esac; shift; done
        /bin/cat \"$from\" > \"$to\"
        printf 'Initializing filter\\n  filter=RT, msec=8.25\\n'
        printf 'Denoising 0%%\\rDenoising 100%%\\n  msec=12.5, other=1\\n'\n";
    let bench = Bench::new();
    let oidn = bench.script("copy", COPY);
    let (table, _) = bench.done(&["--radii", "1", "--backend", "interp", "--oidn", text(&oidn)]);
    assert!(table.contains("whole process"), "{table}");
    let figures = bench.figures();
    let entries = figures["entries"].as_array().expect("a list");
    let copies = || entries.iter().filter(|entry| entry["run_by"] == "oidn");
    assert_eq!((entries.len(), copies().count()), (6, 4));
    for copy in copies() {
        assert_eq!(copy["rel_mse"], figures["scenes"][0]["noisy"]["rel_mse"]);
        assert!(copy["radius"].is_null() && copy["difference_from_f64"].is_null());
        assert_eq!(copy["compile_ms"], 8.25);
        assert_eq!(copy["scenes"][0]["seconds"], 0.0125);
        assert!(copy["scenes"][0]["process_seconds"].as_f64().expect("a number") > 0.0);
    }
}

/// Who fails has a dash and a remark; the others have their figures.
#[cfg(unix)]
#[test]
fn who_fails_does_not_stop_the_others() {
    let bench = Bench::new();
    let fails = bench.script("oidnDenoise", "echo out of luck >&2\nexit 3\n");
    let silent = bench.script("cc", "exit 0\n");
    let (table, remarks) =
        bench.done(&["--radii", "1", "--backend", "interp", "--cc", text(&silent)]);
    // It was found on the path.
    assert!(remarks.contains(text(&fails)) && remarks.contains("out of luck"), "{remarks}");
    assert!(remarks.contains("C, cc"), "{remarks}");
    let with_dash = rows(&table).iter().filter(|row| row.ends_with(" -")).count();
    assert_eq!((rows(&table).len(), with_dash), (8, 6), "{table}");
    let entries = bench.figures()["entries"].take();
    let failed = entries.as_array().expect("a list").iter().filter(|e| !e["failure"].is_null());
    assert_eq!(failed.count(), 6);
}

/// Exported C in the same table: its results are the interpreter's.
#[cfg(unix)]
#[test]
fn compiled_exports_take_part() {
    let bench = Bench::new();
    // The compiler looks for its own programs.
    let cc = bench.script("compiler", "PATH=/usr/bin:/bin exec cc \"$@\"\n");
    bench.done(&["--radii", "2", "--backend", "interp", "--cc", text(&cc)]);
    let figures = bench.figures();
    let entries = figures["entries"].as_array().expect("a list");
    assert_eq!(entries.len(), 4);
    for pair in entries.chunks_exact(2) {
        assert_eq!(pair[1]["run_by"], "C, compiler");
        assert!(pair[1]["compile_ms"].as_f64().expect("a number") > 0.0);
        let [a, b] = [0, 1].map(|k| pair[k]["rel_mse"].as_f64().expect("a number"));
        assert!((a - b).abs() < 1e-5 * a, "{a} and {b}");
    }
}
