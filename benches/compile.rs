//! What an expression costs before its first pixel: parsing, planning, and
//! compiling, for every width of vectors that the host has.
//!
//! ```text
//! cargo bench --bench compile
//! ```

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use tamis::backend::{Backend, Interpreter, Jit, Width};
use tamis::expr::{Tree, codebook};
use tamis::filter::Window;
use tamis::plan::{Passes, Plan};
use tamis::scene::{Facts, LoadOptions, Needs, Scene};

fn compile(criterion: &mut Criterion) {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/data/test/courtyard/4spp.exr");
    let scene = Scene::load(path.as_ref(), &Needs::everything(), 10, &LoadOptions::default())
        .expect("the project's own scene");
    let facts = Facts::of(&scene);
    let jits: Vec<Jit> = Width::ALL.into_iter().filter_map(|w| Jit::with_width(w).ok()).collect();
    for known in codebook::known() {
        let text = known.weight.to_string();
        let weights = std::slice::from_ref(&known.weight);
        let plan = || Plan::new(weights, Window::dense(10), &facts, Passes::ALL).expect("a plan");
        let mut group = criterion.benchmark_group(known.name);
        group.bench_function("parse", |b| {
            b.iter(|| black_box(&text).parse::<Tree>().expect("it was printed"));
        });
        group.bench_function("plan", |b| b.iter(plan));
        let plan = plan();
        group.bench_function("interp", |b| b.iter(|| Interpreter.compile(&plan).is_ok()));
        for jit in &jits {
            group.bench_function(format!("jit, {}", jit.width()), |b| {
                b.iter(|| jit.compile(&plan).is_ok());
            });
        }
        group.finish();
    }
}

criterion_group!(benches, compile);
criterion_main!(benches);
