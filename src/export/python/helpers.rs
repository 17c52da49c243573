//! The functions that formulas call, in NumPy: those of the operator table, by its rows'
//! meanings, and what stages are made with.

use crate::expr::op::Op;

/// A function of the text.
pub(super) struct Helper {
    pub(super) name: &'static str,
    /// Functions before it that it calls.
    pub(super) calls: &'static [&'static str],
    pub(super) text: &'static str,
}

/// The function of an operator; none of those that Python writes as we do.
pub(super) fn of(op: Op) -> Option<&'static str> {
    // Python has names of its own for some.
    let name = match op {
        Op::Add | Op::Sub | Op::Mul | Op::Neg => return None,
        Op::Div => "divide",
        Op::Abs => "magnitude",
        Op::Min => "least",
        Op::Max => "greatest",
        _ => op.name(),
    };
    HELPERS.iter().find(|helper| helper.name == name).map(|helper| helper.name)
}

macro_rules! helpers {
    ($($name:literal, $calls:expr, $text:literal;)*) => {
        /// All of them, those that are called before those that call.
        pub(super) const HELPERS: &[Helper] =
            &[$(Helper { name: $name, calls: &$calls, text: $text }),*];
    };
}

helpers! {
    "image", [], r#"
def image(x):
    """An argument as height x width x components."""
    x = np.asarray(x, dtype=float)
    if x.ndim < 2:
        return x.reshape(1, 1, -1)
    return x if x.ndim == 3 else x[:, :, np.newaxis]
"#;
    "on", [], r#"
def on(size, x):
    """A value at every pixel of an image of this size."""
    x = np.reshape(x, (1, 1, 1)) if np.ndim(x) == 0 else x
    return np.broadcast_to(x, size + x.shape[2:])
"#;
    "same", [], r#"
def same(x, width):
    """A number as so many components."""
    return np.full((1, 1, width), x)
"#;
    "at", [], r#"
def at(x, right, down):
    """What stands so many columns to the right and rows below; beside the image its edge."""
    rows = np.clip(np.arange(x.shape[0]) + down, 0, x.shape[0] - 1)
    columns = np.clip(np.arange(x.shape[1]) + right, 0, x.shape[1] - 1)
    return x[rows][:, columns]
"#;
    "halve", [], r#"
def halve(x):
    """Means of two by two pixels."""
    x = np.pad(x, ((0, x.shape[0] % 2), (0, x.shape[1] % 2), (0, 0)), mode="edge")
    return (x[::2, ::2] + x[::2, 1::2] + x[1::2, ::2] + x[1::2, 1::2]) / 4
"#;
    "double", [], r#"
def double(x, size):
    """What lies between pixels of half the resolution, bilinearly."""
    for axis in (0, 1):
        place = np.arange(size[axis])
        nearest, last = place // 2, x.shape[axis] - 1
        other = np.clip(nearest + np.where(place % 2 == 0, -1, 1), 0, last)
        x = 0.75 * np.take(x, nearest.clip(0, last), axis) + 0.25 * np.take(x, other, axis)
    return x
"#;
    "pixels", [], r#"
def pixels(size, step):
    """The pixels' columns and rows; of half the resolution the middles of two."""
    rows, columns = np.indices(size)
    return step * np.stack([columns, rows], axis=2) + (step - 1) / 2
"#;
    "gather", ["at"], r#"
def gather(of, variance, weight, radius, dilation, step):
    """The mean of `of` around every pixel by weight(j, offset), where j(x) is x at the other pixel;
    and the variance of the mean, if there is one. What was averaged stays where the weights sum to
    nothing that can be trusted."""
    height, width = of.shape[:2]
    rows, columns = np.indices((height, width))
    total, magnitude, mean, spread = 0.0, 0.0, 0.0, 0.0
    for down in range(-radius * dilation, radius * dilation + 1, dilation):
        for right in range(-radius * dilation, radius * dilation + 1, dilation):
            inside = (rows + down >= 0) & (rows + down < height)
            inside &= (columns + right >= 0) & (columns + right < width)
            j = lambda x: at(x, right, down)
            w = weight(j, np.array([[[step * right, step * down]]], dtype=float))
            w = np.where(inside[:, :, np.newaxis], w, 0.0)
            total, magnitude = total + w, magnitude + np.abs(w)
            mean = mean + w * j(of)
            if variance is not None:
                spread = spread + np.minimum(w * w, 1e18) * j(variance)
    trusted = (np.abs(total) >= 1e-30) & (np.abs(total) >= magnitude / 1024)
    divisor = np.where(trusted, total, 1.0)
    mean = np.where(trusted, np.clip(mean / divisor, -1e18, 1e18), of)
    if variance is None:
        return mean
    spread = spread / divisor**2
    return mean, np.where(trusted, np.clip(spread, -1e18, 1e18), variance)
"#;
    "join", [], r#"
def join(*values):
    """All components of all values, one after another."""
    values = [np.reshape(x, (1, 1, 1)) if np.ndim(x) == 0 else x for x in values]
    size = np.broadcast_shapes(*(x.shape[:2] for x in values))
    return np.concatenate([np.broadcast_to(x, size + x.shape[2:]) for x in values], axis=2)
"#;
    "part", [], r#"
def part(x, k):
    """A component, counted from 0."""
    return x if np.ndim(x) == 0 else x[:, :, k : k + 1]
"#;
    "median", [], r#"
def median(*values):
    """The median, component by component; the lower one of an even number."""
    values = np.sort(np.stack(np.broadcast_arrays(*values)), axis=0)
    return values[(len(values) - 1) // 2]
"#;
    "clamp", [], r#"
def clamp(x, low, high):
    """x, kept between low and high."""
    return np.minimum(np.maximum(x, low), high)
"#;
    "mean", ["join"], r#"
def mean(*values):
    """The mean of all components of all values."""
    return join(*values).mean(axis=2, keepdims=True)
"#;
    "luminance", [], r#"
def luminance(color):
    """By the primaries of Rec. 709."""
    return (color * [0.2126, 0.7152, 0.0722]).sum(axis=2, keepdims=True)
"#;
    "linear", ["join"], r#"
def linear(weights, bias, x):
    """A layer: the weights times x, plus the bias."""
    return join(x) @ weights.T + bias
"#;
    "pairs", ["join"], r#"
def pairs(x, y):
    """Two values with as many components; what is missing is zero."""
    x, y = join(x), join(y)
    width = max(x.shape[2], y.shape[2])
    pad = lambda v: np.pad(v, ((0, 0), (0, 0), (0, width - v.shape[2])))
    return pad(x), pad(y)
"#;
    "dot", ["pairs"], r#"
def dot(x, y):
    """The scalar product."""
    x, y = pairs(x, y)
    return (x * y).sum(axis=2, keepdims=True)
"#;
    "distance2", ["pairs"], r#"
def distance2(x, y):
    """The Euclidean distance."""
    x, y = pairs(x, y)
    return np.sqrt(((x - y) ** 2).sum(axis=2, keepdims=True))
"#;
    "distance1", ["pairs"], r#"
def distance1(x, y):
    """The Manhattan distance."""
    x, y = pairs(x, y)
    return np.abs(x - y).sum(axis=2, keepdims=True)
"#;
    "distanceMax", ["pairs"], r#"
def distanceMax(x, y):
    """The Chebyshev distance."""
    x, y = pairs(x, y)
    return np.abs(x - y).max(axis=2, keepdims=True)
"#;
    "divide", [], r#"
def divide(x, y):
    """The quotient; the divisor is kept 1e-18 away from zero, on its own side."""
    y = np.where(np.less(y, 0), np.minimum(y, -1e-18), np.maximum(y, 1e-18))
    return np.clip(x / y, -1e18, 1e18)
"#;
    "pow", [], r#"
def pow(x, y):
    """The power; of a negative base that of its magnitude, negated for odd exponents."""
    base = np.abs(x)
    with np.errstate(divide="ignore", over="ignore"):
        log2 = np.where(base < 1.1754943508222875e-38, -73786976294838206464.0, np.log2(base))
        power = np.minimum(np.exp2(y * log2), 1e18)
    odd = np.less(x, 0) & (np.abs(np.fmod(np.multiply(y, 0.5), 1)) == 0.5)
    return np.where(odd, -power, power)
"#;
    "exp", [], r#"
def exp(x):
    """The exponential, at most 1e18."""
    return np.exp(np.minimum(x, 41.44653))
"#;
    "log", [], r#"
def log(x):
    """The natural logarithm; what is less than the smallest normal number counts as that."""
    return np.log(np.maximum(x, 1.1754943508222875e-38))
"#;
    "sqrt", [], r#"
def sqrt(x):
    """The square root; 0 for negative numbers."""
    return np.sqrt(np.maximum(x, 0))
"#;
    "sin", [], r#"
def sin(x):
    """The sine; far from zero the argument is clamped."""
    return np.sin(np.clip(x, -1e5, 1e5))
"#;
    "cos", [], r#"
def cos(x):
    """The cosine; far from zero the argument is clamped."""
    return np.cos(np.clip(x, -1e5, 1e5))
"#;
    "tan", [], r#"
def tan(x):
    """The tangent; far from zero the argument is clamped."""
    return np.tan(np.clip(x, -1e5, 1e5))
"#;
    "asin", [], r#"
def asin(x):
    """The arc sine; the argument is clamped into [-1, 1]."""
    return np.arcsin(np.clip(x, -1, 1))
"#;
    "acos", [], r#"
def acos(x):
    """The arc cosine; the argument is clamped into [-1, 1]."""
    return np.arccos(np.clip(x, -1, 1))
"#;
    "atan", [], r#"
def atan(x):
    """The arc tangent."""
    return np.arctan(x)
"#;
    "tanh", [], r#"
def tanh(x):
    """The hyperbolic tangent."""
    return np.tanh(x)
"#;
    "logistic", ["exp"], r#"
def logistic(x):
    """1 / (1 + exp(-x))."""
    return 1 / (1 + exp(-x))
"#;
    "leaky", [], r#"
def leaky(x):
    """The leaky rectifier: x, or x / 100 where x < 0."""
    return np.maximum(x, 0.01 * x)
"#;
    "magnitude", [], r#"
def magnitude(x):
    """The absolute value."""
    return np.abs(x)
"#;
    "least", [], r#"
def least(x, y):
    """The smaller one."""
    return np.minimum(x, y)
"#;
    "greatest", [], r#"
def greatest(x, y):
    """The greater one."""
    return np.maximum(x, y)
"#;
    "mitchell", [], r#"
def mitchell(x):
    """The Mitchell-Netravali kernel with B = C = 1/3."""
    a = np.abs(x)
    t = 2 - np.minimum(a, 2)
    return np.where(a < 1, (7 * a**3 - 12 * a**2 + 16 / 3) / 6, t * t * (7 * t - 6) / 18)
"#;
    "sinc", [], r#"
def sinc(x):
    """sin(pi x) / (pi x)."""
    return np.sinc(x)
"#;
    "epanechnikov", [], r#"
def epanechnikov(x):
    """The Epanechnikov kernel."""
    return 0.75 * np.maximum(1 - np.square(x), 0)
"#;
    "biweight", [], r#"
def biweight(x):
    """The biweight kernel."""
    return 15 / 16 * np.maximum(1 - np.square(x), 0) ** 2
"#;
    "tricube", [], r#"
def tricube(x):
    """The tricube kernel."""
    return 70 / 81 * np.maximum(1 - np.abs(x) ** 3, 0) ** 3
"#;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_operator_has_a_function_and_callees_stand_first() {
        for &op in Op::ALL {
            let is_written = matches!(op, Op::Add | Op::Sub | Op::Mul | Op::Neg);
            assert_eq!(of(op).is_none(), is_written, "{}: add it to HELPERS", op.name());
        }
        for (k, helper) in HELPERS.iter().enumerate() {
            let known = |name: &str| HELPERS[..k].iter().any(|earlier| earlier.name == name);
            assert!(helper.calls.iter().all(|name| known(name)), "{}", helper.name);
            assert!(helper.text.contains(&format!("\ndef {}(", helper.name)), "{}", helper.name);
        }
    }
}
