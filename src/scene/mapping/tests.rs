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
    assert!(error.contains("layers mine") && error.contains("--map color=NAME"), "{error}");
    // What is known to be something else is not a colour.
    assert!(mapping(&[("Albedo", "RGB")], None).value(Color).is_none());
}

#[test]
fn depth_is_not_a_component_of_something_else() {
    let m = mapping(&[("", "RGB"), ("Position", "XYZ"), ("Normal", "XYZ")], None);
    assert_eq!(m.value(Depth), None);
}

/// A file of each renderer as its users tick the boxes, and where it is taken from: position,
/// normal, albedo, depth, direct light, colour.
#[test]
fn every_renderer_has_a_file() {
    type Layers = &'static [(&'static str, &'static str)];
    let files: [(&str, Layers, [&str; 6]); 10] = [
        (
            "Redshift",
            &[
                ("", "RGBA"),
                ("DiffuseFilter", "RGB"),
                ("BumpNormals", "XYZ"),
                ("WorldPosition", "XYZ"),
                ("Depth", "Z"),
            ],
            ["WorldPosition.X", "BumpNormals.X", "DiffuseFilter.R", "Depth.Z", "", "R"],
        ),
        (
            "Octane",
            &[
                ("Noisy beauty", "RGB"),
                ("Denoiser albedo", "RGB"),
                ("Denoiser normal", "RGB"),
                ("Position", "RGB"),
                ("Z-depth", "R"),
            ],
            [
                "Position.R",
                "Denoiser normal.R",
                "Denoiser albedo.R",
                "Z-depth.R",
                "",
                "Noisy beauty.R",
            ],
        ),
        (
            "Corona",
            &[
                ("", "RGBA"),
                ("CShading_Albedo", "RGB"),
                ("CGeometry_NormalsShading", "RGB"),
                ("CGeometry_WorldPosition", "RGB"),
                ("CGeometry_ZDepth", "R"),
            ],
            [
                "CGeometry_WorldPosition.R",
                "CGeometry_NormalsShading.R",
                "CShading_Albedo.R",
                "CGeometry_ZDepth.R",
                "",
                "R",
            ],
        ),
        (
            "appleseed",
            &[
                ("beauty", "RGBA"),
                ("albedo", "RGB"),
                ("normal", "RGB"),
                ("position", "RGB"),
                ("depth", "R"),
                ("direct_diffuse", "RGB"),
            ],
            ["position.R", "normal.R", "albedo.R", "depth.R", "direct_diffuse.R", "beauty.R"],
        ),
        (
            "LuxCore",
            &[
                ("ViewLayer.Combined", "RGBA"),
                ("ViewLayer.ALBEDO", "RGB"),
                ("ViewLayer.AVG_SHADING_NORMAL", "XYZ"),
                ("ViewLayer.POSITION", "XYZ"),
                ("ViewLayer.DEPTH", "Z"),
            ],
            [
                "ViewLayer.POSITION.X",
                "ViewLayer.AVG_SHADING_NORMAL.X",
                "ViewLayer.ALBEDO.R",
                "ViewLayer.DEPTH.Z",
                "",
                "ViewLayer.Combined.R",
            ],
        ),
        (
            "V-Ray",
            &[
                ("", "RGBA"),
                ("diffuseChannel", "RGB"),
                ("normalsChannel", "XYZ"),
                ("pointWorldChannel", "XYZ"),
                ("zDepthChannel", ""),
                ("lightingChannel", "RGB"),
            ],
            [
                "pointWorldChannel.X",
                "normalsChannel.X",
                "diffuseChannel.R",
                "zDepthChannel",
                "lightingChannel.R",
                "R",
            ],
        ),
        (
            "Mantra",
            &[("C", "RGBA"), ("basecolor", "RGB"), ("N", "XYZ"), ("P", "XYZ"), ("Pz", "")],
            ["P.X", "N.X", "basecolor.R", "Pz", "", "C.R"],
        ),
        (
            "Unreal",
            &[
                ("FinalImage", "RGBA"),
                ("FinalImageBaseColor", "RGB"),
                ("FinalImageWorldNormal", "RGB"),
                ("FinalImageMovieRenderQueue_WorldDepth", "R"),
            ],
            [
                "",
                "FinalImageWorldNormal.R",
                "FinalImageBaseColor.R",
                "FinalImageMovieRenderQueue_WorldDepth.R",
                "",
                "FinalImage.R",
            ],
        ),
        (
            "Open Image Denoise",
            &[("hdr", "RGB"), ("alb", "RGB"), ("nrm", "RGB")],
            ["", "nrm.R", "alb.R", "", "", "hdr.R"],
        ),
        ("luminance", &[("Y", "")], ["", "", "", "", "", "Y"]),
    ];
    for (name, channels, expected) in files {
        let m = mapping(channels, None);
        if name != "Mantra" {
            // Karma's are the same names and one more.
            assert_eq!(m.convention(), name);
        }
        let features = [WorldPosition, Normal, Texture, Depth, DirIllumination, Color];
        for (feature, expected) in features.into_iter().zip(expected) {
            let first = m.value(feature).map_or("", |source| source.channels[0].as_str());
            assert_eq!(first, expected, "{name}: {}", feature.row().title);
        }
    }
}

#[test]
fn names_of_two_meanings_count_in_files_of_their_renderer_alone() {
    let lit = mapping(
        &[("", "RGB"), ("N", "XYZ"), ("diffuse", "RGB"), ("specular", "RGB"), ("Z", "")],
        None,
    );
    assert_eq!(value(&lit, Texture), "");
    let vray = mapping(&[("", "RGB"), ("VRayNormals", "XYZ"), ("diffuse", "RGB")], None);
    assert_eq!(value(&vray, Texture), "diffuse.R,diffuse.G,diffuse.B");
}

#[test]
fn second_moments_are_variances_where_the_samples_are_known() {
    let layers = [("img", "RGB"), ("nn", "XYZ"), ("m2_img", "RGB"), ("m2_nn", "XYZ")];
    let m = mapping(&layers, None);
    assert_eq!((m.variance(Color), m.unusable().len()), (None, 2));
    let m = mapping(&layers, Some(17));
    let variance = m.variance(Color).expect("they are known");
    assert_eq!((variance.divisor, variance.is_moment), (16.0, true));
    assert_eq!(variance.channels[2], "m2_img.B");
    assert!(m.variance(Normal).is_some_and(|variance| variance.is_moment));
}

#[test]
fn features_have_the_fields_names() {
    let term = |text: &str| Said::read(text).map(|said| said.term);
    assert_eq!(term("albedo=DiffuseFilter"), Ok((Texture, Quantity::Value)));
    assert_eq!(term("variance=Var"), Ok((Color, Quantity::Variance)));
    assert_eq!(term("albedo.variance=V"), Ok((Texture, Quantity::Variance)));
    for wrong in ["albedo", "albedo=", "alb=x", "pixel=x", "cVariance=x"] {
        assert!(Said::read(wrong).is_err(), "{wrong}");
    }
}
