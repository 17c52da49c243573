//! Known filters, as text: the paper's own, the classics to compare with, and
//! the *codebook* that the insert mutation draws from (Section 4.2).
//!
//! The paper names what its codebook is made of (Mitchell, sinc, Epanechnikov,
//! biweight, tricube, Gaussian, cross-bilateral, and all their mathematical
//! sub-expressions) but not what the kernels are applied to. Here each kernel
//! is applied to the Euclidean distance of each feature, which normalisation on
//! load brings to the order of the kernels' supports; distances between pixels
//! are divided by [`REACH`]. The kernels are operators of the language, so that
//! their sub-expressions are those of their arguments; the Gaussian is not, and
//! is there in all its parts.

use super::grammar::PAPER_FEATURES;
use std::collections::HashSet;
use std::sync::LazyLock;

use super::feature::Feature;
use super::op::{Op, Sort};
use super::text;
use super::tree::Tree;

/// The bandwidths of `bilateral`: pixels for `pixel`, the loader's normalised
/// units otherwise. These and those of `cross-bilateral` minimise the error over
/// `data/train` (`examples/tune_bandwidths.rs`), so that what a search is compared with is
/// as good as its form allows; noisy colour turns out to be all but useless.
const BILATERAL: [(Feature, f64); 2] = [(Feature::Pixel, 0.88), (Feature::Color, 45.0)];

/// The bandwidths of `cross-bilateral`, likewise.
const CROSS_BILATERAL: [(Feature, f64); 6] = [
    (Feature::Pixel, 1.9),
    (Feature::Color, 45.0),
    (Feature::WorldPosition, 0.17),
    (Feature::Normal, 0.55),
    (Feature::Texture, 0.18),
    (Feature::DirIllumination, 32.0),
];

/// The distance in pixels at which a kernel of compact support ends when it is
/// applied to pixels: the default window's radius.
pub const REACH: f64 = 10.0;

/// The filter of the paper: Equations 2 and 3, then 4, then 5. What its `f^di`
/// and `f^dl` call direct illumination is one feature here. Norms of differences
/// are distances, colour's is the noisy one's, and the variance is pixel i's.
const KAN2017: &str = "
exp(-distanceMax(worldPosition, worldPosition) / 0.05)
* exp(-((distance1(pixel, pixel) + 2
         + exp(sinc(pow(distance2(worldPosition, worldPosition), 0.002))))
        / pow(2, asin(biweight(pow(pow(distance2(normal, normal) / 2, POWER2), POWER3))))))";
const KAN2017_POWER2: &str = "
exp(biweight(distanceMax(color, color)
             * pow(2, 3 * sinc(distance2(dirIllumination, dirIllumination)))))";
const KAN2017_POWER3: &str = "
(exp(-(pow(distanceMax(texture, texture), 2) / 0.01))
 * exp(tricube(distance2(dirIllumination, dirIllumination)) * mitchell(wpVariance)))";

/// A filter that has a name.
#[derive(Clone, Debug)]
pub struct Known {
    /// What it is called on the command line.
    pub name: &'static str,
    /// One line for people.
    pub doc: &'static str,
    /// Its weight.
    pub weight: Tree,
}

/// The filters that have names.
pub fn known() -> &'static [Known] {
    static KNOWN: LazyLock<[Known; 4]> = LazyLock::new(|| {
        [
            Known {
                name: "gaussian",
                doc: "a Gaussian of the distance in pixels: looks at no feature",
                weight: product_of_gaussians(&BILATERAL[..1]),
            },
            Known {
                name: "bilateral",
                doc: "Gaussians of the distances in pixels and in noisy colour",
                weight: product_of_gaussians(&BILATERAL),
            },
            Known {
                name: "cross-bilateral",
                doc: "Gaussians of the distances in pixels, colour and features",
                weight: product_of_gaussians(&CROSS_BILATERAL),
            },
            Known {
                name: "kan2017",
                doc: "the filter that the paper discovered, Equations 2 to 5",
                weight: parsed(
                    &KAN2017.replace("POWER2", KAN2017_POWER2).replace("POWER3", KAN2017_POWER3),
                ),
            },
        ]
    });
    &*KNOWN
}

/// The weight of the filter of a name.
pub fn named(name: &str) -> Option<&'static Tree> {
    known().iter().find(|filter| filter.name == name).map(|filter| &filter.weight)
}

/// The expressions that the insert mutation draws from: all of them numbers,
/// each once, in a fixed order.
pub fn codebook() -> &'static [Tree] {
    static CODEBOOK: LazyLock<Vec<Tree>> = LazyLock::new(|| {
        let mut seen = HashSet::new();
        let mut trees = Vec::new();
        for whole in wholes() {
            for position in 0..whole.len() {
                let part = whole.subtree(position);
                if part.sort() == Sort::Scalar && seen.insert(part.clone()) {
                    trees.push(part);
                }
            }
        }
        trees
    });
    &CODEBOOK
}

/// The expressions that the codebook is all the parts of.
fn wholes() -> impl Iterator<Item = Tree> {
    const KERNELS: [Op; 5] = [Op::Mitchell, Op::Sinc, Op::Epanechnikov, Op::Biweight, Op::Tricube];
    let kernels = KERNELS.into_iter().flat_map(|kernel| {
        PAPER_FEATURES.iter().map(move |&feature| {
            let in_pixels = feature == Feature::Pixel;
            let unit = if in_pixels { format!(" / {REACH}") } else { String::new() };
            parsed(&format!("{}({}{unit})", kernel.name(), distance(feature)))
        })
    });
    let gaussians = CROSS_BILATERAL.map(|(feature, sigma)| parsed(&gaussian(feature, sigma)));
    kernels.chain(gaussians).chain(named("cross-bilateral").cloned())
}

fn distance(feature: Feature) -> String {
    let name = feature.row().name;
    format!("{}({name}, {name})", Op::Distance2.name())
}

/// exp(-d² / (2σ²)), with 2σ² as one constant, so that a mutation of it is one
/// step to another bandwidth.
fn gaussian(feature: Feature, sigma: f64) -> String {
    format!("exp(-pow({}, 2) / {})", distance(feature), (2.0 * sigma * sigma) as f32)
}

fn product_of_gaussians(bandwidths: &[(Feature, f64)]) -> Tree {
    let factors: Vec<String> =
        bandwidths.iter().map(|&(feature, sigma)| gaussian(feature, sigma)).collect();
    parsed(&factors.join(" * "))
}

fn parsed(text: &str) -> Tree {
    text::parse_scalar(text).expect("a test parses every text of this file")
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use rand::{Rng, RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::expr::feature::{PlaneId, Quantity};
    use crate::expr::tape::Side;

    #[test]
    fn filters_are_what_their_names_say() {
        assert_eq!(
            named("bilateral").expect("it is known").to_string(),
            "exp(-pow(distance2(pixel, pixel), 2) / 1.5488) * exp(-pow(distance2(color, color), 2) / 4050)"
        );
        assert!(named("nothing").is_none());
        for filter in known() {
            assert_eq!(named(filter.name), Some(&filter.weight));
        }
    }

    #[test]
    fn the_codebook_holds_every_kernel_and_every_part_once() {
        let trees = codebook();
        assert_eq!(trees.iter().collect::<HashSet<_>>().len(), trees.len());
        for text in [
            "mitchell(distance2(normal, normal))",
            "sinc(distance2(pixel, pixel) / 10)",
            "exp(-pow(distance2(texture, texture), 2) / 0.0648)",
            "-pow(distance2(texture, texture), 2)",
            "distance2(depth, depth)",
            "2",
        ] {
            assert!(trees.contains(&parsed(text)), "{text}");
        }
        assert!(trees.contains(named("cross-bilateral").expect("it is known")));
        assert!(trees.iter().all(|tree| tree.sort() == Sort::Scalar));
    }

    /// What Equations 2 to 5 look at of a pixel.
    #[derive(Clone, Copy, Debug)]
    struct Sample {
        p: [f64; 2],
        wp: [f64; 3],
        n: [f64; 3],
        t: [f64; 3],
        di: [f64; 3],
        c: [f64; 3],
        var_wp: f64,
    }

    impl Sample {
        /// A pixel at most `spread` away from this one in every feature.
        fn near(self, rng: &mut impl Rng, spread: f64) -> Self {
            let mut away = |x: f64, scale: f64| x + scale * spread * rng.random_range(-1.0..1.0);
            Self {
                p: self.p.map(|x| away(x, 20.0).round()),
                wp: self.wp.map(|x| away(x, 0.3)),
                n: self.n.map(|x| away(x, 2.0)),
                t: self.t.map(|x| away(x, 0.3)),
                di: self.di.map(|x| away(x, 2.0)),
                c: self.c.map(|x| away(x, 2.0)),
                var_wp: away(self.var_wp, 3.0).abs(),
            }
        }

        fn read(&self, plane: PlaneId) -> f64 {
            let component = usize::from(plane.component);
            match (plane.feature, plane.quantity) {
                (Feature::Pixel, Quantity::Value) => self.p[component],
                (Feature::WorldPosition, Quantity::Value) => self.wp[component],
                (Feature::Normal, Quantity::Value) => self.n[component],
                (Feature::Texture, Quantity::Value) => self.t[component],
                (Feature::DirIllumination, Quantity::Value) => self.di[component],
                (Feature::Color, Quantity::Value) => self.c[component],
                (Feature::WorldPosition, Quantity::Variance) => self.var_wp,
                other => panic!("the equations do not look at {other:?}"),
            }
        }
    }

    fn differences<const N: usize>(a: [f64; N], b: [f64; N]) -> [f64; N] {
        std::array::from_fn(|k| (a[k] - b[k]).abs())
    }

    fn l1<const N: usize>(a: [f64; N], b: [f64; N]) -> f64 {
        differences(a, b).into_iter().sum()
    }

    fn l2<const N: usize>(a: [f64; N], b: [f64; N]) -> f64 {
        differences(a, b).into_iter().map(|d| d * d).sum::<f64>().sqrt()
    }

    fn max<const N: usize>(a: [f64; N], b: [f64; N]) -> f64 {
        differences(a, b).into_iter().fold(0.0, f64::max)
    }

    fn sinc(x: f64) -> f64 {
        if x == 0.0 { 1.0 } else { (PI * x).sin() / (PI * x) }
    }

    fn biweight(x: f64) -> f64 {
        if x.abs() < 1.0 { 15.0 / 16.0 * (1.0 - x * x).powi(2) } else { 0.0 }
    }

    fn tricube(x: f64) -> f64 {
        if x.abs() < 1.0 { 70.0 / 81.0 * (1.0 - x.abs().powi(3)).powi(3) } else { 0.0 }
    }

    /// Mitchell and Netravali's piecewise cubic, with B = C = 1/3.
    fn mitchell(x: f64) -> f64 {
        let (b, c, x) = (1.0 / 3.0, 1.0 / 3.0, x.abs());
        let cubic = if x < 1.0 {
            (12.0 - 9.0 * b - 6.0 * c) * x.powi(3)
                + (-18.0 + 12.0 * b + 6.0 * c) * x.powi(2)
                + (6.0 - 2.0 * b)
        } else if x < 2.0 {
            (-b - 6.0 * c) * x.powi(3)
                + (6.0 * b + 30.0 * c) * x.powi(2)
                + (-12.0 * b - 48.0 * c) * x
                + (8.0 * b + 24.0 * c)
        } else {
            0.0
        };
        cubic / 6.0
    }

    /// Equations 2 to 5, written out. Literals of the language are f32.
    fn equations(i: &Sample, j: &Sample) -> f64 {
        let f_wp = l2(i.wp, j.wp);
        let f_di = l2(i.di, j.di);
        let power_3 = (-max(i.t, j.t).powi(2) / f64::from(0.01_f32)).exp()
            * (tricube(f_di) * mitchell(i.var_wp)).exp();
        let power_2 = biweight(max(i.c, j.c) * (3.0 * sinc(f_di)).exp2()).exp();
        let kernel = biweight((l2(i.n, j.n) / 2.0).powf(power_2).powf(power_3));
        let power_1 = -((l1(i.p, j.p) + 2.0 + sinc(f_wp.powf(f64::from(0.002_f32))).exp())
            / kernel.asin().exp2());
        (-max(i.wp, j.wp) / f64::from(0.05_f32)).exp() * power_1.exp()
    }

    #[test]
    fn kan2017_is_equations_2_to_5() {
        let tree = named("kan2017").expect("it is known");
        let mut rng = ChaCha8Rng::seed_from_u64(2017);
        let origin = Sample {
            p: [100.0, 50.0],
            wp: [0.2, 0.5, 0.9],
            n: [0.6, 0.0, 0.8],
            t: [0.5; 3],
            di: [0.7; 3],
            c: [0.6; 3],
            var_wp: 0.0,
        };
        for k in 0..20_000 {
            // From a pixel with itself to pixels that have nothing in common.
            let spread = f64::from(k % 100) / 99.0;
            let (i, j) = (origin.near(&mut rng, spread), origin.near(&mut rng, spread));
            let expected = equations(&i, &j);
            let got = tree.meaning(|plane, side| match side {
                Side::I => i.read(plane),
                Side::J => j.read(plane),
            });
            // The language flushes what f32 holds only as a subnormal.
            let tolerance = 1e-10 * expected + f64::from(f32::MIN_POSITIVE);
            assert!((got - expected).abs() <= tolerance, "{got} for {expected}: {i:?} {j:?}");
        }
    }
}
