//! What the targets that filter have in common: scenes, passes, and results as bits.

use tamis::backend::Filtered;
use tamis::expr::{Feature, Quantity};
use tamis::plan::{PASSES, Passes, Precision};
use tamis::scene::{LoadOptions, Needs, RawScene, Scene};

/// Values that arithmetic trips over, and a few that it should not.
const VALUES: [f32; 16] = [
    0.0, -0.0, 1.0, -1.0, 0.5, 3.0, 1e-3, -0.07, 1e3, 1e-20, -1e-30, 1e-41, 1e18, -1e12, 3e30,
    255.0,
];

/// A scene with every feature, of values that `seed` picks: wild ones, tame ones, or
/// the same everywhere.
pub(crate) fn scene((width, height): (usize, usize), pad: usize, seed: u16) -> Scene {
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
        if !feature.is_stored() {
            continue;
        }
        if feature != Feature::Color {
            let values = (0..feature.width()).map(|_| samples(f32::MIN)).collect();
            raw = raw.with(feature, Quantity::Value, values);
        }
        raw = raw.with(feature, Quantity::Variance, vec![samples(0.0)]);
    }
    raw.prepare(&Needs::everything(), pad, &LoadOptions::default()).expect("every sample is finite")
}

/// Passes, each switched off by a bit; the first says how accurate code is.
pub(crate) fn passes(bits: u16) -> Passes {
    let off = |k: usize| bits >> (k + 1) & 1 == 1;
    let off = PASSES.iter().enumerate().filter(|&(k, _)| off(k));
    let passes = off.fold(Passes::ALL, |passes, (_, row)| {
        passes.without(row.name).expect("it is a row of the table")
    });
    let precision = if bits & 1 == 0 { Precision::Standard } else { Precision::Fast };
    Passes { precision, ..passes }
}

/// Everything that must be the same.
pub(crate) fn bits(results: &[Filtered]) -> Vec<(Vec<usize>, Vec<[u32; 3]>)> {
    let pixels = |f: &Filtered| f.pixels.iter().map(|p| p.map(f32::to_bits)).collect();
    results.iter().map(|f| (f.kept.clone(), pixels(f))).collect()
}
