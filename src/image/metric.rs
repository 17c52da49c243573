//! How far an image is from its reference, in `f64`.
//!
//! - **RelMSE**: mean over pixels and channels of (img - ref)² / (ref² + 0.01). The
//!   error of the paper.
//! - **Trimmed RelMSE**: the same without the worst 0.1% of the pixels, a pixel's
//!   error being the mean over its channels. A handful of pixels at the edges of
//!   visible lights decides the plain mean, so the two stand side by side.
//! - **Two-sided RelMSE**, for searches: the mean of RelMSE and of the same relative
//!   to image and reference alike, (img - ref)² / ((img² + ref²) / 2 + 0.01). A spark
//!   that is left may cost any amount of RelMSE and a light that is lost 1 at most,
//!   so that the cheapest way to be rid of sparks is to put out the lights too. Here
//!   a light costs up to 1.5, and a spark up to half of its RelMSE and 1.
//! - **MSE**: mean of (img - ref)².
//! - **PSNR**, in decibels, of the tone-mapped images: values clamped to [0, 1] and
//!   put through the sRGB curve, no exposure applied, peak 1. Infinite for equal
//!   pictures.
//!
//! A pixel that is not finite makes the first four infinite: an image with such
//! a pixel loses against every image without. Sums run in the images' order,
//! so a result does not depend on the number of threads.

use serde::{Deserialize, Serialize};

use super::{Image, ImageError, is_good};

/// The share of pixels that the trimmed error leaves out.
const TRIMMED: f64 = 0.001;

/// Keeps the denominators of relative errors from vanishing.
const DARK: f64 = 0.01;

/// What a search minimises: a mean over the pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Measure {
    /// RelMSE.
    RelMse,
    /// The two-sided error.
    TwoSided,
}

impl Measure {
    /// Both.
    pub const ALL: [Self; 2] = [Self::RelMse, Self::TwoSided];

    /// As it is written.
    pub fn name(self) -> &'static str {
        match self {
            Self::RelMse => "rel-mse",
            Self::TwoSided => "two-sided",
        }
    }

    /// As reports call it.
    pub fn title(self) -> &'static str {
        match self {
            Self::RelMse => "RelMSE",
            Self::TwoSided => "two-sided RelMSE",
        }
    }

    /// Per pixel, the mean over its channels; infinite where that is not a number.
    ///
    /// # Panics
    /// If the channels differ in length.
    pub fn of_pixels(self, image: [&[f32]; 3], reference: [&[f32]; 3]) -> Vec<f64> {
        match self {
            Self::RelMse => pixel_errors(image, reference, relative),
            Self::TwoSided => pixel_errors(image, reference, |x, y| {
                let both = (x - y) * (x - y) / (0.5 * (x * x + y * y) + DARK);
                0.5 * (relative(x, y) + both)
            }),
        }
    }
}

/// The errors of an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Metrics {
    /// Relative mean square error.
    pub rel_mse: f64,
    /// The same without the worst 0.1% of the pixels.
    pub trimmed_rel_mse: f64,
    /// Mean square error.
    pub mse: f64,
    /// Peak signal-to-noise ratio of the tone-mapped images, in dB.
    pub psnr: f64,
}

impl Metrics {
    /// Compares an image with its reference.
    ///
    /// # Errors
    /// If the images differ in size.
    pub fn of(image: &Image, reference: &Image) -> Result<Self, ImageError> {
        check_sizes(image, reference)?;
        let (image, reference) = (image.rgb(), reference.rgb());
        let mut errors = pixel_errors(image, reference, relative);
        Ok(Self {
            rel_mse: mean(&errors),
            trimmed_rel_mse: trimmed_mean(&mut errors),
            mse: finite_or_worst(mean_over(image, reference, |x, y| (x - y) * (x - y))),
            psnr: psnr(image, reference),
        })
    }
}

/// What comparing an image with a reference that may have holes gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// The errors over the pixels that the reference has.
    pub metrics: Metrics,
    /// Pixels of the reference that are not finite or beyond ±1e18: they were left out.
    pub left_out: usize,
    /// Pixels of the image that are, of those that count. They were not left out.
    pub bad: usize,
}

impl Comparison {
    /// Compares an image with the pixels of its reference that are numbers.
    ///
    /// # Errors
    /// If the images differ in size, or the reference has no such pixel.
    pub fn of(image: &Image, reference: &Image) -> Result<Self, ImageError> {
        check_sizes(image, reference)?;
        let is_sound = |image: &Image, k: usize| image.rgb().iter().all(|rgb| is_good(rgb[k]));
        let pixels = reference.rgb()[0].len();
        let kept: Vec<usize> = (0..pixels).filter(|&k| is_sound(reference, k)).collect();
        let left_out = pixels - kept.len();
        if kept.is_empty() {
            // An image that is compared with nothing would look perfect.
            reference.check_reference()?;
        }
        let metrics = match left_out {
            0 => Metrics::of(image, reference)?,
            _ => Metrics::of(&only(image, &kept), &only(reference, &kept))?,
        };
        let bad = kept.iter().filter(|&&k| !is_sound(image, k)).count();
        Ok(Self { metrics, left_out, bad })
    }
}

pub(super) fn check_sizes(image: &Image, reference: &Image) -> Result<(), ImageError> {
    match image.size() == reference.size() {
        true => Ok(()),
        false => Err(ImageError::SizeMismatch {
            image: image.name().to_owned(),
            size: image.size(),
            reference: reference.name().to_owned(),
            reference_size: reference.size(),
        }),
    }
}

/// Some of an image's pixels, in one row: no measure asks where pixels stand.
fn only(image: &Image, pixels: &[usize]) -> Image {
    let rgb = image.rgb().map(|channel| pixels.iter().map(|&k| channel[k]).collect());
    Image::new(image.name(), pixels.len(), 1, rgb).expect("one sample per pixel")
}

/// The relative mean square error of three channels.
///
/// # Panics
/// If the channels differ in length.
pub fn rel_mse(image: [&[f32]; 3], reference: [&[f32]; 3]) -> f64 {
    mean(&pixel_errors(image, reference, relative))
}

/// The relative mean square error without the worst 0.1% of the pixels (rounded
/// down: none, for less than a thousand pixels).
///
/// # Panics
/// If the channels differ in length.
pub fn trimmed_rel_mse(image: [&[f32]; 3], reference: [&[f32]; 3]) -> f64 {
    trimmed_mean(&mut pixel_errors(image, reference, relative))
}

/// The square of the error of `x`, relative to `y`.
fn relative(x: f64, y: f64) -> f64 {
    (x - y) * (x - y) / (y * y + DARK)
}

/// Per pixel, the mean of its channels' errors; infinite where that is not a number.
fn pixel_errors(
    image: [&[f32]; 3],
    reference: [&[f32]; 3],
    error: impl Fn(f64, f64) -> f64,
) -> Vec<f64> {
    let mut errors = vec![0.0; reference[0].len()];
    for (channel, truth) in image.into_iter().zip(reference) {
        assert_eq!(channel.len(), errors.len(), "channels of one size");
        assert_eq!(truth.len(), errors.len(), "channels of one size");
        for ((sum, &x), &y) in errors.iter_mut().zip(channel).zip(truth) {
            *sum += error(f64::from(x), f64::from(y));
        }
    }
    errors.iter_mut().for_each(|error| *error = finite_or_worst(*error / 3.0));
    errors
}

fn finite_or_worst(error: f64) -> f64 {
    if error.is_nan() { f64::INFINITY } else { error }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn trimmed_mean(errors: &mut [f64]) -> f64 {
    let dropped = (errors.len() as f64 * TRIMMED).floor() as usize;
    let kept = errors.len() - dropped;
    if dropped > 0 {
        errors.select_nth_unstable_by(kept, f64::total_cmp);
        // Selection leaves an order of its own: sum in one that is stated.
        errors[..kept].sort_unstable_by(f64::total_cmp);
    }
    mean(&errors[..kept])
}

fn mean_over(image: [&[f32]; 3], reference: [&[f32]; 3], f: impl Fn(f64, f64) -> f64) -> f64 {
    let pairs = image.into_iter().zip(reference).flat_map(|(a, b)| a.iter().zip(b));
    let sum: f64 = pairs.map(|(&x, &y)| f(f64::from(x), f64::from(y))).sum();
    sum / (3 * reference[0].len()).max(1) as f64
}

fn psnr(image: [&[f32]; 3], reference: [&[f32]; 3]) -> f64 {
    let mse = mean_over(image, reference, |x, y| (srgb(x) - srgb(y)).powi(2));
    -10.0 * mse.log10()
}

/// The tone map: clamped to [0, 1] (NaN to 0), then the sRGB curve.
pub fn srgb(linear: f64) -> f64 {
    let x = if linear.is_nan() { 0.0 } else { linear.clamp(0.0, 1.0) };
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

/// The sRGB curve backwards, of values from 0 to 1.
pub fn linear(encoded: f64) -> f64 {
    let x = encoded.clamp(0.0, 1.0);
    if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(width: usize, height: usize, f: impl Fn(usize) -> f32) -> Image {
        let channel: Vec<f32> = (0..width * height).map(f).collect();
        Image::new("test", width, height, [channel.clone(), channel.clone(), channel])
            .expect("one sample per pixel")
    }

    #[test]
    fn values_worked_out_by_hand() {
        let m = Metrics::of(&grey(2, 1, |i| i as f32), &grey(2, 1, |_| 0.5)).expect("same size");
        assert!((m.rel_mse - 0.25 / 0.26).abs() < 1e-12);
        assert_eq!(m.trimmed_rel_mse, m.rel_mse);
        assert!((m.mse - 0.25).abs() < 1e-12);
        let equal = Metrics::of(&grey(2, 1, |_| 0.5), &grey(2, 1, |_| 0.5)).expect("same size");
        assert_eq!((equal.rel_mse, equal.psnr), (0.0, f64::INFINITY));
        // 0 against 1: the greatest error that the tone map leaves.
        let worst = Metrics::of(&grey(1, 1, |_| 9.0), &grey(1, 1, |_| -9.0)).expect("same size");
        assert!(worst.psnr.abs() < 1e-12);
    }

    #[test]
    fn the_worst_pixels_are_trimmed_as_pixels() {
        let image = grey(100, 20, |i| if i < 2 { 1e6 } else { 1.0 });
        let m = Metrics::of(&image, &grey(100, 20, |_| 1.0)).expect("same size");
        assert!(m.rel_mse > 1e8);
        assert_eq!(m.trimmed_rel_mse, 0.0);
    }

    #[test]
    fn an_image_that_is_no_number_is_infinitely_wrong() {
        for bad in [f32::NAN, f32::INFINITY] {
            let m = Metrics::of(&grey(1, 1, |_| bad), &grey(1, 1, |_| 1.0)).expect("same size");
            assert_eq!((m.rel_mse, m.mse), (f64::INFINITY, f64::INFINITY));
            assert!(!m.psnr.is_nan());
        }
    }

    #[test]
    fn pixels_that_the_reference_lacks_are_left_out_and_counted() {
        let hole = |at: &[usize]| {
            let at = at.to_vec();
            grey(3, 2, move |k| if at.contains(&k) { f32::NAN } else { k as f32 })
        };
        let (whole, image) = (hole(&[]), grey(3, 2, |k| k as f32 + 0.5));
        let plain = Comparison::of(&image, &whole).expect("same size");
        assert_eq!(plain.metrics, Metrics::of(&image, &whole).expect("same size"));
        assert_eq!((plain.left_out, plain.bad), (0, 0));

        let two = Comparison::of(&image, &hole(&[0, 4])).expect("four pixels are left");
        let expected =
            [1.0, 2.0, 3.0, 5.0].map(|y| 0.25 / (y * y + 0.01)).iter().sum::<f64>() / 4.0;
        assert!((two.metrics.rel_mse - expected).abs() < 1e-12);
        assert_eq!((two.left_out, two.bad), (2, 0));

        // The image's own are its fault.
        let bad = Comparison::of(&hole(&[0, 2]), &hole(&[0, 4])).expect("four pixels are left");
        assert_eq!((bad.left_out, bad.bad), (2, 1));
        assert_eq!(bad.metrics.rel_mse, f64::INFINITY);

        let nothing = grey(3, 2, |_| f32::INFINITY);
        assert!(matches!(Comparison::of(&image, &nothing), Err(ImageError::BadReference { .. })));
        let other = Comparison::of(&grey(2, 3, |_| 0.0), &nothing);
        assert!(matches!(other, Err(ImageError::SizeMismatch { .. })));
    }

    #[test]
    fn a_light_that_is_lost_counts_more_on_both_sides_than_on_one() {
        let of = |measure: Measure, x: f32, y: f32| {
            measure.of_pixels([&[x], &[x], &[x]], [&[y], &[y], &[y]])[0]
        };
        // By hand: (1 + 1 / (1/2 + 0.01)) / 2, each denominator with its 0.01.
        let expected = 0.5 * (1.0 / 1.01 + 1.0 / 0.51);
        assert!((of(Measure::TwoSided, 0.0, 1.0) - expected).abs() < 1e-12);
        let (lost, left) = ((0.0, 100.0), (100.0, 0.0));
        assert!(of(Measure::RelMse, lost.0, lost.1) < 1.0);
        assert!(of(Measure::TwoSided, lost.0, lost.1) > 1.49);
        assert!(of(Measure::TwoSided, left.0, left.1) > 0.49 * of(Measure::RelMse, left.0, left.1));
        assert_eq!(of(Measure::TwoSided, 0.3, 0.3), 0.0);
        assert_eq!(of(Measure::TwoSided, f32::NAN, 1.0), f64::INFINITY);
    }

    #[test]
    fn sizes_must_agree() {
        let error = Metrics::of(&grey(2, 3, |_| 0.0), &grey(3, 2, |_| 0.0)).unwrap_err();
        assert!(error.to_string().contains("2x3") && error.to_string().contains("3x2"), "{error}");
    }
}
