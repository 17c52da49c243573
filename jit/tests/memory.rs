//! Kernels give their memory back.
#![cfg(target_os = "linux")]

use tamis_jit::{Body, Chains, CompileError, Compiler, Lanes, Side, Width, WindowSpec};

/// A different kernel for every number.
struct Scaled(f32);

impl Body for Scaled {
    fn emit<L: Lanes>(&self, lanes: &mut L) -> Vec<L::F> {
        let (factor, value) = (lanes.constant(self.0), lanes.plane(0, Side::J));
        vec![lanes.mul(factor, value)]
    }
}

/// Pages of this process that are in memory.
fn resident() -> usize {
    let statm = std::fs::read_to_string("/proc/self/statm").expect("Linux has it");
    let field = statm.split_whitespace().nth(1).expect("the second field");
    field.parse().expect("a number of pages")
}

/// Compiles and drops `count` kernels; a page lost with each would show.
fn stays_flat(compiler: &Compiler, count: u32) {
    let spec = WindowSpec {
        planes: 1,
        taps: 0,
        channels: 1,
        weights: 1,
        absolute: false,
        lone: false,
        mirrored: false,
    };
    let mut start = 0;
    for n in 0..count {
        // The allocator settles during the first kernels.
        if n == count / 10 {
            start = resident();
        }
        let compiled = compiler.compile(spec, Some(Chains::One), &Scaled(n as f32));
        drop(compiled.expect("compiles"));
    }
    let grown = resident().saturating_sub(start);
    let width = compiler.width();
    assert!(grown < 256, "{grown} pages more after {count} kernels of {width}");
}

#[test]
fn a_hundred_thousand_kernels_leave_nothing() {
    for width in Width::ALL {
        match Compiler::with_width(width) {
            Err(CompileError::Width(_)) => {}
            compiler => stays_flat(&compiler.expect("the host has it"), 100_000),
        }
    }
}
