//! The nodes of expressions: what they read, take and give.

use super::feature::{Feature, PlaneId, Quantity};
use super::op::{Form, Op, Sort};
use super::tape::Side;

/// A finite literal, compared by its bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Literal(u32);

impl Literal {
    /// The literal's value.
    pub fn value(self) -> f32 {
        f32::from_bits(self.0)
    }
}

/// Where an expression is looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Place {
    /// At an end of the pair of pixels; a map has pixel i alone.
    Side(Side),
    /// So many columns to the right of pixel i and rows below it. Beyond the edge of the
    /// image the nearest pixel of the image stands in.
    Shift(i8, i8),
}

impl Place {
    /// The same place for whoever stands at another.
    #[must_use]
    pub fn from(self, other: Self) -> Self {
        match (self, other) {
            (Self::Shift(x, y), Self::Shift(u, v)) => {
                Self::Shift(x.saturating_add(u), y.saturating_add(v))
            }
            (place, _) => place,
        }
    }
}

/// The result of a program's earlier stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct StageSignal {
    /// Which stage, counted from 0.
    pub stage: u16,
    /// Components of its value.
    pub width: u16,
    /// Whether the variance of the stage's mean is meant, which is one wide.
    pub variance: bool,
}

/// One plane of an earlier stage's result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct StagePlane {
    /// Which stage, counted from 0.
    pub stage: u16,
    /// Component of the value; the one after the last is the variance.
    pub component: u16,
}

impl StageSignal {
    /// The planes, in the order of the components.
    pub fn planes(self) -> impl Iterator<Item = StagePlane> {
        let components = if self.variance { self.width..self.width + 1 } else { 0..self.width };
        components.map(move |component| StagePlane { stage: self.stage, component })
    }
}

/// One scalar image that an expression can read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Source {
    /// A component of a feature's quantity.
    Feature(PlaneId),
    /// A component of an earlier stage's result.
    Stage(StagePlane),
}

/// Functions of any number of operands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Variadic {
    /// All components of all operands, one after another.
    Join,
    /// The median, component by component; the lower one of an even number.
    Median,
    /// The first operand, kept between the second and the third, component by component.
    Clamp,
    /// The mean of all components of all operands.
    Mean,
    /// The luminance of a colour of three components, by the primaries of Rec. 709.
    Luminance,
}

impl Variadic {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Join, Self::Median, Self::Clamp, Self::Mean, Self::Luminance];

    /// What the components of a colour weigh in its luminance.
    pub const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

    /// What it is called by.
    pub fn name(self) -> &'static str {
        match self {
            Self::Join => "join",
            Self::Median => "median",
            Self::Clamp => "clamp",
            Self::Mean => "mean",
            Self::Luminance => "luminance",
        }
    }

    /// One line for people.
    pub fn doc(self) -> &'static str {
        match self {
            Self::Join => "all components of all operands, one after another",
            Self::Median => "median of the operands, component by component",
            Self::Clamp => "the first operand, kept between the second and the third",
            Self::Mean => "mean of all components of all operands",
            Self::Luminance => "0.2126 R + 0.7152 G + 0.0722 B of a colour",
        }
    }
}

/// A linear layer of a program: W x + b, with its constants in a named block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct LayerRef {
    /// Which of the program's layers.
    pub layer: u16,
    /// Components that it gives.
    pub rows: u16,
    /// Components that it takes.
    pub columns: u16,
}

/// A node of a tree.
///
/// The paper's grammar has the first five; the others are for programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Symbol {
    /// A number.
    Const(Literal),
    /// A feature's variance at pixel i.
    Variance(Feature),
    /// A feature, an operand of a vector operator.
    Vector(Feature),
    /// A feature's gradient, an operand of a vector operator.
    Gradient(Feature),
    /// An operator.
    Op(Op),
    /// The result of an earlier stage.
    Stage(StageSignal),
    /// A named constant of the program, by its number.
    Param(u16),
    /// How far pixel j is from pixel i, in pixels: columns, rows.
    Offset,
    /// Its operand, looked at elsewhere.
    At(Place),
    /// A component of its operand.
    Part(u16),
    /// A function of so many operands.
    Many(Variadic, u8),
    /// A layer, applied to its operand.
    Linear(LayerRef),
}

impl Symbol {
    /// A constant. Literals must be finite: others become zero and ±the
    /// greatest finite number, which no caller in this crate relies on.
    pub fn constant(x: f32) -> Self {
        let finite = if x.is_nan() { 0.0 } else { x.clamp(f32::MIN, f32::MAX) };
        Self::Const(Literal(finite.to_bits()))
    }

    /// The symbol of a feature's quantity, if the language has it.
    pub fn of(feature: Feature, quantity: Quantity) -> Option<Self> {
        feature.spelling(quantity)?;
        Some(match quantity {
            Quantity::Value => Self::Vector(feature),
            Quantity::Gradient => Self::Gradient(feature),
            Quantity::Variance => Self::Variance(feature),
        })
    }

    /// The feature quantity that the symbol reads, if it reads one.
    pub fn reads(self) -> Option<(Feature, Quantity)> {
        match self {
            Self::Variance(f) => Some((f, Quantity::Variance)),
            Self::Vector(f) => Some((f, Quantity::Value)),
            Self::Gradient(f) => Some((f, Quantity::Gradient)),
            _ => None,
        }
    }

    /// The operator, if the symbol is one.
    pub fn op(self) -> Option<Op> {
        match self {
            Self::Op(op) => Some(op),
            _ => None,
        }
    }

    /// The number, if the symbol is one.
    pub fn number(self) -> Option<f32> {
        match self {
            Self::Const(literal) => Some(literal.value()),
            _ => None,
        }
    }

    /// Whether the paper's grammar has the symbol. It has numbers, features and operators,
    /// and nothing that only programs have.
    pub fn is_paper(self) -> bool {
        let leaf = self.number().is_some() || self.reads().is_some();
        leaf || self.op().is_some()
    }

    /// What the symbol stands for in the paper's grammar, which knows bare features as
    /// vectors and everything else as numbers.
    pub fn sort(self) -> Sort {
        match self {
            Self::Vector(_) | Self::Gradient(_) => Sort::Vector,
            _ => Sort::Scalar,
        }
    }

    /// The operands that the paper's grammar gives it; empty for what only programs have.
    pub fn operands(self) -> &'static [Sort] {
        self.op().map_or(&[], Op::operands)
    }

    /// Number of operands.
    pub fn arity(self) -> usize {
        match self {
            Self::Op(op) => op.arity(),
            Self::At(_) | Self::Part(_) | Self::Linear(_) => 1,
            Self::Many(_, operands) => usize::from(operands),
            Self::Const(_)
            | Self::Variance(_)
            | Self::Vector(_)
            | Self::Gradient(_)
            | Self::Stage(_)
            | Self::Param(_)
            | Self::Offset => 0,
        }
    }

    /// How many components the symbol gives for operands of these widths, the first
    /// operand first; `None` if it does not take them. Operands of one component stand
    /// for as many as the others have.
    pub fn width(self, operands: &[usize]) -> Option<usize> {
        let broadcast = || {
            let width = operands.iter().copied().max()?;
            operands.iter().all(|&w| w == 1 || w == width).then_some(width)
        };
        if operands.len() != self.arity() {
            return None;
        }
        match self {
            Self::Const(_) | Self::Param(_) => Some(1),
            Self::Offset => Some(2),
            Self::Variance(f) => Some(PlaneId::components(f, Quantity::Variance)),
            Self::Vector(f) => Some(PlaneId::components(f, Quantity::Value)),
            Self::Gradient(f) => Some(PlaneId::components(f, Quantity::Gradient)),
            Self::Stage(signal) if signal.variance => Some(1),
            Self::Stage(signal) => Some(usize::from(signal.width)),
            Self::Op(op) => match op.row().form {
                Form::Unary(_) | Form::Binary(_) => broadcast(),
                Form::Vectors(_) => Some(1),
            },
            Self::At(_) => operands.first().copied(),
            Self::Part(component) => (usize::from(component) < operands[0]).then_some(1),
            Self::Many(Variadic::Join, _) => {
                Some(operands.iter().sum()).filter(|width| (1..=Self::WIDEST).contains(width))
            }
            Self::Many(Variadic::Median, _) | Self::Many(Variadic::Clamp, 3) => broadcast(),
            Self::Many(Variadic::Clamp, _) => None,
            Self::Many(Variadic::Mean, _) => Some(1),
            Self::Many(Variadic::Luminance, _) => (operands == [3]).then_some(1),
            Self::Linear(layer) => {
                (operands[0] == usize::from(layer.columns)).then_some(usize::from(layer.rows))
            }
        }
    }

    /// The most components that a value may have.
    pub const WIDEST: usize = 256;
}
