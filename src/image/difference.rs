//! Where an image differs from its reference, by three measures.

use super::map::Map;
use super::metric::{Measure, check_sizes, srgb};
use super::{Image, ImageError, flip, is_good, ssim};

/// How far an image is from its reference around every pixel.
///
/// Pixels that the reference lacks are not known in any of the maps. To SSIM and FLIP, which look
/// at surroundings, both images are black there. They see the pictures that PSNR is of, clamped to
/// [0, 1] under the sRGB curve, in which a pixel that is no number is black.
#[derive(Clone, Debug)]
pub struct Differences {
    /// (image - reference)² / (reference² + 0.01), the mean over the channels; infinite where
    /// the image is no number.
    pub relative: Map,
    /// The structural similarity, from -1 to 1, the greater the better. It is not known in the
    /// five outermost rows and columns. See the module `ssim`.
    pub ssim: Map,
    /// LDR-FLIP at 67 pixels per degree, from 0 to 1. See the module `flip`.
    pub flip: Map,
}

impl Differences {
    /// Compares an image with its reference.
    ///
    /// # Errors
    /// If the images differ in size.
    pub fn of(image: &Image, reference: &Image) -> Result<Self, ImageError> {
        check_sizes(image, reference)?;
        let size = reference.size();
        let count = size.0 * size.1;
        if count == 0 {
            let none = || Map::new(size, Vec::new());
            return Ok(Self { relative: none(), ssim: none(), flip: none() });
        }
        let is_known: Vec<bool> =
            (0..count).map(|k| reference.rgb().iter().all(|rgb| is_good(rgb[k]))).collect();
        let clamped = |image: &Image| {
            image.rgb().map(|channel| {
                let pixels = channel.iter().zip(&is_known);
                let clamp = |x: f64| if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) };
                pixels.map(|(&x, &known)| if known { clamp(x.into()) } else { 0.0 }).collect()
            })
        };
        let encoded = |linear: &[Vec<f64>; 3]| {
            linear.each_ref().map(|channel| channel.iter().map(|&x| srgb(x)).collect())
        };
        let map = |mut values: Vec<f64>| {
            let unknown = values.iter_mut().zip(&is_known).filter(|(_, known)| !**known);
            unknown.for_each(|(value, _)| *value = f64::NAN);
            Map::new(size, values)
        };
        let relative = map(Measure::RelMse.of_pixels(image.rgb(), reference.rgb()));
        let (image, reference) = (clamped(image), clamped(reference));
        let flip = map(flip::difference(size, &image, &reference));
        let ssim = map(ssim::similarity(size, &encoded(&image), &encoded(&reference)));
        Ok(Self { relative, ssim, flip })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::exr::Window;

    const SIZE: (usize, usize) = (40, 30);

    fn image(f: impl Fn(usize, usize, usize) -> usize) -> Image {
        let level = |k: usize, c: usize| (f(k % SIZE.0, k / SIZE.0, c) % 64) as f64 / 63.0;
        let pixels = 0..SIZE.0 * SIZE.1;
        let channel = |c: usize| pixels.clone().map(|k| level(k, c) as f32).collect();
        Image::new("test", SIZE.0, SIZE.1, [0, 1, 2].map(channel)).expect("a sample per pixel")
    }

    fn pair() -> [Image; 2] {
        [
            image(|x, y, c| x * 7 + y * 13 + c * 29 + x * y % 5 * 17),
            image(|x, y, c| x * 5 + y * 3 + c * c * 11 + x / 8 * 9),
        ]
    }

    /// The figures are those of flip-evaluator 1.7 and scikit-image 0.26, of these formulas in
    /// NumPy, encoded as sRGB in f64:
    /// `flip_evaluator.evaluate(reference, image, "LDR", applyMagma=False)` and
    /// `structural_similarity(image, reference, gaussian_weights=True, sigma=1.5,
    /// use_sample_covariance=False, data_range=1, channel_axis=2, full=True)`. The mean FLIP is
    /// that of the map in f64: flip-evaluator's own is summed in f32.
    #[test]
    fn flip_and_ssim_are_those_of_their_authors() {
        let [image, reference] = pair();
        let of = Differences::of(&image, &reference).expect("one size");
        let near = |found: f64, expected: f64, by: f64| {
            assert!((found - expected).abs() < by, "{found} is not {expected}");
        };
        near(of.flip.mean().expect("pixels"), 0.669_342_888_9, 1e-6);
        near(of.ssim.mean().expect("pixels"), 0.018_442_490_090_73, 1e-7);
        // A corner, two pixels inside, the opposite corner, an edge.
        for ((x, y), flip) in [
            ((0, 0), 0.903_570_4),
            ((17, 12), 0.491_032_8),
            ((39, 29), 0.966_964_8),
            ((20, 0), 0.915_595_6),
        ] {
            near(of.flip.values()[y * SIZE.0 + x], flip, 5e-6);
        }
        near(of.ssim.values()[12 * SIZE.0 + 17], 0.050_831_731_458, 1e-7);
        assert!(of.ssim.values()[4 * SIZE.0 + 17].is_nan());
        assert!(!of.ssim.values()[5 * SIZE.0 + 17].is_nan());
    }

    #[test]
    fn equal_images_do_not_differ() {
        let [image, _] = pair();
        let of = Differences::of(&image, &image).expect("one size");
        assert_eq!(of.flip.mean(), Some(0.0));
        assert_eq!(of.relative.mean(), Some(0.0));
        assert!((of.ssim.mean().expect("pixels") - 1.0).abs() < 1e-12);
    }

    #[test]
    fn pixels_that_the_reference_lacks_count_nowhere() {
        let [image, whole] = pair();
        let hole = 12 * SIZE.0 + 17;
        let mut rgb = whole.rgb().map(<[f32]>::to_vec);
        rgb[1][hole] = f32::NAN;
        let holed = Image::new("test", SIZE.0, SIZE.1, rgb).expect("a sample per pixel");
        let of = Differences::of(&image, &holed).expect("one size");
        for map in [&of.relative, &of.ssim, &of.flip] {
            assert!(map.values()[hole].is_nan());
            assert!(map.mean().is_some_and(f64::is_finite));
            let only = Window { origin: (17, 12), size: (1, 1) };
            assert_eq!(map.mean_in(&only), None);
        }
        // The image's own count as black, and as infinitely wrong.
        let of = Differences::of(&holed, &whole).expect("one size");
        assert_eq!(of.relative.mean(), Some(f64::INFINITY));
        assert!(of.flip.mean().is_some_and(|flip| flip > 0.0 && flip < 1.0));
    }

    #[test]
    fn images_that_are_too_small_have_no_ssim() {
        let dot = |x: f32| Image::new("dot", 1, 1, [vec![x], vec![x], vec![x]]).expect("a pixel");
        let of = Differences::of(&dot(0.1), &dot(0.5)).expect("one size");
        assert_eq!(of.ssim.mean(), None);
        assert!(of.flip.mean().is_some_and(|flip| flip > 0.1));
        assert!(Differences::of(&dot(0.1), &pair()[0]).is_err());
    }
}
