//! What is too much, and why.

use std::fmt;

use serde::Serialize;

/// Whether a filter can be relied on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// It can.
    Stable,
    /// It can, but reacts more to its input's errors than most do.
    Sensitive,
    /// It cannot.
    Unstable,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Stable => "stable",
            Self::Sensitive => "sensitive",
            Self::Unstable => "unstable",
        })
    }
}

/// Something that is too much.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reason {
    /// How grave it is.
    pub verdict: Verdict,
    /// A sentence.
    pub text: String,
}

/// From where on a figure is a reason.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Above this the filter is sensitive …
    pub sensitive: f64,
    /// … and above this it is unstable.
    pub unstable: f64,
}

/// How far a pixel may be from exact, in units of what its back end promises. Of all
/// renders there are, a certificate has seen few pixels: there, half of the promise is
/// kept in reserve, as the search does. Scenes that are made to be difficult are allowed
/// the whole.
pub const INACCURACY: Limits = Limits { sensitive: 0.5, unstable: 1.0 };

/// How much of a pixel the last bit of a feature may change. Renderers, compilers and
/// conversions between files round as they like, so that bit is nobody's intention.
/// From 1e-4 on it does more than `--precision fast` is allowed to; from 1e-3 on, of
/// the 24 bits of an `f32` fewer are left than the 11 of a `half`, which results are
/// commonly stored as: two runs of one renderer give different files.
pub const ULP: Limits = Limits { sensitive: 1e-4, unstable: 1e-3 };

/// How much of a pixel noise of a thousandth may change, but for one pixel in a
/// thousand. Filters must react to features, and where weights are a millionth of the
/// greatest, by more than the noise: a product of Gaussians whose sum is promised
/// (at least 1e-12, so that exponents are at most 28) with powers up to three changes
/// by 28 · 3 · 1e-3, a twelfth. A tenth is more than that. Half of the pixel is 500
/// times the noise, which is how far sums may cancel before back ends promise nothing
/// any more; and noise of a thousandth is less than any render has.
pub const NOISE: Limits = Limits { sensitive: 0.1, unstable: 0.5 };

/// The share of a scene's pixels in which weights may cancel so far that rounding
/// decides whether the guard acts. The guard is safe, so that this alone makes no
/// filter unstable; but from a hundredth on a result is visibly patched with noise.
pub const DOUBTFUL: f64 = 0.01;

impl Limits {
    /// The verdict on a figure.
    pub fn verdict(self, figure: f64) -> Verdict {
        match figure {
            _ if figure > self.unstable => Verdict::Unstable,
            _ if figure > self.sensitive => Verdict::Sensitive,
            _ => Verdict::Stable,
        }
    }
}
