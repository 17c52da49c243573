//! Any programs over any scene: the interpreter and machine code of every width that the
//! host can run give the same bits, which are numbers, for the whole and for parts of it.
//!
//! An input is the seed of a program, how many stages it has, which passes are off, the
//! image's size and the seed of its scene. Programs are those of the tests.
#![no_main]

#[path = "../../tests/fixture/programs.rs"]
mod programs;
mod shared;

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use tamis::backend::{Backend, Interpreter, Jit, Rect, Width};
use tamis::filter::Filter;
use tamis::plan::Plan;
use tamis::scene::Facts;

use shared::{bits, passes, scene};

/// As far as the tests' programs look.
const PAD: usize = 16;

/// Most stages before the result.
const STAGES: usize = 12;

fuzz_target!(|data: [u8; 15]| {
    let [seed @ .., stages, low, high, width, height, scene_low, scene_high] = data;
    let text = programs::random(u64::from_le_bytes(seed), 1 + usize::from(stages) % STAGES);
    let filter = Filter::parse(&text, Path::new("fuzz.toml")).expect("the tests' programs parse");
    let (width, height) = (1 + usize::from(width) % 70, 1 + usize::from(height) % 90);
    let scene = scene((width, height), PAD, u16::from_le_bytes([scene_low, scene_high]));
    let passes = passes(u16::from_le_bytes([low, high]));
    let checked = filter.check().expect("parsed filters make sense");
    let schedule = Plan::of(&checked, &Facts::of(&scene), passes);
    let schedule = schedule.expect("the scene has every feature");
    let run = |backend: &dyn Backend, rect: Rect| {
        let code = backend.compile(&schedule).ok()?;
        Some(code.run(&scene, &[rect]).expect("the scene has what the program reads"))
    };
    let whole = Rect::whole(&scene);
    let expected = run(&Interpreter, whole).expect("the interpreter runs every program");
    let finite = expected[0].pixels.iter().flatten().all(|x| x.is_finite());
    assert!(finite, "{passes:?}, {width}x{height}:\n{text}");
    let part = Rect { x: width / 3, y: height / 2, width: width - width / 3, height: 1 };
    let row = expected[0].pixels[part.y * width + part.x..][..part.width].to_vec();
    let found = run(&Interpreter, part).expect("as before");
    assert!(found[0].pixels == row, "{passes:?}, {width}x{height}, {part:?}:\n{text}");
    for vectors in Width::ALL {
        // Not every host has every width, and an error is an answer; other bits are none.
        let Ok(jit) = Jit::with_width(vectors) else { continue };
        if let Some(found) = run(&jit, whole) {
            let same = bits(&found) == bits(&expected);
            assert!(same, "{vectors:?}, {passes:?}, {width}x{height}:\n{text}");
        }
    }
});
