//! Laws of the paper's fitness, on two of the project's own scenes.

use std::path::Path;

use super::*;
use crate::backend::{Executable, Interpreter};
use crate::evolve::individual::Judgement;
use crate::evolve::materials::Materials;
use crate::evolve::mutation::mutate;
use crate::evolve::race::Bar;
use crate::evolve::settings::Preset;
use crate::expr::tape::Input;
use crate::plan::{Plan, WindowPlan};
use crate::scene::{LoadOptions, Needs, load_reference};
use crate::tune::stream;

const RADIUS: u32 = 3;

/// About two rows of each tile column: enough to tell expressions apart.
const COVERAGE: Coverage = Coverage::Share { share: 0.03, seed: 5 };

fn scenes() -> Vec<TrainingScene> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/train");
    let load = |name| {
        let folder = root.join(name);
        let options = LoadOptions::default();
        let noisy =
            Scene::load(&folder.join("4spp.exr"), &Needs::everything(), RADIUS as usize, &options);
        let reference = load_reference(&folder.join("reference.exr"));
        TrainingScene::new(noisy.unwrap(), reference.unwrap()).unwrap()
    };
    ["study", "meadow"].map(load).into()
}

fn fitness(backend: &dyn Backend) -> ImageFitness<'_> {
    ImageFitness::new(scenes(), Window::dense(RADIUS), COVERAGE, backend)
}

/// Bred expressions, and a brood of each that grows apart from it.
fn bred(count: usize) -> Vec<Tree> {
    let settings = Preset::Weights.settings();
    let materials = Materials::new(&settings).unwrap();
    let fixture = include_str!("../../../tests/fixture/bred.txt");
    let parents: Vec<Tree> = fixture
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| line.parse().unwrap())
        .collect();
    (0..count)
        .map(|k| {
            let mut rng = stream(11, 0, 0, k);
            let generations = k / parents.len();
            (0..generations).fold(parents[k % parents.len()].clone(), |tree, _| {
                mutate(&tree, &materials, &settings, &mut rng)
            })
        })
        .collect()
}

/// Every CPU back end that this build has.
fn backends() -> Vec<Box<dyn Backend>> {
    vec![
        Box::new(Interpreter),
        #[cfg(feature = "jit")]
        Box::new(crate::backend::Jit::new().unwrap()),
    ]
}

#[test]
fn breeding_fast_changes_little_and_full_judgement_nothing() {
    let trees: Vec<Tree> = bred(30);
    let [standard, fast] = Precision::ALL.map(|p| fitness(&Interpreter).breeding_at(p));
    let values = [&standard, &fast].map(|fitness| fitness.evaluate(&trees).unwrap());
    let entrants: Vec<Entrant<'_>> = trees.iter().map(|tree| Entrant { tree, bar: None }).collect();
    let raced = fast.race(&entrants).unwrap();
    let mut different = 0;
    for (k, tree) in trees.iter().enumerate() {
        let [standard, fast] = values.each_ref().map(|values| values[k]);
        assert!((fast - standard).abs() <= 1e-4 * standard, "{fast}, not {standard}: {tree}");
        assert_eq!(raced[k].verdict, Judgement::Full(fast), "{tree}");
        different += usize::from(fast != standard);
    }
    assert!(different > 20, "all but {different} are computed at standard precision");
    let few = &trees[..3];
    assert_eq!(standard.evaluate_full(few).unwrap(), fast.evaluate_full(few).unwrap());
    assert_eq!(standard.report(&trees[0]).unwrap(), fast.report(&trees[0]).unwrap());
    assert_ne!(standard.identity(), fast.identity());
    let passes = Passes { precision: Precision::Fast, uniform: false, ..Passes::ALL };
    let other = fitness(&Interpreter).with_passes(passes);
    assert_eq!(standard.report(&trees[0]).unwrap(), other.report(&trees[0]).unwrap());
}

#[test]
fn company_changes_no_bit() {
    let trees = bred(300);
    let alone = fitness(&Interpreter).together(1).evaluate(&trees).unwrap();
    assert!(alone.iter().filter(|e| e.is_finite()).count() > 200);
    for backend in backends() {
        for together in [2, 7, 64] {
            let values = fitness(&*backend).together(together).evaluate(&trees).unwrap();
            for ((tree, alone), value) in trees.iter().zip(&alone).zip(values) {
                assert_eq!(value.to_bits(), alone.to_bits(), "{together} together: {tree}");
            }
        }
    }
}

/// Compiles plans of a few weights only, and none that reads depth.
struct Limited;

impl Backend for Limited {
    fn name(&self) -> &'static str {
        "limited"
    }

    fn agreement(&self) -> crate::backend::Agreement {
        crate::backend::Agreement::Bits
    }

    fn compile(&self, plan: &Plan) -> Result<Box<dyn Executable>, BackendError> {
        let reads_depth = plan.inputs().iter().any(|p| p.feature == crate::expr::Feature::Depth);
        if reads_depth || weights_of(plan).pair().results().len() > 3 {
            return Err(BackendError::Padding { reach: 1, pad: 0 });
        }
        Interpreter.compile(plan)
    }
}

#[test]
fn one_that_cannot_be_planned_takes_nobody_along() {
    let trees: Vec<Tree> = [
        "exp(-distance2(normal, normal))",
        "normal",
        "exp(-distance2(normal, normal) / 2)",
        "exp(-distance2(texture, texture))",
        "1",
    ]
    .map(|text| text.parse().unwrap())
    .into();
    let expected = fitness(&Interpreter).together(1).evaluate(&trees).unwrap();
    assert_eq!(expected[1], f64::INFINITY);
    assert_eq!(expected.iter().filter(|error| error.is_finite()).count(), 4);
    for together in [1, 2, 3, 5] {
        // What is too much for the back end in company it does alone.
        let values = fitness(&Limited).together(together).evaluate(&trees).unwrap();
        assert_eq!(values, expected, "{together} together");
    }
}

/// Infinite values would be remembered, also in the checkpoint, though next time the
/// back end may well do.
#[test]
fn a_back_end_that_fails_is_an_error_and_no_value() {
    let trees: Vec<Tree> = ["exp(-distance2(normal, normal))", "distance2(depth, depth)", "1"]
        .map(|text| text.parse().unwrap())
        .into();
    let failed = |error: JudgeError| {
        assert!(matches!(error, JudgeError::Backend { backend: "limited", .. }), "{error}");
        assert!(error.to_string().contains("limited"), "{error}");
    };
    let entrants: Vec<Entrant<'_>> = trees.iter().map(|tree| Entrant { tree, bar: None }).collect();
    for together in [1, 3] {
        let limited = fitness(&Limited).together(together);
        failed(limited.evaluate(&trees).unwrap_err());
        failed(limited.evaluate_full(&trees).unwrap_err());
        failed(limited.difference(&trees[1]).unwrap_err());
        failed(limited.report(&trees[1]).unwrap_err());
        let racing = fitness(&Limited).together(together).racing(&racing(1.0), 3);
        failed(racing.race(&entrants).unwrap_err());
        let bar = Bar { tree: &trees[0], fitness: 0.5 };
        let held: Vec<Entrant<'_>> =
            trees.iter().map(|tree| Entrant { tree, bar: Some(bar) }).collect();
        failed(racing.race(&held).unwrap_err());
    }
    assert_eq!(
        fitness(&Interpreter).difference(&"normal".parse().unwrap()).unwrap(),
        f64::INFINITY
    );
}

/// Machine code, from a generator that panics halfway through a plan that reads depth.
#[cfg(feature = "jit")]
struct Panicking(crate::backend::Jit);

#[cfg(feature = "jit")]
impl Backend for Panicking {
    fn name(&self) -> &'static str {
        "panicking"
    }

    fn agreement(&self) -> crate::backend::Agreement {
        self.0.agreement()
    }

    fn compile(&self, plan: &Plan) -> Result<Box<dyn Executable>, BackendError> {
        use tamis_jit::{Body, Compiler, Lanes, WindowSpec};

        struct Halfway;
        impl Body for Halfway {
            fn emit<L: Lanes>(&self, lanes: &mut L) -> Vec<L::F> {
                lanes.constant(1.0);
                panic!("a broken invariant");
            }
        }
        if plan.inputs().iter().any(|p| p.feature == crate::expr::Feature::Depth) {
            let [planes, channels, weights] = [1; 3];
            let (taps, absolute, lone, mirrored) = (0, false, false, false);
            let spec = WindowSpec { planes, taps, channels, weights, absolute, lone, mirrored };
            Compiler::host()?.compile(spec, None, &Halfway)?;
        }
        self.0.compile(plan)
    }
}

#[test]
#[cfg(feature = "jit")]
fn a_panic_in_the_code_generator_is_an_error_that_says_so() {
    let mut trees = bred(12);
    trees.retain(|tree| !tree.to_string().to_lowercase().contains("depth"));
    assert!(trees.len() > 2);
    let expected = fitness(&Interpreter).evaluate(&trees).unwrap();
    let backend = Panicking(crate::backend::Jit::new().unwrap());
    assert_eq!(fitness(&backend).evaluate(&trees).unwrap(), expected);
    trees.insert(1, "distance2(depth, depth)".parse().unwrap());
    let error = fitness(&backend).evaluate(&trees).unwrap_err();
    assert!(error.to_string().contains("a broken invariant"), "{error}");
}

#[test]
fn breeding_on_all_pixels_is_judging_in_full() {
    let trees = bred(10);
    let backend = Interpreter;
    let fitness = ImageFitness::new(scenes(), Window::dense(1), Coverage::Full, &backend);
    assert_eq!(fitness.evaluate(&trees).unwrap(), fitness.evaluate_full(&trees).unwrap());
}

#[test]
fn what_magnifies_rounding_errors_is_found_out() {
    let backend = Interpreter;
    let fitness = fitness(&backend);
    let difference = |text: &str| fitness.difference(&text.parse().unwrap()).unwrap();
    let sound = difference("exp(-distance2(normal, normal) / 0.1)");
    assert!(sound < fitness.tolerance(), "{sound}");
    let unsound = difference("pow(dot(normal, normal), 10000)");
    assert!(unsound > fitness.tolerance(), "{unsound}");
}

/// Races on a quarter and a half of the pixels.
fn racing(deviations: f64) -> Racing {
    Racing { on: true, rungs: vec![0.25, 0.5], bar: 0.5, deviations }
}

/// Races trees against the third best of them; with their fitness.
fn race(judge: &ImageFitness<'_>, trees: &[Tree], values: &[f64]) -> Vec<Ruling> {
    let mut ranked: Vec<usize> = (0..trees.len()).collect();
    ranked.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let bar = Bar { tree: &trees[ranked[2]], fitness: values[ranked[2]] };
    let entrants: Vec<Entrant<'_>> =
        trees.iter().map(|tree| Entrant { tree, bar: Some(bar) }).collect();
    judge.race(&entrants).unwrap()
}

#[test]
fn who_comes_through_a_race_has_the_fitness_of_one_judged_alone() {
    let trees = bred(90);
    let backend = Interpreter;
    for coverage in [COVERAGE, Coverage::Full] {
        let judge = |deviations| {
            ImageFitness::new(scenes(), Window::dense(1), coverage, &backend)
                .racing(&racing(deviations), 3)
        };
        let values = judge(2.0).evaluate(&trees).unwrap();
        let rulings = race(&judge(2.0), &trees, &values);
        let full = rulings.iter().filter(|ruling| ruling.verdict.is_full()).count();
        assert!((3..60).contains(&full), "{full} of {}", trees.len());
        for (ruling, &value) in rulings.iter().zip(&values) {
            if let Judgement::Full(judged) = ruling.verdict {
                assert_eq!(judged.to_bits(), value.to_bits());
            }
        }
        // Held to a bar that nobody can fail, all come through.
        let rulings = race(&judge(1e300), &trees, &values);
        let finite = rulings.iter().zip(&values).filter(|(_, value)| value.is_finite());
        assert!(finite.clone().count() > 60);
        for (ruling, &value) in finite {
            assert_eq!(ruling.verdict, Judgement::Full(value));
        }
    }
}

#[test]
fn a_verdict_depends_on_neither_company_nor_memory() {
    let trees = bred(60);
    let backend = Interpreter;
    let judge = || fitness(&backend).racing(&racing(1.0), 3);
    let values = judge().evaluate(&trees).unwrap();
    let cold = race(&judge(), &trees, &values);
    assert!(cold.iter().any(|ruling| !ruling.verdict.is_full()));
    // One that has judged the bar in full remembers how it did on each tile.
    let warm = judge();
    let unheld: Vec<Entrant<'_>> = trees.iter().map(|tree| Entrant { tree, bar: None }).collect();
    let full: Vec<f64> = warm.race(&unheld).unwrap().iter().map(|r| r.verdict.value()).collect();
    assert_eq!(full, values);
    assert_eq!(race(&warm, &trees, &values), cold);
    assert_eq!(race(&judge().together(1), &trees, &values), cold);
}

#[test]
fn a_race_on_all_pixels_drops_exactly_who_is_worse() {
    let trees = bred(60);
    let backend = Interpreter;
    let racing = Racing { rungs: vec![0.999_999], ..racing(0.0) };
    let judge = fitness(&backend).racing(&racing, 3);
    let values = judge.evaluate(&trees).unwrap();
    let mut ranked = values.clone();
    ranked.sort_by(f64::total_cmp);
    for (ruling, value) in race(&judge, &trees, &values).iter().zip(values) {
        assert_eq!(ruling.verdict.is_full(), value <= ranked[2], "{value} against {}", ranked[2]);
        let estimate = ruling.verdict.value();
        assert!(estimate == value || (estimate / value - 1.0).abs() < 1e-9, "{estimate} {value}");
    }
}

/// Searches plan weights alone.
fn weights_of(plan: &Plan) -> &WindowPlan {
    plan.window().expect("searches make no programs")
}

/// What a plan computes at one made-up pair of pixels: per weight, its value.
fn weights(plan: &Plan, salt: u32) -> Vec<f32> {
    let sample = |input: Input| {
        let name = format!("{input:?}");
        let hash = name.bytes().fold(salt, |h, b| (h ^ u32::from(b)).wrapping_mul(0x0100_0193));
        let unit = (hash >> 8) as f32 / (1 << 24) as f32;
        if let Input::Offset(_) = input { (unit * 7.0).floor() - 3.0 } else { unit }
    };
    let plan = weights_of(plan);
    let (tap, pixel) = (plan.tap().eval(sample), plan.pixel().eval(sample));
    plan.pair().eval(|input| match input {
        Input::PerTap(k) => tap[k as usize],
        Input::PerPixel(k, _) => pixel[k as usize],
        Input::Plane(..) | Input::Offset(_) | Input::Signal(..) | Input::Constant(_) => {
            sample(input)
        }
    })
}

/// A tape's builder simplifies by what it knows of values, and weights that share
/// values share that knowledge.
#[test]
fn shared_knowledge_changes_no_bit() {
    let settings = Preset::Paper.settings();
    let materials = Materials::new(&settings).unwrap();
    let judge = fitness(&Interpreter);
    for batch in 0..60 {
        let tree = |k: usize| {
            let known = materials.codebook();
            let mut rng = stream(77, 0, batch, k);
            (0..k % 12).fold(known[(batch as usize + k) % known.len()].clone(), |tree, _| {
                mutate(&tree, &materials, &settings, &mut rng)
            })
        };
        let trees: Vec<Tree> = (0..32).map(tree).collect();
        let together = weights(&judge.batching.plan(&trees).unwrap(), batch);
        for (tree, value) in trees.iter().zip(together) {
            let plan = judge.batching.plan(std::slice::from_ref(tree)).unwrap();
            assert_eq!(value.to_bits(), weights(&plan, batch)[0].to_bits(), "{tree}");
        }
    }
}

/// Refused expressions are good for nothing, raced or not, and the others have the
/// values that they have without a restriction.
#[test]
fn a_restriction_keeps_out_whom_it_refuses() {
    let trees = bred(6);
    let refused = trees[2].clone();
    let restriction = || Restriction {
        name: "one less",
        refuses: Box::new(|tree: &Tree| Ok(*tree == refused)),
        objection: Box::new(|tree: &Tree| Ok((*tree == refused).then(|| "refused".to_owned()))),
    };
    let free = fitness(&Interpreter);
    let restricted = fitness(&Interpreter).restricted(restriction());
    assert_ne!(free.identity(), restricted.identity());
    let mut values = free.evaluate(&trees).unwrap();
    values[2] = f64::INFINITY;
    assert_eq!(restricted.evaluate(&trees).unwrap(), values);

    let racing = Preset::Paper.settings().racing;
    let restricted = restricted.racing(&racing, 1);
    let entrants: Vec<Entrant<'_>> = trees.iter().map(|tree| Entrant { tree, bar: None }).collect();
    let rulings = restricted.race(&entrants).unwrap();
    let full = rulings.iter().map(|ruling| ruling.verdict);
    assert!(full.eq(values.into_iter().map(Judgement::Full)), "{rulings:?}");
    assert_eq!(restricted.objection(&trees[2]).unwrap(), Some("refused".to_owned()));
    assert_eq!(restricted.objection(&trees[1]).unwrap(), None);

    let unanswered = fitness(&Interpreter).restricted(Restriction {
        name: "no answer",
        refuses: Box::new(|_| Err("out of order".into())),
        objection: Box::new(|_| Err("out of order".into())),
    });
    assert!(matches!(unanswered.evaluate(&trees), Err(JudgeError::Restriction(_))));
    assert!(matches!(unanswered.objection(&trees[1]), Err(JudgeError::Restriction(_))));
}

/// Runs on another back end, counts the pixels, and raises a flag at a run.
struct Bell {
    runs: std::sync::Arc<Mutex<Vec<usize>>>,
    at: usize,
    flag: std::sync::Arc<std::sync::atomic::AtomicBool>,
}

impl Backend for Bell {
    fn name(&self) -> &'static str {
        "bell"
    }

    fn agreement(&self) -> crate::backend::Agreement {
        crate::backend::Agreement::Bits
    }

    fn compile(&self, plan: &Plan) -> Result<Box<dyn Executable>, BackendError> {
        let (runs, flag) = (self.runs.clone(), self.flag.clone());
        Ok(Box::new(Rung { inner: Interpreter.compile(plan)?, runs, at: self.at, flag }))
    }
}

struct Rung {
    inner: Box<dyn Executable>,
    runs: std::sync::Arc<Mutex<Vec<usize>>>,
    at: usize,
    flag: std::sync::Arc<std::sync::atomic::AtomicBool>,
}

impl Executable for Rung {
    fn run_watched(
        &self,
        scene: &Scene,
        region: &[Rect],
        watch: &crate::backend::Watch<'_>,
    ) -> Result<Vec<crate::backend::Filtered>, BackendError> {
        let mut runs = self.runs.lock().unwrap();
        runs.push(region.iter().map(Rect::pixels).sum());
        if runs.len() == self.at {
            self.flag.store(true, std::sync::atomic::Ordering::Relaxed);
        }
        drop(runs);
        self.inner.run_watched(scene, region, watch)
    }
}

/// Whatever is asked of it: after the flag is up nothing more is filtered, and until then no
/// piece is larger than it may be.
#[test]
fn a_fitness_on_a_back_end_that_can_be_stopped_gives_up_at_once() {
    use crate::backend::Stoppable;
    // A few rows of a scene, for one expression.
    const PIXELS: usize = 2000;
    let trees = bred(8);
    let bar = Bar { tree: &trees[0], fitness: 0.5 };
    let entrants: Vec<Entrant<'_>> =
        trees.iter().map(|tree| Entrant { tree, bar: Some(bar) }).collect();
    type Ask<'t> = (&'t str, Box<dyn Fn(&ImageFitness<'_>) -> Result<(), JudgeError> + Sync + 't>);
    let questions: Vec<Ask<'_>> = vec![
        ("evaluate", Box::new(|judge| judge.evaluate(&trees).map(drop))),
        ("evaluate_full", Box::new(|judge| judge.evaluate_full(&trees[..2]).map(drop))),
        ("race", Box::new(|judge| judge.race(&entrants).map(drop))),
        ("difference", Box::new(|judge| judge.difference(&trees[0]).map(drop))),
    ];
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for (name, ask) in &questions {
        for at in [1, 3] {
            let bell = Bell { runs: Default::default(), at, flag: std::sync::Arc::default() };
            let pairs = PIXELS * (2 * RADIUS as usize + 1).pow(2);
            let backend = Stoppable::new(&bell, bell.flag.clone(), pairs);
            let judge = fitness(&backend).together(1).racing(&racing(1.0), 3);
            let error = pool.install(|| ask(&judge)).expect_err("it was stopped");
            assert!(<ImageFitness<'_> as Fitness>::is_stop(&error), "{name}: {error}");
            let runs = bell.runs.lock().unwrap();
            assert_eq!(runs.len(), at, "{name}: something was run after the flag was up");
            assert!(runs.iter().all(|&pixels| pixels <= 16 * PIXELS), "{name}: {runs:?}");
        }
    }
    let mut free = fitness(&Interpreter);
    free.batching.together = 3;
    let backend = Stoppable::new(&Interpreter, Default::default(), 100_000);
    let stoppable = fitness(&backend).together(3);
    assert_eq!(stoppable.evaluate(&trees).unwrap(), free.evaluate(&trees).unwrap());
    let few = &trees[..2];
    assert_eq!(stoppable.evaluate_full(few).unwrap(), free.evaluate_full(few).unwrap());
    assert_eq!(stoppable.difference(&trees[0]).unwrap(), free.difference(&trees[0]).unwrap());
}

#[test]
fn pictures_are_named_by_their_scenes_and_change_with_their_pixels() {
    let pictures = |scenes| {
        ImageFitness::new(scenes, Window::dense(RADIUS), COVERAGE, &Interpreter).pictures()
    };
    let begun = pictures(scenes());
    let names: Vec<&str> = begun.iter().map(|picture| &*picture.name).collect();
    let noisy = |name: &str| format!("the noisy image of `{name}`");
    assert_eq!(names[0], noisy("study"));
    assert_eq!(names[3], "the reference of `meadow`");
    assert_eq!(begun, pictures(scenes()));

    let mut scenes = scenes();
    let (width, height) = scenes[1].reference.size();
    let mut rgb = scenes[1].reference.rgb().map(<[f32]>::to_vec);
    rgb[2][77] = rgb[2][77].next_up();
    scenes[1].reference = Image::new("reference", width, height, rgb).unwrap();
    let changed = pictures(scenes);
    assert_eq!(Fingerprint::first_changed(&begun, &changed), Some(names[3]));
}
