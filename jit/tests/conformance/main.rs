//! Compiled kernels against the plain meaning of what they compute, bit for bit.

mod hostile;
mod instructions;
mod program;
mod random;
mod reference;
mod windows;
