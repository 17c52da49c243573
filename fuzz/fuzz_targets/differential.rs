//! Any expressions over any scene: the interpreter and machine code of every width
//! and number of chains that the host can run give the same bits.
//!
//! An input is four bytes of options, two that name the scene, and expressions in
//! postfix order, a symbol per byte. Whatever does not find its operands is left
//! out, so that every input means something, and mutations mean something near.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use tamis::backend::{Backend, Chains, Filtered, Interpreter, Jit, Rect, Width};
use tamis::expr::grammar::Vocabulary;
use tamis::expr::{Feature, Quantity, Sort, Symbol, Tree};
use tamis::filter::Window;
use tamis::plan::{Passes, Plan, Precision};
use tamis::scene::{Facts, LoadOptions, Needs, RawScene, Scene};

/// Most symbols of an expression: long enough for spills, short enough for many
/// runs per second.
const MOST_SYMBOLS: usize = 600;

/// Most expressions in a plan: more sums than there are registers for.
const MOST_WEIGHTS: usize = 6;

/// One row of vectors and a rest, at every width.
const SIZE: (usize, usize) = (37, 4);

const PAD: usize = 3;

static SYMBOLS: LazyLock<Vec<Symbol>> = LazyLock::new(|| Vocabulary::all().symbols().collect());

/// Values that arithmetic trips over, and a few that it should not.
const VALUES: [f32; 16] = [
    0.0, -0.0, 1.0, -1.0, 0.5, 3.0, 1e-3, -0.07, 1e3, 1e-20, -1e-30, 1e-41, 1e18, -1e12, 3e30,
    255.0,
];

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

/// A scene with every feature, of values that `seed` picks: wild ones, tame ones, or
/// the same everywhere.
fn scene(seed: u16) -> Scene {
    let (width, height) = SIZE;
    let (wild, mut plane) = (seed % 3, 0u32);
    let mut samples = |least: f32| -> Vec<f32> {
        plane += 1;
        let value = |k: usize| {
            let mut bits = (k as u32 ^ (plane << 16)).wrapping_mul(0x9e37_79b9) ^ u32::from(seed);
            bits = (bits ^ (bits >> 15)).wrapping_mul(0x85eb_ca6b);
            bits ^= bits >> 13;
            match wild {
                0 => VALUES[bits as usize % VALUES.len()],
                1 => (bits % 1000) as f32 / 400.0 - 0.5,
                _ => VALUES[plane as usize % VALUES.len()],
            }
        };
        (0..width * height).map(|k| value(k).max(least)).collect()
    };
    let color = [0; 3].map(|_| samples(0.0));
    let mut raw = RawScene::new("fuzz", width, height, color);
    for feature in Feature::ALL {
        if feature == Feature::Pixel {
            continue;
        }
        if feature != Feature::Color {
            let values = (0..feature.width()).map(|_| samples(f32::MIN)).collect();
            raw = raw.with(feature, Quantity::Value, values);
        }
        raw = raw.with(feature, Quantity::Variance, vec![samples(0.0)]);
    }
    raw.prepare(&Needs::everything(), PAD, &LoadOptions::default()).expect("every sample is finite")
}

fn passes(bits: u16) -> Passes {
    let on = |pass: u16| bits & (1 << pass) == 0;
    Passes {
        merge: on(0),
        facts: on(1),
        fold: on(2),
        share: on(3),
        ranges: on(4),
        contract: on(5),
        rate: on(6),
        support: on(7),
        symmetry: on(8),
        converged: on(9),
        precision: if on(10) { Precision::Standard } else { Precision::Fast },
    }
}

/// Everything that must be the same.
fn bits(results: &[Filtered]) -> Vec<(usize, Vec<[u32; 3]>)> {
    let pixels = |f: &Filtered| f.pixels.iter().map(|p| p.map(f32::to_bits)).collect();
    results.iter().map(|f| (f.kept, pixels(f))).collect()
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
    let scene = scene(u16::from_le_bytes([seed_low, seed_high]));
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
