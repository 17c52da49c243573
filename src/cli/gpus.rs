//! `tamis gpus`: the GPUs of this computer.

use clap::Args;

use super::error::Error;

const EXAMPLES: &str = "\
Examples:
  tamis gpus
  tamis denoise render.exr -o clean.exr --backend gpu --gpu 1

The first is what `--backend gpu` uses. BINDING is the largest buffer that a shader
sees; larger images are filtered in tiles.";

/// List the GPUs of this computer.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Gpus {
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[cfg(not(feature = "gpu"))]
impl Gpus {
    pub(super) fn run(&self) -> Result<String, Error> {
        let _ = self.json;
        Err(Error::NoGpu)
    }
}

#[cfg(feature = "gpu")]
#[derive(serde::Serialize)]
struct Entry {
    index: usize,
    name: String,
    kind: crate::backend::gpu::Kind,
    api: &'static str,
    driver: String,
    max_buffer_bytes: u64,
    max_binding_bytes: u64,
    storage_buffers: u32,
    workgroup_memory_bytes: u32,
    timestamps: bool,
}

#[cfg(feature = "gpu")]
impl Gpus {
    pub(super) fn run(&self) -> Result<String, Error> {
        use crate::backend::BackendError;
        use crate::backend::gpu::{GpuError, adapters};
        use crate::report::score::json;
        use crate::report::{Align, Format, Table};

        let entries: Vec<Entry> = adapters()
            .iter()
            .enumerate()
            .map(|(index, adapter)| Entry {
                index,
                name: adapter.name().to_owned(),
                kind: adapter.kind(),
                api: adapter.api(),
                driver: adapter.driver(),
                max_buffer_bytes: adapter.max_buffer(),
                max_binding_bytes: adapter.max_binding(),
                storage_buffers: adapter.max_bindings(),
                workgroup_memory_bytes: adapter.workgroup_memory(),
                timestamps: adapter.has_timestamps(),
            })
            .collect();
        if self.json {
            return Ok(json(&entries));
        }
        if entries.is_empty() {
            return Err(BackendError::from(GpuError::NoAdapter).into());
        }
        let mut table = Table::new([
            ("#", Align::Right),
            ("NAME", Align::Left),
            ("KIND", Align::Left),
            ("THROUGH", Align::Left),
            ("DRIVER", Align::Left),
            ("BUFFER", Align::Right),
            ("BINDING", Align::Right),
            ("BUFFERS", Align::Right),
            ("SHARED", Align::Right),
            ("CLOCK", Align::Left),
        ]);
        let bytes = |bytes: u64| bytesize::ByteSize(bytes).to_string();
        for entry in entries {
            table.row([
                entry.index.to_string(),
                entry.name,
                entry.kind.name().to_owned(),
                entry.api.to_owned(),
                entry.driver,
                bytes(entry.max_buffer_bytes),
                bytes(entry.max_binding_bytes),
                entry.storage_buffers.to_string(),
                bytes(entry.workgroup_memory_bytes.into()),
                if entry.timestamps { "yes" } else { "no" }.to_owned(),
            ]);
        }
        Ok(table.render(Format::Plain))
    }
}
