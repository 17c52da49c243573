//! HLSL for shader model 6.0.

use naga::back::hlsl::{BindTarget, Options, PipelineOptions, ShaderModel, Writer};

use super::valid::Valid;

/// The shader, and what its entry point is called.
pub(super) fn text(shader: &Valid) -> Result<(String, String), String> {
    let target = |register| BindTarget { register, ..BindTarget::default() };
    let options = Options {
        shader_model: ShaderModel::V6_0,
        binding_map: shader
            .buffers()
            .into_iter()
            .map(|buffer| (buffer.binding, target(buffer.binding.binding)))
            .collect(),
        fake_missing_bindings: false,
        zero_initialize_workgroup_memory: false,
        // The window lies inside of the region, and loops end by themselves.
        restrict_indexing: false,
        force_loop_bounding: false,
        ..Options::default()
    };
    let pipeline = PipelineOptions { entry_point: Some(shader.entry_point()) };
    let mut text = String::new();
    let reflection = Writer::new(&mut text, &options, &pipeline)
        .write(shader.module(), shader.info(), None)
        .map_err(|error| error.to_string())?;
    let names = reflection.entry_point_names.into_iter().collect::<Result<Vec<_>, _>>();
    let name = names.map_err(|error| error.to_string())?.swap_remove(0);
    Ok((text, name))
}
