//! `tamis explain`: what the parts of a filter are for.

mod page;

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::apply::{checked, needs, reach};
use super::backend::{LanesArgs, Processor};
use super::error::Error;
use super::log::Log;
use super::resolve::resolve;
use super::scenes;
use super::spare::spare;
use crate::explain::{Effect, Explanation, Found, Kind, Part, explain, footprints};
use crate::filter::Filter;
use crate::image::{Image, write_atomically};
use crate::report::score::{MetricsJson, json};
use crate::report::{Align, Format, Table, number};
use crate::scene::{LoadOptions, Scene, load_reference};
use page::{Around, Page};

const EXAMPLES: &str = "\
Examples:
  tamis explain tamis-formula --scene data/test/galley
  tamis explain out/best.toml --scene data/test/galley --html explained.html --at 60,45 --at 12,80
  tamis explain tamis --scene noisy.exr,clean.exr --json

The filter runs once without each of its parts: without a feature that the file has,
without a pass, with 0 in the place of a term of a weight's exponent, with 1 in the place
of a factor, or with its mean (in the middle of the image) in the place of a value that a
map makes. How much larger the error is then says what the part is for (less than nothing:
the scene is better off without it), and how much less time is predicted says what it
takes. Constants stay as they were tuned for the whole.

The page (--html) has all parts, and for each --at the weights of every pass around that
pixel as pictures: white is the greatest, red below zero.";

/// Parts whose effects are smaller are left out of the table, unless all are asked for.
const SMALL: f64 = 0.01;

/// The width of the column of formulas.
const WIDTH: usize = 64;

/// Say what each part of a filter does for a scene, and what time it takes.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Explain {
    /// A filter's name (see `tamis filters`), a filter file, or an expression
    #[arg(value_name = "FILTER")]
    filter: String,

    /// A folder with 4spp.exr and reference.exr, or a pair of files
    #[arg(long, value_name = scenes::VALUE)]
    scene: PathBuf,

    /// Write a page with everything, and pictures
    #[arg(long, value_name = "PAGE.html")]
    html: Option<PathBuf>,

    /// A pixel whose weights the page shows (again for more) [default: that in the middle]
    #[arg(long, value_name = "X,Y", value_parser = pixel, requires = "html", allow_hyphen_values = true)]
    at: Vec<[usize; 2]>,

    /// List the parts that matter little, too
    #[arg(long)]
    all: bool,

    /// Print JSON
    #[arg(long, conflicts_with = "all")]
    json: bool,

    /// What runs the filter
    #[arg(long, value_enum, value_name = "BACKEND", default_value_t = Processor::DEFAULT)]
    backend: Processor,

    #[command(flatten)]
    lanes: LanesArgs,
}

fn pixel(text: &str) -> Result<[usize; 2], String> {
    let numbers: Option<Vec<usize>> =
        text.split(',').map(|part| part.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y]) => Ok([x, y]),
        Some(_) | None => Err("two numbers are needed: column and row, from 0".to_owned()),
    }
}

impl Explain {
    pub(super) fn run(&self, log: Log) -> Result<String, Error> {
        let backend = self.backend.open(self.lanes.lanes)?;
        let filter = resolve(&self.filter, None)?;
        let files = scenes::one(&self.scene)?;
        if let Some(page) = &self.html {
            spare(page, [self.filter.as_ref(), files.noisy.as_path(), files.reference.as_path()])?;
        }
        let scene =
            Scene::load(&files.noisy, &needs(&filter), reach(&filter), &LoadOptions::default())?;
        let reference = load_reference(&files.reference)?;
        for note in scene.notes() {
            log.say(format_args!("{}: {note}", files.noisy.display()));
        }
        let at = self.pixels(&scene)?;
        let bar = log.bar(0);
        let told = explain(&filter, &scene, &reference, &*backend, &|done, of| {
            if let Some(bar) = &bar {
                bar.set_length(of as u64);
                bar.set_position(done as u64);
                bar.set_message(format!("part {done}/{of}"));
            }
        });
        if let Some(bar) = bar {
            bar.finish_and_clear();
        }
        let told = told?;
        if let Some(path) = &self.html {
            let page = page(&filter, &files.name, &scene, &reference, &told, &at);
            write_atomically(path, page.as_bytes())?;
            log.say(format_args!("wrote {}", path.display()));
        }
        Ok(match self.json {
            true => to_json(&filter, &files.name, &told),
            false => text(&filter, &files.name, &told, self.all),
        })
    }

    /// The pixels whose weights are shown.
    fn pixels(&self, scene: &Scene) -> Result<Vec<[usize; 2]>, Error> {
        let (width, height) = (scene.layout().width(), scene.layout().height());
        if let Some([x, y]) = self.at.iter().find(|[x, y]| *x >= width || *y >= height) {
            return Err(Error::Usage(format!(
                "--at {x},{y}: the image has {width}x{height} pixels, counted from 0"
            )));
        }
        Ok(match self.at.is_empty() {
            true => vec![[width / 2, height / 2]],
            false => {
                let mut at = self.at.clone();
                let mut shown = std::collections::BTreeSet::new();
                at.retain(|pixel| shown.insert(*pixel));
                at
            }
        })
    }
}

fn page(
    filter: &Filter,
    name: &str,
    scene: &Scene,
    reference: &Image,
    told: &Explanation,
    at: &[[usize; 2]],
) -> String {
    let noisy = scene.noisy();
    let around = at.iter().map(|&at| {
        Around::new(filter, at, [&noisy, &told.image, reference], &footprints(filter, scene, at))
    });
    Page::new(filter, name, told, around.collect()).html()
}

/// The whole, and the parts that matter or all.
fn text(filter: &Filter, scene: &str, told: &Explanation, all: bool) -> String {
    let mut table = Table::new([
        ("stage", Align::Left),
        ("part", Align::Left),
        ("if it is", Align::Left),
        ("RelMSE", Align::Right),
        ("trimmed", Align::Right),
        ("time", Align::Right),
    ]);
    let mut left = 0;
    for (part, found) in &told.parts {
        if !all && is_small(part, found, &told.whole) {
            left += 1;
            continue;
        }
        let [rel_mse, trimmed, time] = figures(found, &told.whole);
        let stage = part.stage.map_or("", |k| filter.stages[k].name.as_str());
        let if_it_is = part.kind.without();
        let cells = [stage, &part.text, if_it_is, &rel_mse, &trimmed, &time];
        table.wrapped_row(cells, WIDTH);
    }
    let mut text = format!("{}\n\n{}", summary(filter, scene, told), table.render(Format::Plain));
    if left > 0 {
        text += &format!(
            "\n{} more: each changes the error by less than 1% and takes less than 1% of the time \
             (--all lists them)\n",
            number::plural(left, "part")
        );
    }
    text
}

/// What the whole filter does, in a line.
fn summary(filter: &Filter, scene: &str, told: &Explanation) -> String {
    let (width, height) = told.image.size();
    format!(
        "{} on {scene} ({width}x{height}): RelMSE {} as rendered, {} filtered; it is predicted to \
         take {:.0} ns per pixel on one core",
        filter.name,
        number::rel_mse(&told.noisy),
        number::rel_mse(&told.whole.metrics),
        told.whole.cost,
    )
}

/// Whether neither the error nor the time hangs on a part. Features are always of interest.
fn is_small(part: &Part, found: &Found, whole: &Effect) -> bool {
    match found {
        Found::Without(effect) if part.stage.is_some() => {
            let [rel_mse, trimmed] = ratios(effect, whole);
            let changes = (rel_mse - 1.0).abs().max((trimmed - 1.0).abs());
            changes < SMALL && saved(effect, whole) < SMALL
        }
        Found::Without(_) | Found::Needed | Found::Absent => false,
    }
}

/// The errors without a part, by those of the whole.
fn ratios(effect: &Effect, whole: &Effect) -> [f64; 2] {
    let (part, whole) = (&effect.metrics, &whole.metrics);
    [part.rel_mse / whole.rel_mse, part.trimmed_rel_mse / whole.trimmed_rel_mse]
}

/// The share of the whole time that is saved without a part.
fn saved(effect: &Effect, whole: &Effect) -> f64 {
    1.0 - effect.cost / whole.cost
}

/// What the errors change by without a part, and the time that is saved.
fn figures(found: &Found, whole: &Effect) -> [String; 3] {
    match found {
        Found::Without(effect) => {
            let [rel_mse, trimmed] = ratios(effect, whole).map(change);
            [rel_mse, trimmed, format!("{:.1}%", 100.0 * saved(effect, whole))]
        }
        Found::Needed => ["needed", "", ""].map(str::to_owned),
        Found::Absent => ["not there", "", ""].map(str::to_owned),
    }
}

/// A ratio as a change of so many percent, or where it is large as a factor.
fn change(ratio: f64) -> String {
    match ratio {
        ..10.0 => format!("{:+.1}%", 100.0 * (ratio - 1.0)),
        10.0.. => format!("x {ratio:.0}"),
        _ => "-".to_owned(),
    }
}

/// Everything that was found.
fn to_json(filter: &Filter, scene: &str, told: &Explanation) -> String {
    #[derive(Serialize)]
    struct ExplanationJson<'a> {
        filter: &'a str,
        scene: &'a str,
        noisy: MetricsJson,
        filtered: MetricsJson,
        predicted_ns_per_pixel: f64,
        parts: Vec<PartJson<'a>>,
    }
    #[derive(Serialize)]
    struct PartJson<'a> {
        kind: &'static str,
        stage: Option<&'a str>,
        part: &'a str,
        if_it_is: &'static str,
        needed: bool,
        absent: bool,
        #[serde(flatten)]
        without: Option<MetricsJson>,
        predicted_ns_per_pixel: Option<f64>,
    }
    let part = |(part, found): &'_ (Part, Found)| {
        let effect = match found {
            Found::Without(effect) => Some(*effect),
            Found::Needed | Found::Absent => None,
        };
        (effect, matches!(found, Found::Needed), part.kind)
    };
    let parts = told.parts.iter().map(|entry| {
        let (effect, needed, kind) = part(entry);
        PartJson {
            kind: match kind {
                Kind::Feature(_) => "feature",
                Kind::Variances => "variances",
                Kind::Pass => "pass",
                Kind::Term => "term",
                Kind::Factor => "factor",
                Kind::Value => "value",
            },
            stage: entry.0.stage.map(|k| filter.stages[k].name.as_str()),
            part: &entry.0.text,
            if_it_is: kind.without(),
            needed,
            absent: effect.is_none() && !needed,
            without: effect.map(|effect| MetricsJson::of(&effect.metrics)),
            predicted_ns_per_pixel: effect.map(|effect| effect.cost),
        }
    });
    json(&ExplanationJson {
        filter: &filter.name,
        scene,
        noisy: MetricsJson::of(&told.noisy),
        filtered: MetricsJson::of(&told.whole.metrics),
        predicted_ns_per_pixel: told.whole.cost,
        parts: parts.collect(),
    })
}

/// The filter as `tamis filters show` prints it.
fn listing(filter: &Filter) -> String {
    crate::filter::show(&checked(filter))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_read_as_people_say_them() {
        assert_eq!(
            [1.0, 0.5, 1.256, 9.99, 45.2].map(change),
            ["+0.0%", "-50.0%", "+25.6%", "+899.0%", "x 45"]
        );
        assert_eq!([change(f64::NAN), change(f64::INFINITY)], ["-", "x inf"]);
    }

    #[test]
    fn pixels_are_two_numbers() {
        assert_eq!(pixel("12, 80"), Ok([12, 80]));
        assert!(pixel("12").is_err() && pixel("-1,2").is_err() && pixel("1,2,3").is_err());
    }
}
