//! Run time against error: ways to filter, measured beside each other on the
//! same scenes, as a table, as JSON and as a chart.
//!
//! Times are per megapixel and come from one run; the scenes' pixels and times
//! are added up before they are divided, so that a small scene does not count as
//! much as a large one. Errors are geometric means over the scenes, so that no
//! scene outweighs another by being noisier.

use std::time::Duration;

use serde::Serialize;

use super::chart::{Chart, Point, Series};
use super::number;
use super::score::{MetricsJson, Total, json};
use super::table::{Align, Format, Table};
use crate::image::Metrics;

/// A scene that was filtered.
#[derive(Clone, Debug)]
pub struct Ground {
    /// Its name.
    pub scene: String,
    /// Number of pixels.
    pub pixels: usize,
    /// The errors of the image as it was rendered.
    pub noisy: Metrics,
}

/// What one way to filter did to one scene.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// The filtering alone, the median of all rounds.
    pub time: Duration,
    /// Where that happens in a program of its own: all of that program's time, its
    /// start and its files included.
    pub process: Option<Duration>,
    /// What had to be done once before the first pixel.
    pub compile: Option<Duration>,
    /// How far the result is from the reference.
    pub metrics: Metrics,
    /// How far it is from what the filter means in exact arithmetic: the greatest
    /// relative difference. `None` for what has no such meaning.
    pub difference: Option<f64>,
}

/// A way to filter: a row of the table.
#[derive(Clone, Debug)]
pub struct Entry {
    /// What is computed.
    pub filter: String,
    /// What computes it: a back end, a compiler, another program.
    pub engine: String,
    /// The window's, if there is a window.
    pub radius: Option<u32>,
    /// One per scene; or why there are none.
    pub outcomes: Result<Vec<Outcome>, String>,
}

/// Everything that one run measured.
#[derive(Clone, Debug)]
pub struct Tradeoff {
    /// The scenes, in the order of the outcomes.
    pub grounds: Vec<Ground>,
    /// The rows.
    pub entries: Vec<Entry>,
    /// Threads that everybody had.
    pub threads: usize,
    /// Measurements of each, of which the median counts.
    pub rounds: usize,
}

/// An entry's outcomes summed up.
#[derive(Clone, Copy, Debug, Serialize)]
struct Summary {
    ms_per_megapixel: f64,
    process_ms_per_megapixel: Option<f64>,
    compile_ms: Option<f64>,
    rel_mse: f64,
    trimmed_rel_mse: f64,
    difference_from_f64: Option<f64>,
}

impl Tradeoff {
    /// The table, under a line that says what it was measured on.
    pub fn render(&self, format: Format) -> String {
        let processes = self.summaries().any(|s| s.process_ms_per_megapixel.is_some());
        let mut columns = vec![
            ("filter", Align::Left),
            ("run by", Align::Left),
            ("radius", Align::Right),
            ("ms/Mpixel", Align::Right),
        ];
        if processes {
            columns.push(("whole process", Align::Right));
        }
        columns.extend([
            ("compile, ms", Align::Right),
            ("RelMSE (trimmed)", Align::Right),
            ("from f64", Align::Right),
        ]);
        let mut table = Table::new(columns);
        let dash = || "-".to_owned();
        for entry in &self.entries {
            let summary = self.summary(entry);
            let cell = |figure: fn(&Summary) -> Option<f64>, text: fn(f64) -> String| {
                summary.as_ref().and_then(figure).map_or_else(dash, text)
            };
            let mut cells = vec![
                entry.filter.clone(),
                entry.engine.clone(),
                entry.radius.map_or_else(dash, |radius| radius.to_string()),
                cell(|s| Some(s.ms_per_megapixel), number::milliseconds),
            ];
            if processes {
                cells.push(cell(|s| s.process_ms_per_megapixel, number::milliseconds));
            }
            cells.push(cell(|s| s.compile_ms, number::milliseconds));
            cells.push(summary.map_or_else(dash, |s| {
                format!("{} ({})", number::error(s.rel_mse), number::error(s.trimmed_rel_mse))
            }));
            cells.push(cell(|s| s.difference_from_f64, number::difference));
            table.row(cells);
        }
        format!("{}\n\n{}", self.caption(), table.render(format))
    }

    /// What was measured on what.
    pub fn caption(&self) -> String {
        let scenes: Vec<&str> = self.grounds.iter().map(|g| g.scene.as_str()).collect();
        let noisy = |figure: fn(&Metrics) -> f64| {
            number::error(Total::GeometricMean.of(self.grounds.iter().map(|g| figure(&g.noisy))))
        };
        format!(
            "{} ({:.2} megapixels; noisy: {} ({})), {}, medians of {}",
            scenes.join(", "),
            self.megapixels(),
            noisy(|m| m.rel_mse),
            noisy(|m| m.trimmed_rel_mse),
            number::plural(self.threads, "thread"),
            number::plural(self.rounds, "interleaved round"),
        )
    }

    /// Why entries have no figures, one line each.
    pub fn failures(&self) -> Vec<String> {
        let failed = self.entries.iter().filter_map(|entry| {
            let reason = entry.outcomes.as_ref().err()?;
            Some(format!("{}: {reason}", entry.title()))
        });
        failed.collect()
    }

    /// The chart: time and error of every entry that has them, entries of one
    /// filter and engine joined over their radii, and the front.
    pub fn chart(&self) -> String {
        let mut series: Vec<Series> = Vec::new();
        for entry in &self.entries {
            let Some(summary) = self.summary(entry) else { continue };
            let point = Point {
                x: summary.ms_per_megapixel,
                y: summary.rel_mse,
                label: entry.radius.map_or_else(String::new, |radius| radius.to_string()),
                title: format!(
                    "{}: {} ms per megapixel, RelMSE {}",
                    entry.title(),
                    number::milliseconds(summary.ms_per_megapixel),
                    number::error(summary.rel_mse)
                ),
            };
            let same = |s: &&mut Series| (&s.color, &s.shape) == (&entry.filter, &entry.engine);
            match series.iter_mut().find(same) {
                Some(series) => series.points.push(point),
                None => series.push(Series {
                    color: entry.filter.clone(),
                    shape: entry.engine.clone(),
                    points: vec![point],
                }),
            }
        }
        let chart = Chart {
            title: "Time against error".to_owned(),
            subtitle: self.caption(),
            x: "milliseconds per megapixel".to_owned(),
            y: "RelMSE, geometric mean over the scenes".to_owned(),
            colors: "filter".to_owned(),
            shapes: "run by".to_owned(),
            labels: "Numbers at marks: the radius.".to_owned(),
            front: "no faster one errs less".to_owned(),
            series,
        };
        chart.svg()
    }

    /// Everything, as JSON. What is not finite is `null`.
    pub fn to_json(&self) -> String {
        #[derive(Serialize)]
        struct Report<'a> {
            threads: usize,
            rounds: usize,
            scenes: Vec<SceneJson<'a>>,
            entries: Vec<EntryJson<'a>>,
        }
        #[derive(Serialize)]
        struct SceneJson<'a> {
            scene: &'a str,
            pixels: usize,
            noisy: MetricsJson,
        }
        #[derive(Serialize)]
        struct EntryJson<'a> {
            filter: &'a str,
            run_by: &'a str,
            radius: Option<u32>,
            on_the_front: bool,
            #[serde(flatten)]
            summary: Option<Summary>,
            scenes: Vec<OutcomeJson<'a>>,
            failure: Option<&'a str>,
        }
        #[derive(Serialize)]
        struct OutcomeJson<'a> {
            scene: &'a str,
            seconds: f64,
            process_seconds: Option<f64>,
            compile_seconds: Option<f64>,
            #[serde(flatten)]
            metrics: MetricsJson,
            difference_from_f64: Option<f64>,
        }
        let seconds = |time: Option<Duration>| time.map(|time| time.as_secs_f64());
        let entries = self.entries.iter().map(|entry| EntryJson {
            filter: &entry.filter,
            run_by: &entry.engine,
            radius: entry.radius,
            on_the_front: self.is_on_the_front(entry),
            summary: self.summary(entry),
            scenes: entry
                .outcomes
                .iter()
                .flatten()
                .zip(&self.grounds)
                .map(|(outcome, ground)| OutcomeJson {
                    scene: &ground.scene,
                    seconds: outcome.time.as_secs_f64(),
                    process_seconds: seconds(outcome.process),
                    compile_seconds: seconds(outcome.compile),
                    metrics: MetricsJson::of(&outcome.metrics),
                    difference_from_f64: outcome.difference,
                })
                .collect(),
            failure: entry.outcomes.as_ref().err().map(String::as_str),
        });
        let scenes = self.grounds.iter().map(|ground| SceneJson {
            scene: &ground.scene,
            pixels: ground.pixels,
            noisy: MetricsJson::of(&ground.noisy),
        });
        json(&Report {
            threads: self.threads,
            rounds: self.rounds,
            scenes: scenes.collect(),
            entries: entries.collect(),
        })
    }

    fn megapixels(&self) -> f64 {
        self.grounds.iter().map(|ground| ground.pixels).sum::<usize>() as f64 / 1e6
    }

    /// An entry's figures, if it ran on every scene.
    fn summary(&self, entry: &Entry) -> Option<Summary> {
        let outcomes = entry.outcomes.as_ref().ok().filter(|all| !all.is_empty())?;
        let summed = |times: &[Duration]| times.iter().sum::<Duration>().as_secs_f64() * 1e3;
        let times: Vec<Duration> = outcomes.iter().map(|o| o.time).collect();
        let processes: Option<Vec<Duration>> = outcomes.iter().map(|o| o.process).collect();
        let compiles: Option<Vec<Duration>> = outcomes.iter().map(|o| o.compile).collect();
        let differences: Option<Vec<f64>> = outcomes.iter().map(|o| o.difference).collect();
        let mean = |figure: fn(&Metrics) -> f64| {
            Total::GeometricMean.of(outcomes.iter().map(|outcome| figure(&outcome.metrics)))
        };
        Some(Summary {
            ms_per_megapixel: summed(&times) / self.megapixels(),
            process_ms_per_megapixel: processes.map(|all| summed(&all) / self.megapixels()),
            compile_ms: compiles.map(|all| summed(&all) / all.len() as f64),
            rel_mse: mean(|m| m.rel_mse),
            trimmed_rel_mse: mean(|m| m.trimmed_rel_mse),
            difference_from_f64: differences.map(|all| all.into_iter().fold(0.0, f64::max)),
        })
    }

    fn summaries(&self) -> impl Iterator<Item = Summary> {
        self.entries.iter().filter_map(|entry| self.summary(entry))
    }

    fn is_on_the_front(&self, entry: &Entry) -> bool {
        self.summary(entry).is_some_and(|own| {
            !self.summaries().any(|other| {
                let (time, error) = (other.ms_per_megapixel, other.rel_mse);
                let no_worse = time <= own.ms_per_megapixel && error <= own.rel_mse;
                no_worse && (time < own.ms_per_megapixel || error < own.rel_mse)
            })
        })
    }
}

impl Entry {
    /// What it is called in sentences.
    fn title(&self) -> String {
        let radius = self.radius.map_or_else(String::new, |radius| format!(", radius {radius}"));
        format!("{}, {}{radius}", self.filter, self.engine)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn metrics(x: f64) -> Metrics {
        Metrics { rel_mse: x, trimmed_rel_mse: x / 2.0, mse: x, psnr: 30.0 }
    }

    fn entry(filter: &str, engine: &str, outcomes: Result<[(u64, f64); 2], &str>) -> Entry {
        let outcome = |(ms, error)| Outcome {
            time: Duration::from_millis(ms),
            process: None,
            compile: Some(Duration::from_millis(3)),
            metrics: metrics(error),
            difference: Some(error * 1e-6),
        };
        Entry {
            filter: filter.to_owned(),
            engine: engine.to_owned(),
            radius: Some(5),
            outcomes: outcomes.map(|all| all.map(outcome).to_vec()).map_err(str::to_owned),
        }
    }

    fn tradeoff() -> Tradeoff {
        let ground =
            |scene: &str, pixels| Ground { scene: scene.to_owned(), pixels, noisy: metrics(1.0) };
        Tradeoff {
            grounds: vec![ground("small", 500_000), ground("large", 1_500_000)],
            entries: vec![
                entry("good", "jit", Ok([(10, 0.1), (30, 0.4)])),
                entry("good", "interp", Ok([(20, 0.1), (60, 0.4)])),
                entry("poor", "jit", Ok([(1, 0.5), (3, 0.5)])),
                entry("choosy", "jit", Err("there are no normals")),
            ],
            threads: 2,
            rounds: 3,
        }
    }

    #[test]
    fn times_are_per_pixel_and_errors_are_geometric_means() {
        let text = tradeoff().render(Format::Plain);
        let row = |start: &str| {
            let row = text.lines().find(|line| line.starts_with(start)).expect("a row");
            row.split_whitespace().collect::<Vec<_>>().join(" ")
        };
        assert_eq!(row("good    interp"), "good interp 5 40.0 3.00 0.200 (0.100) 4.0e-7");
        assert_eq!(row("choosy"), "choosy jit 5 - - - -");
        assert_eq!(tradeoff().failures(), ["choosy, jit, radius 5: there are no normals"]);
    }

    #[test]
    fn the_front_is_what_nothing_beats() {
        let parsed: serde_json::Value = serde_json::from_str(&tradeoff().to_json()).expect("JSON");
        let front = |k: usize| parsed["entries"][k]["on_the_front"].as_bool().expect("a flag");
        assert_eq!([0, 1, 2, 3].map(front), [true, false, true, false]);
        assert_eq!(parsed["entries"][3]["failure"], "there are no normals");
        assert!(parsed["entries"][3]["rel_mse"].is_null());
    }
}
