//! Pictures for people: 8 bits per channel, sRGB, as PNG.

use std::path::Path;

use base64::prelude::{BASE64_STANDARD, Engine};

use crate::image::metric::srgb;
use crate::image::{Image, ImageError, write_atomically};

/// An 8-bit sRGB picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    width: usize,
    height: usize,
    pixels: Vec<[u8; 3]>,
    /// How opaque each pixel is; all of it if nothing is said.
    alpha: Option<Vec<u8>>,
}

impl Picture {
    /// A picture of one colour.
    pub fn filled(width: usize, height: usize, color: [u8; 3]) -> Self {
        Self { width, height, pixels: vec![color; width * height], alpha: None }
    }

    /// Tone-maps an image the way PSNR is measured (clamped to [0, 1], sRGB
    /// curve), after making it `stops` photographic stops brighter.
    pub fn of(image: &Image, stops: f32) -> Self {
        let gain = f64::from(stops).exp2();
        let level = |x: f32| (255.0 * srgb(gain * f64::from(x))).round() as u8;
        let [r, g, b] = image.rgb();
        let pixels = r.iter().zip(g).zip(b).map(|((&r, &g), &b)| [r, g, b].map(level)).collect();
        let (width, height) = image.size();
        Self { width, height, pixels, alpha: None }
    }

    /// The same of an image with alpha: colours are what covers a pixel, and no longer
    /// premultiplied, as PNG has them.
    pub fn with_alpha(image: &Image, stops: f32) -> Self {
        let Some(alpha) = image.alpha() else { return Self::of(image, stops) };
        let straight = image.rgb().map(|channel| {
            let pixels = channel.iter().zip(alpha);
            pixels.map(|(&x, &a)| if a > 0.0 { x / a } else { x }).collect()
        });
        let (width, height) = image.size();
        let straight = Image::new(image.name(), width, height, straight).expect("the same size");
        // Opaqueness is linear, and no number counts as nothing.
        let levels = alpha.iter().map(|&a| (255.0 * a).round().clamp(0.0, 255.0) as u8);
        Self { alpha: Some(levels.collect()), ..Self::of(&straight, stops) }
    }

    /// Width and height.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Sets a pixel; one that lies outside is left out.
    pub fn set(&mut self, x: usize, y: usize, color: [u8; 3]) {
        if x < self.width && y < self.height {
            self.pixels[y * self.width + x] = color;
        }
    }

    /// Copies another picture, without its alpha, in with its top left corner at (x, y).
    pub fn paste(&mut self, other: &Self, x: usize, y: usize) {
        for (row, line) in other.pixels.chunks_exact(other.width.max(1)).enumerate() {
            for (column, &color) in line.iter().enumerate() {
                self.set(x + column, y + row, color);
            }
        }
    }

    /// A part of the picture: `width` x `height` pixels from (x, y), or as many
    /// of them as there are.
    #[must_use]
    pub fn cropped(&self, (x, y): (usize, usize), (width, height): (usize, usize)) -> Self {
        let (x, y) = (x.min(self.width), y.min(self.height));
        let (width, height) = (width.min(self.width - x), height.min(self.height - y));
        let rows = (y..y + height).map(|row| &self.pixels[row * self.width + x..][..width]);
        Self { width, height, pixels: rows.flatten().copied().collect(), alpha: None }
    }

    /// Every pixel as a block of `times` x `times`.
    #[must_use]
    pub fn enlarged(&self, times: usize) -> Self {
        let mut large = Self::filled(self.width * times, self.height * times, [0; 3]);
        for (k, pixel) in large.pixels.iter_mut().enumerate() {
            let (x, y) = (k % large.width / times, k / large.width / times);
            *pixel = self.pixels[y * self.width + x];
        }
        large
    }

    /// The picture as the address of an image in a page, which holds it.
    pub fn to_data_uri(&self) -> String {
        format!("data:image/png;base64,{}", BASE64_STANDARD.encode(self.to_png()))
    }

    /// The picture as a PNG file's bytes.
    pub fn to_png(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        let color = if self.alpha.is_some() { png::ColorType::Rgba } else { png::ColorType::Rgb };
        encoder.set_color(color);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        encoder.set_compression(png::Compression::High);
        let mut writer = encoder.write_header().expect("memory takes what is written to it");
        let data = match &self.alpha {
            None => self.pixels.as_flattened().to_vec(),
            Some(alpha) => {
                let pixels = self.pixels.iter().zip(alpha);
                pixels.flat_map(|(&[r, g, b], &a)| [r, g, b, a]).collect()
            }
        };
        writer.write_image_data(&data).expect("as many bytes per pixel as the header says");
        writer.finish().expect("memory takes what is written to it");
        bytes
    }

    /// Writes a PNG file: the whole of it or nothing.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), ImageError> {
        write_atomically(path, &self.to_png())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tone_mapping_clamps_and_brightens() {
        let channel = vec![0.0, 0.5, 7.0, f32::NAN];
        let image = Image::new("test", 2, 2, [channel.clone(), channel.clone(), channel])
            .expect("four samples of four pixels");
        let levels =
            |stops| Picture::of(&image, stops).pixels.iter().map(|p| p[0]).collect::<Vec<_>>();
        assert_eq!(levels(0.0), [0, 188, 255, 0]);
        assert_eq!(levels(1.0)[1], 255);
    }

    #[test]
    fn cropping_enlarging_and_pasting_move_pixels() {
        let mut picture = Picture::filled(3, 2, [1; 3]);
        picture.set(2, 1, [9; 3]);
        picture.set(3, 0, [7; 3]);
        let corner = picture.cropped((1, 1), (9, 9));
        assert_eq!((corner.size(), &corner.pixels[..]), ((2, 1), &[[1; 3], [9; 3]][..]));
        assert_eq!(corner.enlarged(2).pixels.iter().filter(|p| p[0] == 9).count(), 4);
        picture.paste(&corner, 2, 0);
        assert_eq!(picture.pixels.iter().filter(|p| p[0] == 9).count(), 1);
    }

    #[test]
    fn a_png_decodes_to_what_was_written() {
        let picture = Picture::filled(5, 3, [10, 20, 30]);
        let bytes = picture.to_png();
        let mut reader =
            png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().expect("a PNG file");
        let mut pixels = vec![0; 45];
        reader.next_frame(&mut pixels).expect("one frame");
        assert_eq!(pixels, picture.pixels.as_flattened());
    }
}
