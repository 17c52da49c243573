//! What holds of exports in every language.

use tamis::export::{ExportError, Language, Options, Shading, export};
use tamis::expr::{Feature, PlaneId, Quantity};
use tamis::filter::Filter;
use tamis::plan::Precision;

use crate::fixture::parse;
use crate::{bytes, known, text};

pub(crate) const CASES: &[(&str, fn())] = &[
    ("every::named_filters_are_written_as_they_were", named_filters_are_written_as_they_were),
    ("every::names_reach_comments_alone", names_reach_comments_alone),
    ("every::what_makes_no_sense_is_refused", what_makes_no_sense_is_refused),
    ("every::only_code_is_less_than_exact", only_code),
    ("every::every_term_is_explained", every_term_is_explained),
    #[cfg(not(feature = "gpu"))]
    ("every::shading_languages_want_the_feature", shading_languages_want_the_feature),
];

/// The languages that this build writes.
fn languages() -> impl Iterator<Item = Language> {
    Language::ALL.into_iter().filter(|language| match language {
        Language::C | Language::Latex | Language::Python => true,
        Language::Shading(_) => cfg!(feature = "gpu"),
    })
}

/// What filters may be called.
pub(crate) fn hostile_names() -> Vec<String> {
    let names = [
        "",
        "1",
        "2017 filter",
        "int",
        "main",
        "weight",
        "NAME",
        "STEP",
        "_",
        "__x",
        "a-b",
        "*/ #error out",
        "/* in",
        "/*/",
        "// twice",
        "a\n#error line\n",
        "a\r#error line\r\n",
        "\\",
        "what??/",
        "??/ b",
        "\\\n*/ #error",
        "é/日本語",
        "\u{202e}bidi",
        "\u{0}\u{7}\u{b}\u{c}\u{85}\u{2028}\u{2029} #error",
        "%d \"quoted\" 'x'",
        "}; #endif",
        "$\\end{document}%",
        "{{ name }} @group(0)",
    ];
    names.map(str::to_owned).into_iter().chain(["long ".repeat(2000)]).collect()
}

/// Lines, as the language that knows the most ends of them counts them.
fn lines(text: &str) -> impl Iterator<Item = &str> {
    text.split(['\n', '\r', '\u{b}', '\u{c}', '\u{85}', '\u{2028}', '\u{2029}'])
}

fn names_reach_comments_alone() {
    let filter = |name: &str| Filter::single(name, parse("exp(-distance2(normal, normal))"), 2);
    for language in languages() {
        let comment = match language {
            // Its comments are of another kind, and names are a part of the code.
            Language::C | Language::Python | Language::Shading(Shading::Spirv) => continue,
            Language::Latex => "%",
            Language::Shading(_) => "//",
        };
        let code = |name: &str| {
            let text = text(&filter(name), language);
            let (comments, code): (Vec<&str>, Vec<&str>) =
                lines(&text).partition(|line| line.trim_start().starts_with(comment));
            // In many languages such a line goes on.
            let goes_on = |line: &&str| line.ends_with('\\') || line.ends_with("??/");
            assert!(!comments.iter().any(goes_on), "{name:?}: {text}");
            code.join("\n")
        };
        let plain = code("plain");
        for name in hostile_names() {
            assert_eq!(code(&name), plain, "{name:?} in {}", language.name());
        }
    }
}

fn what_makes_no_sense_is_refused() {
    let mut filter = Filter::single("wide", parse("1"), 2);
    filter.gathers_mut().next().expect("one gather").window.radius = 1000;
    let refused = export(&filter, Language::C, &Options::default());
    assert!(matches!(refused, Err(ExportError::Plan { .. })));
    // A program whose last stage is no colour.
    filter = Filter::single("twice", parse("1"), 2);
    filter.stages.push(filter.stages[0].clone());
    let refused = export(&filter, Language::C, &Options::default());
    assert!(matches!(refused, Err(ExportError::Filter { .. })));
}

fn only_code() {
    let filter = Filter::single("fast", parse("exp(-distance2(normal, normal))"), 2);
    for language in languages() {
        let fast = Options { precision: Precision::Fast, without: &[] };
        let result = export(&filter, language, &fast);
        match language {
            Language::Latex | Language::Python => {
                let error = result.expect_err("there is nothing to choose");
                assert_eq!(error, ExportError::AlwaysExact { language: language.name() });
            }
            Language::C | Language::Shading(_) => {
                assert_ne!(result, export(&filter, language, &Options::default()));
            }
        }
    }
}

fn every_term_is_explained() {
    for (feature, quantity) in Feature::terms() {
        let term = feature.spelling(quantity).expect("a term");
        let weight = match quantity {
            Quantity::Variance => term.to_owned(),
            Quantity::Value | Quantity::Gradient => format!("dot({term}, {term})"),
        };
        let filter = Filter::single(term, parse(&weight), 2);
        for language in languages() {
            // A binary has it too, as its source.
            let export = bytes(&filter, language, Precision::Standard);
            let export = String::from_utf8_lossy(&export);
            let called = match language {
                Language::C | Language::Python => vec![feature.identifier(quantity)],
                Language::Latex => vec![term.to_owned()],
                Language::Shading(_) => {
                    PlaneId::of(feature, quantity).map(PlaneId::identifier).collect()
                }
            };
            let words: Vec<&str> =
                export.split(|c: char| !c.is_alphanumeric() && c != '_').collect();
            for called in called {
                assert!(words.contains(&called.as_str()), "no {called} in: {export}");
            }
            let doc = feature.row().doc.split_whitespace().next().expect("there is a doc");
            assert!(export.to_lowercase().contains(doc), "no {doc} in: {export}");
        }
    }
}

#[cfg(not(feature = "gpu"))]
fn shading_languages_want_the_feature() {
    for language in Language::ALL {
        let result = export(&known()[0], language, &Options::default());
        match language {
            Language::C | Language::Latex | Language::Python => assert!(result.is_ok()),
            Language::Shading(_) => {
                let error = result.expect_err("this build has no shading languages");
                assert_eq!(error, ExportError::WithoutGpu { language: language.name() });
            }
        }
    }
}

fn named_filters_are_written_as_they_were() {
    for filter in known() {
        for language in languages() {
            let is_kept = match language {
                Language::Latex | Language::Shading(Shading::Wgsl) => {
                    !filter.name.starts_with("tamis")
                }
                Language::C
                | Language::Python
                | Language::Shading(Shading::Glsl | Shading::Hlsl | Shading::Msl) => {
                    filter.name == "bilateral"
                }
                Language::Shading(Shading::Spirv) => false,
            };
            if is_kept {
                let name = format!("{}.{}", filter.name, language.name());
                let mut settings = insta::Settings::clone_current();
                settings.set_snapshot_path("../snapshots");
                settings.set_prepend_module_to_snapshot(false);
                settings.set_omit_expression(true);
                settings.bind(|| insta::assert_snapshot!(name, text(&filter, language)));
            }
        }
    }
}
