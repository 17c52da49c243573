//! THE operator table: one row per operator of the language (the paper's
//! Figure 2, and what filters that are tuned need beside it), read by everything
//! that knows operators: parser, printer, grammar, f64 meaning, tape, ranges,
//! documentation. Searches draw from primitive sets ([`grammar`](super::grammar));
//! the paper's is a list of its own, so that a new row changes no preset. Rows are
//! added at the end.
//!
//! A row says how the operator is written, what it means (exactly, in f64), how
//! it is made of primitives, what its results range over, what its derivative is and
//! how far the made code may be from the meaning. To add an operator, add a row; a new
//! *primitive* is only needed where the existing ones cannot make it, and then
//! the compiler names every place that must learn it.
//!
//! Every operator is total: finite operands within ±[`LIMIT`](super::builder::LIMIT) give a finite
//! result within it. What happens outside the textbook domain stands in
//! the row's `edges`.

use super::arithmetic;
use super::elementary;
use super::function::{Binary, Budget, Unary, VectorFunction};
use super::kernels;

/// What kind of operand an operator takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Sort {
    /// A number.
    Scalar,
    /// A feature or a gradient: the paper's ⟨vector⟩.
    Vector,
}

/// How an operator is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Syntax {
    /// `name(operand, …)`
    Call,
    /// `-operand`, binding tighter than any infix operator.
    Prefix,
    /// `left op right`, left-associative, with a binding strength.
    Infix(u8),
}

/// What an operator computes, by the operands it takes.
#[derive(Clone, Copy, Debug)]
pub enum Form {
    /// One scalar.
    Unary(Unary),
    /// Two scalars.
    Binary(Binary),
    /// A vector at i and a vector at j.
    Vectors(VectorFunction),
}

impl Form {
    /// The same in fewer primitives and with a wider budget, where there is something
    /// to be saved.
    pub fn short(self) -> Self {
        match self {
            Self::Unary(f) => Self::Unary(f.short.copied().unwrap_or(f)),
            Self::Binary(f) => Self::Binary(f.short.copied().unwrap_or(f)),
            Self::Vectors(f) => Self::Vectors(f),
        }
    }

    /// How far results may be from the meaning.
    pub fn budget(self) -> Budget {
        match self {
            Self::Unary(f) => f.budget,
            Self::Binary(f) => f.budget,
            Self::Vectors(f) => f.budget,
        }
    }
}

/// A row of the operator table.
#[derive(Debug)]
pub struct OpRow {
    /// The operator's name or symbol in expressions.
    pub name: &'static str,
    /// How it is written.
    pub syntax: Syntax,
    /// What it computes.
    pub form: Form,
    /// One line for people.
    pub doc: &'static str,
    /// What happens outside the textbook domain, and why.
    pub edges: &'static str,
    /// How it is typeset, `#1` and `#2` standing for the operands.
    pub latex: &'static str,
}

macro_rules! operators {
    ($($variant:ident: $name:literal, $syntax:expr, $form:expr, $latex:literal, $doc:literal, $edges:literal;)*) => {
        /// An operator of the language.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Op {
            $(#[doc = $doc] $variant,)*
        }

        impl Op {
            /// Every operator.
            pub const ALL: &'static [Self] = &[$(Self::$variant),*];
        }

        const TABLE: &[OpRow] = &[$(OpRow {
            name: $name,
            syntax: $syntax,
            form: $form,
            doc: $doc,
            edges: $edges,
            latex: $latex,
        }),*];
    };
}

use Form::{Binary as B, Unary as U, Vectors as V};
use Syntax::{Call, Infix, Prefix};

operators! {
    Neg: "-", Prefix, U(arithmetic::NEG), "-#1",
        "negation", "none";
    Sin: "sin", Call, U(elementary::SIN), "\\sin #1",
        "sine, in radians", "far from zero the argument is clamped, where its own rounding exceeds a period";
    Cos: "cos", Call, U(elementary::COS), "\\cos #1",
        "cosine, in radians", "far from zero the argument is clamped, where its own rounding exceeds a period";
    Tan: "tan", Call, U(elementary::TAN), "\\tan #1",
        "tangent, in radians", "far from zero the argument is clamped; finite at its poles";
    Exp: "exp", Call, U(elementary::EXP), "e^{#1}",
        "exponential", "at most LIMIT; 0 where the result would be subnormal";
    Asin: "asin", Call, U(elementary::ASIN), "\\arcsin #1",
        "arc sine, in radians", "the argument is clamped into [-1, 1]";
    Acos: "acos", Call, U(elementary::ACOS), "\\arccos #1",
        "arc cosine, in radians", "the argument is clamped into [-1, 1]";
    Atan: "atan", Call, U(elementary::ATAN), "\\arctan #1",
        "arc tangent, in radians", "none";
    Sqrt: "sqrt", Call, U(elementary::SQRT), "\\sqrt{#1}",
        "square root", "0 for negative arguments";
    Mitchell: "mitchell", Call, U(kernels::MITCHELL), "\\operatorname{mitchell}(#1)",
        "Mitchell-Netravali kernel with B = C = 1/3", "0 for |x| >= 2";
    Sinc: "sinc", Call, U(kernels::SINC), "\\operatorname{sinc}(#1)",
        "sin(pi x) / (pi x)", "1 at 0; far from zero the argument is clamped";
    Epanechnikov: "epanechnikov", Call, U(kernels::EPANECHNIKOV), "\\operatorname{epanechnikov}(#1)",
        "Epanechnikov kernel 3/4 (1 - x^2)", "0 for |x| >= 1";
    Biweight: "biweight", Call, U(kernels::BIWEIGHT), "\\operatorname{biweight}(#1)",
        "biweight kernel 15/16 (1 - x^2)^2", "0 for |x| >= 1";
    Tricube: "tricube", Call, U(kernels::TRICUBE), "\\operatorname{tricube}(#1)",
        "tricube kernel 70/81 (1 - |x|^3)^3", "0 for |x| >= 1";
    Mul: "*", Infix(2), B(arithmetic::MUL), "#1 \\cdot #2",
        "product", "clamped to LIMIT";
    Sub: "-", Infix(1), B(arithmetic::SUB), "#1 - #2",
        "difference", "clamped to LIMIT";
    Add: "+", Infix(1), B(arithmetic::ADD), "#1 + #2",
        "sum", "clamped to LIMIT";
    Div: "/", Infix(2), B(arithmetic::DIV), "\\frac{#1}{#2}",
        "quotient", "the divisor is kept DIVISOR_MIN away from zero, on its own side (zero counts as positive); clamped to LIMIT";
    Pow: "pow", Call, B(elementary::POW), "{#1}^{#2}",
        "power", "pow(x, 0) = 1; pow(0, y) = 0 for y > 0 and LIMIT for y < 0; a negative base gives the power of its magnitude, negated for odd integer exponents; clamped to LIMIT";
    Dot: "dot", Call, V(arithmetic::DOT), "#1 \\cdot #2",
        "scalar product of a at i and b at j", "clamped to LIMIT";
    Distance2: "distance2", Call, V(arithmetic::DISTANCE2), "\\|#1 - #2\\|_{L2}",
        "Euclidean distance of a at i and b at j", "clamped to LIMIT";
    Distance1: "distance1", Call, V(arithmetic::DISTANCE1), "\\|#1 - #2\\|_{L1}",
        "Manhattan distance of a at i and b at j", "clamped to LIMIT";
    DistanceMax: "distanceMax", Call, V(arithmetic::DISTANCE_MAX), "\\|#1 - #2\\|_{\\max}",
        "Chebyshev distance of a at i and b at j", "clamped to LIMIT";
    Log: "log", Call, U(elementary::LOG), "\\log #1",
        "natural logarithm", "arguments below the smallest normal number, 0 and negative ones among them, count as that number: log(0) is about -87.3";
    Abs: "abs", Call, U(arithmetic::ABS), "\\lvert{#1}\\rvert",
        "absolute value", "none";
    Tanh: "tanh", Call, U(elementary::TANH), "\\tanh #1",
        "hyperbolic tangent", "none";
    Logistic: "logistic", Call, U(elementary::LOGISTIC), "\\operatorname{logistic}(#1)",
        "logistic function 1 / (1 + exp(-x))", "at least 1 / LIMIT";
    Leaky: "leaky", Call, U(arithmetic::LEAKY), "\\operatorname{leaky}(#1)",
        "leaky rectifier: x, or x / 100 where x < 0", "none";
    Min: "min", Call, B(arithmetic::MIN), "\\min({#1}, {#2})",
        "the smaller one", "none";
    Max: "max", Call, B(arithmetic::MAX), "\\max({#1}, {#2})",
        "the greater one", "none";
}

impl Op {
    /// The operator's row.
    pub fn row(self) -> &'static OpRow {
        &TABLE[self as usize]
    }

    /// The operator's name or symbol.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// The sorts of the operands, in order.
    pub fn operands(self) -> &'static [Sort] {
        match self.row().form {
            Form::Unary(_) => &[Sort::Scalar],
            Form::Binary(_) => &[Sort::Scalar, Sort::Scalar],
            Form::Vectors(_) => &[Sort::Vector, Sort::Vector],
        }
    }

    /// Number of operands.
    pub fn arity(self) -> usize {
        self.operands().len()
    }

    /// The budget of the row.
    pub fn budget(self) -> Budget {
        self.row().form.budget()
    }

    /// Looks up a function by the name it is called by.
    pub fn parse_call(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|op| op.row().syntax == Call && op.name() == name)
    }
}
