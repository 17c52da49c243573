//! AdamW over named constants and the numbers of layers, each on a scale of its own.
//!
//! Constants whose bounds are positive are tuned by their logarithms: a bandwidth between 0.001
//! and 1 moves by shares of itself. Others move by absolute steps. After every step they are
//! put back within their bounds.

use crate::expr::Constants;

/// How fast the mean of gradients forgets, and that of their squares.
const BETAS: [f64; 2] = [0.9, 0.99];

/// Keeps quotients finite.
const EPSILON: f64 = 1e-8;

/// Gradients longer than this are shortened to it.
const LONGEST: f64 = 5.0;

/// How fast the average of the constants forgets, in the end.
const AVERAGED: f64 = 0.998;

/// Steps in which rates rise from nothing, if that is not more than a tenth of all.
const WARM_UP: u32 = 50;

/// How a constant is tuned.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Scale {
    /// Not at all.
    Fixed,
    /// By steps, within bounds.
    Linear([f64; 2]),
    /// By its logarithm, within bounds.
    Logarithmic([f64; 2]),
    /// As a number of a layer; W decays, b does not.
    Layer { decays: bool },
}

/// The scales of all constants of a filter.
#[derive(Clone, Debug)]
pub struct Scales(Vec<Scale>);

/// Where constants stand, on their scales, and how they have moved.
#[derive(Clone, Debug, PartialEq)]
pub struct Position {
    /// On their scales.
    pub at: Vec<f64>,
    /// The running mean of the gradients.
    pub first: Vec<f64>,
    /// That of their squares.
    pub second: Vec<f64>,
    /// That of the positions.
    pub average: Vec<f64>,
}

/// How a step moves.
#[derive(Clone, Copy, Debug)]
pub struct Rates {
    /// Single constants.
    pub constants: f64,
    /// The numbers of layers.
    pub layers: f64,
    /// The share of W that is lost, times the rate.
    pub decay: f64,
}

impl Rates {
    /// Those of a step: they rise at first, and then fall to nothing as a cosine does.
    #[must_use]
    pub fn at(self, step: u32, steps: u32) -> Self {
        let rising = f64::from(step + 1) / f64::from(WARM_UP.min(steps / 10).max(1));
        let falling =
            0.5 * (1.0 + (std::f64::consts::PI * f64::from(step) / f64::from(steps)).cos());
        let share = rising.min(1.0) * falling;
        Self { constants: self.constants * share, layers: self.layers * share, ..self }
    }
}

impl Scales {
    /// Those of a filter's constants.
    pub fn of(constants: &Constants) -> Self {
        let params = constants.params.iter().map(|param| {
            let bounds = param.bounds.map(f64::from);
            match param.tuned {
                false => Scale::Fixed,
                true if bounds[0] > 0.0 => Scale::Logarithmic(bounds),
                true => Scale::Linear(bounds),
            }
        });
        let layers = constants.layers.iter().flat_map(|layer| {
            let weights = (0..layer.rows() * layer.columns()).map(|_| true);
            weights.chain((0..layer.rows()).map(|_| false))
        });
        Self(params.chain(layers.map(|decays| Scale::Layer { decays })).collect())
    }

    /// Whether any constant may be tuned.
    pub fn any(&self) -> bool {
        self.0.iter().any(|scale| *scale != Scale::Fixed)
    }

    /// Where a filter's constants stand, at rest.
    pub fn position(&self, values: &[f32]) -> Position {
        let place = |(scale, &value): (&Scale, &f32)| match scale {
            Scale::Logarithmic(_) => f64::from(value).ln(),
            Scale::Fixed | Scale::Linear(_) | Scale::Layer { .. } => f64::from(value),
        };
        let at: Vec<f64> = self.0.iter().zip(values).map(place).collect();
        let nothing = vec![0.0; at.len()];
        Position { average: at.clone(), first: nothing.clone(), second: nothing, at }
    }

    /// The constants at some places.
    pub fn values(&self, places: &[f64]) -> Vec<f32> {
        let value = |(scale, &place): (&Scale, &f64)| match *scale {
            Scale::Fixed | Scale::Layer { .. } => place as f32,
            Scale::Linear([low, high]) => place.clamp(low, high) as f32,
            Scale::Logarithmic([low, high]) => place.exp().clamp(low, high) as f32,
        };
        self.0.iter().zip(places).map(value).collect()
    }

    /// Moves against the gradient by the constants; the first step is number 0. Returns how
    /// long the gradient was.
    pub fn step(
        &self,
        position: &mut Position,
        gradient: &[f64],
        number: u32,
        rates: Rates,
    ) -> f64 {
        let slope = |k: usize| {
            let by_value = if gradient[k].is_finite() { gradient[k] } else { 0.0 };
            match self.0[k] {
                Scale::Fixed => 0.0,
                Scale::Linear(_) | Scale::Layer { .. } => by_value,
                Scale::Logarithmic(_) => by_value * position.at[k].exp(),
            }
        };
        let slopes: Vec<f64> = (0..self.0.len()).map(slope).collect();
        let length = slopes.iter().map(|x| x * x).sum::<f64>().sqrt();
        let share = if length > LONGEST { LONGEST / length } else { 1.0 };
        let count = f64::from(number + 1);
        let unbiased = BETAS.map(|beta| 1.0 - beta.powf(count));
        let kept = AVERAGED.min(count / (count + 9.0));
        for (k, slope) in slopes.into_iter().enumerate() {
            let slope = slope * share;
            let Position { at, first, second, average } = position;
            first[k] += (1.0 - BETAS[0]) * (slope - first[k]);
            second[k] += (1.0 - BETAS[1]) * (slope * slope - second[k]);
            let direction = (first[k] / unbiased[0]) / ((second[k] / unbiased[1]).sqrt() + EPSILON);
            match self.0[k] {
                Scale::Fixed => {}
                Scale::Linear([low, high]) => {
                    at[k] = (at[k] - rates.constants * direction).clamp(low, high);
                }
                Scale::Logarithmic([low, high]) => {
                    at[k] = (at[k] - rates.constants * direction).clamp(low.ln(), high.ln());
                }
                Scale::Layer { decays } => {
                    let lost = if decays { rates.decay * at[k] } else { 0.0 };
                    at[k] -= rates.layers * (direction + lost);
                }
            }
            average[k] += (1.0 - kept) * (at[k] - average[k]);
        }
        length
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expr::constants::{Layer, Param};

    fn param(value: f32, bounds: [f32; 2], tuned: bool) -> Param {
        Param { name: "k".to_owned(), value, bounds, tuned }
    }

    #[test]
    fn a_bowl_is_gone_down_and_bounds_hold() {
        let constants = Constants {
            params: vec![
                param(3.0, [-10.0, 10.0], true),
                param(0.001, [1e-4, 1.0], true),
                param(5.0, [2.0, 9.0], true),
                param(7.0, [-9.0, 9.0], false),
            ],
            layers: vec![Layer {
                name: "l".to_owned(),
                weights: vec![vec![1.0]],
                bias: vec![-1.0],
            }],
        };
        let scales = Scales::of(&constants);
        // The third would go below its bounds.
        let wanted = [-1.0, 0.1, 1.0, 0.0, 0.25, 0.5];
        let mut position = scales.position(&constants.values());
        let rates = Rates { constants: 0.05, layers: 0.05, decay: 0.0 };
        for number in 0..2000 {
            let values = scales.values(&position.at);
            let gradient: Vec<f64> =
                values.iter().zip(wanted).map(|(&x, to)| 2.0 * (f64::from(x) - to)).collect();
            scales.step(&mut position, &gradient, number, rates.at(number, 2000));
        }
        let end = scales.values(&position.average);
        for (k, to) in [(0, -1.0), (1, 0.1), (2, 2.0), (3, 7.0), (4, 0.25), (5, 0.5)] {
            assert!((end[k] - to).abs() < 0.02 * (1.0 + to.abs()), "{k}: {} for {to}", end[k]);
        }
    }

    #[test]
    fn a_gradient_that_is_no_number_moves_nothing() {
        let constants = Constants { params: vec![param(3.0, [-9.0, 9.0], true)], layers: vec![] };
        let scales = Scales::of(&constants);
        let mut position = scales.position(&[3.0]);
        let rates = Rates { constants: 0.1, layers: 0.1, decay: 0.0 };
        scales.step(&mut position, &[f64::NAN], 0, rates);
        assert_eq!(scales.values(&position.at), [3.0]);
    }
}
