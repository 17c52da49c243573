//! How numbers are written.

use std::time::Duration;

use crate::image::Metrics;

/// An error figure (RelMSE, MSE): three significant digits, and never so few
/// that two filters that differ by a percent look alike.
pub fn error(x: f64) -> String {
    if !x.is_finite() {
        return if x.is_nan() { "nan".to_owned() } else { "inf".to_owned() };
    }
    let digits = if x == 0.0 { 0 } else { x.abs().log10().floor() as i32 };
    match digits {
        ..-5 | 6.. => format!("{x:.2e}"),
        _ => format!("{x:.*}", (2 - digits).clamp(0, 7) as usize),
    }
}

/// The RelMSE, and in parentheses that without the worst pixels.
pub fn rel_mse(metrics: &Metrics) -> String {
    format!("{} ({})", error(metrics.rel_mse), error(metrics.trimmed_rel_mse))
}

/// Decibels.
pub fn decibels(x: f64) -> String {
    if x.is_finite() { format!("{x:.2} dB") } else { "inf dB".to_owned() }
}

/// A structural similarity: 1 for equal pictures.
pub fn similarity(x: f64) -> String {
    format!("{x:.4}")
}

/// A sample of an image or a feature.
pub fn sample(x: f32) -> String {
    match x.abs() {
        0.0 => "0".to_owned(),
        1e-3..1e5 => {
            let text = format!("{x:.4}");
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        }
        _ => format!("{x:.3e}"),
    }
}

/// A stretch of time that a computation took.
pub fn duration(time: Duration) -> String {
    let seconds = time.as_secs_f64();
    match seconds {
        ..0.001 => format!("{:.0} µs", seconds * 1e6),
        ..1.0 => format!("{:.1} ms", seconds * 1e3),
        ..100.0 => format!("{seconds:.2} s"),
        _ => clock(time),
    }
}

/// A stretch of time that somebody waits: `1:02:03`, or `2:03`.
pub fn clock(time: Duration) -> String {
    let seconds = time.as_secs();
    let (h, m, s) = (seconds / 3600, seconds / 60 % 60, seconds % 60);
    if h > 0 { format!("{h}:{m:02}:{s:02}") } else { format!("{m}:{s:02}") }
}

/// Milliseconds, in a column of which the unit is said: three digits.
pub fn milliseconds(ms: f64) -> String {
    match ms.abs() {
        ..0.9995 => format!("{ms:.3}"),
        ..9.995 => format!("{ms:.2}"),
        ..99.95 => format!("{ms:.1}"),
        _ => format!("{ms:.0}"),
    }
}

/// A relative difference of results that should be equal but for rounding.
pub fn difference(x: f64) -> String {
    format!("{x:.1e}")
}

/// A round value beside an axis.
pub fn tick(x: f64) -> String {
    match x {
        1e3..1e6 => count(x as usize),
        1e-4..1e3 => format!("{x:.6}").trim_end_matches('0').trim_end_matches('.').to_owned(),
        _ => format!("{x:e}"),
    }
}

/// A count, its digits in groups of three.
pub fn count(n: usize) -> String {
    let digits = n.to_string();
    let mut text = String::with_capacity(digits.len() * 4 / 3 + 1);
    for (k, digit) in digits.chars().enumerate() {
        if k > 0 && (digits.len() - k).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A share of a whole, in percent.
pub fn percent(part: usize, whole: usize) -> String {
    format!("{:.1}%", 100.0 * part as f64 / whole.max(1) as f64)
}

/// `1 pixel`, `2 pixels`.
pub fn plural(n: usize, noun: &str) -> String {
    format!("{} {noun}{}", count(n), if n == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_keep_three_digits() {
        let texts = [0.0, 0.03117, 0.794_49, 1.2345, 784.2, 1e-9, 2.5e9].map(error);
        assert_eq!(texts, ["0.00", "0.0312", "0.794", "1.23", "784", "1.00e-9", "2.50e9"]);
        assert_eq!(error(f64::INFINITY), "inf");
    }

    #[test]
    fn samples_times_and_counts_are_short() {
        assert_eq!(
            [0.0, 1.0, -0.25, 1e9, 1e-7].map(sample),
            ["0", "1", "-0.25", "1.000e9", "1.000e-7"]
        );
        assert_eq!(duration(Duration::from_millis(1500)), "1.50 s");
        assert_eq!(duration(Duration::from_micros(90)), "90 µs");
        assert_eq!(clock(Duration::from_secs(3723)), "1:02:03");
        assert_eq!(
            [0.0123, 1.0, 9.999, 99.96, 1234.5].map(milliseconds),
            ["0.012", "1.00", "10.0", "100", "1234"]
        );
        assert_eq!(difference(4.66e-7), "4.7e-7");
        assert_eq!(similarity(0.987_65), "0.9877");
        assert_eq!([1e-5, 0.02, 1.0, 300.0, 2e4].map(tick), ["1e-5", "0.02", "1", "300", "20,000"]);
        assert_eq!([7, 1000, 1_234_567].map(count), ["7", "1,000", "1,234,567"]);
        assert_eq!(plural(1, "pixel") + &plural(2, " row"), "1 pixel2  rows");
    }
}
