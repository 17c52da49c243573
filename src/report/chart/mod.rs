//! Scatter charts with logarithmic axes, as SVG.
//!
//! A series has a colour and a shape, so that two things can be told at once
//! (what and by whom, say); points of one series are joined. The front, drawn
//! behind everything, is the staircase under which no point lies.
//!
//! The first seven colours are those of Okabe and Ito, which people with any colour
//! vision tell apart, but for the yellow one, which hardly shows on white; shapes
//! differ without any colour. The text is text, and fonts are left to the reader: widths
//! are estimated.

mod axis;
mod place;

use std::f64::consts::PI;

use askama::Template;

use super::number;
use axis::Axis;
use place::{Box, Labels};

/// The plot's frame, and what stands around it.
const HEIGHT: f64 = 600.0;
const LEFT: f64 = 76.0;
const TOP: f64 = 64.0;
const PLOT_WIDTH: f64 = 660.0;
const PLOT_HEIGHT: f64 = 470.0;
/// Half a mark's width.
const MARK: f64 = 5.5;
/// The size of labels at marks, and of what their letters take of it on average.
const LABEL: f64 = 11.0;
const LETTER: f64 = 0.58;
/// The size of the legend's text.
const LEGEND: f64 = 13.0;
/// Letters that the legend has room for, however short its texts are: its last line's.
const SHORTEST: usize = 24;
/// From one line of the legend to the next.
const LINE: f64 = 22.0;

/// As many as there are named and shipped filters and entries of Open Image Denoise.
const COLORS: [&str; 12] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#8b5a2b",
    "#8a9a00", "#882255", "#7a5cc0", "#808080",
];
/// As many as `outline` draws, one for every back end, two compilers and Open Image
/// Denoise.
const SHAPES: usize = 7;

/// A chart.
#[derive(Clone, Debug)]
pub struct Chart {
    /// In large letters.
    pub title: String,
    /// Under it.
    pub subtitle: String,
    /// Along the bottom.
    pub x: String,
    /// Along the left side.
    pub y: String,
    /// What colours stand for.
    pub colors: String,
    /// What shapes stand for.
    pub shapes: String,
    /// What labels stand for.
    pub labels: String,
    /// What the front is.
    pub front: String,
    /// The marks.
    pub series: Vec<Series>,
}

/// Points that are joined.
#[derive(Clone, Debug)]
pub struct Series {
    /// What the colour says; equal texts have equal colours.
    pub color: String,
    /// What the shape says.
    pub shape: String,
    /// In the order in which they are joined.
    pub points: Vec<Point>,
}

/// A mark. Only what is positive and finite has a place on logarithmic axes.
#[derive(Clone, Debug)]
pub struct Point {
    /// To the right.
    pub x: f64,
    /// Upwards.
    pub y: f64,
    /// Beside the mark, where there is room; may be empty.
    pub label: String,
    /// What a reader is shown who points at it.
    pub title: String,
}

#[derive(Template)]
#[template(path = "chart.svg", escape = "html")]
struct Drawing<'a> {
    chart: &'a Chart,
    subtitle: String,
    width: f64,
    height: f64,
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
    x_ticks: Vec<Tick>,
    y_ticks: Vec<Tick>,
    front: String,
    lines: Vec<Line>,
    marks: Vec<Mark>,
    labels: Vec<Label>,
    legend: Legend,
}

struct Tick {
    at: f64,
    text: String,
}

struct Line {
    path: String,
    color: &'static str,
}

struct Mark {
    path: String,
    color: &'static str,
    title: String,
}

struct Label {
    x: f64,
    y: f64,
    text: String,
    color: &'static str,
}

struct Legend {
    x: f64,
    heads: Vec<(f64, String)>,
    colors: Vec<(f64, &'static str, String)>,
    shapes: Vec<(f64, String, String)>,
    front: f64,
    note: f64,
}

impl Legend {
    /// The width of a drawing that ends where the longest of its lines does.
    fn width(&self) -> f64 {
        let marked = self.colors.iter().map(|(.., text)| text);
        let texts = marked.chain(self.shapes.iter().map(|(.., text)| text));
        let longest = texts.map(|text| text.chars().count()).max().unwrap_or(0);
        self.x + 28.0 + longest.max(SHORTEST) as f64 * LEGEND * LETTER
    }
}

impl Chart {
    /// The picture. Points without a place are left out.
    pub fn svg(&self) -> String {
        let placed = |point: &&Point| [point.x, point.y].iter().all(|z| z.is_normal() && *z > 0.0);
        let points = || self.series.iter().flat_map(|s| &s.points).filter(placed);
        let x = Axis::over(points().map(|p| p.x), LEFT, LEFT + PLOT_WIDTH);
        let y = Axis::over(points().map(|p| p.y), TOP + PLOT_HEIGHT, TOP);
        let colors = distinct(self.series.iter().map(|s| s.color.as_str()));
        let shapes = distinct(self.series.iter().map(|s| s.shape.as_str()));
        let (mut lines, mut marks, mut wanted) = (Vec::new(), Vec::new(), Vec::new());
        for series in &self.series {
            let color = color(position(&colors, &series.color));
            let shape = position(&shapes, &series.shape);
            let places: Vec<(f64, f64, &Point)> = series
                .points
                .iter()
                .filter(placed)
                .map(|point| (x.at(point.x), y.at(point.y), point))
                .collect();
            lines.push(Line { path: path(places.iter().map(|&(x, y, _)| (x, y))), color });
            for (x, y, point) in places {
                let title = printable(&point.title);
                marks.push(Mark { path: outline(shape, x, y), color, title });
                wanted.push((x, y, printable(&point.label), color));
            }
        }
        let mut taken = Labels::around(wanted.iter().map(|&(x, y, ..)| Box::around(x, y, MARK)));
        let labels = wanted.into_iter().filter(|(_, _, text, _)| !text.is_empty());
        let labels = labels.filter_map(|(x, y, text, color)| {
            let width = text.chars().count() as f64 * LABEL * LETTER;
            let (x, y) = taken.place(x, y, MARK, width, LABEL)?;
            Some(Label { x, y, text, color })
        });
        let tick = |axis: &Axis| -> Vec<Tick> {
            let ticks = axis.ticks();
            ticks.map(|value| Tick { at: axis.at(value), text: number::tick(value) }).collect()
        };
        let legend = self.legend(&colors, &shapes);
        let drawing = Drawing {
            chart: self,
            subtitle: printable(&self.subtitle),
            width: legend.width(),
            height: HEIGHT,
            left: LEFT,
            top: TOP,
            right: LEFT + PLOT_WIDTH,
            bottom: TOP + PLOT_HEIGHT,
            x_ticks: tick(&x),
            y_ticks: tick(&y),
            front: staircase(marked(points(), &x, &y)),
            labels: labels.collect(),
            lines,
            marks,
            legend,
        };
        drawing.render().expect("nothing fails that writes into a string")
    }

    fn legend(&self, colors: &[&str], shapes: &[&str]) -> Legend {
        let x = LEFT + PLOT_WIDTH + 24.0;
        let mut y = TOP + 8.0;
        let mut next = |step: f64| {
            y += step;
            y - step
        };
        let first = next(LINE);
        let colors = colors
            .iter()
            .enumerate()
            .map(|(k, text)| (next(LINE), color(k), printable(text)))
            .collect();
        next(LINE / 2.0);
        let second = next(LINE);
        let shapes = shapes
            .iter()
            .enumerate()
            .map(|(k, text)| {
                let y = next(LINE);
                (y, outline(k, x + 8.0, y), printable(text))
            })
            .collect();
        next(LINE / 2.0);
        let front = next(LINE * 1.5);
        Legend {
            x,
            heads: vec![(first, self.colors.clone()), (second, self.shapes.clone())],
            colors,
            shapes,
            front,
            note: next(LINE),
        }
    }
}

/// Each text once, in the order of first appearance.
fn distinct<'a>(texts: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut found = Vec::new();
    for text in texts {
        if !found.contains(&text) {
            found.push(text);
        }
    }
    found
}

fn position(texts: &[&str], text: &str) -> usize {
    texts.iter().position(|&other| other == text).expect("every series was looked at")
}

fn color(k: usize) -> &'static str {
    COLORS[k % COLORS.len()]
}

/// What XML may hold: control characters cannot even be escaped in it.
fn printable(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

fn path(points: impl Iterator<Item = (f64, f64)>) -> String {
    let steps = points.enumerate().map(|(k, (x, y))| {
        let command = if k == 0 { 'M' } else { 'L' };
        format!("{command}{x:.1} {y:.1}")
    });
    steps.collect()
}

/// The `k`th shape around a point.
fn outline(k: usize, x: f64, y: f64) -> String {
    let closed = |corners: &[(f64, f64)]| {
        path(corners.iter().map(|(dx, dy)| (x + dx * MARK, y + dy * MARK))) + "Z"
    };
    match k % SHAPES {
        0 => format!(
            "M{:.1} {y:.1}a{MARK} {MARK} 0 1 0 {:.1} 0a{MARK} {MARK} 0 1 0 {:.1} 0Z",
            x - MARK,
            2.0 * MARK,
            -2.0 * MARK
        ),
        1 => closed(&[(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)]),
        2 => closed(&[(0.0, -1.2), (1.1, 0.8), (-1.1, 0.8)]),
        3 => closed(&[(0.0, -1.3), (1.3, 0.0), (0.0, 1.3), (-1.3, 0.0)]),
        4 => closed(&[(0.0, 1.2), (1.1, -0.8), (-1.1, -0.8)]),
        6 => {
            let (near, far) = (0.4, 1.2);
            let arm = |(x, y): (f64, f64)| {
                [(near * x, far * y), (near * x, near * y), (far * x, near * y)]
            };
            let quarters = [(1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0)];
            let corners = quarters.into_iter().enumerate().flat_map(|(k, quarter)| {
                let mut corners = arm(quarter);
                // Around the centre, so that every second quarter goes the other way.
                if k % 2 == 1 {
                    corners.reverse();
                }
                corners
            });
            closed(&corners.collect::<Vec<_>>())
        }
        _ => {
            let star = |k: usize| {
                let (length, angle) =
                    (if k.is_multiple_of(2) { 1.5 } else { 0.6 }, k as f64 * 0.2 * PI);
                (length * angle.sin(), -length * angle.cos())
            };
            closed(&(0..10).map(star).collect::<Vec<_>>())
        }
    }
}

/// Where points stand on the paper.
fn marked<'a>(points: impl Iterator<Item = &'a Point>, x: &Axis, y: &Axis) -> Vec<(f64, f64)> {
    points.map(|point| (x.at(point.x), y.at(point.y))).collect()
}

/// The line under which no point lies, from the left to the right edge of the
/// plot. Downwards is better, and so is to the left.
fn staircase(mut points: Vec<(f64, f64)>) -> String {
    points.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.total_cmp(&a.1)));
    let mut corners: Vec<(f64, f64)> = Vec::new();
    for (x, y) in points {
        match corners.last() {
            None => corners.extend([(x, TOP), (x, y)]),
            Some(&(_, lowest)) if y > lowest => corners.extend([(x, lowest), (x, y)]),
            Some(_) => {}
        }
    }
    if let Some(&(_, lowest)) = corners.last() {
        corners.push((LEFT + PLOT_WIDTH, lowest));
    }
    path(corners.into_iter())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(points: &[(f64, f64)]) -> Chart {
        let point =
            |&(x, y): &(f64, f64)| Point { x, y, label: "<5>".into(), title: "a & \u{1} b".into() };
        Chart {
            title: "title".to_owned(),
            subtitle: String::new(),
            x: "time".to_owned(),
            y: "error".to_owned(),
            colors: "filter".to_owned(),
            shapes: "run by".to_owned(),
            labels: "radius".to_owned(),
            front: "front".to_owned(),
            series: vec![Series {
                color: "\"quoted\"".to_owned(),
                shape: "</svg>".to_owned(),
                points: points.iter().map(point).collect(),
            }],
        }
    }

    #[test]
    fn no_two_series_look_alike() {
        let shapes: Vec<String> = (0..SHAPES).map(|k| outline(k, 0.0, 0.0)).collect();
        let all = |texts: &[String]| distinct(texts.iter().map(String::as_str)).len();
        assert_eq!(all(&shapes), SHAPES);
        assert_eq!(distinct(COLORS.into_iter()).len(), COLORS.len());
    }

    #[test]
    fn every_point_that_has_a_place_has_a_mark() {
        let infinite = f64::INFINITY;
        let points = [(1.0, 0.1), (10.0, 0.01), (0.0, 1.0), (3.0, infinite), (f64::NAN, 1.0)];
        for (count, marks) in [(5, 2), (1, 1), (0, 0)] {
            let svg = chart(&points[..count]).svg();
            assert_eq!(svg.matches("class=\"mark\"").count(), marks);
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        }
    }

    #[test]
    fn texts_are_escaped() {
        let svg = chart(&[(1.0, 0.1)]).svg();
        assert_eq!(svg.matches("</svg>").count(), 1, "{svg}");
        assert!(!svg.contains('\u{1}') && !svg.contains("a & "), "{svg}");
    }

    #[test]
    fn the_front_goes_down_and_skips_what_is_beaten() {
        // On paper, where y grows downwards: (2, 90) is slower than (1, 100) and errs more.
        let front = staircase(vec![(1.0, 100.0), (2.0, 90.0), (3.0, 150.0)]);
        assert_eq!(front, "M1.0 64.0L1.0 100.0L3.0 100.0L3.0 150.0L736.0 150.0");
    }
}
