//! Images that do not fit in memory, part by part.
//!
//! A part is some rows of the result. For these a scene is made of the rows that they hang
//! on, and filtered like any other; the bits are those of the whole image, as a pixel's
//! value depends on nothing but its surroundings, and plans on what is known of the whole.

use std::time::Instant;

use super::DenoiseError;
use super::code::{Applied, Code, Run};
use crate::backend::{Backend, Filtered, Rect};
use crate::filter::Filter;
use crate::image::Image;
use crate::plan::Passes;
use crate::scene::SpilledScene;

/// Rows of a part at least: each also computes rows around it.
const SHORTEST: usize = 64;

/// Filters a scene within so many bytes of memory.
pub(super) fn apply(
    filter: &Filter,
    scene: &SpilledScene,
    backend: &dyn Backend,
    passes: Passes,
    run: Run<'_>,
    max_memory: u64,
) -> Result<(Image, Applied), DenoiseError> {
    let checked = filter.check().expect("only filters that make sense get here");
    scene.require(&checked.required())?;
    let code = Code::new(filter, (scene.name(), scene.facts()), backend, passes)?;
    let layout = scene.layout();
    let (width, height) = (layout.width(), layout.height());
    let start = Instant::now();
    let mut rgb = [(); 3].map(|()| Vec::with_capacity(layout.pixels()));
    // A quarter of what the result leaves is for a part, the rest for what filtering it takes.
    let result = 3 * (layout.pixels() * size_of::<f32>()) as u64;
    let rows = max_memory.saturating_sub(result) / 4 / scene.row_bytes();
    let rows = usize::try_from(rows).unwrap_or(usize::MAX).clamp(SHORTEST, height.max(SHORTEST));
    let mut alpha: Option<Vec<f32>> = None;
    let mut kept = vec![0; filter.stages.len()];
    for top in (0..height).step_by(rows) {
        let wanted = top..(top + rows).min(height);
        let around = code.plan().rows(wanted.clone(), height);
        let part = scene.rows(around.clone())?;
        let rect = Rect { x: 0, y: wanted.start - around.start, width, height: wanted.len() };
        let filtered: Filtered = code.run(&part, rect, run)?;
        for (kept, more) in kept.iter_mut().zip(filtered.kept) {
            *kept += more;
        }
        if let Some(part) = part.alpha() {
            let inside = rect.y * width..(rect.y + rect.height) * width;
            alpha.get_or_insert_default().extend(&part[inside]);
        }
        for (channel, samples) in rgb.iter_mut().enumerate() {
            samples.extend(filtered.pixels.iter().map(|color| color[channel]));
        }
    }
    let filtering = start.elapsed();
    let image = Image::new(scene.name(), width, height, rgb)
        .expect("one colour per pixel of every row")
        .with_attributes(scene.attributes())
        .with_alpha(alpha);
    let Code { planning, compilation, .. } = code;
    Ok((image, Applied { kept, planning, compilation, filtering }))
}
