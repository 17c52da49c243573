//! Total meaning: any tree that the grammar can make gives, on any numbers, a finite
//! weight within ±LIMIT; every value lies in the interval that the passes rely on; and
//! passes change what is computed by no more than roundings may. Programs of such formulas
//! give finite colours. (What passes change of their results on ordinary numbers is a matter
//! of `tests/programs`: on these, roundings decide everything.)

mod fixture;
#[path = "fixture/programs.rs"]
mod programs;

use std::collections::BTreeMap;
use std::path::Path;

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tamis::backend::reference::meaning;
use tamis::backend::{Backend, Interpreter, Rect};
use tamis::expr::builder::LIMIT;
use tamis::expr::grammar::{Limits, Vocabulary};
use tamis::expr::interval::Interval;
use tamis::expr::op::Form;
use tamis::expr::tape::{Axis, Input, Instr, Side, Tape};
use tamis::expr::tree::component_pairs;
use tamis::expr::{Feature, PlaneId, Quantity, Symbol, Tree};
use tamis::filter::{Filter, Window};
use tamis::plan::{PASSES, Passes, Plan, Precision, Tapes, WindowPlan};
use tamis::scene::{Fact, Facts, RawScene, Scene};

/// Trees, and pairs of pixels that each is evaluated for.
const TREES: u64 = 5000;
const PAIRS: usize = 24;

/// Programs, each of which filters four scenes in all ways.
const PROGRAMS: u64 = 60;

/// What arithmetic trips over: zeros, subnormals, ends of the range, equal values.
const EXTREMES: [f32; 14] = [
    0.0,
    -0.0,
    1e-45,
    -1e-45,
    f32::MIN_POSITIVE,
    1e-20,
    -1e-18,
    1.0,
    -1.0,
    1e5,
    1e9,
    -1e12,
    LIMIT,
    -LIMIT,
];

fn value(rng: &mut impl Rng) -> f32 {
    match rng.random_range(0..3) {
        0 => EXTREMES[rng.random_range(0..EXTREMES.len())],
        1 => [0.25, 0.5, 1.0, 2.0][rng.random_range(0..4)],
        _ => rng.random_range(-2.0..2.0),
    }
}

/// What a scene may be like: planes of one value, of some range, of any.
fn facts(rng: &mut impl Rng) -> BTreeMap<PlaneId, Fact> {
    let planes = Feature::terms().flat_map(|(feature, quantity)| PlaneId::of(feature, quantity));
    let fact = |plane: PlaneId| {
        let least = match plane.quantity {
            Quantity::Value => -LIMIT,
            Quantity::Gradient | Quantity::Variance => 0.0,
        };
        let mut end = || value(rng).max(least);
        let (a, b) = (end(), end());
        (
            plane,
            match rng.random_range(0..3) {
                _ if !plane.feature.is_stored() => Fact::Range(Interval::new(0.0, 4096.0)),
                0 => Fact::Constant(a),
                1 => Fact::Range(Interval::new(a.min(b), a.max(b))),
                _ => Fact::Range(Interval::new(least, LIMIT)),
            },
        )
    };
    planes.map(fact).collect()
}

/// Two pixels: what planes hold at them, and from the first to the second.
struct Pair {
    planes: BTreeMap<(PlaneId, Side), f32>,
    offset: [f32; 2],
}

impl Pair {
    fn new(facts: &BTreeMap<PlaneId, Fact>, window: Window, rng: &mut impl Rng) -> Self {
        let reach = window.reach() as i32;
        let offset = [0, 1].map(|_| rng.random_range(-reach..=reach) as f32);
        let mut planes = BTreeMap::new();
        let alike = rng.random_range(0..4) == 0;
        for (&plane, fact) in facts {
            let range = fact.interval();
            let mut inside = || match rng.random_range(0..4) {
                0 => range.lo,
                1 => range.hi,
                _ => value(rng).clamp(range.lo, range.hi),
            };
            let (i, mut j) = (inside(), inside());
            if alike {
                j = i;
            }
            let (i, j) = match plane.feature {
                Feature::Pixel => {
                    let i = 2048.0;
                    (i, i + offset[usize::from(plane.component)])
                }
                _ => (i, j),
            };
            planes.insert((plane, Side::I), i);
            planes.insert((plane, Side::J), j);
        }
        Self { planes, offset }
    }

    fn read(&self, plane: PlaneId, side: Side) -> f32 {
        self.planes[&(plane, side)]
    }

    /// The results of tapes, all of whose values are held to their intervals.
    fn weights(&self, tapes: &Tapes, tree: &Tree) -> Vec<f32> {
        let per_tap = evaluated(&tapes.tap, tree, |input| match input {
            Input::Signal(..) | Input::Constant(_) => panic!("only programs have these"),
            Input::Offset(Axis::X) => self.offset[0],
            Input::Offset(Axis::Y) => self.offset[1],
            other => panic!("{other:?} is not known per tap"),
        });
        let per_pixel = [Side::I, Side::J].map(|pixel| {
            evaluated(&tapes.pixel, tree, |input| match input {
                Input::Plane(plane, Side::I) => self.read(plane, pixel),
                other => panic!("{other:?} is not known per pixel"),
            })
        });
        evaluated(&tapes.pair, tree, |input| match input {
            Input::Plane(plane, side) => self.read(plane, side),
            Input::PerTap(k) => per_tap[k as usize],
            Input::PerPixel(k, Side::I) => per_pixel[0][k as usize],
            Input::PerPixel(k, Side::J) => per_pixel[1][k as usize],
            Input::Signal(..) | Input::Constant(_) => panic!("only programs have these"),
            Input::Offset(Axis::X) => self.offset[0],
            Input::Offset(Axis::Y) => self.offset[1],
        })
    }

    /// What the weight may be if every operation is off by `slack` of its result.
    fn enclosure(&self, tree: &Tree, slack: Slack) -> Interval {
        enum Operand {
            Scalar(Interval),
            Vector(Feature, Quantity),
        }
        let mut stack: Vec<Operand> = Vec::new();
        for &symbol in tree.symbols() {
            let operands = stack.split_off(stack.len() - symbol.arity());
            let range = match (symbol, operands.as_slice()) {
                (Symbol::Const(literal), _) => {
                    Interval::point(literal.value().clamp(-LIMIT, LIMIT))
                }
                (Symbol::Variance(feature), _) => {
                    let plane = PlaneId { feature, quantity: Quantity::Variance, component: 0 };
                    Interval::point(self.read(plane, Side::I))
                }
                (Symbol::Vector(feature), _) => {
                    stack.push(Operand::Vector(feature, Quantity::Value));
                    continue;
                }
                (Symbol::Gradient(feature), _) => {
                    stack.push(Operand::Vector(feature, Quantity::Gradient));
                    continue;
                }
                (
                    Symbol::Stage(_)
                    | Symbol::Param(_)
                    | Symbol::Offset
                    | Symbol::At(_)
                    | Symbol::Part(_)
                    | Symbol::Many(..)
                    | Symbol::Linear(_),
                    _,
                ) => panic!("the paper's grammar makes no {symbol:?}"),
                (Symbol::Op(op), operands) => match (op.row().form, operands) {
                    (Form::Unary(f), [Operand::Scalar(x)]) => (f.range)(*x),
                    (Form::Binary(f), [Operand::Scalar(x), Operand::Scalar(y)]) => {
                        (f.range)(*x, *y)
                    }
                    (Form::Vectors(f), [Operand::Vector(a, p), Operand::Vector(b, q)]) => {
                        let read = |plane: Option<PlaneId>, side| {
                            plane.map_or(0.0, |plane| f64::from(self.read(plane, side)))
                        };
                        let pairs: Vec<(f64, f64)> = component_pairs((*a, *p), (*b, *q))
                            .map(|(x, y)| (read(x, Side::I), read(y, Side::J)))
                            .collect();
                        let exact = (f.meaning)(&pairs);
                        // Products that cancel are off by a part of themselves.
                        let magnitude = if f.differences {
                            exact
                        } else {
                            pairs.iter().map(|(x, y)| (x * y).abs()).sum()
                        };
                        let off = f64::from(slack.relative) * magnitude + f.budget.absolute;
                        Interval::new((exact - off) as f32, (exact + off) as f32)
                    }
                    _ => unreachable!("a tree finds its operands"),
                },
            };
            let range = range.widened(slack.relative, slack.absolute).clamped(-LIMIT, LIMIT);
            stack.push(Operand::Scalar(range));
        }
        match stack.as_slice() {
            [Operand::Scalar(range)] => *range,
            _ => unreachable!("a weight is one scalar"),
        }
    }
}

/// How far an operation may be off.
#[derive(Clone, Copy)]
struct Slack {
    relative: f32,
    absolute: f32,
}

/// Another order of rounding, and flushed subnormals.
const ROUNDING: Slack = Slack { relative: 1e-6, absolute: 2e-38 };

/// A merged exponent rounds at up to 128, and does not flush one factor alone.
const MERGED: Slack = Slack { relative: 2e-5, absolute: 1e-19 };

/// The budget of short functions, and a logarithm that is off by as much.
const SHORT: Slack = Slack { relative: 2e-4, absolute: 1e-19 };

/// All results, after every value has been found where the tape says that it is.
fn evaluated(tape: &Tape, tree: &Tree, mut input: impl FnMut(Input) -> f32) -> Vec<f32> {
    let mut values: Vec<f32> = Vec::with_capacity(tape.instrs().len());
    for (value, instr) in tape.iter() {
        let x = match *instr {
            Instr::Const(bits) => f32::from_bits(bits),
            Instr::Input(which) => input(which),
            Instr::Prim(prim, args) => prim.eval(args.map(|a| values[a.index()])),
        };
        let range = tape.range(value);
        assert!(range.contains(x), "{tree}: {instr:?} is {x:e}, outside of {range:?}");
        values.push(x);
    }
    tape.results().iter().map(|r| values[r.index()]).collect()
}

/// Plans to be compared: with everything, with nothing, with all passes but one, with
/// one alone, and with short functions.
fn ways() -> Vec<(String, Passes)> {
    let mut ways = vec![("all".to_owned(), Passes::ALL), ("none".to_owned(), Passes::NONE)];
    for row in PASSES {
        let without = Passes::ALL.without(row.name).expect("it is listed");
        ways.push((format!("without {}", row.name), without));
        let others = PASSES.iter().filter(|other| other.name != row.name);
        let alone = others
            .fold(Passes::ALL, |passes, other| passes.without(other.name).expect("it is listed"));
        ways.push((format!("{} alone", row.name), alone));
    }
    let fast = |passes| Passes { precision: Precision::Fast, ..passes };
    ways.push(("fast".to_owned(), fast(Passes::ALL)));
    ways.push(("fast, no pass".to_owned(), fast(Passes::NONE)));
    ways
}

fn slack(passes: Passes) -> Slack {
    match passes {
        Passes { precision: Precision::Fast, .. } => SHORT,
        Passes { merge: true, .. } => MERGED,
        _ => ROUNDING,
    }
}

#[test]
fn any_tree_on_any_numbers_is_finite_enclosed_and_the_same_with_every_pass() {
    let vocabulary = Vocabulary::all();
    let ways = ways();
    let exact: Vec<&str> = PASSES.iter().filter(|row| row.exact).map(|row| row.name).collect();
    let known = ["share", "hoist", "support", "symmetry", "inline", "dedupe"];
    assert_eq!(exact, known, "a pass that changes no bit: name it here and in docs/NUMERICS.md");
    let window = Window::dense(5);
    let mut decided = 0;
    for seed in 0..TREES {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let limits = Limits { depth: 2 + (seed % 11) as usize, nodes: 60 };
        let tree = vocabulary.random_tree(&mut rng, limits);
        let facts = facts(&mut rng);
        let known = Facts::from_planes(facts.iter().map(|(&plane, &fact)| (plane, fact)));
        let plans: Vec<WindowPlan> = ways
            .iter()
            .map(|(_, passes)| {
                let weights = std::slice::from_ref(&tree);
                WindowPlan::new(weights, window, &known, *passes).expect("every plane is known")
            })
            .collect();
        for _ in 0..PAIRS {
            let pair = Pair::new(&facts, window, &mut rng);
            let exact = tree.meaning(|plane, side| pair.read(plane, side).into());
            assert!(exact.abs() <= f64::from(LIMIT), "{tree} means {exact:e}");
            let mut with_all = None;
            for ((name, passes), plan) in ways.iter().zip(&plans) {
                let weight = pair.weights(plan.tapes(), &tree)[0];
                assert!(weight.abs() <= LIMIT, "{tree}, {name}: {weight:e}");
                let enclosure = pair.enclosure(&tree, slack(*passes));
                assert!(
                    enclosure.contains(weight),
                    "{tree}, {name}: {weight:e} is not in {enclosure:?}"
                );
                decided += usize::from(enclosure.hi - enclosure.lo <= 1e-3 * enclosure.magnitude());
                let with_all = *with_all.get_or_insert(weight);
                let one_less = name.strip_prefix("without ");
                if one_less.is_some_and(|pass| PASSES.iter().any(|r| r.name == pass && r.exact)) {
                    assert_eq!(weight, with_all, "{tree}, {name}");
                }
                if let Some(mirrored) = plan.mirrored() {
                    let both = pair.weights(mirrored, &tree);
                    assert_eq!(both[0], weight, "{tree}, {name}: for both ends");
                    assert!(both[1].abs() <= LIMIT, "{tree}, {name}, mirrored: {:e}", both[1]);
                }
            }
        }
    }
    // Enclosures that allow anything would prove nothing.
    let compared = TREES as usize * PAIRS * ways.len();
    assert!(decided * 2 > compared, "{decided} of {compared} enclosures are narrow");
}

/// Scenes of such numbers: each sample for itself, planes of one value, nothing but zeros,
/// and an ordinary scene with samples that are no numbers, which are repaired.
fn scenes(rng: &mut ChaCha8Rng) -> Vec<Scene> {
    let (width, height) = (17, 11);
    let with = |sample: &mut dyn FnMut(usize) -> f32| {
        let mut image = || (0..width * height).map(&mut *sample).collect::<Vec<f32>>();
        let mut raw = RawScene::new("extreme", width, height, [0; 3].map(|_| image()));
        for feature in Feature::ALL.into_iter().filter(|feature| feature.is_stored()) {
            if feature != Feature::Color {
                let values = (0..feature.width()).map(|_| image()).collect();
                raw = raw.with(feature, Quantity::Value, values);
            }
            raw = raw.with(feature, Quantity::Variance, vec![image()]);
        }
        fixture::prepare(raw)
    };
    let mut plane = 0.0;
    let constant = with(&mut |k| {
        plane = if k == 0 { value(rng) } else { plane };
        plane
    });
    let mut broken = fixture::raw(width, height, 1);
    for x in broken.features.values_mut().flatten().flatten() {
        if rng.random_range(0..20) == 0 {
            *x = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][rng.random_range(0..3)];
        }
    }
    vec![with(&mut |_| value(rng)), constant, with(&mut |_| 0.0), fixture::prepare(broken)]
}

#[test]
fn any_program_on_any_numbers_is_finite_and_the_same_with_every_exact_pass() {
    let without = |passes: Passes, name: &str| passes.without(name).expect("it is listed");
    // Whether weights are equal, so that they may be summed another way, is what the exact
    // passes find out.
    let together = without(Passes::ALL, "separate");
    let exact = PASSES.iter().filter(|row| row.exact);
    let exact = exact.map(|row| (row.name, true, without(together, row.name)));
    let others = PASSES.iter().filter(|row| !row.exact && row.name != "separate");
    let others = others.map(|row| (row.name, false, without(Passes::ALL, row.name)));
    let fast = Passes { precision: Precision::Fast, ..Passes::ALL };
    let more = [("all", false, Passes::ALL), ("none", false, Passes::NONE), ("fast", false, fast)];
    let ways: Vec<(&str, bool, Passes)> =
        [("separate", true, together)].into_iter().chain(exact).chain(others).chain(more).collect();
    for seed in 0..PROGRAMS {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let text = programs::random(seed, 1 + seed as usize % 12);
        let filter = Filter::parse(&text, Path::new("test.toml")).expect("it makes sense");
        let checked = filter.check().expect("it makes sense");
        for (k, scene) in scenes(&mut rng).iter().enumerate() {
            let exact = meaning::of(scene, &checked).pixels;
            assert!(exact.iter().all(|p| p.color.iter().all(|c| c.is_finite())), "{k}, {text}");
            let mut expected = None;
            for &(name, is_exact, passes) in &ways {
                let schedule = Plan::of(&checked, &Facts::of(scene), passes);
                let schedule = schedule.expect("every feature is there");
                let code = Interpreter.compile(&schedule).expect("always possible");
                let filtered = code.run(scene, &[Rect::whole(scene)]).expect("it runs");
                let pixels = &filtered[0].pixels;
                let finite = pixels.iter().flatten().all(|x| x.is_finite());
                assert!(finite, "scene {k}, {name}, seed {seed}: {text}");
                let expected = expected.get_or_insert_with(|| pixels.clone());
                assert!(!is_exact || pixels == expected, "scene {k}, {name}, seed {seed}: {text}");
            }
        }
    }
}
