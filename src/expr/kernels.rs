//! Window functions of one variable, even in it.
//!
//! The paper names them (Section 4.4 and the grammar) but does not define them;
//! these are the usual definitions, from the sources that each constant names.
//! Epanechnikov, biweight and tricube are the kernels of density estimation,
//! scaled to unit integral over [-1, 1] (Silverman, *Density Estimation for
//! Statistics and Data Analysis*, 1986, table 3.1; Cleveland, "Robust Locally
//! Weighted Regression", 1979, for the tricube); Mitchell and sinc are the
//! reconstruction filters of rendering.
//!
//! They are made like the functions of [`super::elementary`], to the same
//! promises, and are measured in the same way: over all `f32` within ±1e18. "ulp"
//! is the worst of the results that the absolute part of the budget leaves.
//!
//! | function | primitives | worst ulp | worst absolute | budget |
//! |---|---|---|---|---|
//! | `mitchell` | 10 | 0 | 9.6e-8 | 1e-7 |
//! | `sinc` | 15 | 4.352 | 9.0e-8 | 4.5 ulp |
//! | `epanechnikov` | 3 | 1.250 | 5.2e-8 | 1.5 ulp |
//! | `biweight` | 4 | 3.335 | 1.1e-7 | 3.5 ulp |
//! | `tricube` | 7 | 3.024 | 1.8e-7 | 3.1 ulp or 1.5e-7 |

use super::builder::{Builder, DIVISOR_MIN};
use super::derivative::{inside, of_even};
use super::elementary::{COS, enclosure, horner};
use super::function::{Budget, Fast, Unary};
use super::interval::Interval;
use super::tape::Value;

/// `mitchell`: the cubic filter of Mitchell and Netravali ("Reconstruction
/// Filters in Computer Graphics", SIGGRAPH 1988) with B = C = 1/3, zero from
/// |x| = 2 on. 10 primitives.
///
/// The outer cubic is written in t = 2 - |x|, where it has its double root, so
/// that it meets zero exactly and from below.
pub const MITCHELL: Unary = Unary {
    meaning: |x| {
        let a = x.abs();
        if a < 1.0 {
            (7.0 * a.powi(3) - 12.0 * a.powi(2) + 16.0 / 3.0) / 6.0
        } else {
            let t = 2.0 - a.min(2.0);
            t * t * (7.0 * t - 6.0) / 18.0
        }
    },
    build: mitchell,
    range: |x| {
        // Falls to its minimum at 10/7, then climbs to the zero at 2.
        const LOWEST: f32 = 10.0 / 7.0;
        let a = x.abs();
        if a.lo >= 2.0 {
            return Interval::point(0.0);
        }
        let [first, last, lowest] =
            [a.lo, a.hi, LOWEST.clamp(a.lo, a.hi)].map(|x| (MITCHELL.meaning)(x.into()));
        enclosure(MITCHELL.budget, lowest, first.max(last))
    },
    derivative: |b, x, _| mitchell_slope(b, x),
    budget: Budget { ulp: 0.0, absolute: 1e-7 },
    fast: Fast { within: 8.0, budget: Budget { ulp: 0.0, absolute: 1e-6 } },
    short: None,
};

/// (7/2 |x| - 4) |x|, or t (4 - 7 t) / 6 with t = 2 - |x|, and the sign of x.
fn mitchell_slope(b: &mut Builder, x: Value) -> Value {
    let (one, two) = (b.constant(1.0), b.constant(2.0));
    let a = b.abs(x);
    let a = b.min(a, two);
    let inner = horner(b, a, &[-4.0, 3.5]);
    let inner = b.mul(a, inner);
    let t = b.sub(two, a);
    let outer = horner(b, t, &[2.0 / 3.0, -7.0 / 6.0]);
    let outer = b.mul(t, outer);
    let slope = b.select_lt(a, one, inner, outer);
    of_even(b, x, slope)
}

fn mitchell(b: &mut Builder, x: Value) -> Value {
    let (one, two) = (b.constant(1.0), b.constant(2.0));
    let a = b.abs(x);
    let a = b.min(a, two);

    let a_squared = b.mul(a, a);
    let slope = horner(b, a, &[-2.0, 7.0 / 6.0]);
    let peak = b.constant(8.0 / 9.0);
    let inner = b.fma(a_squared, slope, peak);
    b.pin(inner);

    let t = b.sub(two, a);
    let t_squared = b.mul(t, t);
    let slope = horner(b, t, &[-1.0 / 3.0, 7.0 / 18.0]);
    let outer = b.mul(t_squared, slope);
    b.select_lt(a, one, inner, outer)
}

/// `sinc`: sin(pi x) / (pi x), 1 at 0: the ideal low-pass filter, not windowed.
/// 15 primitives.
///
/// With r = |x| - 2 round(|x| / 2), which is exact, sin(pi x) = ± sin(pi r), and
/// sin(pi r) / (pi r) = (1 - r^2) q(r^2) with q of degree 5 (relative error
/// 8e-9). The factor 1 - r^2 keeps the zeros at odd numbers exact, r those at
/// even ones, and the sign comes out by itself.
pub const SINC: Unary = Unary {
    meaning: |x| {
        let x = x.abs();
        if x == 0.0 {
            return 1.0;
        }
        // The multiples of pi are taken off before pi is: that is exact.
        let n = x.round_ties_even();
        let sine = (std::f64::consts::PI * (x - n)).sin();
        let sign = if (n * 0.5).fract() == 0.0 { 1.0 } else { -1.0 };
        sign * sine / (std::f64::consts::PI * x)
    },
    build: sinc,
    range: |x| {
        // A bound of -0 would make the envelope -inf.
        let nearest = x.abs().lo.abs();
        let envelope = std::f32::consts::FRAC_1_PI / nearest * 1.000_001;
        SINC_RANGE.clamped(-envelope, envelope)
    },
    derivative: sinc_slope,
    budget: Budget { ulp: 4.5, absolute: 0.0 },
    fast: Fast { within: 8.0, budget: Budget { ulp: 4.5, absolute: 2e-6 } },
    short: None,
};

/// sinc' r / r, in powers of r^2: the Taylor series, to 1e-6 on |r| <= 1/2.
const SINC_SLOPE: [f32; 6] =
    [-3.289_868, 3.246_969_7, -1.144_510_9, 0.209_182_78, -0.023_460_81, 0.001_781_145_5];

/// (cos(pi x) - sinc x) / x, and a series near 0, where that cancels.
fn sinc_slope(b: &mut Builder, x: Value, y: Value) -> Value {
    let (half, minus_two) = (b.constant(0.5), b.constant(-2.0));
    let a = b.abs(x);
    let small = b.min(a, half);
    let z = b.mul(small, small);
    let series = horner(b, z, &SINC_SLOPE);
    let near = b.mul(small, series);

    let t = b.mul(a, half);
    let turns = b.round(t);
    let r = b.fma(turns, minus_two, a);
    let pi = b.constant(std::f32::consts::PI);
    let angle = b.mul(r, pi);
    let cosine = (COS.build)(b, angle);
    let difference = b.sub(cosine, y);
    let divisor = b.max(a, half);
    let far = b.div(difference, divisor);
    let slope = b.select_lt(a, half, near, far);
    of_even(b, x, slope)
}

/// The first minimum, at 1.43, rounded outwards; and the peak.
const SINC_RANGE: Interval = Interval { lo: -0.217_234, hi: 1.0 };

/// -sin(pi r) / (pi r (1 - r^2)), in powers of r^2.
const MINUS_SINC: [f32; 6] =
    [-1.0, 0.644_933_94, -0.166_806_56, 0.023_934_703, -0.002_185_703_7, 0.000_123_636_14];

fn sinc(b: &mut Builder, x: Value) -> Value {
    let a = b.abs(x);
    // Also the guard of the division: here sinc is 1 to the last bit.
    let least = b.constant(DIVISOR_MIN);
    let a = b.max(a, least);
    let (half, minus_one, minus_two) = (b.constant(0.5), b.constant(-1.0), b.constant(-2.0));
    let t = b.mul(a, half);
    let turns = b.round(t);
    let r = b.fma(turns, minus_two, a);
    let z = b.mul(r, r);
    let minus_roots = b.fma(r, r, minus_one);
    b.pin(minus_roots);
    let minus_q = horner(b, z, &MINUS_SINC);
    let ratio = b.div(r, a);
    let sine = b.mul(minus_roots, minus_q);
    b.mul(ratio, sine)
}

/// `epanechnikov`: 3/4 (1 - x^2) for |x| < 1, else 0. 3 primitives.
pub const EPANECHNIKOV: Unary = Unary {
    meaning: |x| 0.75 * (1.0 - x * x).max(0.0),
    build: epanechnikov,
    range: |x| bump(EPANECHNIKOV, x),
    derivative: |b, x, _| slope_inside(b, x, -1.5),
    budget: Budget { ulp: 1.5, absolute: 0.0 },
    fast: Fast { within: 8.0, budget: Budget { ulp: 1.5, absolute: 1e-6 } },
    short: None,
};

/// scale * x, of a kernel that ends at 1.
fn slope_inside(b: &mut Builder, x: Value, scale: f32) -> Value {
    let scale = b.constant(scale);
    let x = b.clamp(x, -1.0, 1.0);
    let slope = b.mul(x, scale);
    inside(b, x, 1.0, slope)
}

fn epanechnikov(b: &mut Builder, x: Value) -> Value {
    let scale = b.constant(-0.75);
    let minus_parabola = minus_parabola(b, x);
    b.mul(minus_parabola, scale)
}

/// `biweight`: 15/16 (1 - x^2)^2 for |x| < 1, else 0. 4 primitives.
pub const BIWEIGHT: Unary = Unary {
    meaning: |x| 15.0 / 16.0 * (1.0 - x * x).max(0.0).powi(2),
    build: biweight,
    range: |x| bump(BIWEIGHT, x),
    derivative: |b, x, _| {
        let slope = slope_inside(b, x, 3.75);
        let minus_parabola = minus_parabola(b, x);
        b.mul(slope, minus_parabola)
    },
    budget: Budget { ulp: 3.5, absolute: 0.0 },
    fast: Fast { within: 8.0, budget: Budget { ulp: 3.5, absolute: 1e-6 } },
    short: None,
};

fn biweight(b: &mut Builder, x: Value) -> Value {
    let scale = b.constant(15.0 / 16.0);
    let minus_parabola = minus_parabola(b, x);
    let square = b.mul(minus_parabola, minus_parabola);
    b.mul(square, scale)
}

/// min(x^2 - 1, 0): rounded once, so exact to the end of the support.
fn minus_parabola(b: &mut Builder, x: Value) -> Value {
    let (minus_one, zero) = (b.constant(-1.0), b.constant(0.0));
    let parabola = b.fma(x, x, minus_one);
    b.pin(parabola);
    b.min(parabola, zero)
}

/// `tricube`: 70/81 (1 - |x|^3)^3 for |x| < 1, else 0. 7 primitives.
///
/// Within 1e-7 of |x| = 1 the rounding of |x|^2 is all that is left of
/// 1 - |x|^3: thousands of ulps of a result that is nearly 0, hence the absolute
/// part of the budget. One more primitive, for (1 - |x|)(1 + |x| + x^2), would
/// mend that and double the error elsewhere.
pub const TRICUBE: Unary = Unary {
    meaning: |x| 70.0 / 81.0 * (1.0 - x.abs().powi(3)).max(0.0).powi(3),
    build: tricube,
    range: |x| bump(TRICUBE, x),
    derivative: |b, x, _| {
        let (one, minus_one, scale) = (b.constant(1.0), b.constant(-1.0), b.constant(-70.0 / 9.0));
        let a = b.abs(x);
        let a = b.min(a, one);
        let square = b.mul(a, a);
        let minus_base = b.fma(square, a, minus_one);
        let base_squared = b.mul(minus_base, minus_base);
        let scaled = b.mul(square, scale);
        let slope = b.mul(scaled, base_squared);
        of_even(b, x, slope)
    },
    budget: Budget { ulp: 3.1, absolute: 1.5e-7 },
    fast: Fast { within: 8.0, budget: Budget { ulp: 3.1, absolute: 1e-6 } },
    short: None,
};

fn tricube(b: &mut Builder, x: Value) -> Value {
    let (one, minus_one, scale) = (b.constant(1.0), b.constant(-1.0), b.constant(-70.0 / 81.0));
    let a = b.abs(x);
    let a = b.min(a, one);
    let square = b.mul(a, a);
    let minus_base = b.fma(square, a, minus_one);
    b.pin(minus_base);
    let square = b.mul(minus_base, minus_base);
    let scaled = b.mul(minus_base, scale);
    b.mul(square, scaled)
}

/// The range of a kernel that falls with |x| from its peak at 0 to the end of its
/// support at 1.
fn bump(kernel: Unary, x: Interval) -> Interval {
    let a = x.abs();
    if a.lo >= 1.0 {
        return Interval::point(0.0);
    }
    let at = |x: f32| (kernel.meaning)(x.into());
    enclosure(kernel.budget, at(a.hi), at(a.lo)).clamped(0.0, at(0.0) as f32)
}

#[cfg(test)]
mod tests {
    use super::super::elementary::suite;
    use super::*;

    suite::conforms!(
        mitchell: MITCHELL
        sinc: SINC
        epanechnikov: EPANECHNIKOV
        biweight: BIWEIGHT
        tricube: TRICUBE
    );

    #[test]
    fn meanings_have_their_known_values() {
        let near = |f: Unary, x: f64, want: f64| {
            let got = (f.meaning)(x);
            assert!((got - want).abs() <= 1e-15, "f({x}) = {got}, not {want}");
        };
        near(MITCHELL, 0.0, 8.0 / 9.0);
        near(MITCHELL, -1.0, 1.0 / 18.0);
        near(MITCHELL, 8.0 / 7.0, 0.0);
        near(MITCHELL, 2.0, 0.0);
        near(SINC, 0.0, 1.0);
        near(SINC, 0.5, std::f64::consts::FRAC_2_PI);
        near(SINC, -1.5, -std::f64::consts::FRAC_2_PI / 3.0);
        near(SINC, 7.0, 0.0);
        near(EPANECHNIKOV, 0.0, 0.75);
        near(EPANECHNIKOV, 0.5, 0.5625);
        near(EPANECHNIKOV, 1.0, 0.0);
        near(BIWEIGHT, 0.0, 15.0 / 16.0);
        near(BIWEIGHT, 0.5, 135.0 / 256.0);
        near(TRICUBE, 0.0, 70.0 / 81.0);
        near(TRICUBE, -0.5, 70.0 / 81.0 * 343.0 / 512.0);
        near(TRICUBE, 1.5, 0.0);
    }

    /// What lets a pass drop the taps beyond a kernel's support.
    #[test]
    fn ranges_beyond_the_support_are_zero() {
        for (kernel, support) in
            [(MITCHELL, 2.0), (EPANECHNIKOV, 1.0), (BIWEIGHT, 1.0), (TRICUBE, 1.0)]
        {
            let beyond = Interval::new(support, f32::INFINITY);
            assert_eq!((kernel.range)(beyond), Interval::point(0.0));
            assert_eq!((kernel.range)(-beyond), Interval::point(0.0));
        }
    }

    #[test]
    fn the_range_of_sinc_takes_negative_zero_for_zero() {
        let positive = (SINC.range)(Interval::new(0.0, 1.0));
        assert_eq!((SINC.range)(Interval { lo: -0.0, hi: 1.0 }), positive);
    }

    /// Each of the three bumps has the integral 1; so has Mitchell.
    #[test]
    fn kernels_integrate_to_one() {
        for kernel in [MITCHELL, EPANECHNIKOV, BIWEIGHT, TRICUBE] {
            let steps = 40_000;
            let width = 4.0 / f64::from(steps);
            let midpoints = (0..steps).map(|k| -2.0 + (f64::from(k) + 0.5) * width);
            let integral: f64 = midpoints.map(|x| (kernel.meaning)(x) * width).sum();
            assert!((integral - 1.0).abs() < 1e-6, "the integral is {integral}");
        }
    }
}
