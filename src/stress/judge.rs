//! Whether what was measured is too much: the figures against the limits of [`verdict`](super::verdict).

use super::accuracy::Accuracy;
use super::behaviour::{Fault, Outcome};
use super::certificate::Certificate;
use super::invariance::{Invariance, Tolerance};
use super::sensitivity::{Noise, Sensitivity};
use super::verdict::{DOUBTFUL, INACCURACY, NOISE, Reason, ULP, Verdict};
use super::{Kind, Peak};
use crate::backend::ACCURACY;

/// Gives a certificate's figures a verdict.
pub(super) fn judge(certificate: &mut Certificate) {
    certificate.reasons = reasons(certificate);
    let gravest = certificate.reasons.iter().map(|reason| reason.verdict).max();
    certificate.verdict = gravest.unwrap_or(Verdict::Stable);
}

/// A figure with what is to be said of it.
type Charge = (Verdict, f64, String);

/// All that is wrong, the gravest first: of each kind, and engine, feature or change,
/// the worst scene's.
fn reasons(certificate: &Certificate) -> Vec<Reason> {
    let charges = [
        accuracy(certificate),
        guards(certificate),
        sensitivity(certificate),
        invariance(certificate),
        behaviour(certificate),
    ];
    let guilty = charges.into_iter().flatten().filter(|charge| charge.0 > Verdict::Stable);
    let mut reasons: Vec<Reason> =
        guilty.map(|(verdict, _, text)| Reason { verdict, text }).collect();
    reasons.sort_by_key(|reason| std::cmp::Reverse(reason.verdict));
    reasons
}

/// The gravest of some charges, the first of those with the greatest figure.
fn worst(charges: impl Iterator<Item = Charge>) -> Option<Charge> {
    charges.reduce(|worst, next| if (next.0, next.1) > (worst.0, worst.1) { next } else { worst })
}

fn place(scene: &str, peak: Peak) -> String {
    format!("in `{scene}` at x = {}, y = {}", peak.x, peak.y)
}

/// The verdict on a difference in units of what is promised.
fn inaccuracy(share: f64, kind: Kind) -> Verdict {
    match (INACCURACY.verdict(share), kind) {
        (Verdict::Sensitive, Kind::Made | Kind::Extreme) => Verdict::Stable,
        (verdict, _) => verdict,
    }
}

fn accuracy(certificate: &Certificate) -> Vec<Charge> {
    let charge = |k: usize| {
        let engine = &certificate.engines[k];
        worst(certificate.scenes.iter().filter_map(|scene| {
            let bound = engine.bound?;
            match &scene.accuracy[k] {
                Accuracy::Measured(peak) => Some((
                    inaccuracy(peak.value / bound, scene.kind),
                    peak.value,
                    format!(
                        "{}: {:.1e} from exact {}, of {bound:.0e} that are promised",
                        engine.name,
                        peak.value,
                        place(&scene.scene, *peak)
                    ),
                )),
                Accuracy::Failed { failure } => Some((
                    Verdict::Unstable,
                    f64::INFINITY,
                    format!("{}: cannot run: {failure}", engine.name),
                )),
            }
        }))
    };
    (0..certificate.engines.len()).filter_map(charge).collect()
}

fn guards(certificate: &Certificate) -> Vec<Charge> {
    let ordinary = certificate.scenes.iter().filter(|scene| scene.kind != Kind::Extreme);
    let gathers = ordinary.flat_map(|scene| scene.guards.iter().map(move |guards| (scene, guards)));
    let charge = worst(gathers.map(|(scene, guards)| {
        let share = guards.doubtful as f64 / guards.pixels.max(1) as f64;
        let verdict = if share > DOUBTFUL { Verdict::Sensitive } else { Verdict::Stable };
        let stage = match scene.guards.len() {
            1 => String::new(),
            _ => format!("stage `{}`: ", guards.stage),
        };
        let text = format!(
            "{stage}weights cancel in {:.1}% of the pixels of `{}`: nothing is promised of them",
            100.0 * share,
            scene.scene
        );
        (verdict, share, text)
    }));
    charge.into_iter().collect()
}

fn sensitivity(certificate: &Certificate) -> Vec<Charge> {
    let mut charges = Vec::new();
    for noise in Noise::ALL {
        let of_noise = || certificate.sensitivity.iter().filter(move |s| s.noise == noise);
        let mut features: Vec<&str> = of_noise().map(|s| s.feature).collect();
        features.sort_unstable();
        features.dedup();
        for feature in features {
            let of_feature = of_noise().filter(|s| s.feature == feature);
            charges.extend(worst(of_feature.map(Sensitivity::charge)));
        }
    }
    charges
}

impl Sensitivity {
    /// The figure that counts.
    pub fn figure(&self) -> f64 {
        match self.noise {
            Noise::Ulp => self.greatest.value,
            Noise::Relative => self.most,
        }
    }

    fn charge(&self) -> Charge {
        let Self { scene, feature, greatest, .. } = self;
        let figure = self.figure();
        match self.noise {
            Noise::Ulp => (
                ULP.verdict(figure),
                figure,
                format!(
                    "the last bit of {feature} changes the result by {figure:.1e} of itself {}",
                    place(scene, *greatest)
                ),
            ),
            Noise::Relative => (
                NOISE.verdict(figure),
                figure,
                format!(
                    "noise of 1e-3 in {feature} changes more than one pixel in a thousand by \
                     {figure:.1e} of itself or more, {:.1e} {}",
                    greatest.value,
                    place(scene, *greatest)
                ),
            ),
        }
    }
}

fn invariance(certificate: &Certificate) -> Vec<Charge> {
    let mut changes: Vec<&str> = Vec::new();
    for invariance in &certificate.invariance {
        if !changes.contains(&invariance.change) {
            changes.push(invariance.change);
        }
    }
    let of = |change| certificate.invariance.iter().filter(move |i| i.change == change);
    changes.into_iter().filter_map(|change| worst(of(change).map(Invariance::charge))).collect()
}

impl Invariance {
    fn charge(&self) -> Charge {
        let figure = self.greatest.value;
        let verdict = match self.tolerance.bound() {
            Some(bound) if figure > bound => Verdict::Unstable,
            Some(_) => Verdict::Stable,
            None => ULP.verdict(figure),
        };
        let what = match self.tolerance {
            Tolerance::Bits => "not a bit should change",
            Tolerance::Rounding => "nothing but roundings should change",
            Tolerance::Order => "only the order of sums should change",
        };
        let place = place(&self.scene, self.greatest);
        let text = format!("{}: {what}, but the result does by {figure:.1e} {place}", self.change);
        (verdict, figure, text)
    }
}

fn behaviour(certificate: &Certificate) -> Vec<Charge> {
    let charge = |behaviour: &super::behaviour::Behaviour| {
        let Outcome::Filtered { difference, broken, escaped } = behaviour.outcome else {
            return None;
        };
        let what = match behaviour.fault {
            Fault::Missing => "without",
            Fault::Zero => "with zeros for",
            Fault::Constant => "with one value for",
            Fault::Nan => "with a NaN in",
            Fault::Infinite => "with an infinity in",
        };
        let begin = format!("{what} {}: ", behaviour.feature);
        Some(if broken > 0 {
            (Verdict::Unstable, broken as f64, format!("{begin}{broken} pixel(s) are no numbers"))
        } else if escaped > 0 {
            let text = format!("{begin}{escaped} pixel(s) change that are out of its reach");
            (Verdict::Unstable, escaped as f64, text)
        } else {
            let difference = difference?;
            let text = format!("{begin}{difference:.1e} from exact, of 1e-5 that are promised");
            (inaccuracy(difference / ACCURACY, Kind::Made), difference, text)
        })
    };
    certificate.behaviour.iter().filter_map(charge).collect()
}
