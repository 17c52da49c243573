//! What the names in a formula stand for.

use super::{OFFSET, VARIANCE};
use crate::expr::constants::Constants;
use crate::expr::feature::{Feature, Quantity};
use crate::expr::op::Op;
use crate::expr::symbol::{LayerRef, StageSignal, Symbol, Variadic};

/// What a formula may look at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reads {
    /// What the paper's weights do: features, at the pixel that each operand means.
    Paper,
    /// A pair of pixels.
    Pair,
    /// A pixel and others at constant offsets from it.
    Pixel,
}

/// An earlier stage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Declared {
    /// Its name.
    pub name: String,
    /// Components of its value.
    pub width: u16,
    /// Whether it has a variance.
    pub variance: bool,
}

/// The names that a formula may use beside features and functions.
#[derive(Clone, Copy, Debug)]
pub struct Scope<'a> {
    /// What the formula may look at.
    pub reads: Reads,
    /// The stages before the formula's own.
    pub stages: &'a [Declared],
    /// The names of its own stage and of those after it, which it cannot read.
    pub later: &'a [String],
    /// The program's constants.
    pub constants: Option<&'a Constants>,
}

impl Scope<'_> {
    /// No names at all.
    pub const PAPER: Self = Self { reads: Reads::Paper, stages: &[], later: &[], constants: None };

    /// What a name stands for; features and functions come before everything else.
    pub(super) fn symbol(&self, name: &str) -> Option<Symbol> {
        if name == OFFSET && self.reads == Reads::Pair {
            return Some(Symbol::Offset);
        }
        if let Some((feature, quantity)) = Feature::parse(name) {
            return Symbol::of(feature, quantity);
        }
        let (stage, variance) = match name.strip_suffix(VARIANCE) {
            Some(stage) => (stage, true),
            None => (name, false),
        };
        let found = self.stages.iter().position(|declared| declared.name == stage);
        if let Some(k) = found
            && (self.stages[k].variance || !variance)
        {
            let (stage, width) = (k as u16, self.stages[k].width);
            return Some(Symbol::Stage(StageSignal { stage, width, variance }));
        }
        let params = &self.constants?.params;
        Some(Symbol::Param(params.iter().position(|param| param.name == name)? as u16))
    }

    /// The layer of a name.
    pub(super) fn layer(&self, name: &str) -> Option<LayerRef> {
        let layers = &self.constants?.layers;
        let k = layers.iter().position(|layer| layer.name == name)?;
        let [rows, columns] = [layers[k].rows(), layers[k].columns()].map(|n| n as u16);
        Some(LayerRef { layer: k as u16, rows, columns })
    }

    /// The names that formulas of this scope may use, features left out.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        let constants = self.constants.into_iter();
        self.stages.iter().map(|stage| stage.name.as_str()).chain(constants.flat_map(|all| {
            let params = all.params.iter().map(|param| param.name.as_str());
            params.chain(all.layers.iter().map(|layer| layer.name.as_str()))
        }))
    }

    /// How a symbol without operands, or a layer, is written.
    pub(super) fn spelling(&self, symbol: Symbol) -> String {
        let layers = self.constants.map_or(&[][..], |all| &all.layers);
        let params = self.constants.map_or(&[][..], |all| &all.params);
        match symbol {
            Symbol::Stage(signal) => {
                let k = usize::from(signal.stage);
                let name = self.stages.get(k).map_or(format!("stage{k}"), |s| s.name.clone());
                if signal.variance { name + VARIANCE } else { name }
            }
            Symbol::Offset => OFFSET.to_owned(),
            Symbol::Param(k) => {
                let k = usize::from(k);
                params.get(k).map_or(format!("constant{k}"), |param| param.name.clone())
            }
            Symbol::Linear(layer) => {
                let k = usize::from(layer.layer);
                layers.get(k).map_or(format!("layer{k}"), |layer| layer.name.clone())
            }
            Symbol::Variance(_) | Symbol::Vector(_) | Symbol::Gradient(_) => {
                let (feature, quantity) = symbol.reads().expect("these read features");
                let term = feature.row().term.filter(|_| quantity == Quantity::Value);
                let term = term.filter(|_| self.reads != Reads::Paper);
                let spelling = term.or_else(|| feature.spelling(quantity));
                spelling.expect("Symbol::of makes only what has a spelling").to_owned()
            }
            Symbol::Const(_)
            | Symbol::Op(_)
            | Symbol::At(_)
            | Symbol::Part(_)
            | Symbol::Many(..) => unreachable!("these are not names"),
        }
    }
}

/// Whether a program may give the name to something of its own.
pub fn is_free(name: &str) -> bool {
    let letters = |c: char| c.is_ascii_alphanumeric() || c == '_';
    name.starts_with(|c: char| c.is_ascii_alphabetic())
        && name.chars().all(letters)
        && ![super::PI, OFFSET, "i", "j"].contains(&name)
        && Feature::parse(name).is_none()
        && Op::parse_call(name).is_none()
        && Variadic::ALL.iter().all(|function| function.name() != name)
}
