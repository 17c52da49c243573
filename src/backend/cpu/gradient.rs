//! Programs and their adjoints on the CPU.
//!
//! Both are walked by the executor of programs, kernel by kernel over the whole image: what
//! goes backward needs what went forward, all of it. Images are small, and who has many of
//! them runs one per thread.

use std::borrow::Cow;
use std::ops::Range;

use super::band::Band;
use super::program::{Engine, ProgramCode, Scratch, Strip};
use super::rows::Products;
use crate::backend::{BackendError, Differentiable, Loss, Rect, Workspace};
use crate::expr::symbol::StagePlane;
use crate::plan::{Factor, Gradient, Kernel, Output, Total};
use crate::scene::Scene;
use crate::scene::plane::Layout;

/// A program and its adjoint in executable form.
pub(super) struct GradientCode<E: Engine> {
    code: ProgramCode<E>,
    gradient: Gradient,
}

impl<E: Engine> GradientCode<E> {
    pub(super) fn new(engine: &E, gradient: &Gradient) -> Result<Self, BackendError> {
        let code = ProgramCode::new(engine, &gradient.program)?;
        Ok(Self { code, gradient: gradient.clone() })
    }
}

/// The planes of one image, which the next one of the same size takes over.
pub(super) struct Planes {
    layout: Layout,
    bands: Vec<Band>,
}

impl<E: Engine> Differentiable for GradientCode<E>
where
    E::Map: Send + Sync,
    E::Gather: Send + Sync,
{
    fn run(
        &self,
        scene: &Scene,
        constants: &[f32],
        loss: &mut Loss<'_>,
        workspace: &mut Workspace,
        derivatives: &mut [f64],
    ) -> Result<f64, BackendError> {
        let (code, program) = (&self.code, &self.code.program);
        code.accepts(scene)?;
        let layout = scene.layout();
        let (width, height) = (layout.width(), layout.height());
        let bands = match workspace.0.take().and_then(|planes| planes.downcast::<Planes>().ok()) {
            Some(planes)
                if planes.layout == layout && planes.bands.len() == program.buffers.len() =>
            {
                planes.bands
            }
            Some(_) | None => {
                let mut bands = code.bands(layout);
                bands.iter_mut().for_each(Band::hold_all);
                bands
            }
        };
        let values = code.values(constants);
        let mut scratch = Scratch::<E>::default();
        let whole = Rect { x: 0, y: 0, width, height };
        let mut strip = Strip::new(code, scene, whole, bands);
        let walk = |kernels: Range<usize>, strip: &mut Strip<'_>, scratch: &mut Scratch<E>| {
            for k in kernels {
                let rows = 0..strip.layout(program.kernels[k].grid()).height();
                code.rows(k, &values[k], rows, strip, scratch)?;
            }
            Ok::<(), BackendError>(())
        };
        walk(0..self.gradient.backward, &mut strip, &mut scratch)?;

        let mut colors = vec![[0.0f32; 3]; layout.pixels()];
        for (component, output) in program.outputs[0].into_iter().enumerate() {
            match output {
                Output::Constant(x) => colors.iter_mut().for_each(|color| color[component] = x),
                Output::Plane(plane) => {
                    let band = &strip.bands[code.place(plane)];
                    for (y, row) in colors.chunks_exact_mut(width).enumerate() {
                        for (color, &x) in row.iter_mut().zip(band.pixels(y)) {
                            color[component] = x;
                        }
                    }
                }
            }
        }
        let mut owed = vec![[0.0f32; 3]; colors.len()];
        let lost = loss(&colors, &mut owed);
        for (component, plane) in self.gradient.owed.into_iter().enumerate() {
            let written = plane.filter(|plane| {
                let given = &program.kernels[self.gradient.backward..];
                matches!(given.first(), Some(Kernel::Given(planes)) if planes.contains(plane))
            });
            let Some(plane) = written else { continue };
            let band = &mut strip.bands[code.place(plane)];
            let mut pixels = vec![0.0; width];
            for (y, row) in owed.chunks_exact(width).enumerate() {
                pixels.iter_mut().zip(row).for_each(|(x, owed)| *x = owed[component]);
                band.write(y, &pixels);
            }
        }
        walk(self.gradient.backward..program.kernels.len(), &mut strip, &mut scratch)?;

        let band = |plane: StagePlane| &strip.bands[code.place(plane)];
        for total in &self.gradient.totals {
            add(total, &band, derivatives);
        }
        workspace.0 = Some(Box::new(Planes { layout, bands: strip.bands }));
        Ok(lost)
    }
}

/// Adds sums over all pixels to the derivatives.
fn add<'b>(total: &Total, band: &dyn Fn(StagePlane) -> &'b Band, derivatives: &mut [f64]) {
    match total {
        Total::Sum { constant, plane } => {
            derivatives[*constant] +=
                sum(&[Factor::Plane(*plane)], &[Factor::Constant(1.0)], band)[0];
        }
        Total::Layer { start, outputs, inputs } => {
            let rows: Vec<usize> =
                (0..outputs.len()).filter(|&row| outputs[row].is_some()).collect();
            let owed: Vec<Factor> = outputs.iter().flatten().copied().collect();
            // What b is multiplied with is one.
            let columns: Vec<Factor> =
                inputs.iter().copied().chain([Factor::Constant(1.0)]).collect();
            let products = sum(&owed, &columns, band);
            for (&row, products) in rows.iter().zip(products.chunks_exact(columns.len())) {
                let (weights, bias) = products.split_at(inputs.len());
                for (column, product) in weights.iter().enumerate() {
                    derivatives[start + row * inputs.len() + column] += product;
                }
                derivatives[start + outputs.len() * inputs.len() + row] += bias[0];
            }
        }
    }
}

/// The sums over all pixels of the products of two factors each, row by row.
fn sum<'b>(rows: &[Factor], columns: &[Factor], band: &dyn Fn(StagePlane) -> &'b Band) -> Vec<f64> {
    let mut sums = vec![0.0; rows.len() * columns.len()];
    let plane = |factor: &Factor| match *factor {
        Factor::Plane(plane) => Some(band(plane).layout),
        Factor::Constant(_) => None,
    };
    // What is owed is the same everywhere only where it is nothing.
    let Some(layout) = rows.iter().find_map(plane) else { return sums };
    for y in 0..layout.height() {
        let pixels = |factor: &Factor| match *factor {
            Factor::Plane(plane) => Cow::Borrowed(band(plane).pixels(y)),
            Factor::Constant(x) => Cow::Owned(vec![x; layout.width()]),
        };
        let rows: Vec<Cow<'_, [f32]>> = rows.iter().map(pixels).collect();
        let columns: Vec<Cow<'_, [f32]>> = columns.iter().map(pixels).collect();
        pulp::Arch::new().dispatch(Products { rows: &rows, columns: &columns, sums: &mut sums });
    }
    sums
}
