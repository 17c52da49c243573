//! Images beside one reference, for whoever wants to look.
//!
//! The page holds every image as half floats, deflated: six to seven bytes a pixel, and two and
//! a half for both error maps. Images of more than [`MOST_PIXELS`] are shown by the means of squares
//! of pixels; figures and crops are of the whole image.

use askama::Template;
use serde::Serialize;

use super::{crops, embed, ramp};
use crate::image::exr::Window;
use crate::image::{Image, Map};
use crate::report::{Align, Contrast, FIGURES, Figures, Picture, Table, number};

/// The most pixels of an image that a page holds: 2048 x 2048.
pub const MOST_PIXELS: usize = 1 << 22;

/// How many crops are chosen.
const CROPS: usize = 4;

/// The width that crops are enlarged to, by whole factors.
const CROP_WIDTH: usize = 216;

/// What the reference is called.
const REFERENCE: &str = "reference";

/// A page about images and their reference.
#[derive(Clone, Copy, Debug)]
pub struct ComparePage<'a> {
    /// The images, of one size.
    pub contrasts: &'a [Contrast],
    /// What they were compared with.
    pub reference: &'a Image,
    /// What is compared, if not all of every image.
    pub overlap: Option<Window>,
}

#[derive(Template)]
#[template(path = "page/compare.html", escape = "html")]
struct Page {
    title: String,
    about: String,
    errors: String,
    keys: Vec<(String, String)>,
    legends: [Legend; 2],
    ramp: String,
    remark: String,
    chosen: String,
    crops: Vec<Crop>,
    data: String,
    parts: Vec<Part>,
}

struct Legend {
    mode: &'static str,
    title: &'static str,
    ticks: ramp::Ticks,
}

struct Crop {
    title: String,
    /// Corner and size as the page counts pixels.
    place: String,
    pictures: Vec<Shown>,
    errors: String,
}

struct Shown {
    title: String,
    url: String,
    best: bool,
}

/// Bytes that the script unpacks.
struct Part {
    id: String,
    base64: String,
}

#[derive(Serialize)]
struct Data<'a> {
    width: usize,
    height: usize,
    step: usize,
    names: Vec<&'a str>,
    ramp: Vec<[u8; 3]>,
}

impl ComparePage<'_> {
    /// The page.
    ///
    /// # Panics
    /// If the images differ in size.
    pub fn html(&self) -> String {
        let size = self.reference.size();
        let step = embed::step(size, MOST_PIXELS);
        let names = self.contrasts.iter().map(|contrast| contrast.name.as_str());
        let names: Vec<&str> = names.chain([REFERENCE]).collect();
        let key = |k: usize| if k < 9 { (k + 1).to_string() } else { String::new() };
        let shown = [size.0.div_ceil(step), size.1.div_ceil(step)];
        let data = Data {
            width: shown[0],
            height: shown[1],
            step,
            names: names.clone(),
            ramp: ramp::colors(),
        };
        let maps: Vec<&Map> = self.contrasts.iter().map(|c| &c.differences.flip).collect();
        let windows = crops::most_different(&maps, CROPS);
        let page = Page {
            title: match self.contrasts {
                [only] => format!("{} beside its reference", only.name),
                several => format!("{} images beside one reference", several.len()),
            },
            about: self.about(),
            errors: self.errors(|contrast| Some(contrast.figures())),
            keys: names.iter().enumerate().map(|(k, name)| (key(k), (*name).to_owned())).collect(),
            legends: [
                Legend {
                    mode: "relative",
                    title: "relative squared error, logarithmic",
                    ticks: ramp::relative_ticks(),
                },
                Legend { mode: "flip", title: "FLIP", ticks: ramp::flip_ticks() },
            ],
            ramp: ramp::gradient(),
            remark: match step {
                1 => "Images are shown pixel by pixel, as half floats.".to_owned(),
                _ => format!(
                    "The images are large: the viewer shows means of {step}x{step} pixels, as half \
                     floats. Figures and the crops below are of all pixels."
                ),
            },
            chosen: match self.contrasts.len() {
                1 => "Parts of the greatest mean FLIP.",
                _ => "Parts in which the images' mean FLIP differs most.",
            }
            .to_owned(),
            crops: windows.iter().map(|window| self.crop(*window, step)).collect(),
            data: embed::json(&data),
            parts: self.parts(step),
        };
        page.render().expect("a page is text")
    }

    fn about(&self) -> String {
        let (width, height) = self.reference.size();
        let mut about =
            format!("Compared with {}, {width}x{height} pixels.", self.reference.name());
        if let Some(window) = self.overlap {
            about += &format!(" The images begin at different places: compared is {window}.");
        }
        let left_out = self.contrasts.iter().map(|c| c.comparison.left_out).max().unwrap_or(0);
        if left_out > 0 {
            let pixels = number::plural(left_out, "pixel");
            about += &format!(" {pixels} of the reference are no numbers, and are left out.");
        }
        for contrast in self.contrasts.iter().filter(|c| c.comparison.bad > 0) {
            let pixels = number::plural(contrast.comparison.bad, "pixel");
            about += &format!(" {pixels} of {} are no numbers.", contrast.name);
        }
        about
    }

    /// A row per image.
    fn errors(&self, figures: impl Fn(&Contrast) -> Option<Figures>) -> String {
        let names = FIGURES.iter().map(|figure| (figure.name, Align::Right));
        let mut table = Table::new([("image", Align::Left)].into_iter().chain(names));
        for contrast in self.contrasts {
            let figures = figures(contrast);
            let text =
                |f: &crate::report::Figure| figures.as_ref().map_or_else(|| "-".to_owned(), f.text);
            table.row([contrast.name.clone()].into_iter().chain(FIGURES.iter().map(text)));
        }
        table.html()
    }

    fn crop(&self, window: Window, step: usize) -> Crop {
        let cut = |image: &Image| {
            let picture = Picture::of(&image.clone().with_origin((0, 0)).within(window), 0.0);
            picture.enlarged((CROP_WIDTH / window.size.0).max(1)).to_data_uri()
        };
        let figures = |contrast: &Contrast| contrast.figures_in(self.reference, window);
        let flips =
            self.contrasts.iter().map(|contrast| contrast.differences.flip.mean_in(&window));
        let flips: Vec<f64> = flips.map(|flip| flip.unwrap_or(f64::INFINITY)).collect();
        let least = flips.iter().copied().fold(f64::INFINITY, f64::min);
        let images = self.contrasts.iter().zip(&flips).map(|(contrast, flip)| Shown {
            title: format!("{}, FLIP {}", contrast.name, number::error(*flip)),
            url: cut(&contrast.image),
            best: self.contrasts.len() > 1 && *flip == least,
        });
        let reference =
            Shown { title: REFERENCE.to_owned(), url: cut(self.reference), best: false };
        let [x, y] = [window.origin.0, window.origin.1].map(|at| at as usize);
        let (width, height) = window.size;
        let place = [x / step, y / step, width.div_ceil(step), height.div_ceil(step)];
        Crop {
            title: format!("{width}x{height} at ({x}, {y})"),
            place: place.map(|n| n.to_string()).join(" "),
            pictures: images.chain([reference]).collect(),
            errors: self.errors(figures),
        }
    }

    fn parts(&self, step: usize) -> Vec<Part> {
        let mut parts = Vec::new();
        let mut add = |id: String, base64: String| parts.push(Part { id, base64 });
        for (k, contrast) in self.contrasts.iter().enumerate() {
            let differences = &contrast.differences;
            add(format!("pixels-{k}"), embed::halves(&contrast.image, step));
            let relative = embed::levels(&differences.relative, step, ramp::relative);
            add(format!("relative-{k}"), relative);
            add(format!("flip-{k}"), embed::levels(&differences.flip, step, ramp::flip));
        }
        let last = self.contrasts.len();
        add(format!("pixels-{last}"), embed::halves(self.reference, step));
        parts
    }
}
