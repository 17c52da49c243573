//! Programs of several stages: every back end against every other and the exact meaning.

#[path = "../fixture/mod.rs"]
mod fixture;
#[path = "../fixture/programs.rs"]
mod programs;

use std::path::Path;

use tamis::backend::reference::meaning::{self, Meaning};
use tamis::backend::reference::oracle::Pixel;
use tamis::backend::{Backend, Executable, Filtered, Interpreter, Rect};
use tamis::expr::Feature;
use tamis::filter::{Filter, shipped};
use tamis::plan::{Kernel, PASSES, Passes, Plan, Program};
use tamis::scene::{Facts, LoadOptions, Scene};

fn parse(text: &str) -> Filter {
    Filter::parse(text, Path::new("test.toml")).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

fn schedule(filter: &Filter, scene: &Scene, passes: Passes) -> Plan {
    let checked = filter.check().expect("parsed filters make sense");
    Plan::of(&checked, &Facts::of(scene), passes).expect("the scene has every feature")
}

fn program(filter: &Filter, scene: &Scene, passes: Passes) -> Program {
    match schedule(filter, scene, passes) {
        Plan::Program(program) => *program,
        Plan::Window(_) => panic!("{} is a program", filter.name),
    }
}

fn run(backend: &dyn Backend, schedule: &Plan, scene: &Scene, region: &[Rect]) -> Filtered {
    let code: Box<dyn Executable> = backend.compile(schedule).expect("it compiles");
    code.run(scene, region).expect("it runs").swap_remove(0)
}

fn whole(backend: &dyn Backend, schedule: &Plan, scene: &Scene) -> Filtered {
    run(backend, schedule, scene, &[Rect::whole(scene)])
}

/// The greatest difference from exact, relative to the pixel's colour or the scene's.
fn difference(scene: &Scene, filter: &Filter, filtered: &Filtered) -> f64 {
    difference_from(&exact(scene, filter), filtered)
}

fn exact(scene: &Scene, filter: &Filter) -> Meaning {
    meaning::of(scene, &filter.check().expect("parsed filters make sense"))
}

fn difference_from(exact: &Meaning, filtered: &Filtered) -> f64 {
    let pixels = filtered.pixels.iter().zip(&exact.pixels);
    // Stricter than what is promised: brighter colours around are no excuse.
    let least = [exact.darkest; 3];
    let strict = |pixel: &Pixel| Pixel { least, ..*pixel };
    pixels.map(|(&computed, exact)| strict(exact).difference(computed)).fold(0.0, f64::max)
}

#[cfg(feature = "jit")]
fn machine_code() -> Vec<tamis::backend::Jit> {
    use tamis::backend::{Jit, Width};
    let widths = [Width::Bits128, Width::Bits256, Width::Bits512];
    widths.into_iter().filter_map(|width| Jit::with_width(width).ok()).collect()
}

#[test]
fn a_program_means_the_same_to_everyone() {
    let filter = parse(programs::SAMPLE);
    for (width, height) in [(70, 41), (1, 1), (5, 90)] {
        let scene = fixture::scene(width, height, 3);
        let schedule = schedule(&filter, &scene, Passes::ALL);
        let expected = whole(&Interpreter, &schedule, &scene);
        let difference = difference(&scene, &filter, &expected);
        assert!(difference < 1e-5, "{width}x{height}: {difference:e} from exact");
        // The exact back end gives what is compared with.
        let exact = whole(&tamis::backend::Exact, &schedule, &scene);
        assert!(self::difference(&scene, &filter, &exact) < 1e-7);
        #[cfg(feature = "jit")]
        for jit in machine_code() {
            assert_eq!(whole(&jit, &schedule, &scene), expected, "{:?}", jit.width());
        }
    }
}

#[test]
fn regions_and_threads_change_no_bit() {
    let filter = parse(programs::SAMPLE);
    let scene = fixture::scene(70, 331, 4);
    let schedule = schedule(&filter, &scene, Passes::ALL);
    let expected = whole(&Interpreter, &schedule, &scene);
    let rects =
        [Rect { x: 3, y: 0, width: 60, height: 2 }, Rect { x: 0, y: 99, width: 70, height: 200 }];
    let parts = run(&Interpreter, &schedule, &scene, &rects);
    let pixels = rects.iter().flat_map(|r| {
        (r.y..r.y + r.height).flat_map(move |y| (r.x..r.x + r.width).map(move |x| y * 70 + x))
    });
    assert_eq!(parts.pixels, pixels.map(|k| expected.pixels[k]).collect::<Vec<_>>());
    // Machine code walks the same bands.
    #[cfg(feature = "jit")]
    for jit in machine_code() {
        assert_eq!(run(&jit, &schedule, &scene, &rects), parts, "{:?}", jit.width());
    }
    for threads in [1, 3, 7] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let filtered = pool.install(|| whole(&Interpreter, &schedule, &scene));
        assert_eq!(filtered, expected, "{threads} threads");
    }
}

#[test]
fn exposure_changes_no_bit_but_its_own() {
    let filter = parse(programs::SAMPLE);
    let [one, four] = [1.0, 4.0].map(|light| {
        let scene = fixture::prepare(fixture::raw_with(40, 30, 5, light, &[]));
        whole(&Interpreter, &schedule(&filter, &scene, Passes::ALL), &scene)
    });
    for (a, b) in one.pixels.iter().zip(&four.pixels) {
        assert_eq!(a.map(|x| x * 4.0), *b);
    }
}

#[test]
fn passes_change_no_more_than_rounding() {
    let scene = fixture::scene(48, 33, 6);
    passes_change_little(&parse(programs::SAMPLE), &scene, 1e-5);
    let scene = fixture::scene(19, 15, 6);
    for seed in 0..36 {
        let filter = parse(&programs::random(seed, 1 + seed as usize % 12));
        passes_change_little(&filter, &scene, RANDOM);
    }
}

/// Fails unless a filter is so near to exact with every pass switched off, and the same to
/// the bit without one that is exact. (But for `separate`: whether weights are equal, so that
/// they may be summed another way, is what the exact passes find out.)
fn passes_change_little(filter: &Filter, scene: &Scene, bound: f64) {
    let run = |passes: Passes| whole(&Interpreter, &schedule(filter, scene, passes), scene);
    let without = |passes: Passes, name: &str| passes.without(name).expect("a pass");
    let together = without(Passes::ALL, "separate");
    let expected = run(together);
    for row in PASSES.iter().filter(|row| row.exact) {
        let same = run(without(together, row.name)) == expected;
        assert!(same, "{} without {}", filter.name, row.name);
    }
    let exact = exact(scene, filter);
    let all = PASSES.iter().map(|row| (row.name, without(Passes::ALL, row.name)));
    for (name, passes) in all.chain([("all of them", Passes::NONE)]) {
        let filtered = run(passes);
        let difference = difference_from(&exact, &filtered);
        assert!(difference < bound, "without {name}: {difference:e} from exact");
        #[cfg(feature = "jit")]
        for jit in machine_code() {
            let schedule = schedule(filter, scene, passes);
            assert_eq!(whole(&jit, &schedule, scene), filtered, "{name}, {:?}", jit.width());
        }
    }
}

/// Pictures that are filtered by the weights of the colour, in one pass.
#[test]
fn other_pictures_cost_no_weights_of_their_own() {
    let scene = fixture::scene(48, 33, 8);
    let pixels = scene.layout().pixels();
    let color = scene.noisy().rgb().map(<[f32]>::to_vec);
    let half = color.clone().map(|channel| channel.iter().map(|x| x / 2.0).collect());
    let noise = [7, 8, 9].map(|salt| fixture::noise(pixels, salt));
    let gathers = |program: &Program| {
        program.kernels.iter().filter(|kernel| matches!(kernel, Kernel::Gather(_))).count()
    };
    for filter in shipped::programs() {
        let name = filter.name.clone();
        let alone = program(&filter, &scene, Passes::ALL);
        let carrying = filter.carrying(3).expect("shipped filters carry others");
        let scene = scene.clone().with_pictures(&[half.clone(), noise.clone(), color.clone()]);
        let plan = |passes| {
            Plan::of_pictures(&carrying, &Facts::of(&scene), passes).expect("it has every feature")
        };
        let run = |backend: &dyn Backend, plan: &Plan| {
            let code = backend.compile(plan).expect("it compiles");
            code.run(&scene, &[Rect::whole(&scene)]).expect("it runs")
        };
        let together = plan(Passes::ALL);
        let Plan::Program(shared) = &together else { panic!("{name} is a program") };
        assert_eq!(gathers(shared), gathers(&alone), "{name}");
        let apart = plan(Passes::ALL.without("dedupe").expect("a pass"));
        let Plan::Program(several) = &apart else { panic!("{name} is a program") };
        // Some gathers average no colour.
        assert!(gathers(several) >= gathers(&alone) + 3, "{name}");

        let results = run(&Interpreter, &together);
        assert_eq!(results.len(), 4);
        let own = whole(&Interpreter, &Plan::Program(Box::new(alone)), &scene);
        assert_eq!(results[0].pixels, own.pixels, "{name}: the colour is what it was");
        assert!(run(&Interpreter, &apart) == results, "{name}: dedupe changes no bit");
        #[cfg(feature = "jit")]
        for jit in machine_code() {
            assert!(run(&jit, &together) == results, "{name}, {:?}", jit.width());
        }
        let exact = run(&tamis::backend::Exact, &together);
        for (picture, (results, exact)) in results.iter().zip(&exact).enumerate() {
            let brightest = exact.pixels.as_flattened().iter().fold(0.0f32, |a, b| a.max(b.abs()));
            let pairs = results.pixels.as_flattened().iter().zip(exact.pixels.as_flattened());
            let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst < 1e-5 * brightest, "{name}, picture {picture}: {worst:e}");
        }
        // Half of the light is half of the result, and the light itself all of it.
        for ((own, half), same) in own
            .pixels
            .as_flattened()
            .iter()
            .zip(results[1].pixels.as_flattened())
            .zip(results[3].pixels.as_flattened())
        {
            let near = |a: f32, b: f32| (a - b).abs() <= 1e-5 * (1.0 + b.abs());
            assert!(near(2.0 * half, *own) && near(*same, *own), "{name}: {half} {same} {own}");
        }
    }
}

/// Means that are taken together are told apart where their weights cannot be trusted.
#[test]
fn means_by_one_weight_each_tell_what_they_keep() {
    let text = r#"
version = 2
name = "twice"
[[stage]]
name = "one"
gather = "color"
weight = "0 * distance2(normal, normal)"
radius = 1
[[stage]]
name = "other"
gather = "mean(color)"
weight = "0 * distance2(normal, normal)"
radius = 1
[[stage]]
name = "result"
map = "one + other"
"#;
    let filter = parse(text);
    let scene = fixture::scene(17, 9, 2);
    // Or else there would be nothing to gather.
    let passes = Passes { fold: false, facts: false, ..Passes::ALL };
    let together = program(&filter, &scene, passes);
    let gathers = together.kernels.iter().filter_map(|kernel| match kernel {
        Kernel::Gather(gather) => Some(gather.stages.as_slice()),
        _ => None,
    });
    assert_eq!(gathers.collect::<Vec<_>>(), [[0, 1]]);
    let expected = whole(&Interpreter, &Plan::Program(Box::new(together)), &scene);
    assert_eq!(expected.kept, [17 * 9, 17 * 9, 0]);
    let apart = schedule(&filter, &scene, passes.without("dedupe").expect("a pass"));
    assert_eq!(whole(&Interpreter, &apart, &scene), expected);
    assert_eq!(whole(&tamis::backend::Exact, &apart, &scene).kept, expected.kept);
}

/// What a random program of at most twelve stages is held to.
const RANDOM: f64 = 1e-3;

#[test]
fn random_programs_mean_the_same_to_everyone() {
    let mut scenes = Vec::new();
    for seed in 0..3 {
        scenes.push(fixture::scene(37, 29, seed));
    }
    let (mut gathers, mut mirrored, mut worst) = (0, 0, 0.0f64);
    for seed in 0..144 {
        let text = programs::random(seed, 1 + seed as usize % 12);
        let filter = parse(&text);
        assert_eq!(parse(&filter.to_toml(toml::Table::new())), filter, "{text}");
        let scene = &scenes[seed as usize % scenes.len()];
        let schedule = schedule(&filter, scene, Passes::ALL);
        if let Plan::Program(program) = &schedule {
            for kernel in &program.kernels {
                if let Kernel::Gather(gather) = kernel {
                    gathers += 1;
                    mirrored += usize::from(gather.pairs.mirrored);
                }
            }
        }
        let expected = whole(&Interpreter, &schedule, scene);
        let finite = expected.pixels.iter().flatten().all(|x| x.is_finite());
        assert!(finite, "seed {seed}:\n{text}");
        worst = worst.max(difference(scene, &filter, &expected));
        #[cfg(feature = "jit")]
        for jit in machine_code() {
            assert_eq!(whole(&jit, &schedule, scene), expected, "seed {seed}:\n{text}");
        }
    }
    assert!(gathers > 80 && mirrored > 5, "{gathers} gathers, {mirrored} of them mirrored");
    assert!(worst < RANDOM, "{worst:e} from exact");
}

/// A scene that is loaded with no more than a program says that it reads is enough.
#[test]
fn programs_say_what_they_read_and_how_far_they_look() {
    for stages in [
        // The colour is averaged, and read nowhere else.
        "[[stage]]\nname = \"a\"\ngather = \"color\"\nweight = \"exp(-distance2(normal, normal))\"\n\
         radius = 1\n[[stage]]\nname = \"b\"\nmap = \"a * 2\"\n",
        // Half the resolution looks beside pixels without a window.
        "[[stage]]\nname = \"a\"\ngrid = \"half\"\nmap = \"color\"\n\
         [[stage]]\nname = \"b\"\nmap = \"a * 2\"\n",
    ] {
        let filter = parse(&format!("version = 2\nname = \"x\"\n{stages}"));
        let checked = filter.check().expect("it makes sense");
        let raw = fixture::raw(20, 15, 12);
        let scene = raw.prepare(&checked.needs(), checked.reach(), &LoadOptions::default());
        let scene = scene.expect("a sound scene");
        let filtered = whole(&Interpreter, &schedule(&filter, &scene, Passes::ALL), &scene);
        let difference = difference(&scene, &filter, &filtered);
        assert!(difference < 1e-6, "{difference:e} from exact: {stages}");
    }
}

/// A pixel counts for nothing where it is out of the receptive field, and one pixel further,
/// as gradients are made of neighbours.
#[test]
fn what_is_out_of_the_receptive_field_changes_no_bit() {
    let filters = (0..24).map(|seed| parse(&programs::random(seed, 1 + seed as usize % 8)));
    let (mut within, mut beyond) = (0, 0);
    for filter in filters.chain([parse(programs::SAMPLE)]) {
        let reach = filter.check().expect("it makes sense").receptive_field() + 1;
        let (width, height, [x, y]) = (150, 21, [75, 10]);
        let raw = fixture::raw(width, height, 11);
        let mut other = raw.clone();
        // Not what scales of the whole scene are made of.
        let scales = [Feature::WorldPosition, Feature::Depth];
        let changed =
            other.features.iter_mut().filter(|((feature, _), _)| !scales.contains(feature));
        for component in changed.flat_map(|(_, components)| components) {
            component[y * width + x] *= 1.5;
        }
        let [before, after] = [raw, other].map(fixture::prepare);
        assert_eq!(before.normalization(), after.normalization(), "or everything changes");
        let run =
            |scene: &Scene| whole(&Interpreter, &schedule(&filter, scene, Passes::ALL), scene);
        let pixels = run(&before).pixels.into_iter().zip(run(&after).pixels).enumerate();
        for (k, _) in pixels.filter(|(_, (before, after))| before != after) {
            let far = (k % width).abs_diff(x).max((k / width).abs_diff(y));
            assert!(far <= reach, "{}: {far} pixels away, of {reach}", filter.name);
            within += 1;
        }
        beyond += usize::from(reach < x);
    }
    assert!(within > 100 && beyond > 20, "{within} changed, {beyond} programs look less far");
}

#[test]
fn what_nobody_needs_is_not_computed() {
    let filter = parse(programs::SAMPLE);
    let scene = fixture::scene(20, 20, 7);
    let all = program(&filter, &scene, Passes::ALL);
    let unused = filter.stages.iter().position(|stage| stage.name == "unused").expect("there");
    let gathers = all.kernels.iter().filter_map(|kernel| match kernel {
        Kernel::Gather(gather) => Some(gather.stages[0]),
        _ => None,
    });
    let gathers: Vec<usize> = gathers.collect();
    assert!(!gathers.contains(&unused) && gathers.len() == 3, "{gathers:?}");

    // A stage that is the same everywhere is no kernel, and neither is who averages it.
    let constant = parse(
        "version = 2\nname = \"x\"\n[[stage]]\nname = \"a\"\nmap = \"exp(0) + 1\"\n\
         [[stage]]\nname = \"b\"\ngather = \"a\"\nweight = \"exp(-cVariance[j])\"\nradius = 3\n\
         [[stage]]\nname = \"c\"\nmap = \"color * b\"\n",
    );
    let program = program(&constant, &scene, Passes::ALL);
    assert_eq!(program.kernels.len(), 1, "{:?}", program.kernels);
}

#[test]
fn maps_side_by_side_are_one_kernel() {
    let filter = parse(programs::SAMPLE);
    let scene = fixture::scene(20, 20, 7);
    let maps = |passes: Passes| {
        let program = program(&filter, &scene, passes);
        let maps = program.kernels.iter().filter(|kernel| matches!(kernel, Kernel::Map(_)));
        (maps.count(), program.buffers.len())
    };
    let (together, stored) = maps(Passes::ALL);
    let (apart, all) = maps(Passes::ALL.without("inline").expect("a pass"));
    assert!(together + 2 < apart, "{together} maps, {apart} apart");
    // What only neighbours read is not stored.
    assert!(stored < all, "{stored} planes, {all} apart");
}

/// Every kernel is asked for the rows that those after it look at, and for no others.
#[test]
fn rows_are_needed_as_far_as_windows_reach() {
    use tamis::filter::Grid;
    let filter = parse(
        "version = 2\nname = \"x\"\n[[stage]]\nname = \"a\"\nmap = \"color + color[0, 5]\"\n\
         [[stage]]\nname = \"b\"\ngather = \"a\"\nweight = \"exp(-cVariance[j])\"\nradius = 3\n\
         grid = \"half\"\n\
         [[stage]]\nname = \"c\"\ngather = \"b\"\nweight = \"exp(-depth[j])\"\nradius = 2\n",
    );
    let scene = fixture::scene(20, 90, 7);
    let program = program(&filter, &scene, Passes::ALL);
    let needed = program.needed(40..48, 90);
    let of = |name: &str| {
        let stage = filter.stages.iter().position(|stage| stage.name == name).expect("there");
        let writes =
            |kernel: &Kernel| kernel.writes().iter().any(|p| usize::from(p.stage) == stage);
        needed[program.kernels.iter().position(writes).expect("it is read")].clone()
    };
    assert_eq!(of("c"), 40..48);
    // 38..50 at full resolution are rows 18 to 25 of half of it, of which the windows reach
    // 15 to 28, which are two rows each.
    assert_eq!(of("b"), 18..26);
    assert_eq!(of("a"), 30..58);
    let half = program.kernels.iter().filter(|kernel| kernel.grid() == Grid::Half).count();
    assert!(half > 3, "{half} kernels on the half grid");
    // Of an image, no kernel needs rows that there are not.
    let all = program.needed(0..90, 90);
    for (rows, kernel) in all.iter().zip(&program.kernels) {
        assert_eq!(*rows, 0..kernel.grid().along(90));
    }
}

#[test]
fn something_stands_in_for_features_that_a_file_lacks() {
    let filter = parse(programs::SAMPLE);
    let lacking = [Feature::Depth, Feature::WorldPosition, Feature::DirIllumination];
    let scene = fixture::prepare(fixture::raw_with(30, 20, 8, 1.0, &lacking));
    let schedule_of = |filter: &Filter| schedule(filter, &scene, Passes::ALL);
    let filtered = whole(&Interpreter, &schedule_of(&filter), &scene);
    // The same as a filter that says so itself.
    let text = programs::SAMPLE.replace("direct)\"", "color)\"");
    let text = text.replace("+ distance1(depth, depth)", "");
    let expected = whole(&Interpreter, &schedule_of(&parse(&text)), &scene);
    assert_eq!(filtered, expected);
    let difference = difference(&scene, &filter, &filtered);
    assert!(difference < 1e-5, "{difference:e} from exact");
}

#[test]
fn what_makes_no_sense_is_refused_with_stage_and_place() {
    let message = |stages: &str| {
        let text = format!("version = 2\nname = \"x\"\n[params]\nk = 2\n{stages}");
        match Filter::parse(&text, Path::new("test.toml")) {
            Ok(_) => panic!("{text} makes no sense"),
            Err(error) => error.to_string(),
        }
    };
    let map = |name: &str, map: &str| format!("[[stage]]\nname = \"{name}\"\nmap = \"{map}\"\n");
    let gather = |of: &str, weight: &str| {
        let rest = format!("weight = \"{weight}\"\nradius = 2\n");
        format!("[[stage]]\nname = \"g\"\ngather = \"{of}\"\n{rest}")
    };
    let cases = [
        (map("a", "b") + &map("b", "color"), "stage `b` is not computed yet"),
        (map("a", "a + 1"), "stage `a` is not computed yet"),
        (map("a", "color + pixel"), "`+` does not take 3 components and 2 components"),
        (map("a", "color[j]"), "there is no pixel j"),
        (map("a", "colour"), "did you mean `color`?"),
        (map("a", "color[3]"), "does not take 3 components"),
        (map("a", "clamp(color, 1)"), "`clamp` does not take"),
        (map("color", "color"), "`color` cannot be the name"),
        (map("a", "color") + &map("a", "color"), "`a` cannot be the name"),
        (map("k", "color"), "`k` cannot be the name"),
        (map("a", "k"), "the filter's result must have 3, but has 1"),
        (map("a", "color.variance"), "has no variance"),
        (gather("color", "color"), "the weight must have 1, but has 3"),
        (gather("color", "color[1, 0][0]"), "a weight looks at the pixels i and j alone"),
        (gather("color", "1").replace("radius = 2", "radius = 200"), "at most 128"),
        (gather("color", "1").replace("weight = \"1\"\n", ""), "has no `weight`"),
        (gather("color", "1") + "grid = \"half\"\n", "must be on the full grid"),
        (map("a", "color") + "radius = 3\n", "what only gathers have"),
        (map("a", "color") + "[absent]\nnormals = 0\n", "`normals` is no feature"),
        (map("a", "color") + "[absent]\nalbedo = 0\ntexture = 1\n", "named twice"),
        (map("a", "\u{a0}exp(1, 2)"), "`exp` takes 1 operand"),
    ];
    for (stages, expected) in cases {
        let message = message(&stages);
        assert!(message.contains("test.toml") && message.contains(expected), "{stages}{message}");
    }
    let out_of_bounds = "version = 2\nname = \"x\"\n[params]\nk = { value = 3, max = 2 }\n"
        .to_owned()
        + &map("a", "k * color");
    let error = Filter::parse(&out_of_bounds, Path::new("test.toml")).expect_err("3 > 2");
    assert!(error.to_string().contains("constant `k` is 3"), "{error}");
}

#[test]
fn a_program_refuses_scenes_of_which_its_facts_do_not_hold() {
    use tamis::backend::BackendError;
    let filter = parse(
        "version = 2\nname = \"x\"\n[absent]\ndepth = 0\n[[stage]]\nname = \"a\"\n\
         map = \"color * (1 + secondaryAlbedo + depth)\"\n",
    );
    let varied = fixture::scene(9, 9, 1);
    let brighter = fixture::prepare(fixture::raw_with(9, 9, 2, 1.0, &[]));
    let without = fixture::prepare(fixture::raw_with(9, 9, 1, 1.0, &[Feature::SecTexture]));
    let code = Interpreter.compile(&schedule(&filter, &varied, Passes::ALL)).expect("compiles");
    let run = |scene: &Scene| code.run(scene, &[Rect::whole(scene)]).map(|_| ());
    assert!(run(&varied).is_ok());
    assert!(matches!(run(&brighter), Err(BackendError::Unlike { .. })));
    assert!(matches!(run(&without), Err(BackendError::NotLoaded(_))));
}

/// Constants by the thousand parse, compile and print, and a layer is a matrix product.
#[test]
fn layers_of_thousands_of_constants_work() {
    let (inputs, units, outputs) = (36, 120, 12);
    let number = |k: usize| ((k * 7919) % 2003) as f32 / 20030.0 - 0.05;
    let block = |name: &str, rows: usize, columns: usize| {
        let row = |r: usize| {
            let numbers = (0..columns).map(|c| number(r * columns + c).to_string());
            format!("[{}]", numbers.collect::<Vec<_>>().join(", "))
        };
        let rows_text = (0..rows).map(row).collect::<Vec<_>>().join(", ");
        let bias = (0..rows).map(|r| number(r).to_string()).collect::<Vec<_>>().join(", ");
        format!("[layers.{name}]\nweights = [{rows_text}]\nbias = [{bias}]\n")
    };
    let statistics = (0..inputs / 3).map(|k| format!("color[{}, 0]", k as i32 - 6));
    let statistics = statistics.collect::<Vec<_>>().join(", ");
    let text = format!(
        "version = 2\nname = \"x\"\n{}{}[[stage]]\nname = \"a\"\n\
         map = \"w2(leaky(w1(join({statistics}))))\"\n\
         [[stage]]\nname = \"b\"\nmap = \"color * exp(join(a[0], a[5], a[11]))\"\n",
        block("w1", units, inputs),
        block("w2", outputs, units),
    );
    let filter = parse(&text);
    let constants = filter.constants.layers.iter().map(|l| l.rows() * (l.columns() + 1));
    assert!(constants.sum::<usize>() > 5_000);
    assert_eq!(parse(&filter.to_toml(toml::Table::new())), filter);
    let shown = tamis::filter::show(&filter.check().expect("it makes sense"));
    assert!(shown.contains("w1: 36 -> 120, weights 120x36"), "{shown}");
    let scene = fixture::scene(23, 11, 9);
    let schedule = schedule(&filter, &scene, Passes::ALL);
    let expected = whole(&Interpreter, &schedule, &scene);
    let difference = difference(&scene, &filter, &expected);
    assert!(difference < 1e-5, "{difference:e} from exact");
    #[cfg(feature = "jit")]
    for jit in machine_code() {
        assert_eq!(whole(&jit, &schedule, &scene), expected, "{:?}", jit.width());
    }
}

/// The shipped programs: on a real render the back ends agree to the bit, and on a small
/// scene, as exact results take minutes for a render, they are near to exact.
#[test]
fn shipped_programs_mean_the_same_to_everyone() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for filter in shipped::programs() {
        let checked = filter.check().expect("shipped filters make sense");
        let file = root.join("data/test/showroom/4spp.exr");
        let scene = Scene::load(&file, &checked.needs(), checked.reach(), &LoadOptions::default());
        let scene = scene.expect("the project's own scene");
        for (scene, small) in [(scene, false), (fixture::scene(48, 40, 10), true)] {
            let schedule = schedule(&filter, &scene, Passes::ALL);
            let expected = whole(&Interpreter, &schedule, &scene);
            #[cfg(feature = "jit")]
            for jit in machine_code() {
                assert_eq!(whole(&jit, &schedule, &scene), expected, "{:?}", jit.width());
            }
            if small {
                let difference = difference(&scene, &filter, &expected);
                println!("{}: {difference:e} from exact", filter.name);
                assert!(difference < 1e-5, "{}: {difference:e} from exact", filter.name);
            }
        }
    }
}
