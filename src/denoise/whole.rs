//! Results as files: like the file that was read, but with other colours.

use std::collections::HashSet;
use std::path::Path;

use super::{DenoiseError, Denoised};
use crate::image::Image;
use crate::image::exr::{Lost, Replacement, rewrite};
use crate::image::files::Format;
use crate::scene::SceneError;

/// The attribute that says how a file was filtered.
pub const ATTRIBUTE: &str = "tamis";

impl Denoised {
    /// Writes an OpenEXR file. If one was read, it is that file with filtered colours: other
    /// channels, parts, views, types, compression, windows and attributes stay as they are, and
    /// an attribute says what was done. Gives what was lost all the same.
    ///
    /// # Errors
    /// If the file cannot be written; what was there before then still is.
    pub fn save(&self, path: &Path) -> Result<Lost, DenoiseError> {
        let first = &self.pictures[0];
        if first.target.listing().header().format() != Format::Exr {
            first.image.save(path).map_err(SceneError::from)?;
            return Ok(Lost::default());
        }
        let images: Vec<&Image> = self
            .pictures
            .iter()
            .flat_map(|picture| std::iter::once(&picture.image).chain(&picture.layers))
            .collect();
        let grey: Vec<Option<Vec<f32>>> = images.iter().map(|image| grey(image)).collect();
        let mut replacements = Vec::new();
        for (image, grey) in images.iter().zip(&grey) {
            let window = image.window().expect("pictures have their place");
            let channels = image.channels();
            match grey {
                Some(samples) => {
                    let channel = channels[0].as_str();
                    replacements.push(Replacement { channel, window, samples });
                }
                None => replacements.extend(
                    channels.iter().zip(image.rgb()).map(|(channel, samples)| Replacement {
                        channel,
                        window,
                        samples,
                    }),
                ),
            }
        }
        let source = first.target.path();
        let lost = rewrite(source, path, &replacements, (ATTRIBUTE, &self.provenance()));
        Ok(lost.map_err(SceneError::from)?)
    }

    /// What a file of one picture does not have of what was read: the pictures beside the best
    /// one, and the layers of the colour's file that feed nothing, light groups among them. The
    /// alpha of the picture is none of them.
    pub fn beside_the_picture(&self) -> Vec<String> {
        let (first, others) = self.pictures.split_first().expect("there is at least one");
        let others = others.iter().map(|picture| picture.target.mapping().which().to_string());
        let mut left_out: Vec<String> = others.collect();
        let fed = self.pictures.iter().flat_map(|picture| {
            let sources = picture.target.mapping().sources();
            let fed = sources.flat_map(|(_, _, source)| source.channels.iter().cloned());
            fed.chain(picture.target.alpha())
        });
        let fed: HashSet<String> = fed.collect();
        for channel in first.target.listing().header().names() {
            let layer = channel.rsplit_once('.').map_or(channel, |(layer, _)| layer);
            if !fed.contains(channel) && !left_out.iter().any(|known| known == layer) {
                left_out.push(layer.to_owned());
            }
        }
        left_out
    }

    /// What made the result: the program, the filter and its fingerprint, the back end and its
    /// precision.
    fn provenance(&self) -> String {
        let version = env!("CARGO_PKG_VERSION");
        let (filter, backend, precision) = (&self.filter, self.backend, self.precision.name());
        let (name, fingerprint) = (&filter.name, filter.fingerprint());
        format!("tamis {version}, filter {name} ({fingerprint:016x}), {backend}, {precision}")
    }
}

/// The samples of a grey picture, whose channels are one in the file.
fn grey(image: &Image) -> Option<Vec<f32>> {
    let [r, g, b] = image.channels();
    (r == g && g == b).then(|| {
        let [r, g, b] = image.rgb();
        // Guides may have colours, so that the three differ.
        r.iter().zip(g).zip(b).map(|((r, g), b)| (r + g + b) / 3.0).collect()
    })
}
