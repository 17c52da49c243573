//! Window functions of one variable.
use super::builder::Builder;
use super::builder::DIVISOR_MIN;
use super::elementary::{enclosure, horner};
use super::function::{Budget, Unary};
use super::interval::Interval;
use super::tape::Value;

/// Mitchell-Netravali.
pub const MITCHELL: Unary = Unary {
    meaning: |x| {
        let a = x.abs();
        if a < 1.0 {
            (7.0 * a.powi(3) - 12.0 * a.powi(2) + 16.0 / 3.0) / 6.0
        } else if a < 2.0 {
            (2.0 - a).powi(2) * (8.0 / 7.0 - a) * 7.0 / 18.0
        } else {
            0.0
        }
    },
    build: mitchell,
    range: |_| Interval::new(-0.04, 0.889),
    budget: Budget { ulp: 2.0, absolute: 1e-7 },
};

fn mitchell(b: &mut Builder, x: Value) -> Value {
    let (one, two) = (b.constant(1.0), b.constant(2.0));
    let a = b.abs(x);
    let a = b.min(a, two);
    let square = b.mul(a, a);
    let slope = horner(b, a, &[-2.0, 7.0 / 6.0]);
    let peak = b.constant(8.0 / 9.0);
    let inner = b.fma(square, slope, peak);
    let t = b.sub(two, a);
    let square = b.mul(t, t);
    let slope = horner(b, t, &[-1.0 / 3.0, 7.0 / 18.0]);
    let outer = b.mul(square, slope);
    b.select_lt(a, one, inner, outer)
}

/// sinc
pub const SINC: Unary = Unary {
    meaning: |x| {
        // The angle is reduced exactly before it is multiplied by pi.
        let n = x.round_ties_even();
        let sine = (std::f64::consts::PI * (x - n)).sin();
        let sine = if (n * 0.5).fract() == 0.0 { sine } else { -sine };
        if x == 0.0 { 1.0 } else { sine / (std::f64::consts::PI * x) }
    },
    build: sinc,
    range: |_| Interval::new(-0.2173, 1.0),
    budget: Budget { ulp: 3.7, absolute: 0.0 },
};

const SINC_Q: [f32; 6] =
    [1.0, -0.644_933_94, 0.166_806_56, -0.023_934_703, 0.002_185_706_5, -0.000_123_631_41];

fn sinc(b: &mut Builder, x: Value) -> Value {
    let a = b.abs(x);
    let least = b.constant(DIVISOR_MIN);
    let a = b.max(a, least);
    let half = b.constant(0.5);
    let t = b.mul(a, half);
    let turns = b.round(t);
    let minus_two = b.constant(-2.0);
    let r = b.fma(turns, minus_two, a);
    let z = b.mul(r, r);
    let minus_one = b.constant(-1.0);
    let ends = b.fma(r, r, minus_one);
    let q = horner(b, z, &SINC_Q.map(|c| -c));
    let ratio = b.div(r, a);
    let product = b.mul(ends, q);
    b.mul(ratio, product)
}

/// Epanechnikov
pub const EPANECHNIKOV: Unary = Unary {
    meaning: |x| 0.75 * (1.0 - x * x).max(0.0),
    build: epanechnikov,
    range: |x| bump(EPANECHNIKOV, x),
    budget: Budget { ulp: 1.5, absolute: 0.0 },
};

fn epanechnikov(b: &mut Builder, x: Value) -> Value {
    let n = below_parabola(b, x);
    let k = b.constant(-0.75);
    b.mul(n, k)
}

/// Biweight
pub const BIWEIGHT: Unary = Unary {
    meaning: |x| 15.0 / 16.0 * (1.0 - x * x).max(0.0).powi(2),
    build: biweight,
    range: |x| bump(BIWEIGHT, x),
    budget: Budget { ulp: 3.7, absolute: 0.0 },
};

fn biweight(b: &mut Builder, x: Value) -> Value {
    let n = below_parabola(b, x);
    let k = b.constant(15.0 / 16.0);
    let square = b.mul(n, n);
    b.mul(square, k)
}

fn below_parabola(b: &mut Builder, x: Value) -> Value {
    let (minus_one, zero) = (b.constant(-1.0), b.constant(0.0));
    let n = b.fma(x, x, minus_one);
    b.min(n, zero)
}

/// Tricube
pub const TRICUBE: Unary = Unary {
    meaning: |x| 70.0 / 81.0 * (1.0 - x.abs().powi(3)).max(0.0).powi(3),
    build: tricube,
    range: |x| bump(TRICUBE, x),
    budget: Budget { ulp: 3.0, absolute: 1.8e-7 },
};

fn tricube(b: &mut Builder, x: Value) -> Value {
    let (one, minus_one, k) = (b.constant(1.0), b.constant(-1.0), b.constant(-70.0 / 81.0));
    let a = b.abs(x);
    let a = b.min(a, one);
    let square = b.mul(a, a);
    let n = b.fma(square, a, minus_one);
    let square = b.mul(n, n);
    let scaled = b.mul(n, k);
    b.mul(square, scaled)
}

fn bump(kernel: Unary, x: Interval) -> Interval {
    let a = x.abs();
    let at = |x: f32| (kernel.meaning)(x.into());
    enclosure(kernel.budget, at(a.hi), at(a.lo)).clamped(0.0, at(0.0) as f32)
}
