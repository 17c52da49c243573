//! Words in pictures, in the 8 x 8 pixel font that every PC once had.

use font8x8::legacy::BASIC_LEGACY;

use super::picture::Picture;

/// Height and width of a character, before scaling.
const CELL: usize = 8;

/// Height of a line of text drawn at a scale.
pub fn height(scale: usize) -> usize {
    CELL * scale
}

/// Width of a text drawn at a scale.
pub fn width(text: &str, scale: usize) -> usize {
    text.chars().count() * CELL * scale
}

/// Writes a text with its top left corner at (x, y). Characters beyond ASCII
/// are drawn as `?`.
pub fn draw(
    picture: &mut Picture,
    text: &str,
    (x, y): (usize, usize),
    scale: usize,
    color: [u8; 3],
) {
    for (k, character) in text.chars().enumerate() {
        let glyph = BASIC_LEGACY.get(character as usize).unwrap_or(&BASIC_LEGACY['?' as usize]);
        for (row, bits) in glyph.iter().enumerate() {
            for column in (0..CELL).filter(|column| bits >> column & 1 == 1) {
                let left = x + (k * CELL + column) * scale;
                let top = y + row * scale;
                for dot in 0..scale * scale {
                    picture.set(left + dot % scale, top + dot / scale, color);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_stays_within_the_size_that_is_promised() {
        let scale = 2;
        let (w, h) = (width("Mitä", scale), height(scale));
        let mut picture = Picture::filled(w + 8, h + 8, [0; 3]);
        let blank = picture.clone();
        draw(&mut picture, "Mitä", (0, 0), scale, [255; 3]);
        assert_ne!(picture, blank);
        let outside = |p: &Picture| (p.cropped((w, 0), (8, h + 8)), p.cropped((0, h), (w + 8, 8)));
        assert_eq!(outside(&picture), outside(&blank));
    }
}
