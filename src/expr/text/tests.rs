use std::f32::consts;
use std::thread;

use proptest::prelude::*;

use super::*;
use crate::expr::feature::Feature;
use crate::expr::op::Op;
use crate::expr::symbol::Symbol;

fn tree(text: &str) -> Tree {
    text.parse().unwrap_or_else(|error| panic!("{error}"))
}

fn complaint(text: &str) -> String {
    text.parse::<Tree>().expect_err("the text is wrong").to_string()
}

/// What is said about each of the texts.
fn complaints(texts: &[&str]) -> String {
    texts.iter().map(|text| complaint(text) + "\n\n").collect()
}

fn round_trips(tree: &Tree) {
    let text = tree.to_string();
    assert_eq!(text.parse().as_ref(), Ok(tree), "{text}");
}

/// Literals whose text or bits are easily lost.
const LITERALS: [f32; 14] = [
    0.0,
    -0.0,
    1.0,
    -2.0,
    0.1,
    0.3333,
    consts::PI,
    -consts::PI,
    1e7,
    -1e-4,
    1.234_567_9e-30,
    f32::MIN_POSITIVE,
    1e-45,
    f32::MAX,
];

/// Any tree, of any operators on any leaves, so also ones that no search makes.
fn any_tree() -> impl Strategy<Value = Tree> {
    let symbols = |sort| -> Vec<Symbol> {
        let terms = Feature::terms().filter_map(|(f, q)| Symbol::of(f, q));
        terms.filter(|symbol| symbol.sort() == sort).collect()
    };
    let leaf = |symbol| Tree::leaf(symbol).expect("a leaf is well-formed");
    let vectors = prop::sample::select(symbols(Sort::Vector)).prop_map(leaf);
    let literal = prop_oneof![
        any::<u32>().prop_map(|bits| Symbol::constant(f32::from_bits(bits))),
        prop::sample::select(LITERALS.as_slice()).prop_map(Symbol::constant),
    ];
    let scalars = prop_oneof![literal, prop::sample::select(symbols(Sort::Scalar))].prop_map(leaf);
    scalars.prop_recursive(24, 96, 2, move |inner| {
        let op = prop::sample::select(Op::ALL);
        (op, inner.clone(), inner, vectors.clone(), vectors.clone()).prop_map(|(op, x, y, a, b)| {
            let operands: Vec<&Tree> = op
                .operands()
                .iter()
                .zip([(&x, &a), (&y, &b)])
                .map(|(sort, (scalar, vector))| match sort {
                    Sort::Scalar => scalar,
                    Sort::Vector => vector,
                })
                .collect();
            Tree::apply(op, &operands).expect("operands of the operator's sorts")
        })
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]

    #[test]
    fn every_tree_round_trips(tree in any_tree()) {
        let text = tree.to_string();
        prop_assert_eq!(text.parse(), Ok(tree), "{}", text);
    }

    #[test]
    fn no_text_makes_the_parser_panic(text in "([-+*/(),.#^ \n]|[0-9]|pi|sin|pow|dot|normal|dVariance|e|π|\\PC){0,24}") {
        if let Err(error) = text.parse::<Tree>() {
            prop_assert!(error.to_string().contains('^'));
        }
    }
}

#[test]
fn every_operator_and_every_term_round_trips() {
    let number = Tree::constant(0.25);
    for (feature, quantity) in Feature::terms() {
        let symbol = Symbol::of(feature, quantity).expect("terms() lists what has a spelling");
        round_trips(&Tree::leaf(symbol).expect("a leaf is well-formed"));
    }
    let normal = tree("normal");
    for &op in Op::ALL {
        let operand = match op.operands()[0] {
            Sort::Scalar => &number,
            Sort::Vector => &normal,
        };
        round_trips(&Tree::apply(op, &vec![operand; op.arity()]).expect("operands fit"));
    }
    for literal in LITERALS {
        round_trips(&Tree::constant(literal));
    }
}

#[test]
fn parentheses_stand_only_where_they_matter() {
    for text in [
        "1 - 2 - 3",
        "1 - (2 - 3)",
        "1 - (2 + 3)",
        "1 / (2 * 3) * 4",
        "(1 + 2) * -(3 + 4)",
        "1 + 2 * 3 - 4 / 5",
        "-distance2(normal, nGradient) / 0.05",
        "-(dVariance / 2)",
        "--dVariance - -sin(pi)",
        "pow(1 + 2, -(3))",
        "1 - -2",
    ] {
        assert_eq!(tree(text).to_string(), text);
    }
    assert_eq!(tree("((1)) + ((2 * (3)))").to_string(), "1 + 2 * 3");
    assert_eq!(tree("dot((normal), ((depth)))").to_string(), "dot(normal, depth)");
}

#[test]
fn a_minus_before_a_number_is_the_numbers_own() {
    let negated = |x| Tree::apply(Op::Neg, &[&Tree::constant(x)]).expect("operands fit");
    assert_eq!(tree("-2"), Tree::constant(-2.0));
    assert_eq!(tree("- 2"), Tree::constant(-2.0));
    assert_eq!(tree("-(2)"), negated(2.0));
    assert_eq!(tree("--2"), negated(-2.0));
    assert_eq!(tree("-pi").to_string(), "-pi");
    assert_eq!(negated(consts::PI).to_string(), "-(pi)");
    assert_eq!(tree("3 -2").to_string(), "3 - 2");
}

#[test]
fn numbers_are_short_and_keep_their_bits() {
    for (x, text) in [
        (0.1, "0.1"),
        (1e6, "1000000"),
        (1e18, "1e18"),
        (-0.000_05, "-5e-5"),
        (consts::PI, "pi"),
        (-0.0, "-0"),
    ] {
        assert_eq!(Tree::constant(x).to_string(), text);
    }
    for (text, x) in
        [(".5", 0.5), ("2.", 2.0), ("1E+3", 1e3), ("0e999", 0.0), ("3.14159274", consts::PI)]
    {
        assert_eq!(tree(text), Tree::constant(x), "{text}");
    }
}

#[test]
fn layout_and_comments_are_free() {
    let text = "# by hand\nexp( # e\n\t- distance2(normal,normal)/0.1)#end";
    assert_eq!(tree(text).to_string(), "exp(-distance2(normal, normal) / 0.1)");
}

#[test]
fn a_weight_must_be_a_number() {
    assert!("normal".parse::<Tree>().is_ok());
    insta::assert_snapshot!(parse_scalar("(normal)").expect_err("a vector"), @r"
    line 1, column 2: the expression needs a number, but `normal` is a vector
      | (normal)
      |  ^
      = `distance2(normal, normal)` is a number, and so is `nVariance`
    ");
}

#[test]
fn complaints_show_the_place_and_what_was_expected() {
    insta::assert_snapshot!(complaints(&[
        "exp(1) *\n  sin(2 + * 3)\n  + 1",
        "pow(2",
        "pow(2)",
        "sin(2, 3)",
        "2 3",
        "sin 3",
        "2 + 3)",
        "",
        "2 ^ 3",
        "1e40",
        "1e-60",
        "dot(normal 2",
    ]));
}

#[test]
fn misspelt_names_get_a_suggestion() {
    insta::assert_snapshot!(complaints(&[
        "distance2(wordPosition, normal)",
        "Distanc2(normal, normal)",
        "gauss(2)",
        "roughness",
    ]));
}

#[test]
fn a_vector_is_no_number_and_a_number_no_vector() {
    insta::assert_snapshot!(complaints(&[
        "2 * nGradient",
        "sin(pixel)",
        "dot(normal + 1, normal)",
        "dot(nVariance, normal)",
        "dot(normal, sqrt(2))",
        "dot(normal, -normal)",
    ]));
}

#[test]
fn nesting_is_no_danger_to_a_small_stack() {
    const DEPTH: usize = 100_000;
    let deep = || {
        for (open, inner, close) in
            [("(", "1", ")"), ("-", "dVariance", ""), ("1 - (", "2", ")"), ("pow(2, ", "3", ")")]
        {
            let text = format!("{}{inner}{}", open.repeat(DEPTH), close.repeat(DEPTH));
            round_trips(&tree(&text));
            latex(&tree(&text));
        }
        let error = complaint(&"(".repeat(DEPTH));
        assert!(error.starts_with("line 1, column 100001: expected an expression"), "{error}");
        let error = complaint(&format!("{}1", "sin(".repeat(DEPTH)));
        assert!(error.contains("never closed") && error.len() < 400, "{error}");
    };
    let thread = thread::Builder::new().stack_size(256 << 10).spawn(deep);
    thread.expect("a thread starts").join().expect("nothing panics");
}

#[test]
fn latex_follows_the_patterns() {
    for (text, expected) in [
        (
            "exp(-distanceMax(normal, texture) / 0.05)",
            r"e^{\frac{-\|\mathrm{normal}_i - \mathrm{texture}_j\|_{\max}}{0.05}}",
        ),
        ("pow(distance2(pixel, pixel), 2)", r"{\|\mathrm{pixel}_i - \mathrm{pixel}_j\|_{L2}}^{2}"),
        ("pow(1 + 2, 3)", r"{\left(1 + 2\right)}^{3}"),
        ("1 - (2 - 3)", r"1 - \left(2 - 3\right)"),
        ("sin(2 * pi) * 1e-7", r"\sin \left(2 \cdot \pi\right) \cdot 1 \cdot 10^{-7}"),
        (
            "-(dVariance + 2) * --3",
            r"-\left(\mathrm{dVariance} + 2\right) \cdot \left(-\left(-3\right)\right)",
        ),
        ("sinc(1 + 2)", r"\operatorname{sinc}(1 + 2)"),
    ] {
        assert_eq!(latex(&tree(text)), expected);
    }
}

#[test]
fn a_product_falls_into_its_factors_however_it_is_nested() {
    for (text, expected) in [
        ("2", &["2"] as &[&str]),
        ("1 + 2 * 3", &[r"1 + 2 \cdot 3"]),
        (
            "(1 + 2) * 3 * (4 - 5) / 6",
            &[r"\frac{\left(1 + 2\right) \cdot 3 \cdot \left(4 - 5\right)}{6}"],
        ),
        (
            "(1 + 2) * (3 * -(4)) * -5",
            &[r"\left(1 + 2\right)", "3", r"\left(-4\right)", r"\left(-5\right)"],
        ),
        (
            "-(1) * 2 * dot(normal, normal)",
            &["-1", "2", r"\left(\mathrm{normal}_i \cdot \mathrm{normal}_j\right)"],
        ),
    ] {
        assert_eq!(latex_factors(&tree(text)), expected, "{text}");
    }
}
