//! How near the predicted run time of programs is to the clock.
//!
//! ```text
//! cargo bench --bench cost
//! cargo bench --bench cost -- --bred 90 --seed 1          # what plan/cost.rs was fitted to
//! ```
//!
//! Shipped programs and bred ones (chains of mutants, named by their seeds) run on one thread
//! in interleaved rounds, and the least time counts: what else a machine does only adds.
//! Machines differ by a factor, which is taken out; what is left is told program by program. At the end stand the shares that would fit these
//! measurements best: `plan/cost.rs` has those of the machine in `benches/RESULTS.md`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Parser;
use serde_json::{Value, json};
use tamis::backend::{Backend, Executable, Jit, Rect};
use tamis::evolve::programs::{Genome, Settings, seed};
use tamis::filter::{Filter, shipped};
use tamis::plan::{Effort, Passes, Plan, Program};
use tamis::report::{Align, Format, Table};
use tamis::scene::{Facts, LoadOptions, Needs, RawScene, Scene};
use tamis::tune::stream;

/// Predicted run times beside measured ones.
#[derive(Parser)]
struct Arguments {
    /// How many bred programs
    #[arg(long, default_value_t = 30)]
    bred: usize,

    /// Measurements of each
    #[arg(long, default_value_t = 7)]
    rounds: usize,

    /// Names the bred programs
    #[arg(long, default_value_t = 2)]
    seed: u64,

    /// Width and height of the frame
    #[arg(long, default_value = "512x288")]
    size: String,

    /// Where the terms and times of all programs go as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,

    /// Given by cargo; without it this only checks that the bench runs
    #[arg(long)]
    bench: bool,
}

/// A program with what was measured of it.
struct Entry {
    name: String,
    effort: Effort,
    code: Box<dyn Executable>,
    milliseconds: Vec<f64>,
}

fn main() {
    let mut arguments = Arguments::parse();
    if !arguments.bench {
        (arguments.bred, arguments.rounds, arguments.size) = (2, 1, "64x48".to_owned());
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let mut filters: Vec<Filter> = shipped::programs().chain([seed()]).collect();
    filters.extend(bred(&filters, arguments.bred, arguments.seed));
    let scene = frame(&arguments.size, &filters);
    let jit = Jit::new().expect("the host has a code generator");
    let facts = Facts::of(&scene);
    let entry = |filter: &Filter| {
        let checked = filter.check().expect("it makes sense");
        let effort = Program::new(&checked, &facts, Passes::ALL).expect("all is there").effort();
        let plan = Plan::of(&checked, &facts, Passes::ALL).expect("all is there");
        let code = jit.compile(&plan).expect("it compiles");
        Entry { name: filter.name.clone(), effort, code, milliseconds: Vec::new() }
    };
    let mut entries: Vec<Entry> = filters.iter().map(entry).collect();
    for round in 0..=arguments.rounds {
        for entry in &mut entries {
            let start = Instant::now();
            pool.install(|| entry.code.run(&scene, &[Rect::whole(&scene)]).expect("it runs"));
            // The first round makes memory and caches ready.
            if round > 0 || arguments.rounds == 1 {
                entry.milliseconds.push(start.elapsed().as_secs_f64() * 1e3);
            }
        }
    }
    let pixels = (scene.layout().width() * scene.layout().height()) as f64;
    let least = |times: &[f64]| times.iter().copied().fold(f64::INFINITY, f64::min);
    let measured: Vec<f64> =
        entries.iter().map(|entry| least(&entry.milliseconds) * 1e6 / pixels).collect();
    let ratio = |(entry, measured): (&Entry, &f64)| entry.effort.nanoseconds() / measured;
    let mut ratios: Vec<f64> = entries.iter().zip(&measured).map(ratio).collect();
    let factor = median(&mut ratios.clone());
    ratios.iter_mut().for_each(|ratio| *ratio /= factor);
    let mut table = Table::new([
        ("program", Align::Left),
        ("measured, ns/pixel", Align::Right),
        ("predicted", Align::Right),
        ("off by", Align::Right),
    ]);
    for ((entry, measured), ratio) in entries.iter().zip(&measured).zip(&ratios) {
        let predicted = entry.effort.nanoseconds() / factor;
        let off = format!("{:+.0}%", 100.0 * (ratio - 1.0));
        table.row([entry.name.clone(), format!("{measured:.0}"), format!("{predicted:.0}"), off]);
    }
    print!("{}", table.render(Format::Markdown));
    let within = ratios.iter().filter(|&&ratio| (0.8..=1.2).contains(&ratio)).count();
    println!(
        "\n{within} of {} are within 20%, after a factor of {:.2}",
        ratios.len(),
        1.0 / factor
    );
    if let Some(path) = &arguments.json {
        let program = |(entry, &nanoseconds): (&Entry, &f64)| {
            let terms = entry.effort.terms();
            json!({"program": entry.name, "terms": terms, "nanoseconds": nanoseconds})
        };
        let programs: Vec<Value> = entries.iter().zip(&measured).map(program).collect();
        let text = serde_json::to_string_pretty(&programs).expect("numbers and names");
        std::fs::write(path, text + "\n").expect("the file can be written");
    }
    let terms: Vec<Vec<f64>> = entries.iter().map(|e| e.effort.terms().to_vec()).collect();
    println!("shares that fit best: {:.4?}", fitted(&terms, &measured));
}

/// Chains of mutants of other programs, of growing length.
fn bred(from: &[Filter], count: usize, seed: u64) -> Vec<Filter> {
    let features = Settings::quick().vocabulary().expect("they are features");
    let chain = |k: usize| {
        let mut genome = Genome::new(from[k % from.len()].clone()).expect("it makes sense");
        let mut rng = stream(seed, 0, 0, k);
        for _ in 0..3 + k / 2 {
            let admits = |genome: &Genome| {
                let reach = genome.filter().check().expect("genomes make sense").reach();
                reach <= 16 && genome.size() < 4000
            };
            genome = genome.mutant(&features, &mut rng, admits).unwrap_or(genome);
        }
        let name = format!("bred {k}, from {}", from[k % from.len()].name);
        Filter { name, ..genome.filter().clone() }
    };
    (0..count).map(chain).collect()
}

/// A test scene, repeated to a size.
fn frame(size: &str, filters: &[Filter]) -> Scene {
    let (width, height) = size.split_once('x').expect("a size is WIDTHxHEIGHT");
    let [width, height] = [width, height].map(|n| n.parse::<usize>().expect("whole numbers"));
    let file = Path::new("data/test/courtyard/4spp.exr");
    let (needs, options) = (Needs::everything(), LoadOptions::default());
    let mut raw = RawScene::read(file, &needs, &options).expect("a scene of the project's own");
    let (columns, rows) = (raw.width, raw.height);
    for image in raw.features.values_mut().flatten() {
        let repeat = |k: usize| image[(k / width % rows) * columns + k % width % columns];
        *image = (0..width * height).map(repeat).collect();
    }
    (raw.width, raw.height) = (width, height);
    let reach = filters.iter().map(|f| f.check().expect("it makes sense").reach()).max();
    raw.prepare(&needs, reach.unwrap_or(0), &options).expect("a sound scene")
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// The shares, none below zero, by which sums of terms come nearest to what was measured, each
/// program counting alike: one share after another is made the best beside the others.
fn fitted(terms: &[Vec<f64>], measured: &[f64]) -> Vec<f64> {
    let rows: Vec<Vec<f64>> = terms
        .iter()
        .zip(measured)
        .map(|(terms, time)| terms.iter().map(|term| term / time).collect())
        .collect();
    let mut shares = vec![0.0; rows.first().map_or(0, Vec::len)];
    for _ in 0..100_000 {
        for k in 0..shares.len() {
            let rest = |row: &Vec<f64>| {
                let others = row.iter().zip(&shares).enumerate().filter(|&(other, _)| other != k);
                1.0 - others.map(|(_, (term, share))| term * share).sum::<f64>()
            };
            let along: f64 = rows.iter().map(|row| row[k] * rest(row)).sum();
            let square: f64 = rows.iter().map(|row| row[k] * row[k]).sum();
            shares[k] = (along / square.max(1e-300)).max(0.0);
        }
    }
    shares
}
