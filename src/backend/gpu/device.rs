//! An opened GPU: every command checked, a lost device noticed.

use std::sync::{Arc, Mutex, PoisonError};

use super::adapter::Adapter;
use super::error::GpuError;

/// An opened adapter.
pub(super) struct Device {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    pub(super) limits: wgpu::Limits,
    /// Nanoseconds per tick of the device's clock, if it can be read.
    pub(super) tick: Option<f32>,
    name: String,
    /// Why the device is no good any more.
    failure: Arc<Mutex<Option<String>>>,
}

impl Device {
    pub(super) fn open(adapter: &Adapter) -> Result<Self, GpuError> {
        let name = adapter.name().to_owned();
        let has = adapter.inner.limits();
        // What WebGPU grants everywhere is all that is used, but for the sizes of
        // buffers: the larger these are, the fewer the tiles.
        let base = wgpu::Limits::default();
        require(&name, &base, &has)?;
        let limits = wgpu::Limits {
            max_buffer_size: has.max_buffer_size,
            max_storage_buffer_binding_size: has.max_storage_buffer_binding_size,
            ..base
        };
        let timestamps = adapter.inner.features() & wgpu::Features::TIMESTAMP_QUERY;
        let description = wgpu::DeviceDescriptor {
            label: Some("tamis"),
            required_features: timestamps,
            required_limits: limits.clone(),
            memory_hints: wgpu::MemoryHints::MemoryUsage,
            ..wgpu::DeviceDescriptor::default()
        };
        let opened = pollster::block_on(adapter.inner.request_device(&description));
        let (device, queue) = opened
            .map_err(|error| GpuError::Open { adapter: name.clone(), reason: error.to_string() })?;
        let failure = Arc::new(Mutex::new(None));
        let note = |failure: Arc<Mutex<Option<String>>>| {
            move |reason: String| {
                let mut slot = failure.lock().unwrap_or_else(PoisonError::into_inner);
                slot.get_or_insert(reason);
            }
        };
        let lost = note(failure.clone());
        device.set_device_lost_callback(move |_, reason| lost(reason));
        // The default handler panics.
        let error = note(failure.clone());
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| error(e.to_string())));
        let tick = (!timestamps.is_empty()).then(|| queue.get_timestamp_period());
        Ok(Self { device, queue, limits, tick, name, failure })
    }

    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// Does something with the device and reports what it had against it.
    pub(super) fn checked<T>(
        &self,
        what: &'static str,
        bytes: u64,
        work: impl FnOnce(&wgpu::Device) -> T,
    ) -> Result<T, GpuError> {
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let result = work(&self.device);
        let errors = [validation.pop(), internal.pop(), memory.pop()];
        let error = errors.into_iter().map(pollster::block_on).find_map(|error| error);
        let adapter = self.name.clone();
        self.alive()?;
        match error {
            None => Ok(result),
            Some(wgpu::Error::OutOfMemory { .. }) => {
                Err(GpuError::OutOfMemory { adapter, what, bytes })
            }
            Some(
                wgpu::Error::Validation { description: reason, .. }
                | wgpu::Error::Internal { description: reason, .. },
            ) => Err(GpuError::Refused { adapter, what, reason }),
        }
    }

    /// A buffer of at least the given size.
    pub(super) fn buffer(
        &self,
        what: &'static str,
        bytes: u64,
        usage: wgpu::BufferUsages,
        mapped_at_creation: bool,
    ) -> Result<wgpu::Buffer, GpuError> {
        self.checked(what, bytes, |device| {
            let size = bytes.next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT).max(16);
            let label = Some(what);
            device.create_buffer(&wgpu::BufferDescriptor { label, size, usage, mapped_at_creation })
        })
    }

    /// A buffer that holds some bytes.
    pub(super) fn filled(
        &self,
        what: &'static str,
        contents: &[u8],
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer, GpuError> {
        let buffer = self.buffer(what, contents.len() as u64, usage, true)?;
        if !contents.is_empty() {
            let mut view = buffer
                .slice(..contents.len() as u64)
                .get_mapped_range_mut()
                .map_err(|error| self.lost(&error.to_string()))?;
            view.copy_from_slice(contents);
        }
        buffer.unmap();
        Ok(buffer)
    }

    /// A compute pipeline of a shader's function; its bindings are what the function uses
    /// unless they are given.
    pub(super) fn pipeline(
        &self,
        text: &str,
        function: &str,
        layout: Option<&wgpu::PipelineLayout>,
    ) -> Result<wgpu::ComputePipeline, GpuError> {
        self.checked("the shader", 0, |device| {
            let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some("tamis"),
                source: wgpu::ShaderSource::Wgsl(text.into()),
            });
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some("tamis"),
                layout,
                module: &module,
                entry_point: Some(function),
                compilation_options: wgpu::PipelineCompilationOptions {
                    // Nothing is read from workgroup memory before it is written.
                    zero_initialize_workgroup_memory: false,
                    ..wgpu::PipelineCompilationOptions::default()
                },
                cache: None,
            })
        })
    }

    /// Waits for what was submitted, and for the callbacks that hang on it.
    pub(super) fn wait(&self, submission: wgpu::SubmissionIndex) -> Result<(), GpuError> {
        let wait = wgpu::PollType::Wait { submission_index: Some(submission), timeout: None };
        self.device.poll(wait).map_err(|error| self.lost(&error.to_string()))?;
        self.alive()
    }

    /// The error of a device that does not do what it promised.
    pub(super) fn lost(&self, otherwise: &str) -> GpuError {
        let failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner);
        let reason = failure.clone().unwrap_or_else(|| otherwise.to_owned());
        GpuError::Lost { adapter: self.name.clone(), reason }
    }

    /// A lost device takes commands without complaint. That it is lost is heard of
    /// when it is asked.
    fn alive(&self) -> Result<(), GpuError> {
        let _ = self.device.poll(wgpu::PollType::Poll);
        let failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner);
        match failure.as_ref() {
            None => Ok(()),
            Some(reason) => {
                Err(GpuError::Lost { adapter: self.name.clone(), reason: reason.clone() })
            }
        }
    }
}

/// Checks the limits that shaders and tiles rely on.
fn require(name: &str, base: &wgpu::Limits, has: &wgpu::Limits) -> Result<(), GpuError> {
    let wanted: [(&'static str, u64, u64); 5] = [
        (
            "the number of storage buffers of a shader",
            has.max_storage_buffers_per_shader_stage.into(),
            base.max_storage_buffers_per_shader_stage.into(),
        ),
        (
            "the largest storage binding in bytes",
            has.max_storage_buffer_binding_size,
            base.max_storage_buffer_binding_size,
        ),
        (
            "the number of invocations of a workgroup",
            has.max_compute_invocations_per_workgroup.into(),
            base.max_compute_invocations_per_workgroup.into(),
        ),
        (
            "the memory of a workgroup in bytes",
            has.max_compute_workgroup_storage_size.into(),
            base.max_compute_workgroup_storage_size.into(),
        ),
        (
            "the number of workgroups along an axis",
            has.max_compute_workgroups_per_dimension.into(),
            base.max_compute_workgroups_per_dimension.into(),
        ),
    ];
    for (limit, has, needs) in wanted {
        if has < needs {
            return Err(GpuError::Limits { adapter: name.to_owned(), limit, has, needs });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_adapter_that_is_too_small_is_refused_by_the_limit_that_it_lacks() {
        let base = wgpu::Limits::default();
        assert!(require("card", &base, &base).is_ok());
        let small = wgpu::Limits { max_storage_buffers_per_shader_stage: 4, ..base.clone() };
        let error = require("card", &base, &small).unwrap_err().to_string();
        assert!(error.contains("storage buffers of a shader is 4, at least 8"), "{error}");
        assert!(error.contains("--backend jit"), "{error}");
    }
}
