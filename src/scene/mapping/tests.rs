//! One made header per convention.

use super::*;
use crate::image::exr::Header;

/// The channels found for a feature's value, without blanks.
fn value(mapping: &Mapping, feature: Feature) -> String {
    mapping.value(feature).map(|source| source.channels.join(",")).unwrap_or_default()
}

fn layers(layers: &[(&str, &str)]) -> Vec<String> {
    let name = |layer: &str, suffix: char| match layer {
        "" => suffix.to_string(),
        _ => format!("{layer}.{suffix}"),
    };
    let names = layers.iter().flat_map(|(layer, suffixes)| {
        let bare = suffixes.is_empty().then(|| (*layer).to_owned());
        bare.into_iter().chain(suffixes.chars().map(move |suffix| name(layer, suffix)))
    });
    names.collect()
}

fn mapping(channels: &[(&str, &str)], spp: Option<u32>) -> Mapping {
    let names = layers(channels);
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    Mapping::of(&Listing::of(Header::made(&names, spp)))
}

use Feature::{Color, Depth, DirIllumination, Normal, SecTexture, Texture, WorldPosition};

#[test]
fn our_own_names() {
    let own: Vec<&str> = Feature::ALL
        .iter()
        .flat_map(|f| f.row().channels.iter().chain(f.row().variance_channels))
        .copied()
        .collect();
    let m = Mapping::of(&Listing::of(Header::made(&own, None)));
    assert_eq!(m.convention(), "Tamis");
    for feature in Feature::ALL {
        let row = feature.row();
        assert_eq!(value(&m, feature), row.channels.join(","));
        let variance = m.variance(feature).map(|source| source.channels.join(","));
        assert_eq!(variance.unwrap_or_default(), row.variance_channels.join(","));
    }
    assert!(m.unusable().is_empty());
}

#[test]
fn pbrt_v4() {
    let gbuffer = [
        ("", "RGB"),
        ("Albedo", "RGB"),
        ("Ns", "XYZ"),
        ("N", "XYZ"),
        ("P", "XYZ"),
        ("u", ""),
        ("v", ""),
        ("Variance", "RGB"),
        ("RelativeVariance", "RGB"),
    ];
    let m = mapping(&gbuffer, None);
    assert_eq!(m.convention(), "pbrt-v4");
    assert_eq!(value(&m, Normal), "Ns.X,Ns.Y,Ns.Z");
    assert_eq!(value(&m, WorldPosition), "P.X,P.Y,P.Z");
    assert_eq!(value(&m, Color), "R,G,B");
    // Per sample, and the number of samples unknown: not a variance for us.
    assert_eq!(m.variance(Color), None);
    assert_eq!(m.unusable().len(), 1);
    let m = mapping(&gbuffer, Some(16));
    assert_eq!(m.variance(Color).map(|source| source.divisor), Some(16.0));
}

#[test]
fn blender_with_several_view_layers_and_a_composite() {
    let m = mapping(
        &[
            ("Composite.Combined", "RGBA"),
            ("ViewLayer.Combined", "RGBA"),
            ("ViewLayer.Depth", "Z"),
            ("ViewLayer.Position", "XYZ"),
            ("ViewLayer.Normal", "XYZ"),
            ("ViewLayer.Denoising Normal", "XYZ"),
            ("ViewLayer.Denoising Albedo", "RGB"),
            ("ViewLayer.Diffuse Direct", "RGB"),
            ("Other.Combined", "RGBA"),
        ],
        None,
    );
    assert_eq!(m.convention(), "Blender Cycles");
    assert_eq!(value(&m, Color), "ViewLayer.Combined.R,ViewLayer.Combined.G,ViewLayer.Combined.B");
    assert!(value(&m, Normal).starts_with("ViewLayer.Denoising Normal.X"));
    assert!(value(&m, Texture).starts_with("ViewLayer.Denoising Albedo.R"));
    assert!(value(&m, DirIllumination).starts_with("ViewLayer.Diffuse Direct.R"));
    assert_eq!(value(&m, Depth), "ViewLayer.Depth.Z");
    let old = mapping(
        &[
            ("RenderLayer.Combined", "RGBA"),
            ("RenderLayer.DiffDir", "RGB"),
            ("RenderLayer.Depth", "V"),
        ],
        None,
    );
    assert_eq!(old.convention(), "Blender Cycles");
    assert_eq!(value(&old, Depth), "RenderLayer.Depth.V");
    assert!(value(&old, DirIllumination).starts_with("RenderLayer.DiffDir"));
}

#[test]
fn arnold_renderman_vray_karma_mitsuba() {
    let arnold = mapping(
        &[
            ("RGBA", "RGBA"),
            ("denoise_albedo", "RGB"),
            ("N", "XYZ"),
            ("P", "XYZ"),
            ("Z", ""),
            ("direct", "RGB"),
            ("variance", "RGB"),
        ],
        Some(4),
    );
    assert_eq!(arnold.convention(), "Arnold");
    assert_eq!(value(&arnold, Depth), "Z");
    assert!(value(&arnold, Color).starts_with("RGBA.R"));
    assert_eq!(arnold.variance(Color), None, "nobody says of what");

    let renderman = mapping(
        &[
            ("Ci", "rgb"),
            ("albedo", "rgb"),
            ("normal", "rgb"),
            ("__Pworld", "rgb"),
            ("zfiltered", ""),
            ("diffuse", "rgb"),
            ("mse", "rgb"),
            ("albedo_var", "rgb"),
        ],
        None,
    );
    assert_eq!(renderman.convention(), "RenderMan");
    assert_eq!(value(&renderman, Normal), "normal.r,normal.g,normal.b");
    assert_eq!(value(&renderman, Depth), "zfiltered");
    assert_eq!(renderman.variance(Color).map(|source| source.divisor), Some(1.0));
    assert_eq!(renderman.variance(Texture), None);

    let vray = mapping(
        &[
            ("", "RGB"),
            ("VRayDiffuseFilter", "RGB"),
            ("VRayNormals", "XYZ"),
            ("Z", ""),
            ("VRayLighting", "RGB"),
        ],
        None,
    );
    assert_eq!(vray.convention(), "V-Ray");
    assert!(value(&vray, DirIllumination).starts_with("VRayLighting"));

    let karma = mapping(
        &[
            ("C", "RGBA"),
            ("albedo", "RGB"),
            ("N", "XYZ"),
            ("P", "XYZ"),
            ("depth", ""),
            ("directdiffuse", "RGB"),
        ],
        None,
    );
    assert_eq!(karma.convention(), "Karma");
    assert!(value(&karma, Color).starts_with("C.R"));
    assert_eq!(value(&karma, Depth), "depth");

    let mitsuba = mapping(
        &[("img", "RGBA"), ("alb", "RGB"), ("nn", "XYZ"), ("pos", "XYZ"), ("dd", "T")],
        None,
    );
    assert_eq!(mitsuba.convention(), "Mitsuba 3");
    assert_eq!(value(&mitsuba, Depth), "dd.T");
    assert!(value(&mitsuba, Color).starts_with("img.R"));
}

#[test]
fn gaps_are_filled_from_other_conventions_and_say_so() {
    let m = mapping(
        &[("", "RGB"), ("Albedo", "RGB"), ("Position", "XYZ"), ("VRayNormals", "XYZ")],
        None,
    );
    assert_eq!(m.convention(), "Tamis");
    assert_eq!(m.value(Normal).map(|source| source.convention), Some("V-Ray"));
    assert_eq!(m.value(SecTexture), None);
}

#[test]
fn a_single_layer_of_any_name_is_the_colour_and_several_are_not() {
    let one = mapping(&[("my render", "RGBA"), ("Depth", "Z")], None);
    assert_eq!(value(&one, Color), "my render.R,my render.G,my render.B");
    let several = mapping(&[("mine", "RGB"), ("yours", "RGB")], None);
    let listing = Listing::of(Header::made(&["mine.R"], None));
    let error = several.color(&listing).unwrap_err().to_string();
    assert!(error.contains("mine.R") && error.contains("R G B"), "{error}");
    // What is known to be something else is not a colour.
    assert!(mapping(&[("Albedo", "RGB")], None).value(Color).is_none());
}

#[test]
fn depth_is_not_a_component_of_something_else() {
    let m = mapping(&[("", "RGB"), ("Position", "XYZ"), ("Normal", "XYZ")], None);
    assert_eq!(m.value(Depth), None);
}
