//! NumPy, for papers and notebooks: a function per stage, written as its formula is.
//!
//! What a filter means, in double precision: no schedule, no tape. Sums, differences and
//! products are left to Python; everything that has a guard in the operator table is a function
//! with that guard. A file holds the functions that it calls.

mod helpers;

use std::collections::BTreeSet;

use askama::Template;

use super::header;
use super::names::Names;
use super::program::{ProgramSubject, facts};
use crate::expr::feature::{Feature, PlaneId, Quantity};
use crate::expr::op::Op;
use crate::expr::symbol::{Place, Symbol, Variadic};
use crate::expr::tape::Side;
use crate::expr::tree::Tree;
use crate::filter::{Gather, Grid, Resolved, Stage, StageKind};
use crate::scene::Facts;

use super::term::Term;
use helpers::HELPERS;

/// Words of the language, and names that the text has for itself.
const TAKEN: &[&str] = &[
    "False", "None", "True", "and", "as", "assert", "async", "await", "break", "class", "continue",
    "def", "del", "elif", "else", "except", "finally", "for", "from", "global", "if", "import",
    "in", "is", "lambda", "nonlocal", "not", "or", "pass", "raise", "return", "try", "while",
    "with", "yield", "np", "abs", "min", "max", "range", "len", "size", "coarse", "exposure", "of",
    "variance", "weight", "i", "j", "offset",
];

#[derive(Template)]
#[template(path = "program.py", escape = "none")]
struct FileTemplate {
    comment: Vec<String>,
    helpers: Vec<&'static str>,
    constants: Vec<(String, String)>,
    stages: Vec<String>,
    name: String,
    arguments: Vec<String>,
    numbers: &'static str,
    /// Whether a stage is of half the resolution.
    is_coarse: bool,
    run: Vec<String>,
    result: String,
}

/// What a text binds: nothing, a product, a sum.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
enum Strength {
    Sum,
    Product,
    Sign,
    Whole,
}

struct Writer<'a> {
    subject: &'a ProgramSubject<'a>,
    facts: Facts,
    names: Names,
    /// By stage.
    stages: Vec<String>,
    /// By stage, what the variance of its mean is called.
    variances: Vec<String>,
    params: Vec<String>,
    layers: Vec<[String; 2]>,
    features: Vec<(Feature, Quantity, String)>,
    helpers: BTreeSet<&'static str>,
    used_params: BTreeSet<usize>,
    used_layers: BTreeSet<usize>,
}

/// The file.
pub(super) fn text(subject: &ProgramSubject<'_>) -> String {
    let filter = subject.checked.filter();
    let mut names = Names::with(TAKEN);
    HELPERS.iter().for_each(|helper| drop(names.unique(helper.name.to_owned())));
    let name = names.unique(subject.identifier.to_ascii_lowercase());
    // The colour is always asked for, as it tells the image's size.
    let mut planes: BTreeSet<PlaneId> = PlaneId::of(Feature::Color, Quantity::Value).collect();
    planes.extend(subject.checked.needs().named().into_iter().flatten());
    let facts = facts(subject.without);
    let present = |plane: &PlaneId| facts.get(*plane) != crate::scene::Fact::Absent;
    let planes: BTreeSet<PlaneId> = planes.into_iter().filter(present).collect();
    let features: Vec<(Feature, Quantity, String)> = Term::of_planes(&planes)
        .into_iter()
        .filter(|term| term.is_image())
        .map(|term| (term.feature, term.quantity, names.unique(term.field())))
        .collect();
    let params = filter.constants.params.iter().map(|param| names.unique(param.name.clone()));
    let params = params.collect();
    let layers = filter.constants.layers.iter().map(|layer| {
        let name = layer.name.to_ascii_uppercase();
        ["WEIGHTS", "BIAS"].map(|part| names.unique(format!("{name}_{part}")))
    });
    let layers = layers.collect();
    let stages = filter.stages.iter().map(|stage| names.unique(stage.name.clone())).collect();
    let variance = |stage: &Stage| names.unique(format!("{}_variance", stage.name));
    let variances = filter.stages.iter().map(variance).collect();
    let mut writer = Writer {
        subject,
        facts,
        names,
        stages,
        variances,
        params,
        layers,
        features,
        helpers: BTreeSet::from(["image", "on"]),
        used_params: BTreeSet::new(),
        used_layers: BTreeSet::new(),
    };
    let (mut functions, mut run) = (Vec::new(), Vec::new());
    for k in 0..filter.stages.len() {
        let (function, lines) = writer.stage(k);
        functions.push(function);
        run.extend(lines);
    }
    let called = |term: Term| writer.feature(term.feature, term.quantity);
    let mut comment = header::program_lines(subject, called);
    comment.push(String::new());
    header::fill(&mut comment, 0, EXACT);
    let numbers = match writer.features.iter().any(|(feature, ..)| feature.row().per_image) {
        true => "numbers for the whole image are numbers, or lists where there are several",
        false => "exposure is a number",
    };
    let template = FileTemplate {
        comment: comment.into_iter().map(|line| line.trim_end().to_owned()).collect(),
        helpers: writer.helpers(),
        constants: writer.constants(),
        stages: functions,
        name,
        arguments: writer.features.iter().map(|(.., name)| name.clone()).collect(),
        numbers,
        is_coarse: filter.stages.iter().any(|stage| stage.grid == Grid::Half),
        run,
        result: writer.stages.last().cloned().unwrap_or_default(),
    };
    let text = template.render().expect("nothing fails that writes into a string");
    let lines: Vec<&str> = text.lines().map(str::trim_end).collect();
    lines.join("\n").trim_start().to_owned() + "\n"
}

/// What the text is, beside what it computes.
const EXACT: &str = "For Python 3 with NumPy, in double precision: what the filter means, and within \
     rounding what Tamis computes in single precision. Written to be read, not to be fast. Sums and \
     products beyond +-1e18, which Tamis limits to that, are left as they are.";

/// Columns of a line.
const LINE: usize = 96;

/// What a value is written as, with what it binds.
type Text = (String, Strength);

impl Writer<'_> {
    fn feature(&self, feature: Feature, quantity: Quantity) -> String {
        let found = self.features.iter().find(|(f, q, _)| (*f, *q) == (feature, quantity));
        found.map_or_else(|| feature.identifier(quantity), |(.., name)| name.clone())
    }

    fn call(&mut self, helper: &'static str) -> &'static str {
        self.helpers.insert(helper);
        helper
    }

    /// The functions that are called, with those that they call.
    fn helpers(&self) -> Vec<&'static str> {
        let mut wanted = self.helpers.clone();
        for helper in HELPERS.iter().rev() {
            if wanted.contains(helper.name) {
                wanted.extend(helper.calls);
            }
        }
        let found = HELPERS.iter().filter(|helper| wanted.contains(helper.name));
        found.map(|helper| helper.text.trim()).collect()
    }

    fn constants(&self) -> Vec<(String, String)> {
        let constants = &self.subject.checked.filter().constants;
        let list = |row: &[f32]| {
            let numbers: Vec<String> = row.iter().map(|x| format!("{x:?}")).collect();
            let lines: Vec<String> = numbers.chunks(8).map(|chunk| chunk.join(", ")).collect();
            format!("[{}]", lines.join(",\n     "))
        };
        let params = self
            .used_params
            .iter()
            .map(|&k| (self.params[k].clone(), format!("{:?}", constants.params[k].value)));
        let layers = self.used_layers.iter().flat_map(|&k| {
            let (layer, [weights, bias]) = (&constants.layers[k], &self.layers[k]);
            let rows: Vec<String> = layer.weights.iter().map(|row| list(row)).collect();
            let matrix = format!("np.array([\n    {},\n])", rows.join(",\n    "));
            [(weights.clone(), matrix), (bias.clone(), format!("np.array({})", list(&layer.bias)))]
        });
        params.chain(layers).collect()
    }

    /// The function of a stage, and the lines that call it.
    fn stage(&mut self, k: usize) -> (String, Vec<String>) {
        let filter = self.subject.checked.filter();
        let stage = &filter.stages[k];
        let own = self.stages[k].clone();
        let function = self.names.unique(format!("compute_{}", stage.name));
        let mut arguments = Vec::new();
        let size = match stage.grid {
            Grid::Full => "size",
            Grid::Half => "coarse",
        };
        let mut doc = vec![match stage.grid {
            Grid::Full => format!("Stage {}.", stage.name),
            Grid::Half => format!("Stage {}, at half resolution.", stage.name),
        }];
        let mut body = Vec::new();
        let mut results = own.clone();
        match &stage.kind {
            StageKind::Map(value) => {
                let value = self.formula(value, k, true, &mut arguments);
                body.push(returned(&value, "    "));
            }
            StageKind::Gather(Gather { of, weight, window, variance }) => {
                let of = self.formula(of, k, true, &mut arguments);
                let variance = variance.as_ref();
                let variance = variance.map(|tree| self.formula(tree, k, true, &mut arguments));
                let weight = self.formula(weight, k, false, &mut arguments);
                let taps = window.diameter();
                doc.push(format!(
                    "The mean over {taps} x {taps} pixels{} by these weights.",
                    match window.dilation {
                        1 => String::new(),
                        dilation => format!(", {dilation} apart,"),
                    }
                ));
                body.push("def weight(j, offset):".to_owned());
                body.push(format!("    {}", returned(&weight, "        ")));
                body.push(String::new());
                let step = stage.grid.step();
                let (radius, apart) = (window.radius, window.dilation);
                let gather = self.call("gather");
                let of = format!("on(size, {of})");
                let (variance, several) = match variance {
                    Some(variance) => (format!("on(size, {variance})"), true),
                    None => ("None".to_owned(), false),
                };
                body.push(format!(
                    "return {gather}({of}, {variance}, weight, {radius}, {apart}, {step})"
                ));
                arguments.push((Leaf::Size, "size".to_owned()));
                if several {
                    results = format!("{own}, {}", self.variances[k]);
                }
            }
        }
        let parameters: Vec<&str> = arguments.iter().map(|(_, name)| name.as_str()).collect();
        let head = wrapped(&format!("def {function}("), &parameters, "):", "");
        let doc = doc.join(" ");
        let mut text = format!("{head}\n    \"\"\"{doc}\"\"\"");
        for line in body {
            text.push_str(&format!("\n    {line}"));
        }
        let given: Vec<String> = arguments
            .iter()
            .map(|(leaf, name)| self.given(*leaf, name, stage.grid, size))
            .collect();
        let given: Vec<&str> = given.iter().map(String::as_str).collect();
        let is_map = matches!(stage.kind, StageKind::Map(_));
        let lines = match is_map {
            true => wrapped(&format!("{results} = on({size}, {function}("), &given, "))", "    "),
            false => wrapped(&format!("{results} = {function}("), &given, ")", "    "),
        };
        (text, lines.lines().map(str::to_owned).collect())
    }

    /// What a stage's function is given for an argument, on its grid.
    fn given(&mut self, leaf: Leaf, name: &str, grid: Grid, size: &str) -> String {
        let own = match leaf {
            Leaf::Size => return size.to_owned(),
            Leaf::Pixel => {
                return format!("{}({size}, {})", self.call("pixels"), grid.step());
            }
            Leaf::Feature => Grid::Full,
            Leaf::Stage(k) => self.subject.checked.filter().stages[k].grid,
        };
        match (own, grid) {
            (Grid::Full, Grid::Half) => format!("{}({name})", self.call("halve")),
            (Grid::Half, Grid::Full) => format!("{}({name}, size)", self.call("double")),
            (Grid::Full, Grid::Full) | (Grid::Half, Grid::Half) => name.to_owned(),
        }
    }

    /// A formula, and in `arguments` what it reads.
    fn formula(
        &mut self,
        tree: &Tree,
        stage: usize,
        map: bool,
        arguments: &mut Vec<(Leaf, String)>,
    ) -> String {
        let places = tree.places(map);
        let mut stack: Vec<Text> = Vec::new();
        for (position, &symbol) in tree.symbols().iter().enumerate() {
            let operands = stack.split_off(stack.len() - symbol.arity());
            let text = match symbol {
                Symbol::Const(literal) => number(literal.value()),
                Symbol::Param(k) => {
                    self.used_params.insert(usize::from(k));
                    (self.params[usize::from(k)].clone(), Strength::Whole)
                }
                Symbol::Offset => ("offset".to_owned(), Strength::Whole),
                Symbol::Variance(feature) => {
                    self.leaf_of(feature, Quantity::Variance, places[position], map, arguments)
                }
                Symbol::Vector(feature) => {
                    self.leaf_of(feature, Quantity::Value, places[position], map, arguments)
                }
                Symbol::Gradient(feature) => {
                    self.leaf_of(feature, Quantity::Gradient, places[position], map, arguments)
                }
                Symbol::Stage(signal) => {
                    let k = usize::from(signal.stage);
                    debug_assert!(k < stage, "formulas read earlier stages");
                    let name = match signal.variance {
                        true => self.variances[k].clone(),
                        false => self.stages[k].clone(),
                    };
                    self.placed(Leaf::Stage(k), name, places[position], map, arguments)
                }
                Symbol::Op(op) => self.operator(op, operands),
                // The leaves below carry the place.
                Symbol::At(_) => operands.into_iter().next().expect("one operand"),
                Symbol::Part(k) => {
                    let part = self.call("part");
                    (format!("{part}({}, {k})", operands[0].0), Strength::Whole)
                }
                Symbol::Many(function, _) => {
                    let name = self.call(match function {
                        Variadic::Join => "join",
                        Variadic::Median => "median",
                        Variadic::Clamp => "clamp",
                        Variadic::Mean => "mean",
                        Variadic::Luminance => "luminance",
                    });
                    called(name, &operands)
                }
                Symbol::Linear(layer) => {
                    let k = usize::from(layer.layer);
                    self.used_layers.insert(k);
                    let linear = self.call("linear");
                    let [weights, bias] = &self.layers[k];
                    let text = format!("{linear}({weights}, {bias}, {})", operands[0].0);
                    (text, Strength::Whole)
                }
            };
            stack.push(text);
        }
        stack.pop().expect("a tree has a root").0
    }

    fn leaf_of(
        &mut self,
        feature: Feature,
        quantity: Quantity,
        place: Place,
        map: bool,
        arguments: &mut Vec<(Leaf, String)>,
    ) -> Text {
        let plane = PlaneId { feature, quantity, component: 0 };
        if (feature, quantity) == (Feature::Pixel, Quantity::Value) {
            return self.placed(Leaf::Pixel, "pixel".to_owned(), place, map, arguments);
        }
        match self.subject.checked.resolve(plane, &self.facts) {
            Some(Resolved::Constant(x)) => {
                let (same, width) = (self.call("same"), PlaneId::components(feature, quantity));
                (format!("{same}({}, {width})", number(x).0), Strength::Whole)
            }
            Some(Resolved::Plane(plane)) => {
                let name = self.feature(plane.feature, quantity);
                self.placed(Leaf::Feature, name, place, map, arguments)
            }
            None => unreachable!("the schedule refuses filters whose features are absent"),
        }
    }

    /// An argument, at a place.
    fn placed(
        &mut self,
        leaf: Leaf,
        name: String,
        place: Place,
        map: bool,
        arguments: &mut Vec<(Leaf, String)>,
    ) -> Text {
        if !arguments.iter().any(|(_, known)| *known == name) {
            arguments.push((leaf, name.clone()));
        }
        let text = match place {
            Place::Side(Side::J) if !map => format!("j({name})"),
            Place::Side(_) | Place::Shift(0, 0) => name,
            Place::Shift(dx, dy) => format!("{}({name}, {dx}, {dy})", self.call("at")),
        };
        (text, Strength::Whole)
    }

    fn operator(&mut self, op: Op, operands: Vec<Text>) -> Text {
        let infix = |strength: Strength| {
            let [(a, left), (b, right)] = operands.as_slice() else { unreachable!("of two") };
            let a = if *left < strength { format!("({a})") } else { a.clone() };
            let b = if *right <= strength { format!("({b})") } else { b.clone() };
            (format!("{a} {} {b}", op.name()), strength)
        };
        match op {
            Op::Add | Op::Sub => infix(Strength::Sum),
            Op::Mul => infix(Strength::Product),
            Op::Neg => {
                let (x, strength) = &operands[0];
                let x = if *strength < Strength::Whole { format!("({x})") } else { x.clone() };
                (format!("-{x}"), Strength::Sign)
            }
            _ => {
                let name = self.call(helpers::of(op).expect("a test looks every operator up"));
                called(name, &operands)
            }
        }
    }
}

/// What an argument is.
#[derive(Clone, Copy, PartialEq)]
enum Leaf {
    Feature,
    Pixel,
    Stage(usize),
    Size,
}

fn called(name: &str, operands: &[Text]) -> Text {
    let operands: Vec<&str> = operands.iter().map(|(text, _)| text.as_str()).collect();
    (format!("{name}({})", operands.join(", ")), Strength::Whole)
}

fn number(x: f32) -> Text {
    let strength = if x.is_sign_negative() { Strength::Sign } else { Strength::Whole };
    (format!("{x:?}"), strength)
}

/// What a function returns, on several lines where one is too long: within parentheses, lines
/// may end between any two words.
fn returned(value: &str, indent: &str) -> String {
    let line = format!("return {value}");
    if line.len() + indent.len() <= LINE {
        return line;
    }
    let mut text = "return (".to_owned();
    let mut column = usize::MAX;
    for word in value.split(' ') {
        match column.saturating_add(1 + word.len()) <= LINE {
            true => text.push(' '),
            false => {
                text.push_str(&format!("\n{indent}    "));
                column = indent.len() + 4;
            }
        }
        text.push_str(word);
        column += 1 + word.len();
    }
    format!("{text}\n{indent})")
}

/// A call, on several lines where one is too long.
fn wrapped(head: &str, items: &[&str], tail: &str, indent: &str) -> String {
    let line = format!("{head}{}{tail}", items.join(", "));
    if line.len() <= LINE {
        return line;
    }
    let mut text = head.to_owned();
    for item in items {
        text.push_str(&format!("\n{indent}    {item},"));
    }
    format!("{text}\n{indent}{tail}")
}
