//! How filters do on scenes: one table, as text or as JSON.

use std::time::Duration;

use serde::Serialize;

use super::number;
use super::table::{Align, Format, Table};
use crate::image::Metrics;

/// What a filter did to a scene.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    /// How far the result is from the reference.
    pub metrics: Metrics,
    /// Pixels that kept their noisy colour.
    pub kept: usize,
    /// Filtering, compilation not included.
    pub time: Duration,
}

/// The results of one scene.
#[derive(Clone, Debug)]
pub struct Score {
    /// The scene's name.
    pub scene: String,
    /// Number of pixels.
    pub pixels: usize,
    /// The errors of the image as it was rendered.
    pub noisy: Metrics,
    /// One per filter of the table; or why the filter cannot run on the scene.
    pub filters: Vec<Result<Measured, String>>,
}

/// How the last row sums the scenes up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Total {
    /// The sum: what the search minimises.
    Sum,
    /// The geometric mean: no scene outweighs another by being noisier.
    GeometricMean,
}

/// Scenes by filters.
#[derive(Clone, Debug)]
pub struct ScoreTable {
    /// The filters' names.
    pub filters: Vec<String>,
    /// A row each.
    pub scenes: Vec<Score>,
    /// The last row.
    pub total: Total,
}

impl Total {
    fn name(self) -> &'static str {
        match self {
            Self::Sum => "sum",
            Self::GeometricMean => "geometric mean",
        }
    }

    /// What values come to. A geometric mean holds none below a tiny one against the others.
    pub fn of(self, values: impl Iterator<Item = f64> + Clone) -> f64 {
        match self {
            Self::Sum => values.sum(),
            Self::GeometricMean => {
                let n = values.clone().count().max(1) as f64;
                (values.map(f64::ln).sum::<f64>() / n).exp()
            }
        }
    }
}

impl ScoreTable {
    /// The table: `RelMSE (trimmed RelMSE)` per scene and filter, then a line
    /// that sums the scenes up, and the time that each filter took per scene.
    pub fn render(&self, format: Format) -> String {
        let left =
            [("RelMSE (trimmed)".to_owned(), Align::Left), ("noisy".to_owned(), Align::Right)];
        let names = self.filters.iter().map(|name| (name.clone(), Align::Right));
        let mut table = Table::new(left.into_iter().chain(names));
        for score in &self.scenes {
            let cells = score.filters.iter().map(|filter| match filter {
                Ok(measured) => number::rel_mse(&measured.metrics),
                Err(_) => "-".to_owned(),
            });
            let left = [score.scene.clone(), number::rel_mse(&score.noisy)];
            table.row(left.into_iter().chain(cells));
        }
        let noisy: Vec<Metrics> = self.scenes.iter().map(|score| score.noisy).collect();
        if self.scenes.len() > 1 {
            let totals = (0..self.filters.len()).map(|k| match self.measured(k) {
                Some(all) => self.summed(&all.iter().map(|m| m.metrics).collect::<Vec<_>>()),
                None => "-".to_owned(),
            });
            let left = [self.total.name().to_owned(), self.summed(&noisy)];
            table.row(left.into_iter().chain(totals));
        }
        let times = (0..self.filters.len()).map(|k| match self.measured(k) {
            Some(all) if !all.is_empty() => {
                number::duration(all.iter().map(|m| m.time).sum::<Duration>() / all.len() as u32)
            }
            Some(_) | None => "-".to_owned(),
        });
        let left = ["time per scene".to_owned(), String::new()];
        table.row(left.into_iter().chain(times));
        table.render(format)
    }

    /// Why filters could not run, one line each.
    pub fn failures(&self) -> Vec<String> {
        let cells = self.scenes.iter().flat_map(|score| score.filters.iter().zip(&self.filters));
        cells
            .filter_map(|(result, filter)| Some(format!("{filter}: {}", result.as_ref().err()?)))
            .collect()
    }

    /// A filter's results, if it ran on every scene.
    fn measured(&self, filter: usize) -> Option<Vec<Measured>> {
        self.scenes.iter().map(|score| score.filters[filter].clone().ok()).collect()
    }

    fn summed(&self, all: &[Metrics]) -> String {
        let mean = self.total.of(all.iter().map(|m| m.rel_mse));
        let trimmed = self.total.of(all.iter().map(|m| m.trimmed_rel_mse));
        format!("{} ({})", number::error(mean), number::error(trimmed))
    }

    /// Everything, as JSON. What is not finite is `null`.
    pub fn to_json(&self) -> String {
        #[derive(Serialize)]
        struct SceneJson<'a> {
            scene: &'a str,
            pixels: usize,
            noisy: MetricsJson,
            filters: Vec<FilterJson<'a>>,
        }
        #[derive(Serialize)]
        struct FilterJson<'a> {
            filter: &'a str,
            #[serde(flatten)]
            metrics: Option<MetricsJson>,
            kept_noisy: Option<usize>,
            seconds: Option<f64>,
            failure: Option<&'a str>,
        }
        let scenes: Vec<SceneJson<'_>> = self
            .scenes
            .iter()
            .map(|score| SceneJson {
                scene: &score.scene,
                pixels: score.pixels,
                noisy: MetricsJson::of(&score.noisy),
                filters: score
                    .filters
                    .iter()
                    .zip(&self.filters)
                    .map(|(result, name)| {
                        let measured = result.as_ref().ok();
                        FilterJson {
                            filter: name,
                            metrics: measured.map(|m| MetricsJson::of(&m.metrics)),
                            kept_noisy: measured.map(|m| m.kept),
                            seconds: measured.map(|m| m.time.as_secs_f64()),
                            failure: result.as_ref().err().map(String::as_str),
                        }
                    })
                    .collect(),
            })
            .collect();
        json(&scenes)
    }
}

/// The errors of an image, as JSON spells them.
#[derive(Serialize)]
pub struct MetricsJson {
    rel_mse: f64,
    trimmed_rel_mse: f64,
    mse: f64,
    psnr_db: f64,
}

impl MetricsJson {
    /// Takes them over.
    pub fn of(metrics: &Metrics) -> Self {
        let Metrics { rel_mse, trimmed_rel_mse, mse, psnr } = *metrics;
        Self { rel_mse, trimmed_rel_mse, mse, psnr_db: psnr }
    }
}

/// Indented JSON that ends its last line.
pub fn json(value: &impl Serialize) -> String {
    serde_json::to_string_pretty(value).expect("reports have text for keys") + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    fn metrics(x: f64) -> Metrics {
        Metrics { rel_mse: x, trimmed_rel_mse: x / 2.0, mse: x, psnr: f64::INFINITY }
    }

    fn table(total: Total) -> ScoreTable {
        let measured = |x| Ok(Measured { metrics: metrics(x), kept: 0, time: Duration::ZERO });
        let score = |scene: &str, x, second| Score {
            scene: scene.to_owned(),
            pixels: 4,
            noisy: metrics(1.0),
            filters: vec![measured(x), second],
        };
        ScoreTable {
            filters: vec!["good".to_owned(), "choosy".to_owned()],
            scenes: vec![
                score("a", 0.1, measured(0.5)),
                score("b", 0.4, Err("b has no normals".to_owned())),
            ],
            total,
        }
    }

    #[test]
    fn rows_are_summed_up_where_every_scene_counts() {
        // Cells without the spaces that line them up.
        let line = |text: &str, name: &str| {
            let line = text.lines().find(|line| line.starts_with(name)).expect("a line");
            line.split_whitespace().collect::<Vec<_>>().join(" ")
        };
        let text = table(Total::GeometricMean).render(Format::Plain);
        let mean = line(&text, "geometric mean");
        assert_eq!(mean, "geometric mean 1.00 (0.500) 0.200 (0.100) -");
        assert!(text.lines().any(|line| line.starts_with('b') && line.ends_with('-')), "{text}");
        let text = table(Total::Sum).render(Format::Plain);
        assert_eq!(line(&text, "sum"), "sum 2.00 (1.00) 0.500 (0.250) -");
        assert_eq!(table(Total::Sum).failures(), ["choosy: b has no normals"]);
    }

    #[test]
    fn json_says_what_failed_and_holds_null_for_infinity() {
        let parsed: serde_json::Value =
            serde_json::from_str(&table(Total::Sum).to_json()).expect("JSON");
        assert_eq!(parsed[0]["filters"][0]["rel_mse"], 0.1);
        assert!(parsed[0]["noisy"]["psnr_db"].is_null());
        assert_eq!(parsed[1]["filters"][1]["failure"], "b has no normals");
    }
}
