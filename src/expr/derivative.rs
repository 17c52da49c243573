//! What derivatives of rows are made with, and the promises that they keep.
//!
//! A row's derivative is that of its *meaning*, guards and clamps included: where one of
//! them decides the result, the derivative is 0. It is built from the operands and
//! from the row's own result, so that e^x costs nothing more. Derivatives are total like
//! everything else: finite, and clamped into ±[`LIMIT`].
//!
//! Where a meaning has a kink there is no derivative, and a row takes a value between
//! those on either side:
//!
//! | where | derivative |
//! |---|---|
//! | ends of a clamp, of a guard or of a kernel's support | 0 |
//! | `abs`, and a component's part in `distance1`, at 0 | 0 |
//! | `sqrt` and `log` where they begin, `distance2` at 0 | 0 |
//! | `leaky` at 0 | 1 |
//! | `min` and `max` of equal operands | that of the second operand |
//! | `distanceMax` where several components are greatest | that of the first of them |
//! | `pow` at a base of 0 | 1 for the exponent 1, else 0 |
//!
//! The divisor of a quotient counts as clamped, and `pow` as flat in the exponent, where
//! the base is 0. The sign of a power of a negative base jumps with the exponent; its
//! derivative there is that of the magnitude, with the sign that the power has.

use super::builder::{Builder, LIMIT};
use super::tape::Value;

/// The derivative where |x| is less than the bound, 0 elsewhere: of what clamps x.
pub(crate) fn inside(b: &mut Builder, x: Value, bound: f32, derivative: Value) -> Value {
    let (magnitude, zero) = (b.abs(x), b.constant(0.0));
    b.select_below(magnitude, bound, derivative, zero)
}

/// The derivative where the result is not clamped, 0 elsewhere.
pub(crate) fn unless_limited(b: &mut Builder, result: Value, derivative: Value) -> Value {
    inside(b, result, LIMIT, derivative)
}

/// -1, 0 or 1.
pub(crate) fn sign(b: &mut Builder, x: Value) -> Value {
    let [minus, zero, one] = [-1.0, 0.0, 1.0].map(|c| b.constant(c));
    let positive = b.select_lt(zero, x, one, zero);
    b.select_below(x, 0.0, minus, positive)
}

/// The derivative of an even function from that at |x|.
pub(crate) fn of_even(b: &mut Builder, x: Value, at_magnitude: Value) -> Value {
    let minus = b.neg(at_magnitude);
    b.select_below(x, 0.0, minus, at_magnitude)
}

#[cfg(test)]
mod tests {
    use super::super::builder::Rules;
    use super::super::elementary::suite::{Random, probes};
    use super::super::interval::Interval;
    use super::super::op::{Form, Op};
    use super::super::tape::{Input, Instr, Side, Tape};
    use super::*;

    /// Components of the vectors.
    const COMPONENTS: usize = 3;

    /// Random points per operator.
    const POINTS: usize = 4000;

    /// A derivative agrees with a difference quotient within this of it, or within
    /// [`ABSOLUTE`]: the sum of what `f32` leaves of cancelling terms of about 1, such as
    /// 1 - y^2.
    const RELATIVE: f64 = 1e-3;
    const ABSOLUTE: f64 = 1e-6;

    /// Every operator in all forms.
    fn forms() -> impl Iterator<Item = (Op, Form)> {
        Op::ALL.iter().flat_map(|&op| [(op, op.row().form), (op, op.row().form.short())])
    }

    fn operands(form: Form) -> usize {
        match form {
            Form::Unary(_) => 1,
            Form::Binary(_) => 2,
            Form::Vectors(_) => 2 * COMPONENTS,
        }
    }

    /// The derivatives by every operand; of vectors, those at i before those at j.
    fn tape(form: Form, rules: Rules) -> Tape {
        let mut b = Builder::new(rules);
        let everything = Interval::new(-LIMIT, LIMIT);
        let inputs: Vec<Value> = (0..operands(form))
            .map(|k| b.input(Input::PerPixel(k as u32, Side::I), everything))
            .collect();
        let results = match form {
            Form::Unary(f) => {
                let y = (f.build)(&mut b, inputs[0]);
                vec![(f.derivative)(&mut b, inputs[0], y)]
            }
            Form::Binary(f) => {
                let result = (f.build)(&mut b, inputs[0], inputs[1]);
                (f.derivatives)(&mut b, inputs[0], inputs[1], result).to_vec()
            }
            Form::Vectors(f) => {
                let (at_i, at_j) = inputs.split_at(COMPONENTS);
                let pairs: Vec<_> = at_i.iter().copied().zip(at_j.iter().copied()).collect();
                let result = (f.build)(&mut b, &pairs);
                let (by_i, by_j): (Vec<_>, Vec<_>) =
                    (f.derivatives)(&mut b, &pairs, result).into_iter().unzip();
                [by_i, by_j].concat()
            }
        };
        b.finish(&results)
    }

    fn meaning(form: Form, point: &[f64]) -> f64 {
        match form {
            Form::Unary(f) => (f.meaning)(point[0]),
            Form::Binary(f) => (f.meaning)(point[0], point[1]),
            Form::Vectors(f) => {
                let (at_i, at_j) = point.split_at(COMPONENTS);
                let pairs: Vec<_> = at_i.iter().copied().zip(at_j.iter().copied()).collect();
                (f.meaning)(&pairs)
            }
        }
    }

    /// The derivatives at a point, after every value has been found where the tape says
    /// that it is.
    fn evaluated(tape: &Tape, point: &[f32]) -> Vec<f32> {
        let mut values: Vec<f32> = Vec::with_capacity(tape.instrs().len());
        for (value, instr) in tape.iter() {
            let x = match *instr {
                Instr::Const(bits) => f32::from_bits(bits),
                Instr::Input(Input::PerPixel(k, _)) => point[k as usize],
                Instr::Input(_) => unreachable!("none is made"),
                Instr::Prim(prim, args) => prim.eval(args.map(|a| values[a.index()])),
            };
            let range = tape.range(value);
            assert!(range.contains(x), "{instr:?} is {x:e}, outside of {range:?}, at {point:?}");
            values.push(x);
        }
        tape.results().iter().map(|r| values[r.index()]).collect()
    }

    /// The difference quotient of a meaning by an operand, and how far it may be off: with
    /// the least step in which the meaning's own rounding is lost. There is none at kinks,
    /// where the quotients to the left and to the right disagree.
    fn quotient(form: Form, point: &[f32], k: usize) -> Option<(f64, f64)> {
        let centre: Vec<f64> = point.iter().copied().map(f64::from).collect();
        let at = |x: f64| {
            let mut moved = centre.clone();
            moved[k] = x;
            meaning(form, &moved)
        };
        let x = centre[k];
        let f = at(x);
        // What rounds to the limit counts as clamped; short functions are off by up to 7e-5.
        if (1.0 - 1e-4..1.0).contains(&(f.abs() / f64::from(LIMIT))) {
            return None;
        }
        // What the meaning adds up, and steps. Those of vectors are longer than what `f32`
        // rounds off differences, in which two components may become equal.
        let greatest = centre.iter().fold(0.0, |greatest: f64, x| greatest.max(x.abs()));
        let (size, mut steps) = match form {
            Form::Unary(_) | Form::Binary(_) => {
                let steps = [1e-6 * x.abs(), 1e-4 * x.abs(), 1e-9, 3e-7, 1e-5].map(|step| {
                    let stays = x == 0.0 || step <= 0.5 * x.abs();
                    if stays { step } else { 0.0 }
                });
                (f.abs(), steps.to_vec())
            }
            Form::Vectors(f) if f.differences => (greatest, vec![1e-6 * greatest]),
            Form::Vectors(_) => (greatest * greatest, vec![1e-6 * greatest]),
        };
        steps.sort_by(f64::total_cmp);
        steps.into_iter().find_map(|step| {
            let (low, high) = (x - step, x + step);
            if !(low < x && x < high) {
                return None;
            }
            let (left, right) = ((f - at(low)) / (x - low), (at(high) - f) / (high - x));
            let quotient = 0.5 * (left + right);
            let noise = (16.0 * size + x.abs() * quotient.abs()) * (-50.0_f64).exp2() / step;
            let tolerated = 0.1 * (RELATIVE * quotient.abs() + ABSOLUTE);
            let agree = (left - right).abs() <= 10.0 * tolerated;
            (noise <= tolerated).then(|| agree.then_some((quotient, noise)))
        })?
    }

    /// Whether a derivative is what the meaning says; none where that says nothing.
    fn agrees(form: Form, point: &[f32], k: usize, got: f32) -> Option<bool> {
        let (quotient, noise) = quotient(form, point, k)?;
        let limit = f64::from(LIMIT);
        let expected = quotient.clamp(-limit, limit);
        let error = (f64::from(got) - expected).abs();
        Some(error <= RELATIVE * expected.abs() + ABSOLUTE + noise)
    }

    /// Operands of magnitudes from 1e-6 to 1e6, every other time near 1. Components are of
    /// one magnitude: beside a great one a small one is lost in the meaning's rounding.
    fn random(form: Form, random: &mut Random) -> Vec<f32> {
        let near = random.between(-1.0, 1.0) < 0.0;
        let mut magnitude = || 10.0_f64.powf(if near { 0.6 } else { random.between(-6.0, 6.0) });
        let magnitudes: Vec<f64> = match form {
            Form::Unary(_) | Form::Binary(_) => (0..2).map(|_| magnitude()).collect(),
            Form::Vectors(_) => vec![magnitude(); 2 * COMPONENTS],
        };
        let operands = magnitudes.iter().take(operands(form));
        operands.map(|magnitude| (magnitude * random.between(-1.0, 1.0)) as f32).collect()
    }

    /// Numbers that are probes; all of one operand, all pairs, random sixes.
    fn special(form: Form, random: &mut Random) -> Vec<Vec<f32>> {
        let probes = probes();
        match form {
            Form::Unary(_) => probes.iter().map(|&x| vec![x]).collect(),
            Form::Binary(_) => {
                probes.iter().flat_map(|&x| probes.iter().map(move |&y| vec![x, y])).collect()
            }
            Form::Vectors(_) => {
                let mut one = || probes[random.between(0.0, probes.len() as f64) as usize];
                (0..20_000).map(|_| [(); 2 * COMPONENTS].map(|()| one()).to_vec()).collect()
            }
        }
    }

    #[test]
    fn derivatives_are_difference_quotients_of_the_meanings() {
        for (op, form) in forms() {
            let tape = tape(form, Rules::ALL);
            let mut stream = Random::stream(op as u64);
            let (mut compared, mut skipped) = (0, 0);
            for _ in 0..POINTS {
                let point = random(form, &mut stream);
                for (k, got) in evaluated(&tape, &point).into_iter().enumerate() {
                    match agrees(form, &point, k, got) {
                        Some(agrees) => {
                            assert!(
                                agrees,
                                "{op:?}{point:?} by operand {k}: {got:e}, not {:e}",
                                quotient(form, &point, k).expect("it agrees or not").0
                            );
                            compared += 1;
                        }
                        None => skipped += 1,
                    }
                }
            }
            println!("{op:?}: {compared} compared, {skipped} skipped");
            // At most one in six is a kink, too steep, or lost in the meaning's own rounding.
            assert!(skipped * 5 <= compared, "{op:?}: {skipped} skipped, {compared} compared");
        }
    }

    /// Subnormal operands count as 0 for some rows, and are left out; so is what a power of 0
    /// does for exponents within 2e-18 of 0.
    #[test]
    fn derivatives_are_difference_quotients_where_functions_break() {
        for (op, form) in forms() {
            let tape = tape(form, Rules::ALL);
            let mut compared = 0;
            for point in special(form, &mut Random::stream(op as u64)) {
                if point.iter().any(|x| x.is_subnormal()) {
                    continue;
                }
                for (k, got) in evaluated(&tape, &point).into_iter().enumerate() {
                    if op == Op::Pow && k == 1 && point[0] == 0.0 {
                        continue;
                    }
                    if let Some(agrees) = agrees(form, &point, k, got) {
                        assert!(
                            agrees,
                            "{op:?}{point:?} by operand {k}: {got:e}, not {:e}",
                            quotient(form, &point, k).expect("it agrees or not").0
                        );
                        compared += 1;
                    }
                }
            }
            assert!(compared >= 100, "{op:?}: {compared} compared");
        }
    }

    #[test]
    fn derivatives_are_total_and_no_rule_changes_them() {
        for (op, form) in forms() {
            let exact = Rules { contract: false, ..Rules::ALL };
            let [all, exact, plain] =
                [Rules::ALL, exact, Rules::NONE].map(|rules| tape(form, rules));
            for point in special(form, &mut Random::stream(op as u64)) {
                let derivatives = evaluated(&all, &point);
                assert!(
                    derivatives.iter().all(|d| d.abs() <= LIMIT),
                    "{op:?}{point:?}: {derivatives:?}"
                );
                assert_eq!(evaluated(&exact, &point), evaluated(&plain, &point), "{op:?}{point:?}");
            }
        }
    }

    #[test]
    fn kinks_and_clamps_have_the_documented_derivatives() {
        let big = LIMIT;
        let cases: &[(Op, &[f32], &[f32])] = &[
            (Op::Abs, &[0.0], &[0.0]),
            (Op::Leaky, &[0.0], &[1.0]),
            (Op::Leaky, &[-3.0], &[0.01]),
            (Op::Sqrt, &[0.0], &[0.0]),
            (Op::Sqrt, &[-1.0], &[0.0]),
            (Op::Log, &[0.0], &[0.0]),
            (Op::Log, &[1e-30], &[big]),
            (Op::Exp, &[0.0], &[1.0]),
            (Op::Exp, &[50.0], &[0.0]),
            (Op::Sin, &[1e9], &[0.0]),
            (Op::Asin, &[1.0], &[0.0]),
            (Op::Epanechnikov, &[1.0], &[0.0]),
            (Op::Epanechnikov, &[-2.0], &[0.0]),
            (Op::Min, &[2.0, 2.0], &[0.0, 1.0]),
            (Op::Max, &[2.0, 2.0], &[0.0, 1.0]),
            (Op::Mul, &[1e10, 1e10], &[0.0, 0.0]),
            (Op::Add, &[big, big], &[0.0, 0.0]),
            (Op::Div, &[0.25, 0.0], &[big, 0.0]),
            (Op::Pow, &[0.0, 1.0], &[1.0, 0.0]),
            (Op::Pow, &[0.0, 2.0], &[0.0, 0.0]),
            (Op::Pow, &[0.0, 0.0], &[0.0, 0.0]),
            (Op::Pow, &[-2.0, 3.0], &[12.0, -8.0 * std::f32::consts::LN_2]),
            (Op::Distance2, &[1.0, 2.0, 3.0, 1.0, 2.0, 3.0], &[0.0; 6]),
            (Op::Distance1, &[1.0, 2.0, 3.0, 1.0, 2.0, 4.0], &[0.0, 0.0, -1.0, 0.0, 0.0, 1.0]),
            (Op::DistanceMax, &[1.0, 1.0, 1.0, 0.0, 0.0, 2.0], &[1.0, 0.0, 0.0, -1.0, 0.0, 0.0]),
            (Op::DistanceMax, &[1.0, 2.0, 3.0, 1.0, 2.0, 3.0], &[0.0; 6]),
            (Op::Dot, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &[4.0, 5.0, 6.0, 1.0, 2.0, 3.0]),
        ];
        for &(op, point, expected) in cases {
            let got = evaluated(&tape(op.row().form, Rules::ALL), point);
            let near = |(&got, &want): (&f32, &f32)| (got - want).abs() <= 1e-6 * want.abs();
            assert!(got.iter().zip(expected).all(near), "{op:?}{point:?}: {got:?}");
        }
    }

    /// What is paid for e^x is its clamp, and not even that where it cannot act.
    #[test]
    fn the_derivative_of_an_exponential_is_itself() {
        let Form::Unary(exp) = Op::Exp.row().form else { panic!("of one operand") };
        let mut b = Builder::new(Rules::ALL);
        let x = b.input(Input::PerPixel(0, Side::I), Interval::new(-LIMIT, 0.0));
        let y = (exp.build)(&mut b, x);
        assert_eq!((exp.derivative)(&mut b, x, y), y);
    }
}
