//! The GPUs of a machine: listing and choosing.

use super::error::GpuError;

/// A GPU, or a driver that imitates one, that has not been opened.
pub struct Adapter {
    pub(super) inner: wgpu::Adapter,
    info: wgpu::AdapterInfo,
}

/// What kind of hardware an adapter is; the better ones first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// A card with memory of its own.
    Discrete,
    /// A part of the processor's package.
    Integrated,
    /// A share of a card, in a virtual machine.
    Virtual,
    /// The driver does not say.
    Unknown,
    /// A driver that computes on the processor.
    Software,
}

impl Kind {
    /// One word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Discrete => "discrete",
            Self::Integrated => "integrated",
            Self::Virtual => "virtual",
            Self::Unknown => "unknown",
            Self::Software => "software",
        }
    }
}

/// Every adapter of this machine, the better kinds first, otherwise as the
/// drivers list them. The order is the same in every run.
pub fn adapters() -> Vec<Adapter> {
    let description = wgpu::InstanceDescriptor {
        flags: wgpu::InstanceFlags::empty(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    };
    let instance = wgpu::Instance::new(description);
    let found = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    let mut adapters: Vec<Adapter> =
        found.into_iter().map(|inner| Adapter { info: inner.get_info(), inner }).collect();
    adapters.sort_by_key(Adapter::kind);
    adapters
}

/// The adapter that `wanted` names: an index into [`adapters`], or a part of a
/// name, in capitals or not. The first one, if nothing is wanted.
///
/// # Errors
/// If there is none, or a name fits several different ones.
pub fn choose(wanted: Option<&str>) -> Result<Adapter, GpuError> {
    let mut adapters = adapters();
    if adapters.is_empty() {
        return Err(GpuError::NoAdapter);
    }
    let names: Vec<String> = adapters.iter().map(|a| a.name().to_owned()).collect();
    let index = find(&names, wanted)?;
    Ok(adapters.swap_remove(index))
}

fn find(names: &[String], wanted: Option<&str>) -> Result<usize, GpuError> {
    let Some(wanted) = wanted else { return Ok(0) };
    if let Ok(index) = wanted.parse::<usize>()
        && index < names.len()
    {
        return Ok(index);
    }
    let lower = wanted.to_lowercase();
    let fitting: Vec<usize> =
        (0..names.len()).filter(|&k| names[k].to_lowercase().contains(&lower)).collect();
    let Some(&first) = fitting.first() else {
        return Err(GpuError::NoSuchAdapter {
            wanted: wanted.to_owned(),
            available: names.to_vec(),
        });
    };
    // One card may be listed once per programming interface.
    if fitting.iter().any(|&k| names[k] != names[first]) {
        let fitting = fitting.iter().map(|&k| format!("{k} ({})", names[k])).collect();
        return Err(GpuError::Ambiguous { wanted: wanted.to_owned(), fitting });
    }
    Ok(first)
}

impl Adapter {
    /// What its driver calls it.
    pub fn name(&self) -> &str {
        &self.info.name
    }

    /// What it is.
    pub fn kind(&self) -> Kind {
        match self.info.device_type {
            wgpu::DeviceType::DiscreteGpu => Kind::Discrete,
            wgpu::DeviceType::IntegratedGpu => Kind::Integrated,
            wgpu::DeviceType::VirtualGpu => Kind::Virtual,
            wgpu::DeviceType::Other => Kind::Unknown,
            wgpu::DeviceType::Cpu => Kind::Software,
        }
    }

    /// The interface it is reached through: Vulkan, Metal or Direct3D 12.
    pub fn api(&self) -> &'static str {
        match self.info.backend {
            wgpu::Backend::Vulkan => "Vulkan",
            wgpu::Backend::Metal => "Metal",
            wgpu::Backend::Dx12 => "Direct3D 12",
            wgpu::Backend::Gl => "OpenGL",
            wgpu::Backend::BrowserWebGpu => "WebGPU",
            wgpu::Backend::Noop => "none",
        }
    }

    /// The driver and its version.
    pub fn driver(&self) -> String {
        format!("{} {}", self.info.driver, self.info.driver_info).trim().to_owned()
    }

    /// The largest buffer, in bytes.
    pub fn max_buffer(&self) -> u64 {
        self.inner.limits().max_buffer_size
    }

    /// The largest part of a buffer that a shader can see, in bytes.
    pub fn max_binding(&self) -> u64 {
        self.inner.limits().max_storage_buffer_binding_size
    }

    /// Storage buffers that a shader can see.
    pub fn max_bindings(&self) -> u32 {
        self.inner.limits().max_storage_buffers_per_shader_stage
    }

    /// Memory that the invocations of a workgroup share, in bytes.
    pub fn workgroup_memory(&self) -> u32 {
        self.inner.limits().max_compute_workgroup_storage_size
    }

    /// Whether the time of a kernel can be measured.
    pub fn has_timestamps(&self) -> bool {
        self.inner.features().contains(wgpu::Features::TIMESTAMP_QUERY)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn adapters_are_found_by_index_and_by_part_of_their_name() {
        let names = ["Big Card 9", "Small Chip", "llvmpipe", "Small Chip"].map(str::to_owned);
        assert_eq!(find(&names, None).expect("the first"), 0);
        assert_eq!(find(&names, Some("2")).expect("an index"), 2);
        assert_eq!(find(&names, Some("LLVM")).expect("a part"), 2);
        assert_eq!(find(&names, Some("small")).expect("one chip by two interfaces"), 1);
        assert_eq!(find(&names, Some("9")).expect("no index, but a part"), 0);
        let missing = find(&names, Some("medium")).unwrap_err().to_string();
        assert!(missing.contains("Big Card 9") && missing.contains("--backend jit"), "{missing}");
        let several = find(&names, Some("c")).unwrap_err().to_string();
        assert!(several.contains("0 (Big Card 9)"), "{several}");
    }
}
