//! What one bad pixel does to a denoised image: the default filter beside Open Image
//! Denoise. Prints the table of docs/NUMERICS.md.
//!
//! ```text
//! cargo run --release --example bad_pixels -- [--scene FOLDER] [--oidn PROGRAM]
//! ```
//!
//! One pixel of a rendered scene is spoilt, in the colour or in the albedo, in all three
//! components. Counted are the pixels of the result that differ from the result of the
//! clean scene by more than a thousandth, and those that are no numbers. Open Image
//! Denoise takes part if `--oidn` names its program `oidnDenoise`, which its releases
//! bring along; it is given colour, albedo and normal as they are, as Tamis is.

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use tamis::backend::{Backend, Jit, Rect};
use tamis::expr::{Feature, Quantity};
use tamis::filter::{Filter, shipped};
use tamis::image::{Image, Metrics, pfm};
use tamis::plan::{Passes, Plan};
use tamis::report::{Align, Format, Table, number};
use tamis::scene::{Facts, LoadOptions, Needs, RawScene, Repair, SceneFiles, load_reference};

type Key = (Feature, Quantity);
const COLOR: Key = (Feature::Color, Quantity::Value);
const ALBEDO: Key = (Feature::Texture, Quantity::Value);
const NORMAL: Key = (Feature::Normal, Quantity::Value);

/// What is wrong with the pixel.
type Fault = (&'static str, Option<(Key, f32)>);
const FAULTS: [Fault; 6] = [
    ("nothing", None),
    ("+Inf in the colour", Some((COLOR, f32::INFINITY))),
    ("NaN in the colour", Some((COLOR, f32::NAN))),
    ("1e6 in the colour", Some((COLOR, 1e6))),
    ("+Inf in the albedo", Some((ALBEDO, f32::INFINITY))),
    ("NaN in the albedo", Some((ALBEDO, f32::NAN))),
];

/// How many of them come before those in the albedo.
const OF_COLOR: usize = 4;

/// A pixel's change that counts, as a share of it.
const CHANGE: f32 = 1e-3;

type Denoise<'a> = Box<dyn Fn(&RawScene) -> Result<Image, Box<dyn Error>> + 'a>;

fn main() -> Result<(), Box<dyn Error>> {
    let (mut folder, mut oidn) = (PathBuf::from("data/test/courtyard"), None);
    let mut arguments = std::env::args().skip(1);
    while let Some(option) = arguments.next() {
        let value = arguments.next().ok_or(format!("`{option}` needs a value"))?;
        match option.as_str() {
            "--scene" => folder = value.into(),
            "--oidn" => oidn = Some(PathBuf::from(value)),
            other => return Err(format!("`{other}` is neither --scene nor --oidn").into()),
        }
    }
    let files = tamis::scene::discover(&[folder])?;
    let SceneFiles { noisy, reference, .. } = files.first().ok_or("no scene")?;
    let raw = RawScene::read(noisy, &Needs::everything(), &LoadOptions::default())?;
    let reference = load_reference(reference)?;

    let filter = shipped::best();
    let mut denoisers: Vec<(String, Denoise<'_>, &[Fault])> = Vec::new();
    // The clean scene has nothing to be left in.
    let ways = [(Repair::Median, "", &FAULTS[..]), (Repair::None, " --repair none", &FAULTS[1..])];
    for (repair, title, faults) in ways {
        let options = LoadOptions { repair, ..LoadOptions::default() };
        let filter = &filter;
        let run = move |raw: &RawScene| tamis(raw, filter, &options);
        denoisers.push((format!("{}{title}", filter.name), Box::new(run), faults));
    }
    if let Some(program) = &oidn {
        let ways = [
            (false, "oidn: colour", &FAULTS[..OF_COLOR]),
            (true, "oidn: +albedo, normal", &FAULTS[..]),
        ];
        for (guides, title, faults) in ways {
            let run = move |raw: &RawScene| open_image_denoise(raw, program, guides);
            denoisers.push((title.to_owned(), Box::new(run), faults));
        }
    }

    let place = raw.height / 2 * raw.width + raw.width / 2;
    println!(
        "{}, {}x{} pixels, the one at ({}, {})\n",
        raw.name,
        raw.width,
        raw.height,
        raw.width / 2,
        raw.height / 2
    );
    let mut table = Table::new([
        ("denoiser", Align::Left),
        ("wrong with one pixel", Align::Left),
        ("pixels changed", Align::Right),
        ("no numbers", Align::Right),
        ("RelMSE", Align::Right),
    ]);
    for (title, denoise, faults) in &denoisers {
        let clean = denoise(&raw)?;
        for &(what, fault) in *faults {
            let mut raw = raw.clone();
            if let Some((key, value)) = fault {
                let components = raw.features.get_mut(&key).ok_or("the scene lacks it")?;
                components.iter_mut().for_each(|component| component[place] = value);
            }
            let result = denoise(&raw)?;
            let (changed, broken) = compare(&result, &clean);
            table.row([
                title.clone(),
                what.to_owned(),
                number::count(changed),
                number::count(broken),
                number::error(Metrics::of(&result, &reference)?.rel_mse),
            ]);
        }
    }
    print!("{}", table.render(Format::Markdown));
    Ok(())
}

/// How many pixels differ from those of a clean image, and how many are no numbers.
fn compare(image: &Image, clean: &Image) -> (usize, usize) {
    let (image, clean) = (image.rgb(), clean.rgb());
    let pixels = || 0..clean[0].len();
    let is_broken = |k: &usize| image.iter().any(|channel| !channel[*k].is_finite());
    let is_changed = |k: &usize| {
        let channels = || image.iter().zip(&clean);
        is_broken(k) || channels().any(|(a, b)| (a[*k] - b[*k]).abs() > CHANGE * b[*k].abs())
    };
    (pixels().filter(is_changed).count(), pixels().filter(is_broken).count())
}

fn tamis(raw: &RawScene, filter: &Filter, options: &LoadOptions) -> Result<Image, Box<dyn Error>> {
    let checked = filter.check()?;
    let scene = raw.clone().prepare(&checked.needs(), checked.reach(), options)?;
    let plan = Plan::of(&checked, &Facts::of(&scene), Passes::ALL)?;
    let filtered = Jit::new()?.compile(&plan)?.run(&scene, &[Rect::whole(&scene)])?.swap_remove(0);
    let rgb = [0, 1, 2].map(|c| filtered.pixels.iter().map(|pixel| pixel[c]).collect());
    Ok(Image::new(&raw.name, raw.width, raw.height, rgb).ok_or("one colour per pixel")?)
}

fn open_image_denoise(
    raw: &RawScene,
    program: &Path,
    guides: bool,
) -> Result<Image, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let mut command = Command::new(program);
    let given = [("--hdr", COLOR), ("--alb", ALBEDO), ("--nrm", NORMAL)];
    for (option, key) in given.into_iter().take(if guides { 3 } else { 1 }) {
        let [r, g, b] = raw.features.get(&key).ok_or("the scene lacks it")?.as_slice() else {
            return Err("three components are needed".into());
        };
        let path = folder.path().join(format!("{}.pfm", option.trim_start_matches('-')));
        fs::write(&path, pfm::write((raw.width, raw.height), [r, g, b]))?;
        command.arg(option).arg(path);
    }
    let output = folder.path().join("out.pfm");
    let done = command.arg("-o").arg(&output).output();
    let done = done.map_err(|error| format!("{}: {error}", program.display()))?;
    if !done.status.success() {
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        return Err(format!("{}: {}\n{said}", program.display(), done.status).into());
    }
    let pfm = pfm::read(&fs::read(&output)?)?;
    let channels = pfm.channels.try_into().map_err(|_| "three channels are expected")?;
    Ok(Image::new(&raw.name, raw.width, raw.height, channels).ok_or("one colour per pixel")?)
}
