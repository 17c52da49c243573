//! Denoises a frame in memory, as a renderer would, and says what it took. What is printed at the
//! end is how the result compares with the one that the same file gets.
//!
//! ```text
//! cargo run --release --example denoise_memory -- [IN.exr]
//! ```
//!
//! The frame is the file's, whose features are put into buffers of their own first: interleaved
//! 32-bit floats, one after the other, as a renderer has them.

use std::error::Error;
use std::ops::ControlFlow;
use std::path::PathBuf;

use tamis::denoise::Denoiser;
use tamis::expr::{Feature, Quantity};
use tamis::scene::{LoadOptions, Needs, RawScene};

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).map_or("data/test/galley/4spp.exr".into(), PathBuf::from);

    // A renderer has these already.
    let frame = RawScene::read(&path, &Needs::everything(), &LoadOptions::default())?;
    let interleaved = |planes: &[Vec<f32>]| -> Vec<f32> {
        (0..planes[0].len()).flat_map(|k| planes.iter().map(move |plane| plane[k])).collect()
    };
    let buffers: Vec<(Feature, Quantity, Vec<f32>)> = frame
        .features
        .iter()
        .map(|(&(feature, quantity), planes)| (feature, quantity, interleaved(planes)))
        .collect();

    // One denoiser for all frames: it keeps the code that it makes.
    let denoiser = Denoiser::builder().build()?;
    let mut clean = vec![0.0f32; 3 * frame.width * frame.height];
    for _ in 0..3 {
        let mut given = denoiser.frame(frame.width, frame.height);
        for (feature, quantity, samples) in &buffers {
            given = given.feature(*feature, *quantity, samples);
        }
        if let Some(samples) = frame.samples {
            given = given.samples(samples);
        }
        let progress = |done: usize, of: usize| {
            eprint!("\r{}%", 100 * done / of);
            ControlFlow::Continue(())
        };
        let report = given.progress(&progress).run(&mut clean)?;
        let took = &report.applied;
        println!(
            "\r{}x{} pixels on {}: preparing {:?}, planning {:?}, compiling {:?}, filtering {:?}",
            frame.width,
            frame.height,
            report.backend,
            report.preparing,
            took.planning,
            took.compilation,
            took.filtering,
        );
        report.notes.iter().for_each(|note| println!("{note}"));
    }

    let file = denoiser.denoise(&path)?;
    let [r, g, b] = file.image().rgb();
    let colors = r.iter().zip(g).zip(b).flat_map(|((r, g), b)| [*r, *g, *b]);
    let differ = clean.iter().zip(colors).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
    println!("{differ} samples differ from what the file gets");
    Ok(())
}
