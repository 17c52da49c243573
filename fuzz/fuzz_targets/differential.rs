//! Any expressions over any scene: the interpreter and machine code of every width
//! and number of chains that the host can run give the same bits.
//!
//! An input is four bytes of options, two that name the scene, and expressions in
//! postfix order, a symbol per byte. Whatever does not find its operands is left
//! out, so that every input means something, and mutations mean something near.
#![no_main]

mod shared;

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use tamis::backend::{Backend, Chains, Interpreter, Jit, Rect, Width};
use tamis::expr::grammar::Vocabulary;
use tamis::expr::{Sort, Symbol, Tree};
use tamis::filter::Window;
use tamis::plan::Plan;
use tamis::scene::Facts;

use shared::{bits, passes, scene};

/// Most symbols of an expression: long enough for spills, short enough for many
/// runs per second.
const MOST_SYMBOLS: usize = 600;

/// Most expressions in a plan: more sums than there are registers for.
const MOST_WEIGHTS: usize = 6;

/// One row of vectors and a rest, at every width.
const SIZE: (usize, usize) = (37, 4);

const PAD: usize = 3;

static SYMBOLS: LazyLock<Vec<Symbol>> = LazyLock::new(|| Vocabulary::all().symbols().collect());

/// A byte that a number's four bytes follow.
const NUMBER: u8 = 255;

fn expressions(bytes: &[u8]) -> Vec<Tree> {
    let mut stack: Vec<Vec<Symbol>> = Vec::new();
    let mut bytes = bytes.iter().copied();
    while let Some(byte) = bytes.next() {
        let symbol = match byte {
            NUMBER => {
                let mut next = || bytes.next().unwrap_or(0);
                Symbol::constant(f32::from_le_bytes([next(), next(), next(), next()]))
            }
            byte => SYMBOLS[usize::from(byte) % SYMBOLS.len()],
        };
        let wanted = symbol.operands();
        let Some(first) = stack.len().checked_sub(wanted.len()) else { continue };
        let sort = |part: &Vec<Symbol>| part.last().map(|root| root.sort());
        let fits = stack[first..].iter().map(sort).eq(wanted.iter().map(|&sort| Some(sort)));
        let length: usize = stack[first..].iter().map(Vec::len).sum();
        if fits && length < MOST_SYMBOLS {
            let mut whole = stack.split_off(first).concat();
            whole.push(symbol);
            stack.push(whole);
        }
    }
    let scalars =
        stack.into_iter().rev().map(|part| Tree::new(part).expect("operands were counted"));
    scalars.filter(|tree| tree.sort() == Sort::Scalar).take(MOST_WEIGHTS).collect()
}

fuzz_target!(|data: &[u8]| {
    let Some((&[radius, chains, low, high, seed_low, seed_high], rest)) = data.split_first_chunk()
    else {
        return;
    };
    let weights = expressions(rest);
    if weights.is_empty() {
        return;
    }
    let scene = scene(SIZE, PAD, u16::from_le_bytes([seed_low, seed_high]));
    let window = Window::dense(u32::from(radius) % (PAD as u32 + 1));
    let passes = passes(u16::from_le_bytes([low, high]));
    let Ok(plan) = Plan::new(&weights, window, &Facts::of(&scene), passes) else { return };
    let rects = [Rect::whole(&scene), Rect { x: 5, y: 1, width: 23, height: 2 }];
    let run = |backend: &dyn Backend| {
        let code = backend.compile(&plan).ok()?;
        Some(bits(&code.run(&scene, &rects).expect("the scene has what the plan reads")))
    };
    let expected = run(&Interpreter).expect("the interpreter runs every plan");
    for width in Width::ALL {
        // Not every host has every width.
        let Ok(jit) = Jit::with_width(width) else { continue };
        let jit = match chains % 4 {
            0 => jit,
            1 => jit.with_chains(Chains::One),
            2 => jit.with_chains(Chains::Two),
            _ => jit.with_chains(Chains::Four),
        };
        // An error is an answer; other bits are none.
        if let Some(found) = run(&jit) {
            assert!(found == expected, "{width:?}, {window:?}, {passes:?}: {weights:?}");
        }
    }
});
