//! How renderers name the channels that hold the features: one row each.
//!
//! A row lists, per feature, the *layers* a renderer's files hold it in, best
//! first. A layer stands for its channels: `albedo` for `albedo.R`, `albedo.G`,
//! `albedo.B` (or `.X .Y .Z`); of a feature one component wide, for `depth`
//! itself or `depth.Z`, `.V`, `.Y`, `.T`, `.R`. The empty layer is bare `R G B`.
//! Upper and lower case are not told apart: no renderer's names differ in case
//! alone. Which row fits a file is [`Mapping`](super::mapping::Mapping)'s matter.
//!
//! What rows cannot know: whether a user renamed the outputs, and in which space
//! positions and normals are (pbrt's are in camera space by default). The
//! normalisation makes filters indifferent to where the world's origin is, but
//! not to its rotation.

use crate::expr::feature::{Feature, Quantity};

/// A renderer's naming convention.
#[derive(Debug)]
pub struct Convention {
    /// The renderer.
    pub name: &'static str,
    /// Layers per feature, best first.
    values: &'static [(Feature, &'static [&'static str])],
    /// Layers that hold variances, and variances of what.
    variances: &'static [(Feature, &'static [&'static str], Spread)],
}

/// What a file's variance is the variance of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spread {
    /// Of the pixel's mean: what filters expect.
    OfMean,
    /// Of one sample: to be divided by the number of samples per pixel, where
    /// the file states it, and of no use otherwise.
    PerSample,
    /// Not documented by the renderer, so not used.
    Unclear,
}

use Feature::{Color, Depth, DirIllumination, Normal, SecTexture, Texture, WorldPosition};

/// Every convention. Of two that explain a file equally well, the earlier one is
/// taken; the last collects common names that belong to no renderer.
pub static CONVENTIONS: [Convention; 9] = [
    // Tamis' own names are the feature table's (`Feature::row`), not repeated here.
    Convention { name: "Tamis", values: &[], variances: &[] },
    Convention {
        name: "pbrt-v4",
        values: &[
            (WorldPosition, &["P"]),
            // Ns is the shading normal, N the geometric one.
            (Normal, &["Ns", "N"]),
            (Texture, &["Albedo"]),
            (Color, &[""]),
        ],
        variances: &[(Color, &["Variance"], Spread::PerSample)],
    },
    Convention {
        name: "Blender Cycles",
        values: &[
            (WorldPosition, &["Position"]),
            // The denoising passes see through mirrors and are antialiased.
            (Normal, &["Denoising Normal", "Normal"]),
            (Texture, &["Denoising Albedo", "Diffuse Color", "DiffCol"]),
            (Depth, &["Denoising Depth", "Depth", "Z"]),
            // Diffuse only, and without the surface's colour: the nearest there is.
            (DirIllumination, &["Diffuse Direct", "DiffDir"]),
            // "Noisy Image" stands beside an image that was denoised already.
            (Color, &["Noisy Image", "Combined"]),
        ],
        variances: &[],
    },
    Convention {
        name: "Arnold",
        values: &[
            (WorldPosition, &["P"]),
            (Normal, &["denoise_normal", "N"]),
            (Texture, &["denoise_albedo", "albedo", "diffuse_albedo"]),
            (Depth, &["Z"]),
            (DirIllumination, &["direct", "diffuse_direct"]),
            (Color, &["RGBA", "beauty", ""]),
        ],
        variances: &[(Color, &["variance"], Spread::Unclear)],
    },
    Convention {
        name: "RenderMan",
        values: &[
            (WorldPosition, &["__Pworld", "Pworld"]),
            (Normal, &["normal", "__Nworld", "Nn"]),
            (Texture, &["albedo"]),
            (Depth, &["zfiltered", "z"]),
            (DirIllumination, &["directDiffuse", "diffuse"]),
            (Color, &["Ci", ""]),
        ],
        // Its statistics `mse` are the variance divided by the sample count.
        variances: &[
            (Color, &["mse", "Ci_mse"], Spread::OfMean),
            (Normal, &["normal_mse"], Spread::OfMean),
            (Texture, &["albedo_mse"], Spread::OfMean),
            (Depth, &["zfiltered_mse"], Spread::OfMean),
            (Color, &["Ci_var"], Spread::PerSample),
            (Normal, &["normal_var"], Spread::PerSample),
            (Texture, &["albedo_var"], Spread::PerSample),
            (Depth, &["zfiltered_var"], Spread::PerSample),
        ],
    },
    Convention {
        name: "V-Ray",
        values: &[
            (WorldPosition, &["VRayWorldPosition", "worldPosition"]),
            (Normal, &["VRayNormals", "VRayBumpNormals", "normals"]),
            (Texture, &["VRayDiffuseFilter", "diffuseFilter", "diffuse"]),
            (Depth, &["VRayZDepth", "zDepth", "Z"]),
            (DirIllumination, &["VRayLighting", "lighting"]),
            (Color, &[""]),
        ],
        variances: &[],
    },
    Convention {
        name: "Karma",
        values: &[
            (WorldPosition, &["P"]),
            (Normal, &["N"]),
            (Texture, &["albedo"]),
            (Depth, &["depth", "Pz", "Z"]),
            (DirIllumination, &["directdiffuse", "direct"]),
            (Color, &["C", "Cf", ""]),
        ],
        variances: &[],
    },
    Convention {
        // The user chooses these names; the rows are those of the manual's and of
        // widespread examples. The `moment` integrator's `m2_*` are E[x²] per
        // sample: of no use without the sample count, which no channel states.
        name: "Mitsuba 3",
        values: &[
            (WorldPosition, &["pos", "position", "pp"]),
            (Normal, &["nn", "sh_normal", "ns", "normal"]),
            (Texture, &["alb", "albedo"]),
            (Depth, &["dd", "depth"]),
            (DirIllumination, &["direct"]),
            (Color, &["img", "image", ""]),
        ],
        variances: &[],
    },
    Convention {
        name: "common names",
        values: &[
            (WorldPosition, &["WorldPosition", "World Position", "Position", "P"]),
            (Normal, &["Normal", "Normals", "ShadingNormal", "Shading Normal", "N", "Ns"]),
            (Texture, &["Albedo", "DiffuseAlbedo", "Diffuse Albedo", "BaseColor", "Texture"]),
            (SecTexture, &["SecondaryAlbedo", "Secondary Albedo", "SecTexture"]),
            (Depth, &["Depth", "Z", "ZDepth", "Distance"]),
            (DirIllumination, &["Direct", "DirectIllumination", "DirectLighting"]),
            (Color, &["", "color", "colour", "beauty", "rgb", "rgba", "noisy", "combined"]),
        ],
        variances: &[],
    },
];

/// Suffixes of three components.
const TRIPLES: [[&str; 3]; 2] = [["r", "g", "b"], ["x", "y", "z"]];
/// Suffixes of one component; the bare layer comes before them.
const SINGLES: [&str; 5] = ["z", "v", "y", "t", "r"];

/// One way to name the channels of a quantity: full names without prefix, in
/// lower case, in component order. Of a variance, either one or one per
/// component.
pub(super) type Candidate = Vec<String>;

impl Convention {
    /// The ways this convention names a feature's value, best first.
    pub(super) fn value(&self, feature: Feature) -> Vec<Candidate> {
        if self.is_own() {
            return own(feature, Quantity::Value);
        }
        let rows = self.values.iter().filter(|row| row.0 == feature);
        rows.flat_map(|row| row.1).flat_map(|layer| expand(layer, feature.width())).collect()
    }

    /// The ways this convention names a feature's variance, best first.
    pub(super) fn variance(&self, feature: Feature) -> Vec<(Candidate, Spread)> {
        if self.is_own() {
            let rows = own(feature, Quantity::Variance).into_iter();
            return rows.map(|candidate| (candidate, Spread::OfMean)).collect();
        }
        let rows = self.variances.iter().filter(|row| row.0 == feature);
        rows.flat_map(|&(_, layers, spread)| {
            let wide = layers.iter().flat_map(move |layer| expand(layer, feature.width()));
            let single = layers.iter().flat_map(|layer| expand(layer, 1));
            wide.chain(single).map(move |candidate| (candidate, spread))
        })
        .collect()
    }

    /// The layers a feature's value is looked for in, for error messages.
    pub(super) fn layers(&self, feature: Feature) -> Vec<&'static str> {
        if self.is_own() {
            return feature.row().channels.to_vec();
        }
        let rows = self.values.iter().filter(|row| row.0 == feature);
        rows.flat_map(|row| row.1)
            .map(|&layer| if layer.is_empty() { "R G B" } else { layer })
            .collect()
    }

    fn is_own(&self) -> bool {
        self.name == CONVENTIONS[0].name
    }
}

/// Tamis' own names, read off the feature's row.
fn own(feature: Feature, quantity: Quantity) -> Vec<Candidate> {
    let row = feature.row();
    let names = match quantity {
        Quantity::Value => row.channels,
        Quantity::Variance => row.variance_channels,
        // Gradients are derived, never stored.
        Quantity::Gradient => &[],
    };
    if names.is_empty() {
        return Vec::new();
    }
    let mut ways = vec![names.iter().map(|name| name.to_lowercase()).collect()];
    if let ([single], Quantity::Variance) = (names, quantity) {
        // One variance per component is averaged into the one that filters read.
        ways.extend(expand(single, row.width).into_iter().filter(|way| way.len() > 1));
    }
    ways
}

fn expand(layer: &str, width: usize) -> Vec<Candidate> {
    let layer = layer.to_lowercase();
    let name = |suffix: &str| {
        if layer.is_empty() { suffix.to_owned() } else { format!("{layer}.{suffix}") }
    };
    match width {
        3 if layer.is_empty() => vec![TRIPLES[0].iter().map(|suffix| name(suffix)).collect()],
        3 => TRIPLES.iter().map(|set| set.iter().map(|suffix| name(suffix)).collect()).collect(),
        _ => {
            let bare = std::iter::once(layer.clone());
            bare.chain(SINGLES.iter().map(|suffix| name(suffix))).map(|name| vec![name]).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn our_own_names_are_those_of_the_feature_table() {
        let tamis = &CONVENTIONS[0];
        assert_eq!(tamis.value(Texture)[0], ["albedo.r", "albedo.g", "albedo.b"]);
        assert_eq!(tamis.value(Depth)[0], ["depth.z"]);
        assert_eq!(tamis.variance(Color)[0].0, ["variance.r", "variance.g", "variance.b"]);
        assert_eq!(tamis.variance(Normal)[0].0, ["normal.variance"]);
        assert!(tamis.value(Feature::Pixel).is_empty());
    }

    #[test]
    fn a_layer_stands_for_its_channels() {
        let blender = &CONVENTIONS[2];
        let ways = blender.value(Depth);
        assert_eq!(ways[0], ["denoising depth"]);
        assert!(ways.contains(&vec!["depth.z".to_owned()]));
        assert!(blender.value(Normal).contains(&vec![
            "normal.x".to_owned(),
            "normal.y".to_owned(),
            "normal.z".to_owned()
        ]));
    }
}
