//! What was found about a filter as a page: one file, without scripts.

use askama::Template;

use super::{figures, listing, ratios, saved, summary};
use crate::explain::{Explanation, Footprint, Found, Kind};
use crate::filter::{Filter, Grid, StageKind};
use crate::image::Image;
use crate::report::Picture;

/// Columns and rows of an image that are shown around a pixel.
const NEAR: usize = 48;

/// How many times those are enlarged.
const ZOOM: usize = 5;

/// Columns and rows of a picture of weights, about.
const SIDE: usize = 105;

/// The mark of a pixel.
const MARK: [u8; 3] = [0xff, 0x30, 0x30];

/// Where there is no image.
const BESIDE: [u8; 3] = [0x28, 0x34, 0x58];

/// Everything about a filter and a scene.
#[derive(Template)]
#[template(path = "page/explain.html")]
pub(super) struct Page {
    title: String,
    summary: String,
    around: Vec<Around>,
    rows: Vec<Row>,
    listing: String,
}

/// A part.
struct Row {
    /// Whether a stage begins with it.
    first: bool,
    stage: String,
    kind: &'static str,
    text: String,
    if_it_is: &'static str,
    rel_mse: String,
    trimmed: String,
    time: String,
    /// What the trimmed error changes by without it, as a share of the whole filter's.
    worse: f64,
    /// The share of the time that is saved without it.
    saved: f64,
}

/// A pixel, and what is averaged for it.
pub(super) struct Around {
    title: String,
    pictures: Vec<Shown>,
    passes: Vec<Shown>,
}

/// A picture with what is said of it.
struct Shown {
    caption: String,
    source: String,
    width: usize,
    height: usize,
}

impl Shown {
    fn new(caption: String, picture: &Picture) -> Self {
        let (width, height) = picture.size();
        Self { caption, source: picture.to_data_uri(), width, height }
    }
}

impl Page {
    pub(super) fn new(
        filter: &Filter,
        scene: &str,
        told: &Explanation,
        around: Vec<Around>,
    ) -> Self {
        let mut before = None;
        let rows = told.parts.iter().map(|(part, found)| {
            let [rel_mse, trimmed, time] = figures(found, &told.whole);
            let (worse, saved) = match found {
                Found::Without(effect) => {
                    (ratios(effect, &told.whole)[1] - 1.0, saved(effect, &told.whole))
                }
                Found::Needed | Found::Absent => (0.0, 0.0),
            };
            let first = before != Some(part.stage);
            before = Some(part.stage);
            Row {
                first,
                stage: part.stage.map_or("reads", |k| filter.stages[k].name.as_str()).to_owned(),
                kind: match part.kind {
                    Kind::Feature(_) | Kind::Variances => "feature",
                    Kind::Pass => "pass",
                    Kind::Term => "term",
                    Kind::Factor => "factor",
                    Kind::Value => "value",
                },
                text: part.text.clone(),
                if_it_is: part.kind.without(),
                rel_mse,
                trimmed,
                time,
                worse,
                saved,
            }
        });
        Self {
            title: format!("{} on {scene}", filter.name),
            summary: summary(filter, scene, told),
            rows: rows.collect(),
            around,
            listing: listing(filter),
        }
    }

    pub(super) fn html(&self) -> String {
        self.render().expect("what it holds can be written")
    }

    /// The parts without which the error grows most.
    fn foremost(&self) -> Vec<&Row> {
        let mut rows: Vec<&Row> = self.rows.iter().filter(|row| row.worse > 0.0).collect();
        rows.sort_by(|a, b| b.worse.total_cmp(&a.worse));
        rows.truncate(10);
        rows
    }
}

impl Row {
    /// The length of the bar of errors, in percent: full where the error doubles.
    fn harm(&self) -> f64 {
        100.0 * self.worse.abs().min(1.0)
    }

    /// The length of the bar of time, in percent.
    fn share(&self) -> f64 {
        100.0 * self.saved.clamp(0.0, 1.0)
    }
}

impl Around {
    /// What stands around a pixel in the noisy image, the filtered one and the truth, and the
    /// weights of every pass.
    pub(super) fn new(
        filter: &Filter,
        at: [usize; 2],
        images: [&Image; 3],
        prints: &[Footprint],
    ) -> Self {
        let titles = ["as rendered", "filtered", "reference"];
        let pictures = titles.iter().zip(images).map(|(title, image)| {
            Shown::new((*title).to_owned(), &near(&Picture::of(image, 0.0), at))
        });
        let passes = prints.iter().map(|print| {
            let stage = &filter.stages[print.stage];
            let StageKind::Gather(gather) = &stage.kind else { unreachable!("passes are gathers") };
            let window = gather.window;
            let diameter = window.diameter();
            let apart = match window.dilation {
                1 => String::new(),
                apart => format!(", {apart} apart"),
            };
            let half = match stage.grid {
                Grid::Full => "",
                Grid::Half => ", half resolution",
            };
            let own = print.shares[print.shares.len() / 2].unwrap_or(0.0);
            let caption = format!(
                "{}: {diameter}x{diameter} taps{apart}{half}; its own share {:.1}%",
                stage.name,
                100.0 * own
            );
            Shown::new(caption, &weights(print, diameter))
        });
        let [x, y] = at;
        Self {
            title: format!("Around pixel {x},{y}"),
            pictures: pictures.collect(),
            passes: passes.collect(),
        }
    }
}

/// A picture's part around a pixel, which is marked.
fn near(picture: &Picture, [x, y]: [usize; 2]) -> Picture {
    let (width, height) = picture.size();
    let corner = |at: usize, end: usize| at.saturating_sub(NEAR / 2).min(end.saturating_sub(NEAR));
    let (left, top) = (corner(x, width), corner(y, height));
    let mut near = picture.cropped((left, top), (NEAR, NEAR)).enlarged(ZOOM);
    frame(&mut near, [x - left, y - top], ZOOM);
    near
}

/// The weights of a pass: black is nothing, white the greatest.
fn weights(print: &Footprint, diameter: usize) -> Picture {
    let cell = (SIDE / diameter).max(1);
    let greatest = print.shares.iter().flatten().fold(0.0f64, |most, share| most.max(share.abs()));
    let mut small = Picture::filled(diameter, diameter, BESIDE);
    for (k, share) in print.shares.iter().enumerate() {
        if let Some(share) = share {
            let level =
                if greatest > 0.0 { (255.0 * share.abs() / greatest).round() } else { 0.0 } as u8;
            let color = if *share < 0.0 { [level, 0, 0] } else { [level; 3] };
            small.set(k % diameter, k / diameter, color);
        }
    }
    let mut picture = small.enlarged(cell);
    if cell > 4 {
        frame(&mut picture, [diameter / 2; 2], cell);
    }
    picture
}

/// Draws a frame around an enlarged pixel.
fn frame(picture: &mut Picture, [x, y]: [usize; 2], times: usize) {
    for k in 0..times {
        for (u, v) in [(k, 0), (k, times - 1), (0, k), (times - 1, k)] {
            picture.set(x * times + u, y * times + v, MARK);
        }
    }
}
