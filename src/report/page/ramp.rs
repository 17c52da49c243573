//! Colours of error maps, and what they stand for.

/// Every sixteenth colour of matplotlib's `magma` (Smith, van der Walt; CC0), which FLIP's authors
/// show it with: black for none, nearly white for the most.
const MAGMA: [u32; 17] = [
    0x00_0004, 0x0a_0822, 0x1d_1147, 0x36_106b, 0x51_127c, 0x6a_1c81, 0x83_2681, 0x9c_2e7f,
    0xb7_3779, 0xd0_416f, 0xe7_5263, 0xf5_6b5c, 0xfc_8961, 0xfe_a772, 0xfe_c488, 0xfd_e2a3,
    0xfc_fdbf,
];

/// The greatest level: 0 is for what is not known.
const LEVELS: f64 = 254.0;

/// The powers of ten between which relative squared errors are told apart.
const POWERS: [i32; 2] = [-4, 1];

/// The colours of all levels; what is not known is grey.
pub(super) fn colors() -> Vec<[u8; 3]> {
    let channels = |color: u32| [16, 8, 0].map(|shift| f64::from(color >> shift & 255));
    let color = |level: usize| {
        let at = level as f64 / LEVELS * (MAGMA.len() - 1) as f64;
        let below = (at as usize).min(MAGMA.len() - 2);
        let (low, high) = (channels(MAGMA[below]), channels(MAGMA[below + 1]));
        let mixed = |c: usize| low[c] + (high[c] - low[c]) * (at - below as f64);
        [0, 1, 2].map(|c| mixed(c).round() as u8)
    };
    std::iter::once([128; 3]).chain((0..=LEVELS as usize).map(color)).collect()
}

/// The stops of a gradient in CSS.
pub(super) fn gradient() -> String {
    MAGMA.map(|color| format!("#{color:06x}")).join(", ")
}

/// The level of a FLIP.
pub(super) fn flip(x: f64) -> u8 {
    level(x)
}

/// The level of a relative squared error, which is logarithmic.
pub(super) fn relative(x: f64) -> u8 {
    let [low, high] = POWERS.map(f64::from);
    level((x.log10() - low) / (high - low))
}

fn level(share: f64) -> u8 {
    if share.is_nan() { 0 } else { 1 + (share.clamp(0.0, 1.0) * LEVELS).round() as u8 }
}

/// What stands under a legend: places in percent, and texts.
pub(super) type Ticks = Vec<(usize, String)>;

/// Those of FLIP.
pub(super) fn flip_ticks() -> Ticks {
    (0..=4).map(|k| (25 * k, format!("{}", 0.25 * k as f64))).collect()
}

/// Those of relative squared errors.
pub(super) fn relative_ticks() -> Ticks {
    let [low, high] = POWERS;
    let text = |power: i32| match power {
        0.. => format!("{}", 10i32.pow(power as u32)),
        _ => format!("{}", 10f64.powi(power)),
    };
    (low..=high)
        .map(|power| (100 * (power - low) as usize / (high - low) as usize, text(power)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_where_the_ticks_say() {
        assert_eq!([flip(0.0), flip(1.0), flip(7.0), flip(f64::NAN)], [1, 255, 255, 0]);
        assert_eq!([1e-9, 0.0, 1e-4, 10.0, f64::INFINITY].map(relative), [1, 1, 1, 255, 255]);
        assert_eq!(relative(10f64.powf(-1.5)), 128);
        let ticks = relative_ticks();
        assert_eq!(ticks[0], (0, "0.0001".to_owned()));
        assert_eq!(ticks[4], (80, "1".to_owned()));
        assert_eq!(ticks[5], (100, "10".to_owned()));
    }

    #[test]
    fn there_is_a_color_for_every_level() {
        let colors = colors();
        assert_eq!(colors.len(), 256);
        assert_eq!([colors[0], colors[1], colors[255]], [[128; 3], [0, 0, 4], [252, 253, 191]]);
    }
}
