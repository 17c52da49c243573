//! The proof that a filter makes sense.

use std::collections::BTreeSet;

use super::{Filter, Gather, Grid, Stage, StageKind, StandIn, Window};
use crate::expr::builder::LIMIT;
use crate::expr::feature::{Feature, PlaneId, Quantity};
use crate::expr::symbol::{Place, Symbol};
use crate::expr::tape::Side;
use crate::expr::text::{Declared, Reads, Scope, is_free};
use crate::expr::tree::Tree;
use crate::scene::{Fact, Facts, Needs};

/// What a filter's last stage gives.
const COLOR: usize = 3;

/// Why a filter makes no sense.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FilterError {
    /// There is nothing to compute.
    #[error("it has no stage")]
    NoStage,
    /// More stages than formulas can number.
    #[error("it has {0} stages; at most {max} are accepted", max = Checked::MOST_STAGES)]
    Stages(usize),
    /// More named constants than formulas can number.
    #[error("it has {0} named constants; at most {max} are accepted", max = u16::MAX)]
    Params(usize),
    /// A name cannot be used, or is used twice.
    #[error(
        "`{0}` cannot be the name of a stage or constant: names are letters, digits and `_`, \
         begin with a letter, are used once, and are neither features nor functions"
    )]
    Name(String),
    /// A constant is out of its bounds, or no number that formulas can compute with.
    #[error(
        "constant `{name}` is {value}; it must lie in [{}, {}], and bounds within ±1e18",
        .bounds[0], .bounds[1]
    )]
    Param {
        /// Which constant.
        name: String,
        /// Its value.
        value: f32,
        /// Its bounds.
        bounds: [f32; 2],
    },
    /// A layer's block has no regular shape, or numbers that formulas cannot compute with.
    #[error(
        "layer `{0}` needs rows of equally many numbers within ±1e18, one bias per row, and at \
         most {max} rows and columns", max = Symbol::WIDEST
    )]
    Layer(String),
    /// A formula reads a stage that is not before it, or as what it is not.
    #[error("stage `{stage}` reads what no stage before it gives")]
    Reads {
        /// The reader.
        stage: String,
    },
    /// A formula names a constant or a layer that is not there.
    #[error("stage `{stage}` uses a constant that the filter does not have")]
    Constant {
        /// The user.
        stage: String,
    },
    /// A map looks at pixel j, or a weight beside its pixels.
    #[error("stage `{stage}`: maps look at pixel i and around it, weights at pixels i and j")]
    Place {
        /// Which stage.
        stage: String,
    },
    /// A formula has the wrong number of components.
    #[error("stage `{stage}`: {what} must have {wanted}, but has {found}")]
    Width {
        /// Which stage.
        stage: String,
        /// Which formula.
        what: &'static str,
        /// How many components it must have.
        wanted: usize,
        /// How many it has.
        found: usize,
    },
    /// A window is empty or too large.
    #[error(
        "stage `{stage}` has radius {radius} and dilation {dilation}; the dilation must be at \
         least 1 and their product at most {max}", max = Window::MAX_RADIUS
    )]
    Window {
        /// Which stage.
        stage: String,
        /// Its radius.
        radius: u32,
        /// Its dilation.
        dilation: u32,
    },
    /// The result is not on the image's pixels.
    #[error("stage `{stage}` is the filter's result, and so must be on the full grid")]
    Grid {
        /// Which stage.
        stage: String,
    },
    /// What stands in for a feature cannot.
    #[error("`{feature}` cannot be replaced by that: {why}")]
    StandIn {
        /// The feature that may be absent.
        feature: &'static str,
        /// Why not.
        why: &'static str,
    },
}

/// A filter that makes sense, with the widths of its stages.
#[derive(Clone, Debug)]
pub struct Checked<'a> {
    filter: &'a Filter,
    stages: Vec<Declared>,
}

/// What a filter reads where it names a plane of a feature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Resolved {
    /// A plane of the scene.
    Plane(PlaneId),
    /// The same number everywhere.
    Constant(f32),
}

impl Filter {
    /// Checks that the filter makes sense.
    ///
    /// # Errors
    /// For the first thing that does not.
    pub fn check(&self) -> Result<Checked<'_>, FilterError> {
        if self.constants.params.len() > usize::from(u16::MAX) {
            return Err(FilterError::Params(self.constants.params.len()));
        }
        let mut names = BTreeSet::new();
        let mut name = |name: &str| match is_free(name) && names.insert(name.to_owned()) {
            true => Ok(()),
            false => Err(FilterError::Name(name.to_owned())),
        };
        for param in &self.constants.params {
            name(&param.name)?;
            let [low, high] = param.bounds;
            let bounded = -LIMIT <= low && low <= param.value && param.value <= high;
            if !bounded || high > LIMIT {
                let (name, value, bounds) = (param.name.clone(), param.value, param.bounds);
                return Err(FilterError::Param { name, value, bounds });
            }
        }
        for layer in &self.constants.layers {
            name(&layer.name)?;
            let (rows, columns) = (layer.rows(), layer.columns());
            let sizes = [rows, columns].iter().all(|n| (1..=Symbol::WIDEST).contains(n));
            let regular =
                layer.bias.len() == rows && layer.weights.iter().all(|row| row.len() == columns);
            let bounded = layer.weights.iter().flatten().chain(&layer.bias);
            if !sizes || !regular || !bounded.into_iter().all(|x| x.abs() <= LIMIT) {
                return Err(FilterError::Layer(layer.name.clone()));
            }
        }
        for &(feature, stand_in) in &self.absent {
            let why = match stand_in {
                _ if feature == Feature::Color => Some("every file has a colour"),
                _ if !feature.is_stored() => Some("every scene has it"),
                StandIn::Constant(x) if x.abs() <= LIMIT => None,
                StandIn::Constant(_) => Some("the number is out of range"),
                StandIn::Feature(Feature::Color) if feature.width() == Feature::Color.width() => {
                    None
                }
                StandIn::Feature(_) => {
                    Some("only the colour, which has three components, is always there")
                }
            };
            if let Some(why) = why {
                return Err(FilterError::StandIn { feature: feature.row().name, why });
            }
        }
        if self.stages.is_empty() {
            return Err(FilterError::NoStage);
        }
        if self.stages.len() > Checked::MOST_STAGES {
            return Err(FilterError::Stages(self.stages.len()));
        }
        let mut stages: Vec<Declared> = Vec::with_capacity(self.stages.len());
        for stage in &self.stages {
            name(&stage.name)?;
            let declared = Checked { filter: self, stages: stages.clone() }.stage(stage)?;
            stages.push(declared);
        }
        let last = stages.last().expect("there is a stage");
        if usize::from(last.width) != COLOR {
            return Err(FilterError::Width {
                stage: last.name.clone(),
                what: "the filter's result",
                wanted: COLOR,
                found: usize::from(last.width),
            });
        }
        if let Some(Stage { name, grid: Grid::Half, .. }) = self.stages.last() {
            return Err(FilterError::Grid { stage: name.clone() });
        }
        Ok(Checked { filter: self, stages })
    }
}

impl<'a> Checked<'a> {
    /// Filters of more stages are refused.
    pub const MOST_STAGES: usize = 1000;

    /// The filter.
    pub fn filter(&self) -> &'a Filter {
        self.filter
    }

    /// The stages as later ones see them.
    pub fn stages(&self) -> &[Declared] {
        &self.stages
    }

    /// The names that a formula of a stage may use.
    pub fn scope(&self, stage: usize, reads: Reads) -> Scope<'_> {
        let constants = Some(&self.filter.constants);
        Scope { reads, stages: &self.stages[..stage], later: &[], constants }
    }

    /// What the next stage is, if it makes sense after these.
    fn stage(&self, stage: &Stage) -> Result<Declared, FilterError> {
        let name = || stage.name.clone();
        let (width, variance) = match &stage.kind {
            StageKind::Map(value) => {
                self.formula(stage, value, false)?;
                (value.width(), false)
            }
            StageKind::Gather(Gather { of, weight, window, variance }) => {
                self.formula(stage, of, false)?;
                self.formula(stage, weight, true)?;
                let number = |what, tree: &Tree| match tree.width() {
                    1 => Ok(()),
                    found => Err(FilterError::Width { stage: name(), what, wanted: 1, found }),
                };
                number("the weight", weight)?;
                if let Some(variance) = variance {
                    self.formula(stage, variance, false)?;
                    number("the variance", variance)?;
                }
                let Window { radius, dilation } = *window;
                let reach = radius.checked_mul(dilation);
                if dilation == 0 || reach.is_none_or(|reach| reach > Window::MAX_RADIUS) {
                    return Err(FilterError::Window { stage: name(), radius, dilation });
                }
                (of.width(), variance.is_some())
            }
        };
        Ok(Declared { name: name(), width: width as u16, variance })
    }

    /// Checks what a formula reads, and where.
    fn formula(&self, stage: &Stage, tree: &Tree, pair: bool) -> Result<(), FilterError> {
        let name = || stage.name.clone();
        let constants = &self.filter.constants;
        for symbol in tree.symbols() {
            match *symbol {
                Symbol::Stage(signal) => {
                    let known = self.stages.get(usize::from(signal.stage));
                    let fits = |known: &Declared| {
                        known.width == signal.width && (known.variance || !signal.variance)
                    };
                    if !known.is_some_and(fits) {
                        return Err(FilterError::Reads { stage: name() });
                    }
                }
                Symbol::Param(k) if usize::from(k) >= constants.params.len() => {
                    return Err(FilterError::Constant { stage: name() });
                }
                Symbol::Linear(layer) => {
                    let shape = |known: &crate::expr::constants::Layer| {
                        (known.rows(), known.columns())
                            == (usize::from(layer.rows), usize::from(layer.columns))
                    };
                    if !constants.layers.get(usize::from(layer.layer)).is_some_and(shape) {
                        return Err(FilterError::Constant { stage: name() });
                    }
                }
                Symbol::Offset if !pair => return Err(FilterError::Place { stage: name() }),
                Symbol::At(Place::Side(Side::J)) if !pair => {
                    return Err(FilterError::Place { stage: name() });
                }
                Symbol::At(Place::Shift(..)) if pair => {
                    return Err(FilterError::Place { stage: name() });
                }
                Symbol::Param(_)
                | Symbol::Offset
                | Symbol::At(_)
                | Symbol::Const(_)
                | Symbol::Variance(_)
                | Symbol::Vector(_)
                | Symbol::Gradient(_)
                | Symbol::Op(_)
                | Symbol::Part(_)
                | Symbol::Many(..) => {}
            }
        }
        Ok(())
    }

    /// Every formula of the filter.
    fn formulas(&self) -> impl Iterator<Item = &'a Tree> {
        self.filter.stages.iter().flat_map(|stage| match &stage.kind {
            StageKind::Map(value) => vec![value],
            // The colour itself is not among what the paper's weights look at.
            StageKind::Gather(gather) if self.filter.paper().is_some() => vec![&gather.weight],
            StageKind::Gather(gather) => {
                [&gather.of, &gather.weight].into_iter().chain(&gather.variance).collect()
            }
        })
    }

    /// The planes of features that the formulas name.
    fn named(&self) -> BTreeSet<PlaneId> {
        let planes = self.formulas().flat_map(Tree::planes);
        planes.collect()
    }

    /// What stands in for a feature, if anything does.
    pub(super) fn stand_in(&self, feature: Feature) -> Option<StandIn> {
        let found = self.filter.absent.iter().find(|(absent, _)| *absent == feature);
        found.map(|&(_, stand_in)| stand_in)
    }

    /// The planes that a scene should be loaded with: what the formulas name, and what
    /// may stand in for it.
    pub fn needs(&self) -> Needs {
        let named = self.named();
        let stand_ins = named.iter().filter_map(|plane| match self.stand_in(plane.feature)? {
            StandIn::Feature(feature) => Some(PlaneId { feature, ..*plane }),
            StandIn::Constant(_) => None,
        });
        let stand_ins: Vec<PlaneId> = stand_ins.collect();
        Needs::planes(named.into_iter().chain(stand_ins))
    }

    /// The planes without which the filter cannot run.
    pub fn required(&self) -> Needs {
        let named = self.named();
        Needs::planes(named.into_iter().filter(|plane| self.stand_in(plane.feature).is_none()))
    }

    /// What is read for a plane that a formula names, in a scene of which these facts are
    /// known; `None` if it is absent and nothing stands in for it.
    pub fn resolve(&self, plane: PlaneId, facts: &Facts) -> Option<Resolved> {
        if facts.get(plane) != Fact::Absent {
            return Some(Resolved::Plane(plane));
        }
        match self.stand_in(plane.feature)? {
            StandIn::Constant(x) => Some(Resolved::Constant(match plane.quantity {
                Quantity::Value => x,
                // A constant has neither.
                Quantity::Gradient | Quantity::Variance => 0.0,
            })),
            StandIn::Feature(feature) => {
                let other = PlaneId { feature, ..plane };
                match facts.get(other) {
                    Fact::Absent => Some(Resolved::Constant(0.0)),
                    Fact::Constant(_) | Fact::Range(_) => Some(Resolved::Plane(other)),
                }
            }
        }
    }

    /// How far any stage looks, in pixels: the padding that a scene's planes need.
    pub fn reach(&self) -> usize {
        let shifts = self.formulas().flat_map(|tree| {
            // A shift of what is shifted already may reach the sum of both.
            tree.places(true).into_iter().map(|place| match place {
                Place::Shift(dx, dy) => dx.unsigned_abs().max(dy.unsigned_abs()).into(),
                Place::Side(_) => 0,
            })
        });
        let windows = self.filter.gathers().map(|gather| gather.window.reach() as usize);
        // From one grid to the other, the pixel beside is looked at.
        let grids = self.filter.stages.iter().map(|stage| usize::from(stage.grid == Grid::Half));
        shifts.chain(windows).chain(grids).max().unwrap_or(0)
    }

    /// How far from a pixel of the image what its result depends on may lie, in pixels of
    /// the image, through all stages: the radius of the receptive field.
    pub fn receptive_field(&self) -> usize {
        let stages = &self.filter.stages;
        let mut fields: Vec<usize> = Vec::with_capacity(stages.len());
        for stage in stages {
            let (grid, step) = (stage.grid, stage.grid.step());
            let field = |tree: &Tree, map: bool, reach: usize| {
                let looks = tree.symbols().iter().zip(tree.places(map)).map(|(symbol, place)| {
                    let beside = step
                        * match place {
                            Place::Side(Side::I) => 0,
                            Place::Side(Side::J) => reach,
                            Place::Shift(dx, dy) => dx.unsigned_abs().max(dy.unsigned_abs()).into(),
                        };
                    match symbol {
                        Symbol::Stage(signal) => {
                            let stage = usize::from(signal.stage);
                            // Between two pixels of half the resolution, the further one of
                            // which begins two pixels away.
                            let between = match (stages[stage].grid, grid) {
                                (Grid::Half, Grid::Full) => 2,
                                (Grid::Half, Grid::Half) | (Grid::Full, _) => 0,
                            };
                            beside + between + fields[stage]
                        }
                        _ if symbol.reads().is_some() => beside,
                        _ => 0,
                    }
                });
                looks.max().unwrap_or(0)
            };
            fields.push(match &stage.kind {
                StageKind::Map(value) => field(value, true, 0),
                StageKind::Gather(gather) => {
                    let reach = gather.window.reach() as usize;
                    let averaged = [Some(&gather.of), gather.variance.as_ref()];
                    let averaged = averaged.into_iter().flatten().map(|tree| field(tree, true, 0));
                    let averaged = averaged.max().unwrap_or(0) + step * reach;
                    averaged.max(field(&gather.weight, false, reach))
                }
            });
        }
        fields.pop().unwrap_or(0)
    }
}
