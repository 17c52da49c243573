//! GLSL 4.50, for Vulkan and for OpenGL.

use naga::back::glsl::{Options, PipelineOptions, Version, Writer, WriterFlags};
use naga::proc::BoundsCheckPolicies;

use super::valid::Valid;

/// The shader. Its first line is the version, which must stand there.
pub(super) fn text(shader: &Valid) -> Result<String, String> {
    let options = Options {
        version: Version::Desktop(450),
        writer_flags: WriterFlags::empty(),
        binding_map: shader
            .buffers()
            .into_iter()
            .map(|buffer| (buffer.binding, buffer.binding.binding as u8))
            .collect(),
        zero_initialize_workgroup_memory: false,
    };
    let (shader_stage, entry_point) = shader.entry_point();
    let pipeline = PipelineOptions { shader_stage, entry_point, multiview: None };
    let (module, info) = (shader.module(), shader.info());
    let mut text = String::new();
    Writer::new(&mut text, module, info, &options, &pipeline, BoundsCheckPolicies::default())
        .and_then(|mut writer| writer.write())
        .map_err(|error| error.to_string())?;
    Ok(text)
}
