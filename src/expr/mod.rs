//! Floor 0: the expression language. Pure: no files, no threads.
//!
//! [`Feature`]s and [`Op`]s are rows of two tables; everything else reads them.
//! A [`Tree`] is an expression as people and the search handle it; a
//! [`Tape`](tape::Tape) is the straight-line code over a dozen primitives that
//! back ends run.

pub mod arithmetic;
pub mod builder;
pub mod codebook;
pub mod constants;
pub mod derivative;
pub mod elementary;
pub mod evaluate;
pub mod feature;
pub mod function;
pub mod grammar;
pub mod interval;
pub mod kernels;
pub mod op;
pub mod symbol;
pub mod tape;
pub mod text;
pub mod tree;

pub use constants::Constants;
pub use evaluate::Evaluator;
pub use feature::{Feature, PlaneId, Quantity, Unit};
pub use op::{Op, Sort};
pub use symbol::{Place, Source, StagePlane, Symbol};
pub use tree::Tree;
