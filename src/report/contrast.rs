//! Images beside one reference: by how much, and where they differ.

use crate::image::exr::Window;
use crate::image::{Comparison, Differences, Image, ImageError, Metrics};

use super::number;

/// An image beside its reference.
#[derive(Clone, Debug)]
pub struct Contrast {
    /// What it is called.
    pub name: String,
    /// The image.
    pub image: Image,
    /// The errors, and what they leave out.
    pub comparison: Comparison,
    /// Where it differs.
    pub differences: Differences,
}

/// How far an image, or a part of it, is from its reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    /// The errors pixel by pixel.
    pub metrics: Metrics,
    /// The mean structural similarity; none if no pixel is far enough from the edges.
    pub ssim: Option<f64>,
    /// The mean LDR-FLIP; none if the reference has no pixel.
    pub flip: Option<f64>,
}

/// A figure: what it is called, how it is written, and what is the better the less it is.
pub struct Figure {
    /// What it is called.
    pub name: &'static str,
    /// As a report has it.
    pub text: fn(&Figures) -> String,
    /// The less, the better.
    pub badness: fn(&Figures) -> f64,
}

/// All figures, in the order of reports.
pub const FIGURES: [Figure; 6] = [
    Figure {
        name: "RelMSE",
        text: |f| number::error(f.metrics.rel_mse),
        badness: |f| f.metrics.rel_mse,
    },
    Figure {
        name: "RelMSE, trimmed",
        text: |f| number::error(f.metrics.trimmed_rel_mse),
        badness: |f| f.metrics.trimmed_rel_mse,
    },
    Figure { name: "MSE", text: |f| number::error(f.metrics.mse), badness: |f| f.metrics.mse },
    Figure {
        name: "PSNR",
        text: |f| number::decibels(f.metrics.psnr),
        badness: |f| -f.metrics.psnr,
    },
    Figure {
        name: "SSIM",
        text: |f| f.ssim.map_or_else(|| "-".to_owned(), number::similarity),
        badness: |f| -f.ssim.unwrap_or(f64::NEG_INFINITY),
    },
    Figure {
        name: "FLIP",
        text: |f| f.flip.map_or_else(|| "-".to_owned(), number::error),
        badness: |f| f.flip.unwrap_or(f64::INFINITY),
    },
];

impl Contrast {
    /// Compares an image with its reference.
    ///
    /// # Errors
    /// If the images differ in size, or the reference has no pixel that is a number.
    pub fn of(name: String, image: Image, reference: &Image) -> Result<Self, ImageError> {
        let comparison = Comparison::of(&image, reference)?;
        let differences = Differences::of(&image, reference)?;
        Ok(Self { name, image, comparison, differences })
    }

    /// Of the whole image.
    pub fn figures(&self) -> Figures {
        Figures {
            metrics: self.comparison.metrics,
            ssim: self.differences.ssim.mean(),
            flip: self.differences.flip.mean(),
        }
    }

    /// Of a part, whose place is counted from the images' corner: SSIM and FLIP of its pixels
    /// still see what is around them. None where the reference has no pixel that is a number.
    ///
    /// # Panics
    /// If the part does not lie in the image, or the reference is another than it was.
    pub fn figures_in(&self, reference: &Image, part: Window) -> Option<Figures> {
        let cut = |image: &Image| image.clone().with_origin((0, 0)).within(part);
        let comparison = Comparison::of(&cut(&self.image), &cut(reference)).ok()?;
        Some(Figures {
            metrics: comparison.metrics,
            ssim: self.differences.ssim.mean_in(&part),
            flip: self.differences.flip.mean_in(&part),
        })
    }
}

/// The window that all images have, if they begin at different places.
pub fn common_window(images: &[Image], reference: &Image) -> Option<Window> {
    let own = reference.window()?;
    let windows = images.iter().map(Image::window).collect::<Option<Vec<Window>>>()?;
    match windows.iter().all(|window| window.origin == own.origin) {
        true => None,
        false => windows.iter().try_fold(own, |all, window| all.overlap(window)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_is_judged_by_its_own_pixels() {
        let image = |bad: f32| {
            let channel: Vec<f32> =
                (0..24 * 20).map(|k| if k % 24 < 12 { 0.5 } else { 0.5 + bad }).collect();
            Image::new("test", 24, 20, [channel.clone(), channel.clone(), channel])
                .expect("a sample per pixel")
        };
        let reference = image(0.0);
        let contrast = Contrast::of("a".to_owned(), image(0.2), &reference).expect("one size");
        let at = |x| {
            let part = Window { origin: (x, 4), size: (8, 8) };
            contrast.figures_in(&reference, part).expect("it has pixels")
        };
        let (good, bad) = (at(0), at(16));
        assert_eq!(good.metrics.rel_mse, 0.0);
        assert!((bad.metrics.rel_mse - 0.04 / 0.26).abs() < 1e-6);
        assert!((contrast.figures().metrics.rel_mse - 0.02 / 0.26).abs() < 1e-6);
        assert!(good.flip < bad.flip && good.ssim > bad.ssim, "{good:?} {bad:?}");
        for Figure { name, badness, .. } in &FIGURES {
            assert!(badness(&good) < badness(&bad), "{name}");
        }
    }
}
