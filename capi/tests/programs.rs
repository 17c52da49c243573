//! C programs that use the library, and one that misuses it, under the sanitizers of addresses
//! and of undefined behaviour.
#![cfg(unix)]

mod common;

use std::path::Path;
use std::process::Command;

use common::{Programs, interleaved, own, project, raw, run, scenes};
use tamis::denoise::Denoiser;
use tamis::expr::{Feature, Quantity};
use tamis::image::pfm;

#[test]
fn misuse_is_told_and_harms_nothing() {
    let programs = Programs::new();
    let program = programs.compile(&own("tests/misuse.c"));
    let said = run(&mut Command::new(program));
    assert!(said.contains("all of it holds"), "{said}");
}

/// Rows from the last to the first.
fn turned(plane: &[f32], width: usize) -> Vec<f32> {
    plane.chunks(width).rev().flatten().copied().collect()
}

/// Writes an image so that its first row comes first in the file, as the example takes rows.
fn write(path: &Path, planes: &[Vec<f32>], (width, height): (usize, usize)) {
    let planes: Vec<Vec<f32>> = planes.iter().map(|plane| turned(plane, width)).collect();
    let bytes = pfm::write((width, height), [&planes[0], &planes[1], &planes[2]]);
    std::fs::write(path, bytes).expect("the folder can be written to");
}

#[test]
fn the_example_gives_the_librarys_bits_on_every_test_scene() {
    let programs = Programs::new();
    let program = programs.compile(&project("examples/embed.c"));
    let denoiser = Denoiser::builder().build().expect("the processor is there");
    for scene in scenes() {
        let raw = raw(&scene);
        let size = (raw.width, raw.height);
        let guides = [Feature::Color, Feature::Texture, Feature::Normal];
        for inputs in 1..=guides.len() {
            let mut frame = denoiser.frame(size.0, size.1);
            let mut command = Command::new(&program);
            command.arg(programs.path("clean.pfm"));
            let buffers: Vec<(Feature, Vec<f32>)> = guides[..inputs]
                .iter()
                .map(|&guide| {
                    let planes = &raw.features[&(guide, Quantity::Value)];
                    let path = programs.path(&format!("{}.pfm", guide.term()));
                    write(&path, planes, size);
                    command.arg(path);
                    (guide, interleaved(planes))
                })
                .collect();
            for (guide, buffer) in &buffers {
                frame = frame.feature(*guide, Quantity::Value, buffer);
            }
            let expected = frame.filter().expect("it runs");
            let said = run(&mut command);
            assert!(said.contains("100%") && said.contains("tamis: 0."), "{said}");
            let clean = std::fs::read(programs.path("clean.pfm")).expect("it was written");
            let clean = pfm::read(&clean).expect("an image");
            assert_eq!(clean.size, size);
            let planes: Vec<Vec<f32>> =
                clean.channels.iter().map(|plane| turned(plane, size.0)).collect();
            let same = interleaved(&planes) == expected.colors().as_flattened();
            assert!(same, "{} with {inputs} images", scene.display());
        }
    }
}

#[test]
fn the_example_says_what_is_wrong_with_its_files() {
    let programs = Programs::new();
    let program = programs.compile(&project("examples/embed.c"));
    let clean = programs.path("clean.pfm");
    let fails = |color: &str, content: Option<&[u8]>, said: &str| {
        let color = programs.path(color);
        if let Some(content) = content {
            std::fs::write(&color, content).expect("the folder can be written to");
        }
        let output = Command::new(&program).arg(&clean).arg(&color).output().expect("it starts");
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{text}");
        assert!(text.contains(said) && !text.contains("Sanitizer"), "{text}");
    };
    fails("absent.pfm", None, "cannot be opened");
    fails("grey.pfm", Some(b"Pf\n1 1\n-1.0\nabcd"), "is no PFM file of three channels");
    fails("short.pfm", Some(b"PF\n2 2\n-1.0\nabcd"), "ends too early");
    fails("empty.pfm", Some(b"PF\n0 2\n-1.0\nabcd"), "is empty");
    assert!(!clean.exists(), "nothing was written");
}
