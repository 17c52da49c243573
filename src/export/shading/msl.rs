//! The Metal shading language, version 2.1: the first that states a kernel's
//! workgroup size.

use naga::back::msl::{BindTarget, EntryPointResources, Options, PipelineOptions, write_string};

use super::valid::{Access, Buffer, Valid};

/// The shader, and what its entry point is called: `main` is a word of C++.
pub(super) fn text(shader: &Valid) -> Result<(String, String), String> {
    let (stage, entry_point) = shader.entry_point();
    let resources = EntryPointResources {
        resources: shader
            .buffers()
            .into_iter()
            .map(|buffer| (buffer.binding, target(&buffer)))
            .collect(),
        immediates_buffer: None,
        // Naga insists on being given the sizes of arrays. Nothing reads them here.
        sizes_buffer: shader.buffers().last().map(|buffer| buffer.binding.binding as u8 + 1),
    };
    let options = Options {
        lang_version: (2, 1),
        per_entry_point_map: [(entry_point.clone(), resources)].into(),
        fake_missing_bindings: false,
        zero_initialize_workgroup_memory: false,
        // Loops end by themselves, and the window's spacing is not zero.
        force_loop_bounding: false,
        emit_int_div_checks: false,
        ..Options::default()
    };
    let pipeline =
        PipelineOptions { entry_point: Some((stage, entry_point)), ..PipelineOptions::default() };
    let (text, translation) = write_string(shader.module(), shader.info(), &options, &pipeline)
        .map_err(|error| error.to_string())?;
    let names = translation.entry_point_names.into_iter().collect::<Result<Vec<_>, _>>();
    let name = names.map_err(|error| error.to_string())?.swap_remove(0);
    Ok((text, name))
}

fn target(buffer: &Buffer) -> BindTarget {
    BindTarget {
        buffer: Some(buffer.binding.binding as u8),
        mutable: buffer.access == Access::Write,
        ..BindTarget::default()
    }
}
