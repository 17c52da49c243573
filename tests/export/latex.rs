//! LaTeX of programs: well formed, and where pdflatex is installed typeset.

use std::fs;
use std::process::Command;

use libtest_mimic::Trial;
use tamis::export::Language;
use tamis::filter::{Filter, shipped};

use crate::every::hostile_names;
use crate::fixture_programs::{SAMPLE, random};
use crate::harness::trial;
use crate::programs::parse;
use crate::text;

pub(crate) const CASES: &[(&str, fn())] = &[
    ("latex::programs_are_well_formed", programs_are_well_formed),
    ("latex::every_stage_has_an_equation", every_stage_has_an_equation),
];

/// The tests that take pdflatex, ignored where it is absent.
pub(crate) fn typeset() -> Vec<Trial> {
    let ignored = Command::new("pdflatex").arg("--version").output().is_err();
    let cases: [(&str, fn()); 2] = [
        ("latex::programs_are_typeset", programs_are_typeset),
        ("latex::the_formula_fits_on_one_page", the_formula_fits_on_one_page),
    ];
    cases.map(|(name, case)| trial(name.to_owned(), ignored, case)).into()
}

fn programs() -> Vec<Filter> {
    let random = (0..24).map(|seed| random(seed, 1 + seed as usize % 12));
    let named = |name| Filter { name, ..parse(SAMPLE) };
    let named = hostile_names().into_iter().map(named);
    let random = random.map(|text| parse(&text)).filter(|filter| filter.paper().is_none());
    shipped::programs().chain(random).chain(named).collect()
}

/// The lines that are no comments.
fn typesetting(text: &str) -> String {
    let lines = text.lines().filter(|line| !line.starts_with('%'));
    lines.map(|line| format!("{line}\n")).collect()
}

/// The commands that amsmath and LaTeX itself define and exports use.
const COMMANDS: &[&str] = &[
    "begin",
    "end",
    "begingroup",
    "endgroup",
    "allowdisplaybreaks",
    "notag",
    "quad",
    "text",
    "mathrm",
    "mathcal",
    "operatorname",
    "left",
    "right",
    "frac",
    "sqrt",
    "sum",
    "cdot",
    "log",
    "sin",
    "cos",
    "tan",
    "arcsin",
    "arccos",
    "arctan",
    "tanh",
    "min",
    "max",
    "lvert",
    "rvert",
    "pi",
    "downarrow",
    "times",
    "hat",
];

fn programs_are_well_formed() {
    for filter in programs() {
        let text = typesetting(&text(&filter, Language::Latex));
        let mut open: Vec<String> = Vec::new();
        let mut rest = text.as_str();
        let close = |open: &mut Vec<String>, expected: String| {
            assert_eq!(open.pop(), Some(expected), "{}: {text}", filter.name);
        };
        while let Some(at) = rest.find(['\\', '{', '}', '&', '$', '#', '~', '%', '_', '^']) {
            let tail = &rest[at..];
            let (mark, after) = tail.split_at(1);
            rest = after;
            match mark {
                "{" => open.push("{".to_owned()),
                "}" => close(&mut open, "{".to_owned()),
                "#" | "%" => panic!("{}: a bare {mark} in {text}", filter.name),
                "\\" => {
                    let word: String =
                        after.chars().take_while(char::is_ascii_alphabetic).collect();
                    rest = &after[word.len().max(1)..];
                    match word.as_str() {
                        "" => assert!(after.starts_with(['\\', '_', ',', '|', ';']), "{after}"),
                        "left" => open.push("left".to_owned()),
                        "right" => close(&mut open, "left".to_owned()),
                        "begin" | "end" => {
                            let name = rest[1..].split('}').next().expect("a name");
                            rest = &rest[name.len() + 2..];
                            match word.as_str() {
                                "begin" => open.push(name.to_owned()),
                                _ => close(&mut open, name.to_owned()),
                            }
                        }
                        word => assert!(COMMANDS.contains(&word), "\\{word} is not known"),
                    }
                }
                _ => {}
            }
        }
        assert!(open.is_empty(), "{}: {open:?}", filter.name);
    }
}

fn every_stage_has_an_equation() {
    for filter in shipped::programs() {
        let text = text(&filter, Language::Latex);
        for stage in &filter.stages {
            let name = stage.name.replace('_', r"\_");
            let found = text.contains(&format!("\\mathrm{{{name}}} = {{}} & "))
                || text.contains(&format!("\\mathrm{{{name}}}^{{\\downarrow}} = {{}} & "));
            assert!(found, "{name}");
        }
        for layer in &filter.constants.layers {
            assert!(text.contains(&format!("\\operatorname{{{}}}(x) = ", layer.name)));
        }
    }
}

/// Has a document typeset. Returns how many pages it has.
fn pages(document: &str) -> usize {
    let folder = tempfile::tempdir().expect("a temporary folder");
    fs::write(folder.path().join("filter.tex"), document).expect("writable");
    let mut command = Command::new("pdflatex");
    command.current_dir(folder.path()).args(["-interaction=nonstopmode", "-halt-on-error"]);
    let output = command.arg("filter.tex").output().expect("pdflatex was there");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}");
    // The log breaks lines.
    let said = said.replace('\n', "");
    let (_, count) = said.split_once("filter.pdf (").expect("it says what it wrote");
    count.split(' ').next().and_then(|count| count.parse().ok()).expect("a number of pages")
}

fn document(export: &str) -> String {
    let head = "\\documentclass{article}\n\\usepackage{amsmath}\n\\begin{document}\n";
    format!("{head}{export}\\end{{document}}\n")
}

fn programs_are_typeset() {
    for filter in programs().into_iter().take(16) {
        assert!(pages(&document(&text(&filter, Language::Latex))) >= 1);
    }
}

/// With the preamble that the first lines recommend.
fn the_formula_fits_on_one_page() {
    let filter = shipped::programs().find(|filter| filter.name == "tamis-formula");
    let text = text(&filter.expect("it is shipped"), Language::Latex);
    let preamble: String = text
        .lines()
        .filter_map(|line| line.strip_prefix("%     "))
        .filter(|line| line.starts_with('\\'))
        .map(|line| format!("{line}\n"))
        .collect();
    assert!(preamble.contains("\\begin{document}"), "{preamble}");
    assert_eq!(pages(&format!("{preamble}{text}\\end{{multicols}}\\end{{document}}\n")), 1);
}
