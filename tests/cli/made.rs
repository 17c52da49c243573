//! Files that are made for tests as a renderer would, and files read whole.

use std::collections::BTreeMap;
use std::path::Path;

use exr::image::{FlatImage, FlatSamples};
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, Image, Layer, WritableImage, read_all_flat_layers_from_file,
};

use crate::place::{Place, stderr};

/// The channels of a file by the number of their part and their name, and the parts'
/// attributes.
pub(crate) struct Whole {
    pub(crate) channels: BTreeMap<(usize, String), FlatSamples>,
    pub(crate) attributes: Vec<BTreeMap<String, String>>,
}

impl Whole {
    pub(crate) fn read(path: &Path) -> Self {
        let image: FlatImage = read_all_flat_layers_from_file(path)
            .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let mut channels = BTreeMap::new();
        let mut attributes = Vec::new();
        for (part, layer) in image.layer_data.into_iter().enumerate() {
            let mut said = BTreeMap::new();
            said.insert("encoding".to_owned(), format!("{:?}", layer.encoding));
            said.insert("size".to_owned(), format!("{:?}", layer.size));
            let mut own = layer.attributes;
            for (name, value) in std::mem::take(&mut own.other) {
                said.insert(name.to_string(), format!("{value:?}"));
            }
            said.insert("own".to_owned(), format!("{own:?}"));
            attributes.push(said);
            for channel in layer.channel_data.list {
                channels.insert((part, channel.name.to_string()), channel.sample_data);
            }
        }
        let mut shared = BTreeMap::from([(
            "windows".to_owned(),
            format!("{:?} {}", image.attributes.display_window, image.attributes.pixel_aspect),
        )]);
        for (name, value) in image.attributes.other {
            shared.insert(name.to_string(), format!("{value:?}"));
        }
        attributes.push(shared);
        Self { channels, attributes }
    }

    /// Checks that another file differs in these channels alone, and says so in an attribute.
    #[track_caller]
    pub(crate) fn is_kept_by(&self, other: &Self, but: &[(usize, &str)]) {
        let names = |whole: &Self| whole.channels.keys().cloned().collect::<Vec<_>>();
        assert_eq!(names(self), names(other));
        for ((part, name), samples) in &self.channels {
            let new = &other.channels[&(*part, name.clone())];
            let is_same = bits(samples) == bits(new);
            let is_filtered = but.contains(&(*part, name.as_str()));
            assert_eq!(is_same, !is_filtered, "part {part}, channel {name}");
        }
        for (part, (before, after)) in self.attributes.iter().zip(&other.attributes).enumerate() {
            let mut after = after.clone();
            let said = after.remove("tamis");
            let is_filtered = but.iter().any(|(of, _)| *of == part);
            assert_eq!(said.is_some(), is_filtered, "part {part} says what was done");
            assert!(said.is_none_or(|said| said.contains("filter tamis (")));
            assert_eq!(*before, after, "attributes of part {part}");
        }
    }

    pub(crate) fn samples(&self, part: usize, name: &str) -> Vec<f32> {
        self.channels[&(part, name.to_owned())].values_as_f32().collect()
    }
}

/// The type of samples, and their bits.
pub(crate) fn bits(samples: &FlatSamples) -> (u8, Vec<u32>) {
    match samples {
        FlatSamples::F16(samples) => {
            (0, samples.iter().map(|sample| u32::from(sample.to_bits())).collect())
        }
        FlatSamples::F32(samples) => (1, samples.iter().map(|sample| sample.to_bits()).collect()),
        FlatSamples::U32(samples) => (2, samples.clone()),
    }
}

/// RelMSE of three channels.
pub(crate) fn error(image: [&[f32]; 3], reference: [&[f32]; 3]) -> f64 {
    let pairs = image.into_iter().zip(reference).flat_map(|(a, b)| a.iter().zip(b));
    let errors = pairs.map(|(&a, &b)| f64::from(a - b).powi(2) / (f64::from(b).powi(2) + 0.01));
    errors.sum::<f64>() / (3 * image[0].len()) as f64
}

/// A wall with a checker of two albedos and a ball before it, as a renderer sees them.
pub(crate) struct Made {
    pub(crate) channels: BTreeMap<&'static str, Vec<f32>>,
    pub(crate) truth: [Vec<f32>; 3],
}

pub(crate) const SIZE: (usize, usize) = (48, 32);

impl Made {
    pub(crate) fn new(seed: u32) -> Self {
        let mut made = Self { channels: BTreeMap::new(), truth: Default::default() };
        let mut state = u64::from(seed) << 32 | 1;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            ((state >> 40) as f32 + 0.5) / (1 << 24) as f32
        };
        for y in 0..SIZE.1 {
            for x in 0..SIZE.0 {
                let (u, v) = (x as f32 / SIZE.0 as f32, y as f32 / SIZE.1 as f32);
                let (dx, dy) = ((u - 0.6) / 0.2, (v - 0.5) / 0.28);
                let ball = dx * dx + dy * dy < 1.0;
                let check = if (x / 6 + y / 6) % 2 == 0 { 0.2 } else { 0.7 };
                let albedo = if ball { [0.8, 0.2, 0.1] } else { [check, 0.3, 0.9 - check] };
                let z = (1.0 - dx * dx - dy * dy).max(0.0).sqrt();
                let normal = if ball { [dx, dy, z] } else { [0.0, 0.0, 1.0] };
                let light = 0.4 + 0.8 * (0.4 * normal[0] - 0.4 * normal[1] + 0.8 * normal[2]);
                // Four samples of a light that is there every other time.
                let seen: f32 = (0..4).map(|_| -uniform().ln()).sum::<f32>() / 4.0;
                for (k, name) in ["R", "G", "B"].into_iter().enumerate() {
                    made.truth[k].push(albedo[k] * light);
                    made.push(name, albedo[k] * light * seen);
                }
                for (k, name) in ["Albedo.R", "Albedo.G", "Albedo.B"].into_iter().enumerate() {
                    made.push(name, albedo[k]);
                }
                for (k, name) in ["Normal.X", "Normal.Y", "Normal.Z"].into_iter().enumerate() {
                    made.push(name, normal[k]);
                }
                made.push("Depth.Z", if ball { 3.0 - z } else { 5.0 });
            }
        }
        made
    }

    pub(crate) fn push(&mut self, name: &'static str, sample: f32) {
        self.channels.entry(name).or_default().push(sample);
    }

    /// The channels, each as f(name) has it renamed; left out where that gives nothing.
    pub(crate) fn named(&self, f: impl Fn(&str) -> Option<String>) -> Vec<(String, FlatSamples)> {
        let channels = self.channels.iter();
        let named = channels
            .filter_map(|(name, samples)| Some((f(name)?, FlatSamples::F32(samples.clone()))));
        named.collect()
    }

    pub(crate) fn all(&self) -> Vec<(String, FlatSamples)> {
        self.named(|name| Some(name.to_owned()))
    }

    pub(crate) fn error_of(&self, image: [&[f32]; 3]) -> f64 {
        error(image, self.truth.each_ref().map(Vec::as_slice))
    }

    pub(crate) fn noise(&self) -> f64 {
        self.error_of(["R", "G", "B"].map(|name| &self.channels[name][..]))
    }
}

pub(crate) fn layer(channels: Vec<(String, FlatSamples)>) -> Layer<AnyChannels<FlatSamples>> {
    let channels = channels.into_iter().map(|(name, samples)| AnyChannel::new(&name[..], samples));
    let channels = AnyChannels::sort(channels.collect());
    Layer::new(SIZE, Default::default(), Encoding::FAST_LOSSLESS, channels)
}

pub(crate) fn write(path: &Path, channels: Vec<(String, FlatSamples)>) {
    Image::from_layer(layer(channels)).write().to_file(path).expect("a writable folder");
}

/// Filters `in.exr`, and gives both files.
#[track_caller]
pub(crate) fn denoised(place: &Place, more: &[&str]) -> (Whole, Whole, String) {
    let output = place.run(&[&["denoise", "in.exr", "-o", "out.exr"], more].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let whole = |name: &str| Whole::read(&place.path(name));
    (whole("in.exr"), whole("out.exr"), stderr(&output))
}
