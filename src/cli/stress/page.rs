//! A certificate as tables.

use std::fmt::Write;

use crate::report::{Align, Format, Table, number};
use crate::stress::accuracy::Accuracy;
use crate::stress::behaviour::{Behaviour, Fault, Outcome};
use crate::stress::certificate::Certificate;
use crate::stress::guards::Guards;
use crate::stress::invariance::{Invariance, Tolerance};
use crate::stress::sensitivity::{Noise, Sensitivity};

/// Writes it.
pub(super) fn text(certificate: &Certificate) -> String {
    let Certificate { filter, stages, reach, seed, verdict, .. } = certificate;
    let stages = number::plural(*stages, "stage");
    let mut page = format!("{filter}, {stages}, reach {reach}, seed {seed}: {verdict}\n");
    for reason in &certificate.reasons {
        let _ = writeln!(page, "  {}: {}", reason.verdict, reason.text);
    }
    page.push_str(
        "\nGreatest relative difference from f64, and pixels that guards kept as they were (of \
         several the most)\n\n",
    );
    page.push_str(&accuracy(certificate));
    page.push_str("\nGreatest relative change of a pixel by noise in one feature\n\n");
    page.push_str(&sensitivity(certificate));
    page.push_str("\nGreatest relative change of a pixel by what should change nothing\n\n");
    page.push_str(&invariance(certificate));
    page.push_str(
        "\nBad features: greatest relative difference from f64; NaN, inf: pixels that spoil\n\n",
    );
    page.push_str(&behaviour(certificate));
    page
}

fn dash() -> String {
    "-".to_owned()
}

/// A figure that is zero more often than not.
fn figure(x: f64) -> String {
    if x == 0.0 { "0".to_owned() } else { number::difference(x) }
}

/// A row per scene.
fn accuracy(certificate: &Certificate) -> String {
    let mut columns = vec![("scene", Align::Left), ("reach", Align::Right)];
    columns.extend(certificate.engines.iter().map(|engine| (engine.name.as_str(), Align::Right)));
    let guards = ["vanish", "cancel", "overflow", "unpromised"];
    columns.extend(guards.map(|name| (name, Align::Right)));
    let mut table = Table::new(columns);
    for scene in &certificate.scenes {
        let accuracy = scene.accuracy.iter().map(|accuracy| match accuracy {
            Accuracy::Measured(peak) => figure(peak.value),
            Accuracy::Failed { .. } => dash(),
        });
        let counts: [fn(&Guards) -> usize; 3] = [|g| g.vanished, |g| g.cancelled, |g| g.overflowed];
        let shares = counts.map(|count| {
            let share = |g: &&Guards| count(g) as f64 / g.pixels.max(1) as f64;
            let most = scene.guards.iter().max_by(|a, b| share(a).total_cmp(&share(b)));
            most.map_or_else(dash, |most| number::percent(count(most), most.pixels))
        });
        let unpromised = number::percent(scene.unpromised, scene.pixels);
        let name = [scene.scene.clone(), scene.reach.to_string()];
        table.row(name.into_iter().chain(accuracy).chain(shares).chain([unpromised]));
    }
    table.render(Format::Plain)
}

/// Each text once, in the order of their first places.
fn distinct<'a>(texts: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut found: Vec<&str> = Vec::new();
    for text in texts {
        if !found.contains(&text) {
            found.push(text);
        }
    }
    found
}

/// A row per feature: the worst scene of each kind of noise.
fn sensitivity(certificate: &Certificate) -> String {
    let mut table = Table::new([
        ("feature", Align::Left),
        ("last bit", Align::Right),
        ("in", Align::Left),
        ("1e-3, 99.9%", Align::Right),
        ("100%", Align::Right),
        ("in", Align::Left),
    ]);
    for feature in distinct(certificate.sensitivity.iter().map(|s| s.feature)) {
        let worst = |noise| {
            let all = certificate.sensitivity.iter();
            all.filter(|s| s.feature == feature && s.noise == noise)
                .max_by(|a, b| a.figure().total_cmp(&b.figure()))
        };
        let scene = |s: Option<&Sensitivity>| s.map_or_else(dash, |s| s.scene.clone());
        let number = |x: Option<f64>| x.map_or_else(dash, figure);
        let (ulp, relative) = (worst(Noise::Ulp), worst(Noise::Relative));
        table.row([
            feature.to_owned(),
            number(ulp.map(Sensitivity::figure)),
            scene(ulp),
            number(relative.map(|s| s.most)),
            number(relative.map(|s| s.greatest.value)),
            scene(relative),
        ]);
    }
    table.render(Format::Plain)
}

/// A row per change: the worst scene.
fn invariance(certificate: &Certificate) -> String {
    let mut table = Table::new([
        ("change", Align::Left),
        ("greatest", Align::Right),
        ("in", Align::Left),
        ("allowed", Align::Left),
    ]);
    let all = || certificate.invariance.iter();
    for change in distinct(all().map(|i| i.change)) {
        let value = |i: &&Invariance| i.greatest.value;
        let of_change = all().filter(|i| i.change == change);
        let worst = of_change.max_by(|a, b| value(a).total_cmp(&value(b)));
        let worst = worst.expect("every change listed was made");
        let allowed = match worst.tolerance {
            Tolerance::Bits => "nothing".to_owned(),
            Tolerance::Rounding => "as by the last bit".to_owned(),
            Tolerance::Order => worst.tolerance.bound().map_or_else(dash, number::difference),
        };
        let greatest = figure(worst.greatest.value);
        table.row([change.to_owned(), greatest, worst.scene.clone(), allowed]);
    }
    table.render(Format::Plain)
}

/// A row per feature.
fn behaviour(certificate: &Certificate) -> String {
    let faults = Fault::ALL.map(|fault| match fault {
        Fault::Missing => "missing",
        Fault::Zero => "all 0",
        Fault::Constant => "constant",
        Fault::Nan => "NaN",
        Fault::Infinite => "inf",
    });
    let mut table = Table::new(
        std::iter::once(("feature", Align::Left)).chain(faults.map(|name| (name, Align::Right))),
    );
    let all = || certificate.behaviour.iter();
    for feature in distinct(all().map(|b| b.feature)) {
        let cells = Fault::ALL.map(|fault| {
            let found = all().find(|b| b.feature == feature && b.fault == fault);
            found.map_or_else(dash, cell)
        });
        table.row(std::iter::once(feature.to_owned()).chain(cells));
    }
    table.render(Format::Plain)
}

fn cell(behaviour: &Behaviour) -> String {
    match (behaviour.fault, behaviour.outcome) {
        (_, Outcome::Refused) => "refused".to_owned(),
        (Fault::Nan | Fault::Infinite, Outcome::Filtered { broken, escaped, .. }) => {
            (broken + escaped).to_string()
        }
        (Fault::Missing | Fault::Zero | Fault::Constant, Outcome::Filtered { difference, .. }) => {
            difference.map_or_else(dash, figure)
        }
    }
}
