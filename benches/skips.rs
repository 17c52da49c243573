//! What each skip saves: every pass of the planner off against all of them on, per
//! test scene, and what it changes in the result.
//!
//! ```text
//! cargo bench --bench skips
//! cargo bench --bench skips -- --filters kan2017 out/best.toml --radius 5 --rounds 7
//! ```
//!
//! Machine code on one thread; all variants of a filter are interleaved, round by
//! round, and medians count. A row sums up the filters (the named and the shipped
//! ones, if none are chosen): times and their ratio are geometric means; of the
//! greatest relative difference of a channel, and of the relative change of
//! RelMSE, it is the greatest. Programs take part if they are named; their windows are
//! their own.
//!
//! `liveness` is no pass but the loader's: its times are those of loading what a
//! filter reads, and of loading everything.

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Parser;
use tamis::backend::{Backend, Executable, Jit, Rect};
use tamis::expr::codebook;
use tamis::filter::{Checked, Filter, Window};
use tamis::image::{Image, Metrics};
use tamis::plan::{PASSES, Passes, Plan};
use tamis::report::{Align, Format, Table, number};
use tamis::scene::{Facts, LoadOptions, Needs, Scene, SceneFiles, discover, load_reference};

/// Skips measured on scenes.
#[derive(Parser)]
struct Arguments {
    /// Names, files or expressions
    #[arg(long, num_args = 1..)]
    filters: Vec<String>,

    /// Folders with scenes
    #[arg(long, num_args = 1.., default_values = [concat!(env!("CARGO_MANIFEST_DIR"), "/data/test")])]
    scenes: Vec<PathBuf>,

    /// The window's
    #[arg(long, default_value_t = Window::DEFAULT_RADIUS)]
    radius: u32,

    /// Measurements of each
    #[arg(long, default_value_t = 5)]
    rounds: usize,

    /// Given by cargo; without it this only checks that the bench runs
    #[arg(long)]
    bench: bool,
}

/// A skip against the same without it, for one filter.
struct Saving {
    on: f64,
    off: f64,
    /// The greatest relative difference of the results.
    difference: f64,
    /// The relative change of RelMSE.
    error: f64,
}

fn main() {
    let mut arguments = Arguments::parse();
    if !arguments.bench {
        (arguments.radius, arguments.rounds) = (1, 1);
        arguments.filters = vec!["gaussian".to_owned()];
    }
    let mut filters: Vec<Filter> = match arguments.filters.as_slice() {
        [] => every_filter(),
        texts => texts.iter().map(|text| filter(text)).collect(),
    };
    for filter in filters.iter_mut().filter(|filter| filter.paper().is_some()) {
        filter.gathers_mut().for_each(|gather| gather.window = Window::dense(arguments.radius));
    }
    let mut scenes = discover(&arguments.scenes).expect("folders with scenes");
    if !arguments.bench {
        scenes.truncate(1);
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread");
    let table = pool.install(|| table(&arguments, &filters, &scenes));
    println!(
        "{}, radius {}, jit, one thread, medians of {}",
        number::plural(filters.len(), "filter"),
        arguments.radius,
        number::plural(arguments.rounds, "interleaved round")
    );
    print!("{}", table.render(Format::Markdown));
}

/// The named filters and those that come with the program and are single weights.
fn every_filter() -> Vec<Filter> {
    let shipped = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/data/filters"));
    let files = shipped.read_dir().expect("the project's own filters");
    let mut files: Vec<PathBuf> = files.map(|file| file.expect("readable").path()).collect();
    files.sort();
    let shipped = files.iter().map(|path| read(path)).filter(|filter| filter.paper().is_some());
    let known = codebook::known().iter();
    known.map(|known| single(known.name, known.weight.clone())).chain(shipped).collect()
}

fn single(name: &str, weight: tamis::expr::Tree) -> Filter {
    Filter::single(name, weight, Window::DEFAULT_RADIUS)
}

fn filter(text: &str) -> Filter {
    let shipped = format!("{}/data/filters/{text}.toml", env!("CARGO_MANIFEST_DIR"));
    let files = [Path::new(text), Path::new(&shipped)];
    let file = files.into_iter().find(|path| path.is_file());
    let parse = || text.parse().unwrap_or_else(|error| panic!("{text}: {error}"));
    let weight = codebook::named(text).cloned();
    match (weight, file) {
        (None, Some(file)) => read(file),
        (weight, _) => single(text, weight.unwrap_or_else(parse)),
    }
}

fn read(path: &Path) -> Filter {
    Filter::read(path).unwrap_or_else(|error| panic!("{error}"))
}

fn checked(filter: &Filter) -> Checked<'_> {
    filter.check().expect("filters that are read make sense")
}

fn table(arguments: &Arguments, filters: &[Filter], scenes: &[SceneFiles]) -> Table {
    let mut table = Table::new([
        ("skip", Align::Left),
        ("scene", Align::Left),
        ("on, ms", Align::Right),
        ("off, ms", Align::Right),
        ("off / on", Align::Right),
        ("difference", Align::Right),
        ("RelMSE", Align::Right),
    ]);
    let mut rows: Vec<(&str, &str, Vec<Saving>)> = Vec::new();
    for name in PASSES.iter().map(|pass| pass.name).chain(["liveness"]) {
        rows.extend(scenes.iter().map(|scene| (name, scene.name.as_str(), Vec::new())));
    }
    for scene in scenes {
        let reference = load_reference(&scene.reference).expect("a reference");
        for filter in filters {
            let passes = passes(arguments, scene, &reference, filter);
            let all = passes.into_iter().chain([liveness(arguments, scene, &reference, filter)]);
            let of_scene = rows.iter_mut().filter(|(_, name, _)| *name == scene.name);
            for ((_, _, savings), saving) in of_scene.zip(all) {
                savings.push(saving);
            }
        }
    }
    for (skip, scene, savings) in rows {
        let mean = |figure: fn(&Saving) -> f64| {
            let logarithms = savings.iter().map(|saving| figure(saving).ln());
            (logarithms.sum::<f64>() / savings.len() as f64).exp()
        };
        let most = |figure: fn(&Saving) -> f64| savings.iter().map(figure).fold(0.0, f64::max);
        table.row([
            skip.to_owned(),
            scene.to_owned(),
            number::milliseconds(mean(|s| s.on)),
            number::milliseconds(mean(|s| s.off)),
            format!("{:.2}", mean(|s| s.off / s.on)),
            small(most(|s| s.difference)),
            small(most(|s| s.error)),
        ]);
    }
    table
}

fn small(x: f64) -> String {
    if x == 0.0 { "0".to_owned() } else { number::difference(x) }
}

/// A saving per pass.
fn passes(
    arguments: &Arguments,
    files: &SceneFiles,
    reference: &Image,
    filter: &Filter,
) -> Vec<Saving> {
    let scene = load(files, filter, &checked(filter).needs());
    let off = PASSES.iter().map(|pass| Passes::ALL.without(pass.name).expect("there is this pass"));
    let codes: Vec<Box<dyn Executable>> =
        [Passes::ALL].into_iter().chain(off).map(|p| compile(&scene, filter, p)).collect();
    let mut times = vec![Vec::new(); codes.len()];
    let mut images = vec![None; codes.len()];
    for _ in 0..arguments.rounds {
        for (k, code) in codes.iter().enumerate() {
            let start = Instant::now();
            let image = run(&**code, &scene);
            times[k].push(milliseconds(start));
            images[k] = Some(image);
        }
    }
    let times: Vec<f64> = times.into_iter().map(median).collect();
    let images: Vec<Image> = images.into_iter().map(|i| i.expect("a round, at least")).collect();
    let rest = times.iter().zip(&images).skip(1);
    rest.map(|(&off, without)| saving((times[0], &images[0]), (off, without), reference)).collect()
}

/// Loading what the filter reads, and all that there is.
fn liveness(
    arguments: &Arguments,
    files: &SceneFiles,
    reference: &Image,
    filter: &Filter,
) -> Saving {
    let choices = [checked(filter).needs(), Needs::everything()];
    let mut times = [Vec::new(), Vec::new()];
    for _ in 0..arguments.rounds {
        for (needs, times) in choices.iter().zip(&mut times) {
            let start = Instant::now();
            black_box(load(files, filter, needs));
            times.push(milliseconds(start));
        }
    }
    let images = choices.map(|needs| {
        let scene = load(files, filter, &needs);
        run(&*compile(&scene, filter, Passes::ALL), &scene)
    });
    let [on, off] = times.map(median);
    saving((on, &images[0]), (off, &images[1]), reference)
}

fn load(files: &SceneFiles, filter: &Filter, needs: &Needs) -> Scene {
    let pad = checked(filter).reach();
    Scene::load(&files.noisy, needs, pad, &LoadOptions::default()).expect("a sound scene")
}

fn compile(scene: &Scene, filter: &Filter, passes: Passes) -> Box<dyn Executable> {
    let schedule = Plan::of(&checked(filter), &Facts::of(scene), passes)
        .expect("the scene has what the filter reads");
    let jit = Jit::new().expect("the host has a code generator");
    jit.compile(&schedule).expect("a plan of moderate size")
}

fn run(code: &dyn Executable, scene: &Scene) -> Image {
    let whole = Rect::whole(scene);
    let filtered = code.run(scene, &[whole]).expect("the plan was made for it").swap_remove(0);
    let rgb = [0, 1, 2].map(|channel| filtered.pixels.iter().map(|c| c[channel]).collect());
    Image::new(scene.name(), whole.width, whole.height, rgb).expect("one colour per pixel")
}

fn saving(on: (f64, &Image), off: (f64, &Image), reference: &Image) -> Saving {
    let pixels = on.1.rgb().into_iter().flatten().zip(off.1.rgb().into_iter().flatten());
    let difference = pixels
        .map(|(&on, &off)| match (on - off).abs() {
            0.0 => 0.0,
            difference => f64::from(difference) / f64::from(on.abs()),
        })
        .fold(0.0, f64::max);
    let error = |image| Metrics::of(image, reference).expect("of one size").rel_mse;
    let (kept, changed) = (error(on.1), error(off.1));
    Saving { on: on.0, off: off.0, difference, error: (changed - kept).abs() / kept }
}

fn milliseconds(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

fn median(mut samples: Vec<f64>) -> f64 {
    samples.sort_by(f64::total_cmp);
    samples[samples.len() / 2]
}
