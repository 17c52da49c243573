//! What is in a file, and what becomes of it: as text and as JSON.

use std::collections::BTreeMap;
use std::fmt::Write;

use serde::Serialize;

use super::{Align, Format, Table, number};
use crate::expr::{Feature, PlaneId, Quantity};
use crate::image::exr::{Channel, Part};
use crate::scene::defect::Defect;
use crate::scene::inspect::{Finding, Inspection, Scan, Scans};

/// All that there is to say of a file; serialised, as `tamis inspect --json` prints it.
#[derive(Serialize)]
pub struct Findings {
    file: String,
    convention: &'static str,
    samples_per_pixel: Option<u32>,
    /// The views and layers that `denoise` filters, each with features of its own.
    pictures: Vec<String>,
    /// The renderer, if names tell that it is no other.
    renderer: Option<&'static str>,
    /// What that calls the settings that write albedo, normals and depth; only if one of
    /// them is absent.
    switch_on: Option<&'static str>,
    layers: Vec<LayerEntry>,
    features: Vec<FeatureEntry>,
    bad_pixels: Vec<BadEntry>,
}

#[derive(Serialize)]
struct LayerEntry {
    name: Option<String>,
    width: usize,
    height: usize,
    origin: (i32, i32),
    compression: String,
    storage: &'static str,
    channels: Vec<ChannelEntry>,
}

#[derive(Serialize)]
struct ChannelEntry {
    name: String,
    #[serde(rename = "type")]
    kind: String,
    feeds: Option<String>,
    /// What its samples are like; nothing if it is of a kind that is not read.
    samples: Option<SamplesEntry>,
}

#[derive(Serialize)]
struct SamplesEntry {
    min: Option<f32>,
    max: Option<f32>,
    constant: Option<f32>,
    nan: usize,
    infinite: usize,
    /// Finite, but beyond ±1e18.
    huge: usize,
    negative: usize,
}

#[derive(Serialize)]
struct BadEntry {
    defect: &'static str,
    /// The channel; of fireflies, the feature.
    of: String,
    count: usize,
    /// Columns and rows of the first ones.
    first: Vec<(usize, usize)>,
    /// What becomes of them by default.
    fate: &'static str,
}

#[derive(Serialize)]
struct FeatureEntry {
    feature: &'static str,
    status: Status,
    channels: Vec<String>,
    /// Whose names they are.
    convention: Option<&'static str>,
    variance: Option<VarianceEntry>,
}

#[derive(Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Status {
    Present,
    Constant,
    Absent,
}

#[derive(Serialize)]
#[serde(tag = "status", rename_all = "kebab-case")]
enum VarianceEntry {
    /// The file holds it.
    Present { channels: Vec<String> },
    /// It holds one that cannot be used.
    Unusable { channels: Vec<String>, reason: &'static str },
    /// It will be estimated where a filter reads it.
    Estimated,
}

impl Findings {
    /// Puts together what was found.
    pub fn of(inspection: &Inspection, scans: &Scans) -> Self {
        let Scans { channels: scans, findings } = scans;
        let header = inspection.header();
        let roles: BTreeMap<&str, PlaneId> = inspection
            .channels()
            .filter_map(|(_, channel, role)| Some((channel.name.as_str(), role?)))
            .collect();
        let layer = |part: &Part| LayerEntry {
            name: part.name.clone(),
            width: part.window.size.0,
            height: part.window.size.1,
            origin: part.window.origin,
            compression: part.compression.clone(),
            storage: if part.tiled { "tiles" } else { "scan lines" },
            channels: part.channels.iter().map(|channel| entry(channel, &roles, scans)).collect(),
        };
        let stored = Feature::ALL.into_iter().filter(|f| !f.row().channels.is_empty());
        let mapping = inspection.mapping();
        let renderer = mapping.renderer();
        let guides = [Feature::Texture, Feature::Normal, Feature::Depth];
        let lacks_some = guides.iter().any(|&guide| mapping.value(guide).is_none());
        Self {
            renderer,
            switch_on: renderer.filter(|_| lacks_some).map(|_| mapping.switches()),
            file: header.path().display().to_string(),
            convention: inspection.mapping().convention(),
            samples_per_pixel: header.samples_per_pixel(),
            pictures: inspection
                .targets()
                .iter()
                .map(|target| target.mapping().which().to_string())
                .filter(|name| !name.is_empty())
                .collect(),
            layers: header.parts().iter().map(layer).collect(),
            features: stored.map(|feature| feature_entry(feature, inspection, scans)).collect(),
            bad_pixels: findings.iter().map(BadEntry::new).collect(),
        }
    }

    /// For people.
    pub fn text(&self) -> String {
        let mut text = format!("{}: channels named as {} does\n", self.file, self.convention);
        if let Some(count) = self.samples_per_pixel {
            let _ = writeln!(text, "{} per pixel", number::plural(count as usize, "sample"));
        }
        if !self.pictures.is_empty() {
            let _ = writeln!(text, "pictures: {}", self.pictures.join("; "));
        }
        for layer in &self.layers {
            text.push_str(&layer.text());
        }
        text.push_str("\nFeatures\n");
        let columns = ["feature", "status", "from", "variance"];
        let mut table = Table::new(columns.map(|name| (name, Align::Left)));
        for entry in &self.features {
            let status = match entry.status {
                Status::Present => "present",
                Status::Constant => "constant",
                Status::Absent => "absent",
            };
            let from = match (&entry.channels[..], entry.convention) {
                (channels, Some(convention)) if convention != self.convention => {
                    format!("{} ({convention})", channels.join(" "))
                }
                (channels, _) if entry.status == Status::Absent => {
                    format!("no {}", channels.join(", "))
                }
                (channels, _) => channels.join(" "),
            };
            let variance = match &entry.variance {
                None => "-".to_owned(),
                Some(VarianceEntry::Present { channels }) => channels.join(" "),
                Some(VarianceEntry::Unusable { channels, reason }) => {
                    format!("estimated: {} not used, {reason}", channels.join(" "))
                }
                Some(VarianceEntry::Estimated) => "estimated".to_owned(),
            };
            table.row([entry.feature.to_owned(), status.to_owned(), from, variance]);
        }
        text.push_str(&table.render(Format::Plain));
        if let (Some(renderer), Some(settings)) = (self.renderer, self.switch_on) {
            let _ = writeln!(text, "\nTo have what is absent, switch on in {renderer}: {settings}");
        }
        text.push_str(&self.bad_pixels());
        text
    }

    fn bad_pixels(&self) -> String {
        if self.bad_pixels.is_empty() {
            return "\nBad pixels: none\n".to_owned();
        }
        let mut table = Table::new([
            ("defect", Align::Left),
            ("in", Align::Left),
            ("pixels", Align::Right),
            ("first at (x, y)", Align::Left),
            ("by default", Align::Left),
        ]);
        for bad in &self.bad_pixels {
            let mut first: Vec<String> =
                bad.first.iter().map(|(x, y)| format!("({x}, {y})")).collect();
            if bad.count > first.len() {
                first.push("…".to_owned());
            }
            table.row([
                bad.defect.to_owned(),
                bad.of.clone(),
                number::count(bad.count),
                first.join(" "),
                bad.fate.to_owned(),
            ]);
        }
        format!("\nBad pixels\n{}", table.render(Format::Plain))
    }
}

impl BadEntry {
    fn new(finding: &Finding) -> Self {
        let fate = match (finding.defect, finding.quantity) {
            (_, None) => "no filter reads it",
            (Defect::Far, _) => "set to 0: nothing was hit",
            (Defect::Nan | Defect::Infinite | Defect::Huge, _) => "median of the good ones around",
            (Defect::Negative, Some(Quantity::Variance)) => "counted as 0",
            (Defect::Negative, Some(Quantity::Value | Quantity::Gradient)) => "kept",
            (Defect::Outside, _) => "brought into bounds",
            (Defect::Firefly, _) => "kept",
        };
        Self {
            defect: match finding.defect {
                Defect::Far => "far",
                Defect::Nan => "nan",
                Defect::Infinite => "infinite",
                Defect::Huge => "huge",
                Defect::Negative => "negative",
                Defect::Outside => "outside",
                Defect::Firefly => "firefly",
            },
            of: finding.of.clone(),
            count: finding.count,
            first: finding.first.clone(),
            fate,
        }
    }
}

impl LayerEntry {
    fn text(&self) -> String {
        let name = self.name.as_ref().map_or(String::new(), |name| format!(" `{name}`"));
        let place = match self.origin {
            (0, 0) => String::new(),
            (x, y) => format!(" at ({x}, {y})"),
        };
        let mut text = format!(
            "\nLayer{name}: {}x{} pixels{place}, {}, {}, {}\n",
            self.width,
            self.height,
            self.storage,
            self.compression,
            number::plural(self.channels.len(), "channel"),
        );
        let mut table = Table::new([
            ("channel", Align::Left),
            ("type", Align::Left),
            ("feeds", Align::Left),
            ("least", Align::Right),
            ("greatest", Align::Right),
            ("remarks", Align::Left),
        ]);
        for channel in &self.channels {
            let bound = |pick: fn(&SamplesEntry) -> Option<f32>| {
                let samples = channel.samples.as_ref();
                samples.and_then(pick).map_or("-".to_owned(), number::sample)
            };
            table.row([
                channel.name.clone(),
                channel.kind.clone(),
                channel.feeds.clone().unwrap_or_else(|| "-".to_owned()),
                bound(|samples| samples.min),
                bound(|samples| samples.max),
                match &channel.samples {
                    Some(samples) => samples.remarks(),
                    None => "not read: deep or subsampled".to_owned(),
                },
            ]);
        }
        text.push_str(&table.render(Format::Plain));
        text
    }
}

impl SamplesEntry {
    fn new(scan: &Scan) -> Self {
        Self {
            min: scan.range.map(|(least, _)| least),
            max: scan.range.map(|(_, greatest)| greatest),
            constant: scan.constant(),
            nan: scan.nan,
            infinite: scan.infinite,
            huge: scan.huge,
            negative: scan.negative,
        }
    }

    fn remarks(&self) -> String {
        let constant = self.constant.map(|x| format!("constant {}", number::sample(x)));
        let counts = [
            (self.nan, "NaN"),
            (self.infinite, "infinite"),
            (self.huge, "beyond ±1e18"),
            // Signed features are negative all over: that is no remark.
        ];
        let counts = counts.into_iter().filter(|(count, _)| *count > 0);
        let counts = counts.map(|(count, what)| format!("{} {what}", number::count(count)));
        constant.into_iter().chain(counts).collect::<Vec<_>>().join(", ")
    }
}

fn entry(
    channel: &Channel,
    roles: &BTreeMap<&str, PlaneId>,
    scans: &BTreeMap<String, Scan>,
) -> ChannelEntry {
    ChannelEntry {
        name: channel.name.clone(),
        kind: channel.kind.to_string(),
        feeds: roles.get(channel.name.as_str()).map(term),
        samples: scans.get(&channel.name).map(SamplesEntry::new),
    }
}

/// What a channel feeds: the term that reads it, and of which component.
fn term(plane: &PlaneId) -> String {
    match plane.quantity {
        Quantity::Value => format!("{}[{}]", plane.feature.term(), plane.component),
        Quantity::Gradient | Quantity::Variance => plane.to_string(),
    }
}

fn feature_entry(
    feature: Feature,
    inspection: &Inspection,
    scans: &BTreeMap<String, Scan>,
) -> FeatureEntry {
    let row = feature.row();
    let mapping = inspection.mapping();
    let Some(source) = mapping.value(feature) else {
        // As the file's renderer calls them.
        let own = row.channels.iter().map(|&name| name.to_owned()).collect();
        let names = mapping.names(feature);
        let channels = if names.is_empty() { own } else { names };
        let status = Status::Absent;
        return FeatureEntry {
            feature: feature.term(),
            status,
            channels,
            convention: None,
            variance: None,
        };
    };
    let constant = |name: &String| scans.get(name).is_some_and(|scan| scan.constant().is_some());
    let status =
        if source.channels.iter().all(constant) { Status::Constant } else { Status::Present };
    let unusable = mapping.unusable().iter().find(|unusable| unusable.feature == feature);
    let variance = match (mapping.variance(feature), unusable) {
        (Some(source), _) => VarianceEntry::Present { channels: source.channels.clone() },
        (None, Some(unusable)) => {
            VarianceEntry::Unusable { channels: unusable.channels.clone(), reason: unusable.reason }
        }
        (None, None) => VarianceEntry::Estimated,
    };
    let variance = feature.spelling(Quantity::Variance).map(|_| variance);
    FeatureEntry {
        feature: feature.term(),
        status,
        channels: source.channels.clone(),
        convention: Some(source.convention),
        variance,
    }
}
