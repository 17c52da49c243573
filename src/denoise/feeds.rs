//! What feeds a filter, in one line.

use std::fmt;
use std::path::Path;

use crate::expr::{Feature, Quantity};
use crate::scene::Target;

/// Which channels feed which feature, what is absent, and what it would bring.
pub struct Feeds<'a>(pub &'a Target);

/// What `tamis` gains by guides that are absent, measured on scenes that it was not tuned on
/// (docs/filters/tamis.md).
const GUIDES_LEAVE: &str = "about a quarter of the error";

impl fmt::Display for Feeds<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mapping = self.0.mapping();
        let which = mapping.which().to_string();
        if !which.is_empty() {
            write!(f, "{which}: ")?;
        }
        if let Some(renderer) = mapping.renderer() {
            write!(f, "{renderer}: ")?;
        }
        let sources = mapping.sources().filter(|&(_, quantity, _)| quantity == Quantity::Value);
        // What is in files of their own is told file by file.
        let mut told: Vec<String> = Vec::new();
        let mut beside: Vec<(&Path, Vec<String>)> = Vec::new();
        for (feature, _, source) in sources {
            let places = source.channels.iter().filter_map(|channel| self.0.place(channel));
            let (files, names): (Vec<&Path>, Vec<&str>) = places.unzip();
            let text = format!("{} from {}", feature.row().title, layer(&names));
            match files.first().filter(|&&file| file != self.0.path()) {
                None => told.push(text),
                Some(&file) => match beside.iter_mut().find(|(known, _)| *known == file) {
                    Some((_, told)) => told.push(text),
                    None => beside.push((file, vec![text])),
                },
            }
        }
        // The colour first, as people think of it.
        told.sort_by_key(|text| !text.starts_with(Feature::Color.row().title));
        let variances =
            mapping.sources().filter(|&(_, quantity, _)| quantity == Quantity::Variance);
        let variances: Vec<&str> = variances.map(|(feature, ..)| feature.row().title).collect();
        if !variances.is_empty() {
            told.push(format!("variances of {}", variances.join(", ")));
        }
        f.write_str(&told.join(", "))?;
        for (file, told) in beside {
            write!(f, "; {}: {}", file.display(), told.join(", "))?;
        }

        let lacks = |feature: &Feature| mapping.value(*feature).is_none();
        let guides = [Feature::Texture, Feature::Normal, Feature::Depth];
        let mut absent: Vec<&str> =
            guides.iter().filter(|f| lacks(f)).map(|feature| feature.row().title).collect();
        if mapping.variance(Feature::Color).is_none() {
            absent.push("variances (estimated)");
        }
        if !absent.is_empty() {
            write!(f, "; absent: {}", absent.join(", "))?;
        }
        if lacks(&Feature::Texture) || lacks(&Feature::Normal) {
            write!(f, "; albedo and normals would take away {GUIDES_LEAVE}")?;
            if !mapping.switches().is_empty() {
                write!(f, " (switch on: {})", mapping.switches())?;
            }
        }
        Ok(())
    }
}

/// What channels have in common, or their names.
fn layer(channels: &[&str]) -> String {
    let Some(first) = channels.first() else { return String::new() };
    match first.rsplit_once('.') {
        Some((layer, _)) if channels.len() > 1 => layer.to_owned(),
        _ => channels.join(" "),
    }
}
