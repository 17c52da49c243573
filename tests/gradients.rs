//! Gradients of programs by their constants: machine code and interpreter against central
//! differences of the exact meaning, in f64.

#[path = "fixture/mod.rs"]
mod fixture;
#[path = "fixture/programs.rs"]
mod programs;

use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tamis::backend::reference::meaning;
use tamis::backend::{Differentiator, Interpreter, Workspace};
use tamis::expr::op::{Form, Op};
use tamis::filter::Filter;
use tamis::plan::{Gradient, PASSES, Passes};
use tamis::scene::{Facts, Scene};

fn parse(text: &str) -> Filter {
    Filter::parse(text, Path::new("test.toml")).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

/// What every colour counts for in the loss, which is their weighted sum.
fn shares(scene: &Scene) -> Vec<[f32; 3]> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let pixels = scene.layout().pixels();
    (0..pixels).map(|_| [(); 3].map(|()| rng.random_range(-1.0..1.0))).collect()
}

fn gradient(filter: &Filter, scene: &Scene, passes: Passes) -> Gradient {
    let checked = filter.check().expect("parsed filters make sense");
    Gradient::new(&checked, &Facts::of(scene), passes).expect("the scene has every feature")
}

/// The loss and its derivatives by every constant.
fn computed(
    engine: &dyn Differentiator,
    gradient: &Gradient,
    scene: &Scene,
    constants: &[f32],
) -> (f64, Vec<f64>) {
    let code = engine.differentiate(gradient).expect("it compiles");
    let shares = shares(scene);
    let mut loss = |colors: &[[f32; 3]], owed: &mut [[f32; 3]]| {
        owed.copy_from_slice(&shares);
        let products = colors.iter().flatten().zip(shares.iter().flatten());
        products.map(|(&x, &share)| f64::from(x) * f64::from(share)).sum()
    };
    let mut workspace = Workspace::default();
    // What the first run leaves to the second changes nothing.
    let runs = [(), ()].map(|()| {
        let mut derivatives = vec![0.0; constants.len()];
        let lost = code.run(scene, constants, &mut loss, &mut workspace, &mut derivatives);
        (lost.expect("it runs"), derivatives)
    });
    let [first, second] = runs;
    assert_eq!(first, second);
    second
}

/// The exact loss with these constants, and the sum of its terms' magnitudes.
fn exact(filter: &Filter, scene: &Scene, constants: &[f32]) -> (f64, f64) {
    let mut filter = filter.clone();
    filter.constants.set_values(constants);
    let checked = filter.check().expect("steps are small");
    let exposure = f64::from(scene.normalization().exposure);
    let shares = shares(scene);
    let pixels = meaning::of(scene, &checked).pixels;
    let terms = pixels.iter().zip(&shares).flat_map(|(pixel, shares)| {
        (0..3).map(move |k| pixel.color[k] / exposure * f64::from(shares[k]))
    });
    terms.fold((0.0, 0.0), |(sum, size), x| (sum + x, size + x.abs()))
}

/// The derivative by a constant, or nothing where the quotients to the left and to the right
/// disagree: at kinks, jumps, and where an adjoint overflows.
fn quotient(filter: &Filter, scene: &Scene, constants: &[f32], k: usize) -> Option<f64> {
    let x = constants[k];
    let step = (x.abs().max(0.25) * (-14.0_f32).exp2()).max(f32::MIN_POSITIVE);
    let at = |x: f32| {
        let mut moved = constants.to_vec();
        moved[k] = x;
        exact(filter, scene, &moved)
    };
    let (low, high) = (x - step, x + step);
    let ((f, size), (left, _), (right, _)) = (at(x), at(low), at(high));
    let [below, above] = [(f - left) / f64::from(x - low), (right - f) / f64::from(high - x)];
    let quotient = 0.5 * (below + above);
    let noise = size * (-48.0_f64).exp2() / f64::from(step);
    let smooth = (below - above).abs() <= 2e-3 * quotient.abs() + noise + 1e-4 * size;
    smooth.then_some(quotient)
}

/// Compares the derivatives by all constants. Returns how many were compared, how many are
/// not 0, and the greatest error, relative to the derivative or to a hundredth of the loss.
fn compare(filter: &Filter, scene: &Scene, derivatives: &[f64]) -> (usize, usize, f64) {
    let constants = filter.constants.values();
    let (_, size) = exact(filter, scene, &constants);
    let (mut compared, mut moving, mut worst) = (0, 0, 0.0f64);
    for (k, &got) in derivatives.iter().enumerate() {
        let Some(expected) = quotient(filter, scene, &constants, k) else { continue };
        let error = (got - expected).abs() / (expected.abs() + 0.01 * size + 1e-12);
        assert!(
            error < TOLERATED,
            "constant {k} of {}: {got:e}, not {expected:e}\n{}",
            filter.name,
            filter.to_toml(toml::Table::new())
        );
        worst = worst.max(error);
        compared += 1;
        moving += usize::from(expected.abs() > 1e-6 * size);
    }
    (compared, moving, worst)
}

/// Single precision, and sums over hundreds of pairs that cancel.
const TOLERATED: f64 = 1e-4;

#[test]
fn the_gradient_of_a_program_is_that_of_its_meaning() {
    let filter = parse(programs::SAMPLE);
    let constants = filter.constants.values();
    for (width, height) in [(23, 14), (1, 1), (5, 30)] {
        let scene = fixture::scene(width, height, 3);
        let gradient = gradient(&filter, &scene, Passes::ALL);
        let (_, derivatives) = computed(&Interpreter, &gradient, &scene, &constants);
        let (compared, moving, worst) = compare(&filter, &scene, &derivatives);
        println!("{width}x{height}: {compared} compared, {moving} moving, {worst:e}");
        if width > 1 {
            assert!(compared >= 8 && moving >= 6, "{compared} compared, {moving} moving");
        }
    }
}

#[test]
fn gradients_of_random_programs_are_those_of_their_meanings() {
    let (mut all, mut nonzero, mut worst) = (0, 0, 0.0f64);
    for seed in 0..90 {
        let filter = parse(&programs::random(seed, 1 + seed as usize % 12));
        let scene = fixture::scene(13, 11, seed % 3);
        let gradient = gradient(&filter, &scene, Passes::ALL);
        let constants = filter.constants.values();
        let (_, derivatives) = computed(&Interpreter, &gradient, &scene, &constants);
        let (compared, moving, error) = compare(&filter, &scene, &derivatives);
        all += compared;
        nonzero += moving;
        worst = worst.max(error);
    }
    println!("{all} compared, {nonzero} moving, {worst:e}");
    assert!(all > 700 && nonzero > 150, "{all} compared, {nonzero} not 0");
}

/// Every operator, in a map and in a weight, of what hangs on constants.
#[test]
fn gradients_pass_through_every_operator() {
    let scene = fixture::scene(13, 11, 2);
    for op in Op::ALL {
        let name = op.name();
        let apply = |x: &str, y: &str| match op.row().form {
            Form::Unary(_) => format!("{name}({x})"),
            Form::Vectors(_) => format!("{name}({x}, {y})"),
            Form::Binary(_) if name.chars().all(char::is_alphanumeric) => {
                format!("{name}({x}, {y})")
            }
            Form::Binary(_) => format!("({x}) {name} ({y})"),
        };
        // Within the domain of every function, and away from most kinks.
        let map = apply("k * albedo + 0.05", "q * normal + 0.3");
        let weight = match op.row().form {
            Form::Vectors(_) => apply("k * first", "q * first"),
            Form::Unary(_) | Form::Binary(_) => {
                apply("k * abs(base[i] - base[j]) + 0.1", "q * base[j] + 0.2")
            }
        };
        let text = format!(
            "version = 2\nname = \"{}\"\n\n[params]\nk = 0.6\nq = 0.4\nr = 1.2\n\n\
             [[stage]]\nname = \"first\"\nmap = \"join(albedo[0] * r, k * normal[1], depth)\"\n\n\
             [[stage]]\nname = \"base\"\nmap = \"mean({map})\"\n\n\
             [[stage]]\nname = \"second\"\ngather = \"color * r + 0.1 * base\"\n\
             weight = \"exp(-abs({weight})) + 0.1\"\nradius = 2\n\n\
             [[stage]]\nname = \"result\"\nmap = \"clamp(second + base * color, 0.3 * k, 2 * r) + 0.1 * q * luminance(second)\"\n",
            op.row().name.replace(['*', '/', '+', '-'], "arithmetic")
        );
        let filter = parse(&text);
        let gradient = gradient(&filter, &scene, Passes::ALL);
        let constants = filter.constants.values();
        let (_, derivatives) = computed(&Interpreter, &gradient, &scene, &constants);
        let (compared, _, worst) = compare(&filter, &scene, &derivatives);
        println!("{op:?}: {compared} compared, {worst:e}");
        assert!(compared >= 2, "{op:?}: {compared} compared");
    }
}

#[cfg(feature = "jit")]
#[test]
fn machine_code_gives_the_bits_of_the_interpreter() {
    use tamis::backend::{Jit, Width};
    let widths = [Width::Bits128, Width::Bits256, Width::Bits512];
    let jits: Vec<Jit> =
        widths.into_iter().filter_map(|width| Jit::with_width(width).ok()).collect();
    let scene = fixture::scene(37, 21, 3);
    let random = (0..40).map(|seed| parse(&programs::random(seed, 1 + seed as usize % 12)));
    for filter in random.chain([parse(programs::SAMPLE)]) {
        let gradient = gradient(&filter, &scene, Passes::ALL);
        let constants = filter.constants.values();
        let expected = computed(&Interpreter, &gradient, &scene, &constants);
        for jit in &jits {
            let got = computed(jit, &gradient, &scene, &constants);
            assert_eq!(got, expected, "{} by {:?}", filter.name, jit.width());
        }
    }
}

/// Code that was compiled once serves any values of the constants.
#[test]
fn constants_are_given_when_the_code_runs() {
    let scene = fixture::scene(19, 13, 5);
    let filter = parse(programs::SAMPLE);
    let gradient = gradient(&filter, &scene, Passes::ALL);
    let values = filter.constants.values();
    let moved: Vec<f32> = values.iter().map(|x| x * 1.25).collect();
    let mut other = filter.clone();
    other.constants.set_values(&moved);
    let own = self::gradient(&other, &scene, Passes::ALL);
    let [given, own] =
        [gradient, own].map(|gradient| computed(&Interpreter, &gradient, &scene, &moved));
    assert_eq!(given, own);
    let (lost, _) = exact(&filter, &scene, &moved);
    assert!((given.0 - lost).abs() < 1e-4 * (1.0 + lost.abs()), "{} and {lost}", given.0);
}

#[test]
fn passes_change_gradients_by_no_more_than_rounding() {
    let scene = fixture::scene(17, 12, 6);
    for filter in [parse(programs::SAMPLE), parse(&programs::random(7, 8))] {
        let constants = filter.constants.values();
        let without = |name: &str| Passes::ALL.without(name).expect("a pass");
        let all = PASSES.iter().map(|row| without(row.name)).chain([Passes::NONE]);
        for passes in all {
            let gradient = gradient(&filter, &scene, passes);
            let (_, derivatives) = computed(&Interpreter, &gradient, &scene, &constants);
            compare(&filter, &scene, &derivatives);
        }
    }
}

/// Every stage and every place beside a pixel takes planes of its own.
#[test]
fn a_program_of_hundreds_of_stages_has_a_gradient() {
    let mut text = String::from("version = 2\nname = \"long\"\n[params]\nk = 0.1\n");
    for stage in 0..400 {
        let last = if stage == 0 { "color".to_owned() } else { format!("s{}", stage - 1) };
        text += &format!("[[stage]]\nname = \"s{stage}\"\n");
        text += &match stage % 10 {
            0 => format!(
                "gather = \"{last}\"\nweight = \"exp(-0.1 * k * distance2({last}, {last}))\"\nradius = 1\n"
            ),
            _ => format!(
                "map = \"(1 - 0.1 * k) * {last} + 0.1 * k * ({last}[1, 0] + {last}[0, -1]) / 2\"\n"
            ),
        };
    }
    let (filter, scene) = (parse(&text), fixture::scene(7, 5, 4));
    let gradient = gradient(&filter, &scene, Passes::ALL);
    let constants = filter.constants.values();
    let (_, derivatives) = computed(&Interpreter, &gradient, &scene, &constants);
    let (compared, moving, _) = compare(&filter, &scene, &derivatives);
    assert_eq!([compared, moving], [1, 1]);
}
