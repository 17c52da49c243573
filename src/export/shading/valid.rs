//! Proof that a shader is valid.
//!
//! The only way to a [`Valid`] leads through naga's parser and validator, and the
//! writers of other languages take nothing else: what is not valid cannot be
//! written.

use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{AddressSpace, ResourceBinding, ShaderStage, StorageAccess};

/// A valid shader: its WGSL, and what naga made of it.
pub(super) struct Valid {
    text: String,
    module: naga::Module,
    info: ModuleInfo,
}

/// A buffer that a shader is given.
#[derive(Clone, Debug)]
pub(super) struct Buffer {
    pub(super) name: String,
    pub(super) binding: ResourceBinding,
    pub(super) access: Access,
}

/// What a shader does with a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Access {
    /// It is read, the same for all invocations.
    Uniform,
    /// It is read.
    Read,
    /// It is written.
    Write,
}

impl Valid {
    /// Parses and validates WGSL. What it needs beyond WebGPU is refused.
    pub(super) fn new(text: String) -> Result<Self, String> {
        let module =
            naga::front::wgsl::parse_str(&text).map_err(|error| error.emit_to_string(&text))?;
        let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
            .validate(&module)
            .map_err(|error| error.emit_to_string(&text))?;
        Ok(Self { text, module, info })
    }

    /// The WGSL.
    pub(super) fn text(&self) -> &str {
        &self.text
    }

    pub(super) fn module(&self) -> &naga::Module {
        &self.module
    }

    pub(super) fn info(&self) -> &ModuleInfo {
        &self.info
    }

    /// The stage and name of its one entry point.
    pub(super) fn entry_point(&self) -> (ShaderStage, String) {
        let [entry] = self.module.entry_points.as_slice() else {
            unreachable!("a kernel has one entry point");
        };
        (entry.stage, entry.name.clone())
    }

    /// The buffers, in the order of their bindings.
    pub(super) fn buffers(&self) -> Vec<Buffer> {
        let globals = self.module.global_variables.iter();
        let mut buffers: Vec<Buffer> = globals
            .filter_map(|(_, global)| {
                let access = match global.space {
                    AddressSpace::Uniform => Access::Uniform,
                    AddressSpace::Storage { access } if access.contains(StorageAccess::STORE) => {
                        Access::Write
                    }
                    _ => Access::Read,
                };
                let name = global.name.clone()?;
                Some(Buffer { name, binding: global.binding?, access })
            })
            .collect();
        buffers.sort_by_key(|buffer| buffer.binding);
        buffers
    }
}
