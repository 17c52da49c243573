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
//! is there in all its parts. "Bilateral" and "cross-bilateral" are products of
//! Gaussians of the bandwidths in [`SIGMAS`].

use std::collections::HashSet;
use std::sync::LazyLock;

use super::feature::Feature;
use super::op::{Op, Sort};
use super::text;
use super::tree::Tree;

/// The bandwidth of each feature's Gaussian in `gaussian`, `bilateral` and
/// `cross-bilateral`: pixels for `pixel`, the loader's normalised units for the
/// others. A feature without one has no Gaussian.
pub const SIGMAS: [(Feature, f64); 6] = [
    (Feature::Pixel, 5.0),
    (Feature::Color, 0.5),
    (Feature::WorldPosition, 0.05),
    (Feature::Normal, 0.3),
    (Feature::Texture, 0.1),
    (Feature::DirIllumination, 0.3),
];

/// The distance in pixels at which a kernel of compact support ends when it is
/// applied to pixels: the default window's radius.
pub const REACH: f64 = 10.0;

/// The filter of the paper, Equations 2 to 5, in this order.
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
                weight: product_of_gaussians(&[Feature::Pixel]),
            },
            Known {
                name: "bilateral",
                doc: "Gaussians of the distances in pixels and in noisy colour",
                weight: product_of_gaussians(&[Feature::Pixel, Feature::Color]),
            },
            Known {
                name: "cross-bilateral",
                doc: "Gaussians of the distances in pixels, colour and features",
                weight: product_of_gaussians(&SIGMAS.map(|(feature, _)| feature)),
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
        Feature::ALL.into_iter().map(move |feature| {
            let unit = match feature {
                Feature::Pixel => format!(" / {REACH}"),
                Feature::WorldPosition
                | Feature::Normal
                | Feature::Texture
                | Feature::SecTexture
                | Feature::Depth
                | Feature::DirIllumination
                | Feature::Color => String::new(),
            };
            parsed(&format!("{}({}{unit})", kernel.name(), distance(feature)))
        })
    });
    let gaussians = SIGMAS.into_iter().map(|(feature, sigma)| parsed(&gaussian(feature, sigma)));
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

fn product_of_gaussians(features: &[Feature]) -> Tree {
    let factors: Vec<String> = SIGMAS
        .iter()
        .filter(|(feature, _)| features.contains(feature))
        .map(|&(feature, sigma)| gaussian(feature, sigma))
        .collect();
    parsed(&factors.join(" * "))
}

fn parsed(text: &str) -> Tree {
    text::parse_scalar(text).expect("a test parses every text of this file")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_are_what_their_names_say() {
        assert_eq!(
            named("bilateral").expect("it is known").to_string(),
            "exp(-pow(distance2(pixel, pixel), 2) / 50) * exp(-pow(distance2(color, color), 2) / 0.5)"
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
            "exp(-pow(distance2(texture, texture), 2) / 0.02)",
            "-pow(distance2(texture, texture), 2)",
            "distance2(depth, depth)",
            "2",
        ] {
            assert!(trees.contains(&parsed(text)), "{text}");
        }
        assert!(trees.contains(named("cross-bilateral").expect("it is known")));
        assert!(trees.iter().all(|tree| tree.sort() == Sort::Scalar));
    }
}
