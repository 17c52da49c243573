//! SPIR-V 1.3, with names and, as its source, the WGSL: what a caller must know
//! is nowhere else in a binary.

use naga::back::spv::{
    BindingInfo, DebugInfo, Options, PipelineOptions, SourceLanguage, WriterFlags,
    ZeroInitializeWorkgroupMemoryMode, write_vec,
};

use super::valid::Valid;

/// The words, lowest byte first.
pub(super) fn bytes(shader: &Valid) -> Result<Vec<u8>, String> {
    let options = Options {
        lang_version: (1, 3),
        flags: WriterFlags::DEBUG,
        fake_missing_bindings: false,
        binding_map: shader
            .buffers()
            .into_iter()
            .map(|buffer| {
                let info = BindingInfo {
                    descriptor_set: buffer.binding.group,
                    binding: buffer.binding.binding,
                    binding_array_size: None,
                };
                (buffer.binding, info)
            })
            .collect(),
        zero_initialize_workgroup_memory: ZeroInitializeWorkgroupMemoryMode::None,
        // Loops end by themselves, and the window's spacing is not zero.
        force_loop_bounding: false,
        emit_int_div_checks: false,
        debug_info: Some(DebugInfo {
            source_code: shader.text(),
            file_name: "filter.wgsl",
            language: SourceLanguage::Unknown,
        }),
        ..Options::default()
    };
    let (shader_stage, entry_point) = shader.entry_point();
    let pipeline = PipelineOptions { shader_stage, entry_point };
    let words = write_vec(shader.module(), shader.info(), &options, Some(&pipeline))
        .map_err(|error| error.to_string())?;
    Ok(words.into_iter().flat_map(u32::to_le_bytes).collect())
}
