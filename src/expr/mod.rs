//! Floor 0: the expression language. Pure: no files, no threads.

pub mod builder;
pub mod elementary;
pub mod feature;
pub mod function;
pub mod interval;
pub mod kernels;
pub mod tape;
