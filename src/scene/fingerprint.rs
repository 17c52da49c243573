//! Pictures by a checksum of their pixels: whoever goes on with a run learns whether they are
//! still those that it was begun with.

use crc32fast::Hasher;
use serde::{Deserialize, Serialize};

use super::{Plane, Scene};
use crate::image::Image;

/// A picture as a run has it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fingerprint {
    /// What errors call it.
    pub name: String,
    /// Of its size and its pixels, as they are once loaded: what options change there
    /// changes this too.
    pub checksum: u32,
}

impl Fingerprint {
    /// Of a scene: its colour and all of its planes. Padding does not count.
    pub fn of_scene(name: impl Into<String>, scene: &Scene) -> Self {
        let layout = scene.layout();
        let mut sum = Sum::of_size(layout.width(), layout.height());
        for channel in scene.color() {
            (0..layout.height()).for_each(|y| sum.samples(channel.pixels(y)));
        }
        for (id, plane) in scene.planes() {
            sum.0.update(format!("{id:?}").as_bytes());
            match plane {
                Plane::Constant(value) => sum.samples(&[*value]),
                Plane::Samples(samples) => {
                    (0..layout.height()).for_each(|y| sum.samples(samples.pixels(y)));
                }
            }
        }
        Self { name: name.into(), checksum: sum.0.finalize() }
    }

    /// Of an image's colours.
    pub fn of_image(name: impl Into<String>, image: &Image) -> Self {
        let (width, height) = image.size();
        let mut sum = Sum::of_size(width, height);
        image.rgb().iter().for_each(|channel| sum.samples(channel));
        Self { name: name.into(), checksum: sum.0.finalize() }
    }

    /// The first of the pictures that a run was begun with that is not among those given, or
    /// is another one now; or one that was given and is new.
    pub fn first_changed<'a>(begun: &'a [Self], given: &'a [Self]) -> Option<&'a str> {
        let lacks = |all: &[Self], one: &&Self| !all.contains(one);
        let changed = begun.iter().find(|one| lacks(given, one));
        changed.or_else(|| given.iter().find(|one| lacks(begun, one))).map(|one| &*one.name)
    }
}

/// A checksum in the making.
struct Sum(Hasher);

impl Sum {
    fn of_size(width: usize, height: usize) -> Self {
        let mut hasher = Hasher::new();
        [width, height].iter().for_each(|size| hasher.update(&(*size as u64).to_le_bytes()));
        Self(hasher)
    }

    fn samples(&mut self, samples: &[f32]) {
        if cfg!(target_endian = "little") {
            self.0.update(bytemuck::cast_slice(samples));
        } else {
            samples.iter().for_each(|sample| self.0.update(&sample.to_le_bytes()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expr::{Feature, Quantity};
    use crate::scene::{LoadOptions, Needs, RawScene};

    fn scene(pad: usize, change: impl Fn(&mut [f32], &mut [f32])) -> Scene {
        let mut color: Vec<f32> = (0..24).map(|k| 0.1 + k as f32).collect();
        let mut depth: Vec<f32> = (0..24).map(|k| 2.0 + (k % 5) as f32).collect();
        change(&mut color, &mut depth);
        RawScene::new("room", 6, 4, [color.clone(), color.clone(), color])
            .with(Feature::Depth, Quantity::Value, vec![depth])
            .prepare(&Needs::everything(), pad, &LoadOptions::default())
            .expect("a sound scene")
    }

    #[test]
    fn every_pixel_counts_and_padding_does_not() {
        let of = |scene: &Scene| Fingerprint::of_scene("room", scene);
        let begun = of(&scene(2, |_, _| {}));
        assert_eq!(begun, of(&scene(40, |_, _| {})));
        assert_ne!(begun, of(&scene(2, |color, _| color[7] = color[7].next_up())));
        assert_ne!(begun, of(&scene(2, |_, depth| depth[23] += 1.0)));

        let image = |width, height, last: f32| {
            let channel: Vec<f32> = (0..11).map(|k| k as f32).chain([last]).collect();
            let rgb = [channel.clone(), channel.clone(), channel];
            let image = Image::new("clean", width, height, rgb).expect("it has its size");
            Fingerprint::of_image("clean", &image)
        };
        assert_eq!(image(4, 3, 1.0), image(4, 3, 1.0));
        assert_ne!(image(4, 3, 1.0), image(3, 4, 1.0));
        assert_ne!(image(4, 3, 1.0), image(4, 3, 1.0f32.next_up()));
    }

    #[test]
    fn what_has_changed_is_named() {
        let one = |name: &str, checksum| Fingerprint { name: name.to_owned(), checksum };
        let begun = [one("a", 1), one("b", 2)];
        let changed =
            |given: &[Fingerprint]| Fingerprint::first_changed(&begun, given).map(str::to_owned);
        assert_eq!(changed(&begun), None);
        assert_eq!(changed(&[one("a", 1), one("b", 3)]).as_deref(), Some("b"));
        assert_eq!(changed(&[one("b", 2)]).as_deref(), Some("a"));
        assert_eq!(changed(&[one("a", 1), one("b", 2), one("c", 3)]).as_deref(), Some("c"));
    }
}
