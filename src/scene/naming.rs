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
    /// What a user switches on there to get albedo, normals and depth; nothing if nobody
    /// knows.
    pub switches: &'static str,
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
    /// that is known, and of no use otherwise.
    PerSample,
    /// Not documented by the renderer, so not used.
    Unclear,
}

use Feature::{Color, Depth, DirIllumination, Normal, SecTexture, Texture, WorldPosition};

/// Every convention. Of two that explain a file equally well, the earlier one is
/// taken; the last collects common names that belong to no renderer.
pub static CONVENTIONS: [Convention; 18] = [
    // Tamis' own names are the feature table's (`Feature::row`), not repeated here.
    Convention { name: "Tamis", switches: "", values: &[], variances: &[] },
    Convention {
        name: "pbrt-v4",
        switches: "Film \"gbuffer\"",
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
        switches: "View Layer > Passes > Data > Denoising Data",
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
        switches: "AOVs denoise_albedo, N, P, Z",
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
        switches: "display channels albedo, normal, zfiltered, mse",
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
        // Render elements have other names in the standalone program (`…Channel`).
        name: "V-Ray",
        switches: "render elements Diffuse Filter, Normals, Z-Depth",
        values: &[
            (WorldPosition, &["VRayWorldPosition", "worldPosition", "pointWorldChannel"]),
            (
                Normal,
                &["VRayBumpNormals", "VRayNormals", "bumpNormals", "normals", "normalsChannel"],
            ),
            (Texture, &["VRayDiffuseFilter", "diffuseFilter", "diffuseChannel", "diffuse"]),
            (Depth, &["VRayZDepth", "zDepth", "zDepthChannel", "Z"]),
            (DirIllumination, &["VRayLighting", "lighting", "lightingChannel"]),
            (Color, &["", "RGB_color"]),
        ],
        variances: &[],
    },
    Convention {
        name: "Karma",
        switches: "render settings > AOVs: albedo, N, P, depth",
        values: &[
            (WorldPosition, &["P"]),
            (Normal, &["N"]),
            (Texture, &["albedo", "basecolor"]),
            (Depth, &["depth", "Pz", "Z"]),
            (DirIllumination, &["directdiffuse", "direct"]),
            (Color, &["C", "Cf", ""]),
        ],
        variances: &[],
    },
    Convention {
        name: "Mantra",
        switches: "extra image planes basecolor, N, P, Pz",
        values: &[
            (WorldPosition, &["P"]),
            (Normal, &["N"]),
            (Texture, &["basecolor", "export_basecolor"]),
            (Depth, &["Pz"]),
            (DirIllumination, &["direct_comp", "direct_diffuse"]),
            (Color, &["Cf+Af", "C", ""]),
        ],
        variances: &[],
    },
    Convention {
        // Users choose these names, and for some filter the direct light is a second
        // integrator's image. Moments are of single samples.
        name: "Mitsuba 3",
        switches: "integrator \"aov\" with \"albedo:albedo,nn:sh_normal,pos:position,dd:depth\"",
        values: &[
            (WorldPosition, &["pos", "position", "pp"]),
            (Normal, &["nn", "sh_normal", "shn", "ns", "normal"]),
            (Texture, &["alb", "albedo"]),
            (Depth, &["dd", "depth"]),
            (DirIllumination, &["direct"]),
            (Color, &["path", "img", "image", "<root>", ""]),
        ],
        variances: &[],
    },
    Convention {
        name: "Redshift",
        switches: "AOVs Diffuse Filter, Bump Normals, World Position, Depth",
        values: &[
            (WorldPosition, &["WorldPosition"]),
            (Normal, &["BumpNormals", "Normals"]),
            (Texture, &["DiffuseFilter"]),
            (Depth, &["Depth", "Z"]),
            (Color, &["Beauty", ""]),
        ],
        variances: &[],
    },
    Convention {
        name: "Octane",
        switches: "render AOVs Denoiser albedo, Denoiser normal, Position, Z-depth",
        values: &[
            (WorldPosition, &["Position"]),
            (Normal, &["Denoiser normal", "Shading normal", "Smooth normal"]),
            (Texture, &["Denoiser albedo", "Diffuse filter"]),
            (Depth, &["Z-depth", "Z depth"]),
            (DirIllumination, &["Diffuse direct"]),
            (Color, &["Noisy beauty", "Beauty", "Main", ""]),
        ],
        variances: &[],
    },
    Convention {
        name: "Corona",
        switches: "render elements CShading_Albedo, CGeometry_NormalsShading, CGeometry_ZDepth",
        values: &[
            (WorldPosition, &["CGeometry_WorldPosition"]),
            (Normal, &["CGeometry_NormalsShading", "CGeometry_NormalsGeometry"]),
            (Texture, &["CShading_Albedo", "CShading_SourceColor"]),
            (Depth, &["CGeometry_ZDepth"]),
            (DirIllumination, &["CShading_DirectLight", "CShading_Direct"]),
            (Color, &["CShading_Beauty", "", "Beauty"]),
        ],
        variances: &[],
    },
    Convention {
        name: "appleseed",
        switches: "AOVs albedo, normal, position, depth",
        values: &[
            (WorldPosition, &["position"]),
            (Normal, &["normal"]),
            (Texture, &["albedo"]),
            (Depth, &["depth"]),
            (DirIllumination, &["direct_diffuse"]),
            (Color, &["beauty", ""]),
        ],
        variances: &[],
    },
    Convention {
        name: "LuxCore",
        switches: "AOVs Albedo, Average Shading Normal, Position, Depth",
        values: &[
            (WorldPosition, &["POSITION"]),
            (Normal, &["AVG_SHADING_NORMAL", "SHADING_NORMAL"]),
            (Texture, &["ALBEDO"]),
            (Depth, &["DEPTH"]),
            (DirIllumination, &["DIRECT_DIFFUSE"]),
            (Color, &["Combined", "RGB_IMAGEPIPELINE", "RGBA_IMAGEPIPELINE", ""]),
        ],
        variances: &[],
    },
    Convention {
        name: "Unreal",
        switches: "Movie Render Queue > Deferred Rendering > Additional Post Process Materials",
        values: &[
            (WorldPosition, &["FinalImageWorldPosition", "WorldPosition"]),
            (Normal, &["FinalImageWorldNormal", "WorldNormal"]),
            (Texture, &["FinalImageBaseColor", "BaseColor"]),
            (
                Depth,
                &["FinalImageMovieRenderQueue_WorldDepth", "FinalImageWorldDepth", "SceneDepth"],
            ),
            (Color, &["FinalImage", "PathTracer", "FinalImagePathTracer", ""]),
        ],
        variances: &[],
    },
    Convention {
        // What its examples call their files: with --aux a file's name is a layer's.
        name: "Open Image Denoise",
        switches: "",
        values: &[
            (Normal, &["nrm", "normal"]),
            (Texture, &["alb", "albedo"]),
            (Color, &["hdr", "color", ""]),
        ],
        variances: &[],
    },
    Convention {
        name: "common names",
        switches: "",
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
    Convention {
        name: "luminance",
        switches: "",
        values: &[(Color, &["Y", "luminance", "grey", "gray"])],
        variances: &[],
    },
];

/// Layers that mean one thing to one renderer and another to others (`diffuse` is an albedo to
/// V-Ray, reflected light to most). They count in files alone that the renderer has named
/// otherwise, too.
const AMBIGUOUS: [&str; 2] = ["diffuse", "lighting"];

/// Before the name of a layer: that of the means of its samples' squares, which become
/// variances of the mean with the layer itself and the number of samples per pixel. (Mitsuba's
/// integrator `moment`.)
pub(super) const MOMENT: &str = "m2_";

/// Suffixes of three components.
const TRIPLES: [[&str; 3]; 3] = [["r", "g", "b"], ["x", "y", "z"], ["red", "green", "blue"]];
/// Suffixes of one component; the bare layer comes before them.
const SINGLES: [&str; 5] = ["z", "v", "y", "t", "r"];

/// One way to name the channels of a quantity: full names without prefix, in
/// lower case, in component order. Of a variance, either one or one per
/// component.
pub(super) type Candidate = Vec<String>;

/// A way to name a quantity, as a convention has it.
pub(super) struct Way {
    pub(super) channels: Candidate,
    pub(super) spread: Spread,
    /// Whether the name means other things to other renderers.
    pub(super) is_ambiguous: bool,
}

impl Convention {
    /// The ways this convention names a feature's value, best first.
    pub(super) fn value(&self, feature: Feature) -> Vec<Way> {
        let certain = |channels| Way { channels, spread: Spread::OfMean, is_ambiguous: false };
        if self.is_own() {
            return own(feature, Quantity::Value).into_iter().map(certain).collect();
        }
        let rows = self.values.iter().filter(|row| row.0 == feature);
        rows.flat_map(|row| row.1)
            .flat_map(|layer| {
                // A grey image is one channel wide.
                let width = if self.is_grey() { 1 } else { feature.width() };
                let is_ambiguous = AMBIGUOUS.contains(layer);
                let ways = expand(layer, width).into_iter();
                ways.map(move |channels| Way { is_ambiguous, ..certain(channels) })
            })
            .collect()
    }

    /// The ways this convention names a feature's variance, best first.
    pub(super) fn variance(&self, feature: Feature) -> Vec<Way> {
        let way = |channels, spread| Way { channels, spread, is_ambiguous: false };
        if self.is_own() {
            let rows = own(feature, Quantity::Variance).into_iter();
            return rows.map(|channels| way(channels, Spread::OfMean)).collect();
        }
        let rows = self.variances.iter().filter(|row| row.0 == feature);
        rows.flat_map(|&(_, layers, spread)| {
            let wide = layers.iter().flat_map(move |layer| expand(layer, feature.width()));
            let single = layers.iter().flat_map(|layer| expand(layer, 1));
            wide.chain(single).map(move |channels| way(channels, spread))
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

    /// Whether no other renderer has this layer, so that it tells whose file it is.
    pub(super) fn has_alone(&self, way: &Way, feature: Feature) -> bool {
        let others = CONVENTIONS.iter().filter(|other| !std::ptr::eq(*other, self));
        !way.is_ambiguous
            && !others.flat_map(|other| other.value(feature)).any(|o| o.channels == way.channels)
    }

    fn is_own(&self) -> bool {
        self.name == CONVENTIONS[0].name
    }

    fn is_grey(&self) -> bool {
        self.name == CONVENTIONS[CONVENTIONS.len() - 1].name
    }
}

/// Whether a layer is known to hold something else than light: surfaces, places, hashes of
/// Cryptomatte.
pub(super) fn is_data(layer: &str) -> bool {
    let lower = layer.to_lowercase();
    let last = lower.rsplit('.').next().unwrap_or_default();
    let data = [WorldPosition, Normal, Texture, SecTexture, Depth];
    let rows = CONVENTIONS.iter().flat_map(|row| row.values).filter(|row| data.contains(&row.0));
    let mut known = rows.flat_map(|row| row.1).filter(|name| !AMBIGUOUS.contains(name));
    last.starts_with("crypto") || known.any(|name| name.eq_ignore_ascii_case(last))
}

/// The longest layer that some convention knows at the end of a name of a file, which may go
/// on before it (`shot_12-albedo`).
pub(super) fn layer_in(name: &str) -> Option<&'static str> {
    let lower = name.to_lowercase();
    let is_end = |layer: &&str| {
        let layer = layer.to_lowercase();
        lower
            .strip_suffix(layer.as_str())
            .is_some_and(|before| before.is_empty() || before.ends_with(['.', '_', '-', ' ']))
    };
    let rows = CONVENTIONS.iter().flat_map(|row| row.values).flat_map(|row| row.1).copied();
    rows.filter(|layer| layer.len() > 1).filter(is_end).max_by_key(|layer| layer.len())
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

pub(super) fn expand(layer: &str, width: usize) -> Vec<Candidate> {
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

    fn ways(convention: &Convention, feature: Feature) -> Vec<Candidate> {
        convention.value(feature).into_iter().map(|way| way.channels).collect()
    }

    #[test]
    fn our_own_names_are_those_of_the_feature_table() {
        let tamis = &CONVENTIONS[0];
        assert_eq!(ways(tamis, Texture)[0], ["albedo.r", "albedo.g", "albedo.b"]);
        assert_eq!(ways(tamis, Depth)[0], ["depth.z"]);
        let variance = &tamis.variance(Color)[0].channels;
        assert_eq!(*variance, ["variance.r", "variance.g", "variance.b"]);
        assert_eq!(tamis.variance(Normal)[0].channels, ["normal.variance"]);
        assert!(tamis.value(Feature::Pixel).is_empty());
    }

    #[test]
    fn a_layer_stands_for_its_channels() {
        let blender = &CONVENTIONS[2];
        let depth = ways(blender, Depth);
        assert_eq!(depth[0], ["denoising depth"]);
        assert!(depth.contains(&vec!["depth.z".to_owned()]));
        assert!(ways(blender, Normal).contains(&vec![
            "normal.x".to_owned(),
            "normal.y".to_owned(),
            "normal.z".to_owned()
        ]));
    }

    #[test]
    fn a_files_name_may_end_in_a_layers() {
        assert_eq!(layer_in("shot_12-albedo"), Some("Albedo"));
        assert_eq!(layer_in("shot.Denoiser Normal"), Some("Denoiser normal"));
        assert_eq!(layer_in("alb"), Some("alb"));
        assert_eq!(layer_in("malbedo"), None);
    }
}
