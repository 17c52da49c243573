//! What is known of a scene's planes before a pixel is filtered.
//!
//! The passes substitute these: a feature that is zero everywhere takes the
//! terms that read it out of the expression, and a range drops guards that can
//! never act. Machine code specialised to facts is right only for scenes they
//! hold of, so facts of several scenes are joined to what holds of all, and a
//! plan [keeps](crate::plan::WindowPlan::facts) those that it was made with.

use std::collections::BTreeMap;
use std::fmt;

use super::Scene;
use super::plane::{Plane, constant};
use crate::expr::builder::LIMIT;
use crate::expr::feature::{Feature, PlaneId, Quantity};
use crate::expr::interval::Interval;

/// What is known of one plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fact {
    /// The scene does not provide it, or it was not asked for.
    Absent,
    /// Every pixel has this value.
    Constant(f32),
    /// Every sample, padding included, lies in here.
    Range(Interval),
}

impl Fact {
    /// What is known of a plane.
    pub fn of(plane: &Plane) -> Self {
        match plane {
            Plane::Constant(value) => Self::Constant(*value),
            // The padding repeats pixels, so the pixels' range is the plane's.
            Plane::Samples(samples) => {
                let rows = 0..samples.layout().height();
                Self::Range(range(rows.map(|y| samples.pixels(y))))
            }
        }
    }

    /// What is known of a plane, given its pixels row by row.
    pub(super) fn of_pixels(pixels: &[f32], width: usize) -> Self {
        match constant(pixels) {
            Some(value) => Self::Constant(value),
            None => Self::Range(range(pixels.chunks(width))),
        }
    }

    /// What holds wherever either holds. Absent from one is absent from both: a
    /// filter that reads the plane cannot run on all of the scenes.
    pub fn join(self, other: Self) -> Self {
        match (self, other) {
            (Self::Absent, _) | (_, Self::Absent) => Self::Absent,
            (Self::Constant(a), Self::Constant(b)) if a == b => Self::Constant(a),
            (
                a @ (Self::Constant(_) | Self::Range(_)),
                b @ (Self::Constant(_) | Self::Range(_)),
            ) => Self::Range(a.interval().hull(b.interval())),
        }
    }

    /// Whether this holds of a plane of which `actual` is known. Of an absent plane
    /// nothing else holds.
    pub fn covers(self, actual: Self) -> bool {
        match (self, actual) {
            (Self::Absent, Self::Absent) => true,
            (Self::Absent, _) | (_, Self::Absent) => false,
            (Self::Constant(_) | Self::Range(_), Self::Constant(_) | Self::Range(_)) => {
                let (all, actual) = (self.interval(), actual.interval());
                all.contains(actual.lo) && all.contains(actual.hi)
            }
        }
    }

    /// The values that the plane can have; everything if it is absent.
    pub fn interval(self) -> Interval {
        match self {
            Self::Absent => Interval::ENTIRE,
            Self::Constant(value) => Interval::point(value),
            Self::Range(interval) => interval,
        }
    }
}

/// What follows a plane's name in a sentence.
impl fmt::Display for Fact {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Absent => f.write_str("is absent"),
            Self::Constant(value) => write!(f, "is {value} everywhere"),
            Self::Range(Interval::ENTIRE) => f.write_str("may be anything"),
            Self::Range(Interval { lo, hi }) => write!(f, "lies between {lo} and {hi}"),
        }
    }
}

/// The range of a plane's pixels; everything if one of them is a NaN.
fn range<'a>(rows: impl Iterator<Item = &'a [f32]>) -> Interval {
    // Eight running bounds: a single one would wait for itself at every pixel.
    let (mut lo, mut hi) = ([f32::INFINITY; 8], [f32::NEG_INFINITY; 8]);
    let mut is_nan = false;
    for row in rows {
        let (groups, rest) = row.as_chunks::<8>();
        let mut widen = |k: usize, x: f32| {
            lo[k] = if x < lo[k] { x } else { lo[k] };
            hi[k] = if x > hi[k] { x } else { hi[k] };
            is_nan |= x.is_nan();
        };
        for group in groups {
            group.iter().enumerate().for_each(|(k, &x)| widen(k, x));
        }
        rest.iter().enumerate().for_each(|(k, &x)| widen(k, x));
    }
    if is_nan {
        return Interval::ENTIRE;
    }
    let bounds = lo.into_iter().zip(hi).map(|(lo, hi)| Interval { lo, hi });
    // Bounds that saw no pixel are inside out, which a hull does not notice.
    bounds.reduce(Interval::hull).map_or(Interval::ENTIRE, |all| Interval::new(all.lo, all.hi))
}

/// The facts of every plane that a scene, or all of several, provides.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Facts {
    planes: BTreeMap<PlaneId, Fact>,
}

impl Facts {
    /// The facts of a scene. They were found when it was loaded.
    pub fn of(scene: &Scene) -> Self {
        scene.facts.clone()
    }

    /// Facts stated outright; planes not named are absent.
    pub fn from_planes(planes: impl IntoIterator<Item = (PlaneId, Fact)>) -> Self {
        let known = planes.into_iter().filter(|(_, fact)| *fact != Fact::Absent);
        Self { planes: known.collect() }
    }

    /// What holds of every scene that has all features: samples lie within the
    /// range that expressions compute in, and gradients and variances are not
    /// negative. A plan made with these is right for all scenes.
    pub fn of_any_scene() -> Self {
        let range = |quantity| match quantity {
            Quantity::Value => Interval::new(-LIMIT, LIMIT),
            Quantity::Gradient | Quantity::Variance => Interval::new(0.0, LIMIT),
        };
        Self::from_planes(Feature::terms().flat_map(|(feature, quantity)| {
            PlaneId::of(feature, quantity).map(move |id| (id, Fact::Range(range(quantity))))
        }))
    }

    /// What is known of a plane.
    pub fn get(&self, id: PlaneId) -> Fact {
        self.planes.get(&id).copied().unwrap_or(Fact::Absent)
    }

    /// Every plane that is not absent.
    pub fn iter(&self) -> impl Iterator<Item = (PlaneId, Fact)> {
        self.planes.iter().map(|(&id, &fact)| (id, fact))
    }

    /// What holds of both.
    pub fn join(&self, other: &Self) -> Self {
        let both = self.iter().map(|(id, fact)| (id, fact.join(other.get(id))));
        Self { planes: both.filter(|(_, fact)| *fact != Fact::Absent).collect() }
    }

    /// What holds of all; nothing is known of no scene at all.
    pub fn of_all<'a>(scenes: impl IntoIterator<Item = &'a Scene>) -> Self {
        let facts = scenes.into_iter().map(Self::of);
        facts.reduce(|all, next| all.join(&next)).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expr::feature::{Feature, Quantity};

    #[test]
    fn a_fact_covers_what_is_as_it_says() {
        let constant = Fact::Constant(0.5);
        let range = |lo, hi| Fact::Range(Interval::new(lo, hi));
        assert!(constant.covers(constant) && constant.covers(range(0.5, 0.5)));
        assert!(Fact::Constant(0.0).covers(Fact::Constant(-0.0)));
        assert!(!constant.covers(Fact::Constant(0.25)) && !constant.covers(range(0.0, 0.5)));
        assert!(range(0.0, 1.0).covers(constant) && range(0.0, 1.0).covers(range(0.0, 1.0)));
        assert!(
            !range(0.0, 1.0).covers(range(0.0, 1.5)) && !range(0.0, 1.0).covers(range(-0.5, 1.0))
        );
        assert!(Fact::Range(Interval::ENTIRE).covers(range(-1e30, f32::INFINITY)));
        // A NaN among the samples leaves no range.
        assert!(!range(-LIMIT, LIMIT).covers(Fact::Range(Interval::ENTIRE)));
        assert!(!Fact::Range(Interval::ENTIRE).covers(Fact::Absent));
        assert!(!Fact::Absent.covers(constant) && Fact::Absent.covers(Fact::Absent));
    }

    #[test]
    fn joining_keeps_what_both_say() {
        let (c, r) = (Fact::Constant(1.0), Fact::Range(Interval::new(-2.0, 0.0)));
        assert_eq!(c.join(c), c);
        assert_eq!(c.join(Fact::Constant(3.0)), Fact::Range(Interval::new(1.0, 3.0)));
        assert_eq!(c.join(r), Fact::Range(Interval::new(-2.0, 1.0)));
        assert_eq!(r.join(Fact::Absent), Fact::Absent);
        assert_eq!(Fact::Absent.join(c), Fact::Absent);
        assert_eq!(Fact::Constant(0.0).join(Fact::Constant(-0.0)), Fact::Constant(0.0));

        let id = PlaneId { feature: Feature::Depth, quantity: Quantity::Value, component: 0 };
        let here = Facts::from_planes([(id, c)]);
        assert_eq!(here.join(&Facts::default()).get(id), Fact::Absent);
        assert_eq!(here.join(&here), here);
    }
}
