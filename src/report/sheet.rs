//! Contact sheets: pictures side by side under captions.

use super::caption;
use super::picture::Picture;

const MARGIN: usize = 6;
const PAPER: [u8; 3] = [24, 24, 24];
const INK: [u8; 3] = [230, 230, 230];

/// A picture with what stands above it: a line in large letters, and perhaps
/// one in small ones.
#[derive(Clone, Debug)]
pub struct Panel {
    /// The picture.
    pub picture: Picture,
    /// What it shows.
    pub title: String,
    /// A figure, say; may be empty.
    pub subtitle: String,
}

/// Lays panels out in rows of `columns`.
pub fn sheet(panels: &[Panel], columns: usize) -> Picture {
    let columns = columns.clamp(1, panels.len().max(1));
    let size = |along: fn(&Picture) -> usize| {
        panels.iter().map(|panel| along(&panel.picture)).max().unwrap_or(0)
    };
    let (width, height) = (size(|p| p.size().0), size(|p| p.size().1));
    let subtitles = panels.iter().any(|panel| !panel.subtitle.is_empty());
    let head =
        caption::height(2) + MARGIN + if subtitles { caption::height(1) + MARGIN } else { 0 };
    let (cell_width, cell_height) = (width + MARGIN, head + height + MARGIN);
    let rows = panels.len().div_ceil(columns);
    let mut sheet =
        Picture::filled(columns * cell_width + MARGIN, rows * cell_height + MARGIN, PAPER);
    for (k, panel) in panels.iter().enumerate() {
        let x = MARGIN + k % columns * cell_width;
        let y = MARGIN + k / columns * cell_height;
        // Large letters where they fit, small ones where they do not.
        let scale = if caption::width(&panel.title, 2) <= width { 2 } else { 1 };
        let room = |text: &str, scale: usize| {
            text.chars().take(width / caption::width("M", scale)).collect::<String>()
        };
        caption::draw(&mut sheet, &room(&panel.title, scale), (x, y), scale, INK);
        let below = y + caption::height(2) + MARGIN;
        caption::draw(&mut sheet, &room(&panel.subtitle, 1), (x, below), 1, INK);
        sheet.paste(&panel.picture, x, y + head);
    }
    sheet
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panels_fill_rows() {
        let panel = |title: &str| Panel {
            picture: Picture::filled(40, 20, [200; 3]),
            title: title.to_owned(),
            subtitle: String::new(),
        };
        let panels = [panel("a"), panel("a very long title"), panel("c")];
        let one_row = sheet(&panels, 3).size();
        let two_rows = sheet(&panels, 2).size();
        assert_eq!(one_row.0, 3 * 46 + 6);
        assert_eq!(two_rows.0, 2 * 46 + 6);
        assert_eq!(two_rows.1 - 6, 2 * (one_row.1 - 6));
    }
}
