//! Tunes the constants of a small program on frames that were never in a file, and prints the
//! program that comes out.
//!
//! ```text
//! cargo run --release --example tune_memory
//! ```
//!
//! The frames are made here: a wall of three colours with an edge, and noise from a generator
//! with a seed. A renderer would hand over its own.

use std::error::Error;
use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tamis::backend::Interpreter;
use tamis::expr::{Feature, Quantity};
use tamis::filter::Filter;
use tamis::image::Image;
use tamis::scene::{LoadOptions, RawScene};
use tamis::tune::{Control, Level, Reference, Settings, Tuner, TuningScene};

const PROGRAM: &str = r#"
version = 2
name = "walls"

[params]
range = { value = 0.5, min = 0.01, max = 100 }
edge = { value = 0.5, min = 0.01, max = 100 }

[[stage]]
name = "result"
gather = "color"
weight = "exp(-range * distance2(color, color) - edge * distance2(normal, normal))"
radius = 4
"#;

const SIDE: usize = 64;

/// A frame with noise, and what it should be.
fn frame(filter: &Filter, seed: u64) -> Result<TuningScene, Box<dyn Error>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let place = |k: usize| (k % SIDE, k / SIDE);
    let image = |f: &dyn Fn(usize, usize) -> f32| -> Vec<f32> {
        (0..SIDE * SIDE).map(|k| f(place(k).0, place(k).1)).collect()
    };
    let edge = 16 + 8 * (seed as usize % 4);
    let clean =
        [0.8, 0.4, 0.2].map(|c| image(&|x, y| if x < edge { c } else { c * y as f32 / 64.0 }));
    let noisy = clean.clone().map(|channel| {
        channel.iter().map(|c| c + c * (rng.random::<f32>() - 0.5)).collect::<Vec<f32>>()
    });
    let front = image(&|x, _| if x < edge { 1.0 } else { 0.0 });
    let side = image(&|x, _| if x < edge { 0.0 } else { 1.0 });
    let name = format!("wall {seed}");
    let checked = filter.check()?;
    let scene = RawScene::new(&name, SIDE, SIDE, noisy)
        .with(Feature::Normal, Quantity::Value, vec![front, vec![0.0; SIDE * SIDE], side])
        .prepare(&checked.needs(), checked.reach(), &LoadOptions::default())?;
    let levels = vec![Level { samples: Some(4), scene }];
    let image = Image::new(&name, SIDE, SIDE, clean).ok_or("one colour per pixel")?;
    let reference = Reference::new(image.rgb());
    Ok(TuningScene { name, levels, image, reference })
}

fn main() -> Result<(), Box<dyn Error>> {
    let filter = Filter::parse(PROGRAM, Path::new("walls.toml"))?;
    let frames = |seeds: std::ops::Range<u64>| -> Result<Vec<TuningScene>, Box<dyn Error>> {
        seeds.map(|seed| frame(&filter, seed)).collect()
    };
    let (training, validation) = (frames(0..6)?, frames(6..8)?);
    let settings = Settings { steps: 200, crop: 32, interval: 50, ..Settings::default() };
    let mut tuner = Tuner::new(filter.clone(), settings, &training, &validation, &Interpreter)?;
    let outcome = tuner.run(&Control::default(), &mut |_| {})?;
    for (before, after) in filter.constants.params.iter().zip(&outcome.filter.constants.params) {
        println!("{}: {} before, {} now", before.name, before.value, after.value);
    }
    println!("{}", outcome.filter.to_toml(toml::Table::new()));
    Ok(())
}
