//! A search's page: its course while it runs, and all that it found at its end.

use askama::Template;
use serde::Serialize;

use super::{crops, embed};
use crate::image::{Differences, Image, ImageError, Metrics};
use crate::report::{Picture, number};

/// Chart.js, as its authors publish it.
const CHARTS: &str = include_str!("../../../templates/vendor/chart.umd.min.js");

/// Seconds after which a page of a search under way loads itself again.
const RELOAD: u32 = 10;

/// The most generations that a chart has points of.
const POINTS: usize = 1000;

/// How many crops of a scene are shown, and what they are enlarged to.
const CROPS: usize = 2;
const CROP_WIDTH: usize = 432;

/// A page about a search.
#[derive(Clone, Debug)]
pub struct SearchPage {
    /// What is searched, in large letters.
    pub title: String,
    /// How far it is, or how it ended.
    pub standing: String,
    /// Whether it goes on: then the page loads itself again.
    pub under_way: bool,
    /// Errors by generation.
    pub course: Course,
    /// What is shown below each other, as far as it is known.
    pub sections: Vec<Section>,
    /// The command that repeats the search.
    pub command: String,
    /// The parameters, as an HTML table.
    pub parameters: String,
}

/// Errors by generation.
#[derive(Clone, Debug, Default)]
pub struct Course {
    /// What the errors are.
    pub axis: String,
    /// The generations.
    pub generations: Vec<u32>,
    /// Lines of an error per generation.
    pub lines: Vec<Line>,
    /// Some of them, as an HTML table.
    pub table: String,
}

/// An error per generation; not a number where it is not known.
#[derive(Clone, Debug)]
pub struct Line {
    /// What it is the error of.
    pub name: String,
    /// As many as there are generations.
    pub values: Vec<f64>,
}

/// A part of the page.
#[derive(Clone, Debug)]
pub enum Section {
    /// Programs of which none is better by all goals.
    Front(Front),
    /// What a filter makes of images.
    Scene(BeforeAfter),
    /// Figures.
    Figures {
        /// Its heading.
        title: String,
        /// What they are.
        about: String,
        /// The figures, as an HTML table.
        table: String,
    },
    /// A drawing.
    Drawing {
        /// Its heading.
        title: String,
        /// How to read it.
        about: String,
        /// The drawing.
        svg: String,
    },
    /// Formulas.
    Formulas {
        /// Its heading.
        title: String,
        /// The formulas.
        text: String,
    },
}

/// Programs of which none is better by all goals.
#[derive(Clone, Debug)]
pub struct Front {
    /// What is to the right.
    pub x: String,
    /// What is upwards.
    pub y: String,
    /// The programs.
    pub programs: Vec<FrontPoint>,
    /// Their figures, as an HTML table.
    pub table: String,
}

/// A program of the front.
#[derive(Clone, Debug)]
pub struct FrontPoint {
    /// What it is called.
    pub name: String,
    /// Its place in the chart.
    pub place: [f64; 2],
    /// Its figures, in a line.
    pub figures: String,
    /// Its formulas.
    pub formulas: String,
    /// Whether it is the result.
    pub is_result: bool,
}

/// What a filter makes of an image.
#[derive(Clone, Debug)]
pub struct BeforeAfter {
    /// Its heading.
    pub title: String,
    /// What stands under it.
    about: String,
    crops: Vec<Crop>,
}

#[derive(Clone, Debug)]
struct Crop {
    title: String,
    /// Before, after, the reference, the difference.
    pictures: [Shown; 4],
}

#[derive(Clone, Debug)]
struct Shown {
    title: String,
    url: String,
}

impl BeforeAfter {
    /// Parts of an image before and after filtering, where filtering changed FLIP the most.
    ///
    /// # Errors
    /// If the images differ in size.
    pub fn new(
        title: String,
        before: &Image,
        after: &Image,
        reference: &Image,
    ) -> Result<Self, ImageError> {
        let [noisy, clean] = [before, after].map(|image| Metrics::of(image, reference));
        let (noisy, clean) = (noisy?, clean?);
        let was = Differences::of(before, reference)?.flip;
        let is = Differences::of(after, reference)?.flip;
        let about = format!(
            "RelMSE (trimmed) before {}, after {}; FLIP before {}, after {}. The pictures are clamped \
             to [0, 1] under the sRGB curve.",
            number::rel_mse(&noisy),
            number::rel_mse(&clean),
            was.mean().map_or_else(|| "-".to_owned(), number::error),
            is.mean().map_or_else(|| "-".to_owned(), number::error),
        );
        let windows = crops::most_different(&[&was, &is], CROPS);
        let crops = windows.into_iter().map(|window| {
            let times = (CROP_WIDTH / window.size.0).max(1);
            let cut = |image: &Image| image.clone().with_origin((0, 0)).within(window);
            let shown = |title: &str, image: &Image| Shown {
                title: title.to_owned(),
                url: Picture::of(image, 0.0).enlarged(times).to_data_uri(),
            };
            let [before, after, reference] = [before, after, reference].map(cut);
            Crop {
                title: {
                    let ((w, h), (x, y)) = (window.size, window.origin);
                    format!("{w}x{h} pixels at ({x}, {y})")
                },
                pictures: [
                    shown("before", &before),
                    shown("after", &after),
                    shown("reference", &reference),
                    shown("|after - reference|, four times", &differing(&after, &reference)),
                ],
            }
        });
        Ok(Self { title, about, crops: crops.collect() })
    }
}

/// Four times the absolute difference, channel by channel.
fn differing(image: &Image, reference: &Image) -> Image {
    let (mine, truth) = (image.rgb(), reference.rgb());
    let channel = |c: usize| {
        mine[c].iter().zip(truth[c]).map(|(x, y)| 4.0 * (x - y).abs()).collect::<Vec<f32>>()
    };
    let (width, height) = image.size();
    Image::new(image.name(), width, height, [0, 1, 2].map(channel)).expect("a sample per pixel")
}

#[derive(Template)]
#[template(path = "page/search.html", escape = "html")]
struct Page<'a> {
    page: &'a SearchPage,
    reload: u32,
    charts: &'static str,
    data: String,
}

#[derive(Serialize)]
struct Data<'a> {
    axis: &'a str,
    generations: Vec<u32>,
    lines: Vec<LineData<'a>>,
    front: Option<FrontData<'a>>,
}

#[derive(Serialize)]
struct LineData<'a> {
    name: &'a str,
    /// Null where it is not known.
    values: Vec<f64>,
}

#[derive(Serialize)]
struct FrontData<'a> {
    x: &'a str,
    y: &'a str,
    programs: Vec<ProgramData<'a>>,
}

#[derive(Serialize)]
struct ProgramData<'a> {
    name: &'a str,
    place: [f64; 2],
    result: bool,
}

impl SearchPage {
    /// The page.
    pub fn html(&self) -> String {
        let course = &self.course;
        let kept = kept(course);
        let of = |values: &[f64]| kept.iter().map(|&k| values[k]).collect();
        let front = self.sections.iter().find_map(|section| match section {
            Section::Front(front) => Some(front),
            _ => None,
        });
        let data = Data {
            axis: &course.axis,
            generations: kept.iter().map(|&k| course.generations[k]).collect(),
            lines: course
                .lines
                .iter()
                .map(|line| LineData { name: &line.name, values: of(&line.values) })
                .collect(),
            front: front.map(|front| FrontData {
                x: &front.x,
                y: &front.y,
                programs: front
                    .programs
                    .iter()
                    .map(|program| ProgramData {
                        name: &program.name,
                        place: program.place,
                        result: program.is_result,
                    })
                    .collect(),
            }),
        };
        let page = Page { page: self, reload: RELOAD, charts: CHARTS, data: embed::json(&data) };
        page.render().expect("a page is text")
    }
}

/// Which generations a chart shows: all of a short search, and of a long one so many that are
/// evenly apart, with the last and those at which something is known that mostly is not.
fn kept(course: &Course) -> Vec<usize> {
    let count = course.generations.len();
    let step = count.div_ceil(POINTS).max(1);
    let rare = course.lines.iter().filter(|line| {
        let known = line.values.iter().filter(|x| !x.is_nan()).count();
        known > 0 && known < count && known <= POINTS
    });
    let rare: Vec<&Line> = rare.collect();
    let is_kept = |k: &usize| {
        k.is_multiple_of(step)
            || k + 1 == count
            || rare.iter().any(|line| !line.values[*k].is_nan())
    };
    (0..count).filter(is_kept).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_courses_are_thinned_and_keep_what_is_rare() {
        let count = 5000;
        let line = |name: &str, f: fn(usize) -> f64| Line {
            name: name.to_owned(),
            values: (0..count).map(f).collect(),
        };
        let mut course = Course {
            generations: (0..count as u32).collect(),
            lines: vec![line("best", |k| k as f64)],
            ..Course::default()
        };
        let plain = kept(&course);
        assert_eq!((plain.len(), plain[1], plain.last()), (1001, 5, Some(&4999)));
        course.lines.push(line("validation", |k| if k % 101 == 0 { 1.0 } else { f64::NAN }));
        let with = kept(&course);
        assert!((0..count).step_by(101).all(|k| with.contains(&k)) && with.len() < 1100);
    }
}
