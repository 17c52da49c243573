//! The features of a pixel: one row each.
//!
//! A row says how a feature is spelled in expressions (its value, its gradient,
//! its variance), how wide it is, which EXR channels hold it and what it is
//! measured in. The parser, the grammar, the loader, the passes, the exports and
//! the documentation all read these rows; adding a feature is adding a row.

use std::fmt;

/// Which of a feature's quantities is meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Quantity {
    /// The feature itself.
    Value,
    /// Per component, the magnitude of the central differences in x and y.
    Gradient,
    /// The variance of the pixel's mean, averaged over the components: a scalar.
    Variance,
}

/// What a feature is measured in. Weights look at features in units of the
/// picture itself; `scene::normalize` says how these are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Unit {
    /// Its own, as the renderer has it.
    Own,
    /// Extents of the visible geometry, counted from its centre.
    Place,
    /// Extents of the visible geometry.
    Length,
    /// The image's exposure.
    Light,
}

/// A row of the feature table.
#[derive(Debug)]
pub struct FeatureRow {
    /// Spelling of the value in expressions.
    pub name: &'static str,
    /// The field's term for the value, where it is another: read like `name`, and
    /// printed in programs.
    pub term: Option<&'static str>,
    /// Spelling of the gradient, where the grammar has one.
    pub gradient: Option<&'static str>,
    /// Spelling of the variance, where there is one.
    pub variance: Option<&'static str>,
    /// The EXR channels, one per component; empty for what no file holds.
    pub channels: &'static [&'static str],
    /// The EXR channels whose average is the variance (alternatives: either all
    /// of them, or the per-feature one).
    pub variance_channels: &'static [&'static str],
    /// Number of components.
    pub width: usize,
    /// What its values are measured in.
    pub unit: Unit,
    /// Whether its values have two signs.
    pub signed: bool,
    /// What its components lie in by what they are: a surface reflects a share of the
    /// light, a direction has a length of 1. The loader brings values into these bounds.
    pub bounds: Option<[f32; 2]>,
    /// Whether it is one number for the whole image.
    pub per_image: bool,
    /// What people call it.
    pub title: &'static str,
    /// One line for people.
    pub doc: &'static str,
}

/// Makes the enum, the list of all and the table from one row per feature.
macro_rules! features {
    ($($(#[$doc:meta])* $name:ident $row:tt)*) => {
        /// A per-pixel quantity that weights can look at (Section 4.3 of the paper, and
        /// the two further ones that its Equations 3 and 4 use: `color` and `pixel`).
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Feature {
            $($(#[$doc])* $name,)*
        }

        impl Feature {
            /// Every feature, in the table's order.
            pub const ALL: [Self; TABLE.len()] = [$(Self::$name),*];
        }

        const TABLE: [FeatureRow; [$(stringify!($name)),*].len()] = [$(FeatureRow $row),*];
    };
}

/// What rows of features have in common that no file holds.
const NOT_STORED: FeatureRow = FeatureRow {
    name: "",
    term: None,
    gradient: None,
    variance: None,
    channels: &[],
    variance_channels: &[],
    width: 1,
    unit: Unit::Own,
    signed: false,
    bounds: None,
    per_image: false,
    title: "",
    doc: "",
};

features! {
    /// World-space position of the first hit.
    WorldPosition {
        name: "worldPosition",
        term: Some("position"),
        gradient: Some("wpGradient"),
        variance: Some("wpVariance"),
        channels: &["Position.X", "Position.Y", "Position.Z"],
        variance_channels: &["Position.Variance"],
        width: 3,
        unit: Unit::Place,
        signed: true,
        bounds: None,
        per_image: false,
        title: "positions",
        doc: "world-space position of the first hit, relative to the visible geometry's extent",
    }
    /// Shading normal at the first hit.
    Normal {
        name: "normal",
        term: None,
        gradient: Some("nGradient"),
        variance: Some("nVariance"),
        channels: &["Normal.X", "Normal.Y", "Normal.Z"],
        variance_channels: &["Normal.Variance"],
        width: 3,
        unit: Unit::Own,
        signed: true,
        bounds: Some([-1.0, 1.0]),
        per_image: false,
        title: "normals",
        doc: "shading normal at the first hit",
    }
    /// Diffuse albedo ("texture") at the first hit.
    Texture {
        name: "texture",
        term: Some("albedo"),
        gradient: Some("tGradient"),
        variance: Some("tVariance"),
        channels: &["Albedo.R", "Albedo.G", "Albedo.B"],
        variance_channels: &["Albedo.Variance"],
        width: 3,
        unit: Unit::Own,
        signed: false,
        bounds: Some([0.0, 1.0]),
        per_image: false,
        title: "albedo",
        doc: "diffuse albedo at the first hit",
    }
    /// Diffuse albedo seen through glossy or specular reflection.
    SecTexture {
        name: "secTexture",
        term: Some("secondaryAlbedo"),
        gradient: Some("secTGradient"),
        variance: Some("secTexVariance"),
        channels: &["SecondaryAlbedo.R", "SecondaryAlbedo.G", "SecondaryAlbedo.B"],
        variance_channels: &["SecondaryAlbedo.Variance"],
        width: 3,
        unit: Unit::Own,
        signed: false,
        bounds: Some([0.0, 1.0]),
        per_image: false,
        title: "reflected albedo",
        doc: "diffuse albedo seen through glossy or specular reflection",
    }
    /// Distance from the camera to the first hit.
    Depth {
        name: "depth",
        term: None,
        gradient: Some("dGradient"),
        variance: Some("dVariance"),
        channels: &["Depth.Z"],
        variance_channels: &["Depth.Variance"],
        width: 1,
        unit: Unit::Length,
        signed: false,
        bounds: None,
        per_image: false,
        title: "depth",
        doc: "distance to the first hit, relative to the visible geometry's extent",
    }
    /// Direct illumination at the first hit.
    DirIllumination {
        name: "dirIllumination",
        term: Some("direct"),
        gradient: Some("diGradient"),
        variance: Some("diVariance"),
        channels: &["Direct.R", "Direct.G", "Direct.B"],
        variance_channels: &["Direct.Variance"],
        width: 3,
        unit: Unit::Light,
        signed: false,
        bounds: None,
        per_image: false,
        title: "direct light",
        doc: "direct illumination at the first hit, relative to the image's exposure",
    }
    /// The noisy colour itself.
    Color {
        name: "color",
        term: None,
        gradient: None,
        variance: Some("cVariance"),
        channels: &["R", "G", "B"],
        variance_channels: &["Variance.R", "Variance.G", "Variance.B"],
        width: 3,
        unit: Unit::Light,
        signed: false,
        bounds: None,
        per_image: false,
        title: "colour",
        doc: "the noisy colour, relative to the image's exposure",
    }
    /// The pixel's own coordinates, in pixels.
    Pixel {
        name: "pixel",
        width: 2,
        title: "pixel coordinates",
        doc: "the pixel's coordinates, in pixels",
        ..NOT_STORED
    }
    /// Whether the colour's variance was measured: the same for all pixels of an image.
    Measured {
        name: "measured",
        per_image: true,
        title: "whether variances were measured",
        doc: "1 where the file holds the colour's variance, 0 where it is estimated from the image",
        ..NOT_STORED
    }
    /// Samples per pixel: the same for all pixels of an image.
    Samples {
        name: "samples",
        per_image: true,
        title: "samples per pixel",
        doc: "samples per pixel, at most 65536; 0 where nobody says how many",
        ..NOT_STORED
    }
    /// Other pictures that are filtered by the colour's weights.
    Layer {
        name: "otherLayer",
        width: 3 * Feature::PICTURES,
        unit: Unit::Light,
        title: "other pictures",
        doc: "up to four pictures that are filtered by the colour's weights (`denoise --layers`), \
              three components each, relative to the image's exposure; 0 where there is none",
        ..NOT_STORED
    }
    /// How noisy the image is as a whole: the same for all of its pixels.
    Grain {
        name: "grain",
        per_image: true,
        width: 2,
        title: "grain",
        doc: "lower quartile and median, over squares of 16 pixels, of the colour's estimated \
              relative variance; 0 where the file holds the colour's variance",
        ..NOT_STORED
    }
}

impl Feature {
    /// How many other pictures are filtered at a time.
    pub const PICTURES: usize = 4;

    /// The feature's row.
    pub fn row(self) -> &'static FeatureRow {
        &TABLE[self as usize]
    }

    /// Number of components.
    pub fn width(self) -> usize {
        self.row().width
    }

    /// Whether files hold it. What they do not hold, every scene has.
    pub fn is_stored(self) -> bool {
        !self.row().channels.is_empty()
    }

    /// The field's term for its value, which expressions read and `--map` takes.
    pub fn term(self) -> &'static str {
        self.row().term.unwrap_or(self.row().name)
    }

    /// The spelling of one of its quantities, if expressions can name it.
    pub fn spelling(self, quantity: Quantity) -> Option<&'static str> {
        let row = self.row();
        match quantity {
            Quantity::Value => Some(row.name),
            Quantity::Gradient => row.gradient,
            Quantity::Variance => row.variance,
        }
    }

    /// What code calls one of its quantities, as far as expressions can name it:
    /// `world_position`, `wp_gradient`.
    pub fn identifier(self, quantity: Quantity) -> String {
        snake_case(self.spelling(quantity).unwrap_or(self.row().name))
    }

    /// Components of one of its quantities as files and frames in memory hold it; 0 if they hold
    /// none.
    pub fn stored_width(self, quantity: Quantity) -> usize {
        match quantity {
            Quantity::Value => self.row().channels.len(),
            Quantity::Variance => self.row().variance_channels.len(),
            Quantity::Gradient => 0,
        }
    }

    /// Looks a spelling up.
    pub fn parse(text: &str) -> Option<(Self, Quantity)> {
        let term = |f: &Self| f.row().term == Some(text);
        let alias = || Some((Self::ALL.into_iter().find(term)?, Quantity::Value));
        Self::terms().find(|&(f, q)| f.spelling(q) == Some(text)).or_else(alias)
    }

    /// Every (feature, quantity) that expressions can name.
    pub fn terms() -> impl Iterator<Item = (Self, Quantity)> {
        Self::ALL.into_iter().flat_map(|f| {
            Quantity::ALL.into_iter().filter(move |&q| f.spelling(q).is_some()).map(move |q| (f, q))
        })
    }
}

/// A spelling as code has it: `worldPosition` as `world_position`.
pub fn snake_case(spelling: &str) -> String {
    let mut name = String::with_capacity(spelling.len() + 2);
    for c in spelling.chars() {
        if c.is_ascii_uppercase() {
            name.push('_');
        }
        name.push(c.to_ascii_lowercase());
    }
    name
}

impl Quantity {
    /// All three.
    pub const ALL: [Self; 3] = [Self::Value, Self::Gradient, Self::Variance];
}

/// One scalar image: a component of one of a feature's quantities.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PlaneId {
    /// Whose.
    pub feature: Feature,
    /// Which quantity.
    pub quantity: Quantity,
    /// Component, below [`PlaneId::components`]; 0 for variances.
    pub component: u8,
}

impl PlaneId {
    /// The planes of one quantity of a feature, in component order.
    pub fn of(feature: Feature, quantity: Quantity) -> impl Iterator<Item = Self> {
        (0..Self::components(feature, quantity) as u8).map(move |component| Self {
            feature,
            quantity,
            component,
        })
    }

    /// How many planes a quantity of a feature has: its width, 1 for variances.
    pub fn components(feature: Feature, quantity: Quantity) -> usize {
        match quantity {
            Quantity::Value | Quantity::Gradient => feature.width(),
            Quantity::Variance => 1,
        }
    }

    /// What code calls it where it is a number of its own: `world_position_x`,
    /// `texture_r`, `n_variance`.
    pub fn identifier(self) -> String {
        let Self { feature, quantity, component } = self;
        let name = feature.identifier(quantity);
        if Self::components(feature, quantity) == 1 {
            return name;
        }
        let k = usize::from(component);
        let channel = feature.row().channels.get(k).and_then(|channel| channel.rsplit('.').next());
        match channel.or(["X", "Y", "Z"].get(k).copied()) {
            Some(axis) if feature.width() <= 3 => format!("{name}_{}", axis.to_ascii_lowercase()),
            _ => format!("{name}_{k}"),
        }
    }
}

impl fmt::Display for PlaneId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.feature.spelling(self.quantity).unwrap_or(self.feature.row().name);
        match self.quantity {
            Quantity::Variance => f.write_str(name),
            Quantity::Value | Quantity::Gradient => write!(f, "{name}[{}]", self.component),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_stand_in_the_order_of_the_enum_and_are_consistent() {
        for (k, feature) in Feature::ALL.into_iter().enumerate() {
            assert_eq!(feature as usize, k);
            let row = feature.row();
            assert!(row.channels.is_empty() || row.channels.len() == row.width);
            assert_eq!(row.variance.is_some(), !row.variance_channels.is_empty());
        }
    }

    #[test]
    fn every_spelling_is_unique_and_parses_back() {
        for (feature, quantity) in Feature::terms() {
            let text = feature.spelling(quantity).expect("terms() lists only what has a spelling");
            assert_eq!(Feature::parse(text), Some((feature, quantity)));
        }
        let terms = Feature::ALL.into_iter().filter_map(|f| Some((f, f.row().term?)));
        for (feature, term) in terms {
            assert_eq!(Feature::parse(term), Some((feature, Quantity::Value)), "{term}");
        }
    }

    #[test]
    fn identifiers_are_in_snake_case_and_unique() {
        let planes = Feature::terms().flat_map(|(f, q)| PlaneId::of(f, q));
        let identifiers: Vec<String> = planes.map(PlaneId::identifier).collect();
        for expected in [
            "depth",
            "d_gradient",
            "world_position_x",
            "wp_gradient_z",
            "sec_t_gradient_g",
            "sec_tex_variance",
            "color_r",
            "pixel_y",
        ] {
            assert_eq!(identifiers.iter().filter(|known| *known == expected).count(), 1);
        }
        let unique: std::collections::BTreeSet<_> = identifiers.iter().collect();
        assert_eq!(unique.len(), identifiers.len());
    }
}
