//! The tapes of kernels as statements of C: one per value, but for linear layers, which become
//! loops over tables.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use crate::export::c::weight::{constant, expression};
use crate::export::names::Names;
use crate::expr::constants::Constants;
use crate::expr::tape::{Input, Instr, Prim, Tape, Value};

/// Tables of fewer numbers than this are not worth a loop.
const SMALLEST: usize = 8;

/// What the kernels of a file share.
pub(super) struct Shared<'a> {
    /// What every name begins with.
    pub(super) prefix: &'a str,
    /// Names at file level.
    pub(super) names: Names,
    constants: &'a Constants,
    /// Named constants by the bits of their value, and what the file calls them.
    params: BTreeMap<u32, String>,
    used: BTreeSet<u32>,
    tables: Vec<Table>,
    /// The functions of bits that are called.
    prims: Vec<Prim>,
}

/// The numbers of a linear layer: rows of weights, and a bias per row.
#[derive(PartialEq)]
struct Table {
    name: String,
    weights: Vec<Vec<f32>>,
    bias: Vec<f32>,
}

/// A tape as statements.
pub(super) struct Statements {
    /// The statements, a line each, without indentation.
    pub(super) lines: Vec<String>,
    /// An expression per result.
    pub(super) results: Vec<String>,
}

/// One component of a layer: where its chain of sums ends, and what it is made of.
struct Row {
    tail: usize,
    weights: Vec<f32>,
    bias: f32,
}

/// Rows that are made of the same values.
struct Block {
    columns: Vec<Value>,
    rows: Vec<Row>,
}

impl<'a> Shared<'a> {
    /// `literals` are the numbers that formulas write out: a constant of the same value has no
    /// name, because nobody could tell which of the two is meant.
    pub(super) fn new(prefix: &'a str, constants: &'a Constants, literals: &[f32]) -> Self {
        let mut names = Names::default();
        let mut params = BTreeMap::new();
        for param in &constants.params {
            let same = |other: &f32| other.abs() == param.value.abs();
            let others = constants.params.iter().filter(|other| same(&other.value)).count();
            if others == 1 && !literals.iter().any(same) {
                let name = names.unique(format!("{prefix}_{}", param.name));
                params.insert(param.value.to_bits(), name);
            }
        }
        let (used, tables, prims) = (BTreeSet::new(), Vec::new(), Vec::new());
        Self { prefix, names, constants, params, used, tables, prims }
    }

    /// A number, by its name if it has one.
    fn number(&mut self, x: f32) -> String {
        match self.params.get(&x.to_bits()) {
            Some(name) => {
                self.used.insert(x.to_bits());
                name.clone()
            }
            None => constant(x),
        }
    }

    /// Writes a tape. `input` names what it reads, and `wanted` what its results should be
    /// called; `local` are the names that the function has already.
    pub(super) fn statements(
        &mut self,
        tape: &Tape,
        local: &mut Names,
        input: impl Fn(Input) -> String,
        wanted: &[String],
    ) -> Statements {
        let blocks = blocks(tape);
        let member: BTreeMap<usize, (usize, usize)> = blocks
            .iter()
            .enumerate()
            .flat_map(|(b, block)| (0..).zip(&block.rows).map(move |(r, row)| (row.tail, (b, r))))
            .collect();
        let mut inner = BTreeSet::new();
        for &tail in member.keys() {
            let mut at = tail;
            while let Some((_, next)) = link(tape, at) {
                at = next.index();
                inner.insert(at);
            }
        }
        let mut called: BTreeMap<usize, &String> = BTreeMap::new();
        for (result, name) in tape.results().iter().zip(wanted) {
            called.entry(result.index()).or_insert(name);
        }

        let mut lines = Vec::new();
        let mut layers: Vec<Option<String>> = blocks.iter().map(|_| None).collect();
        // Constants and inputs stand where they are used.
        let mut texts: Vec<String> = Vec::with_capacity(tape.instrs().len());
        let mut count = 0;
        for (value, instr) in tape.iter() {
            let at = value.index();
            let text = match *instr {
                Instr::Const(bits) => self.number(f32::from_bits(bits)),
                Instr::Input(read) => input(read),
                Instr::Prim(..) if inner.contains(&at) => String::new(),
                Instr::Prim(..) if member.contains_key(&at) => {
                    let (b, row) = member[&at];
                    let layer = layers[b].get_or_insert_with(|| {
                        let columns = blocks[b].columns.iter().map(|x| texts[x.index()].clone());
                        self.layer(&blocks[b], columns.collect(), local, &mut lines)
                    });
                    format!("{layer}[{row}]")
                }
                Instr::Prim(prim, operands) => {
                    self.note(prim);
                    let operand = |k: usize| texts[operands[k].index()].as_str();
                    let value = expression(self.prefix, prim, [0, 1, 2, 3].map(operand));
                    let name = match called.get(&at) {
                        Some(name) => local.unique((*name).clone()),
                        None => {
                            count += 1;
                            local.unique(format!("v{}", count - 1))
                        }
                    };
                    lines.push(format!("const float {name} = {value};"));
                    name
                }
            };
            texts.push(text);
        }
        let results = tape.results().iter().map(|result| texts[result.index()].clone()).collect();
        Statements { lines, results }
    }

    fn note(&mut self, prim: Prim) {
        if !self.prims.contains(&prim) {
            self.prims.push(prim);
        }
    }

    /// The functions of bits that kernels call.
    pub(super) fn calls(&self, prim: Prim) -> bool {
        self.prims.contains(&prim)
    }

    /// Writes a layer as a loop. Returns what the array of its results is called.
    fn layer(
        &mut self,
        block: &Block,
        columns: Vec<String>,
        local: &mut Names,
        lines: &mut Vec<String>,
    ) -> String {
        let weights: Vec<Vec<f32>> = block.rows.iter().map(|row| row.weights.clone()).collect();
        let bias: Vec<f32> = block.rows.iter().map(|row| row.bias).collect();
        let known = self.tables.iter().position(|t| t.weights == weights && t.bias == bias);
        let table = known.unwrap_or_else(|| {
            let holds = |rows: &[Vec<f32>]| weights.iter().all(|row| rows.contains(row));
            let layer = self.constants.layers.iter().find(|layer| holds(&layer.weights));
            let name = layer.map_or("layer", |layer| layer.name.as_str());
            let name = self.names.unique(format!("{}_{name}", self.prefix));
            self.tables.push(Table { name, weights, bias });
            self.tables.len() - 1
        });
        let table = self.tables[table].name.clone();
        let (rows, width) = (block.rows.len(), columns.len());
        let own = &table[self.prefix.len() + 1..];
        let result = local.unique(format!("{own}_out"));
        let given = local.unique(format!("{own}_in"));
        lines.push(format!("float {result}[{rows}];"));
        lines.push(format!("const float {given}[{width}] = {{"));
        let mut line = String::from("   ");
        for column in columns {
            if line.len() + column.len() > 84 {
                lines.push(std::mem::replace(&mut line, String::from("   ")));
            }
            let _ = write!(line, " {column},");
        }
        lines.extend([line, "};".to_owned()]);
        lines.push(format!("for (int row = 0; row < {rows}; ++row) {{"));
        lines.push(format!("    float sum = {table}_bias[row];"));
        lines.push(format!("    for (int column = 0; column < {width}; ++column)"));
        lines.push(format!("        sum = fmaf({table}[row][column], {given}[column], sum);"));
        lines.push(format!("    {result}[row] = sum;"));
        lines.push("}".to_owned());
        result
    }

    /// The constants that kernels name, and the tables of layers.
    pub(super) fn declarations(&self) -> String {
        let mut text = String::new();
        if !self.used.is_empty() {
            text.push_str("\n/* The filter's constants, where their values stand alone. */\n");
        }
        for param in &self.constants.params {
            let bits = param.value.to_bits();
            if let Some(name) = self.params.get(&bits).filter(|_| self.used.contains(&bits)) {
                let _ = writeln!(text, "static const float {name} = {};", constant(param.value));
            }
        }
        for Table { name, weights, bias } in &self.tables {
            let (rows, columns) = (weights.len(), weights[0].len());
            let _ = writeln!(
                text,
                "\n/* A layer: its results are weights times operands, plus a bias each. */\n\
                 static const float {name}[{rows}][{columns}] = {{"
            );
            for row in weights {
                text.push_str("    {");
                for (k, &x) in row.iter().enumerate() {
                    let separator = match k {
                        0 => "",
                        k if k % 6 == 0 => ",\n     ",
                        _ => ", ",
                    };
                    let _ = write!(text, "{separator}{}", constant(x));
                }
                text.push_str("},\n");
            }
            let bias: Vec<String> = bias.iter().map(|&x| constant(x)).collect();
            let bias: Vec<String> = bias.chunks(6).map(|chunk| chunk.join(", ")).collect();
            let bias = bias.join(",\n    ");
            let _ =
                writeln!(text, "}};\nstatic const float {name}_bias[{rows}] = {{\n    {bias}}};");
        }
        text
    }
}

/// If a value is a constant times another value, added to a sum: these two.
fn term(tape: &Tape, at: usize) -> Option<((f32, Value), Value)> {
    let Instr::Prim(Prim::Fma, [a, b, sum, _]) = tape.instrs()[at] else { return None };
    let number = |value: Value| match tape.instr(value) {
        Instr::Const(bits) => Some(f32::from_bits(bits)),
        Instr::Input(_) | Instr::Prim(..) => None,
    };
    match (number(a), number(b)) {
        (Some(weight), None) => Some(((weight, b), sum)),
        (None, Some(weight)) => Some(((weight, a), sum)),
        _ => None,
    }
}

/// The same, if the sum is another such value.
fn link(tape: &Tape, at: usize) -> Option<((f32, Value), Value)> {
    term(tape, at).filter(|(_, sum)| term(tape, sum.index()).is_some())
}

/// The layers of a tape: sums that begin with a constant and go on with constants times the
/// same values. Their sums are nobody else's, so a loop may make them in another order.
fn blocks(tape: &Tape) -> Vec<Block> {
    let mut uses = vec![0usize; tape.instrs().len()];
    // A sum that is another's first part, and nothing else, ends nowhere.
    let mut goes_on = vec![false; tape.instrs().len()];
    for (value, instr) in tape.iter() {
        instr.operands().iter().for_each(|operand| uses[operand.index()] += 1);
        if let Some((_, sum)) = link(tape, value.index()) {
            goes_on[sum.index()] = true;
        }
    }
    tape.results().iter().for_each(|result| uses[result.index()] += 1);
    let mut blocks: Vec<Block> = Vec::new();
    for (value, _) in tape.iter() {
        let tail = value.index();
        let Some(mut last) = term(tape, tail).filter(|_| !goes_on[tail] || uses[tail] > 1) else {
            continue;
        };
        let mut terms = vec![last.0];
        while let Some(next) = term(tape, last.1.index()).filter(|_| uses[last.1.index()] == 1) {
            terms.push(next.0);
            last = next;
        }
        let Instr::Const(bias) = tape.instr(last.1) else { continue };
        terms.reverse();
        let (weights, columns): (Vec<f32>, Vec<Value>) = terms.into_iter().unzip();
        let row = Row { tail, weights, bias: f32::from_bits(bias) };
        match blocks.iter_mut().find(|block| block.columns == columns) {
            Some(block) => block.rows.push(row),
            None => blocks.push(Block { columns, rows: vec![row] }),
        }
    }
    blocks.retain(|block| block.rows.len() * block.columns.len() >= SMALLEST);
    blocks.retain(|block| block.rows.len() > 1 && block.columns.len() > 1);
    blocks
}
