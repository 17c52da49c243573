//! The buffers that tiles pass through, two sets of them: while the GPU works on
//! one tile, the next is packed and the one before is read back.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, PoisonError};

use super::device::Device;
use super::error::GpuError;

/// Tiles that are under way at a time, of whatever frames. Memory limits are met
/// by this many sets of buffers.
pub(super) const SLOTS: u64 = 2;

/// Bytes that a tile needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Needs {
    pub(super) near: u64,
    pub(super) own: u64,
    pub(super) result: u64,
    /// What counts pixels that kept what was to be averaged.
    pub(super) kept: u64,
}

/// Where `own` begins behind `near`, and counts and two timestamps behind the result, in the
/// buffers that are copied from and to.
const ALIGN: u64 = wgpu::QUERY_RESOLVE_BUFFER_ALIGNMENT;
pub(super) const TIMESTAMPS: u64 = 2 * size_of::<u64>() as u64;

impl Needs {
    /// Where `own` begins in the buffer for uploading.
    pub(super) fn own_start(&self) -> u64 {
        self.near.next_multiple_of(ALIGN)
    }

    /// The size of the buffer for uploading.
    pub(super) fn upload(&self) -> u64 {
        self.own_start() + self.own
    }

    /// Where the counts begin in the buffer for reading back.
    pub(super) fn kept_start(&self) -> u64 {
        self.result.next_multiple_of(ALIGN)
    }

    /// Where the timestamps begin in it.
    pub(super) fn timestamps_start(&self) -> u64 {
        (self.kept_start() + self.kept).next_multiple_of(ALIGN)
    }

    /// The size of the buffer for reading back.
    pub(super) fn back(&self) -> u64 {
        self.timestamps_start() + TIMESTAMPS
    }

    /// All of a slot's buffers.
    pub(super) fn total(&self) -> u64 {
        self.upload() + self.near + self.own + self.result + self.kept + self.back() + ALIGN
    }

    fn covers(&self, other: &Self) -> bool {
        self.near >= other.near
            && self.own >= other.own
            && self.result >= other.result
            && self.kept >= other.kept
            && self.upload() >= other.upload()
            && self.back() >= other.back()
    }
}

/// A set of buffers.
pub(super) struct Slot {
    holds: Needs,
    /// Mapped, except while the GPU copies from it.
    pub(super) upload: wgpu::Buffer,
    pub(super) near: wgpu::Buffer,
    pub(super) own: wgpu::Buffer,
    pub(super) result: wgpu::Buffer,
    pub(super) kept: wgpu::Buffer,
    pub(super) back: wgpu::Buffer,
    /// Two timestamps, and where they are resolved, if the device has a clock.
    pub(super) clock: Option<(wgpu::QuerySet, wgpu::Buffer)>,
}

impl Slot {
    pub(super) fn new(device: &Device, needs: Needs) -> Result<Self, GpuError> {
        use wgpu::BufferUsages as Usage;
        let upload = device.buffer(
            "uploading a tile",
            needs.upload(),
            Usage::MAP_WRITE | Usage::COPY_SRC,
            true,
        )?;
        let inputs = Usage::STORAGE | Usage::COPY_DST;
        let near = device.buffer("a tile's planes", needs.near, inputs, false)?;
        let own = device.buffer("a tile's planes", needs.own, inputs, false)?;
        let outputs = Usage::STORAGE | Usage::COPY_SRC;
        let result = device.buffer("a tile's result", needs.result, outputs, false)?;
        let counts = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST;
        let kept = device.buffer("a tile's counts", needs.kept, counts, false)?;
        let back = device.buffer(
            "reading a tile back",
            needs.back(),
            Usage::MAP_READ | Usage::COPY_DST,
            false,
        )?;
        let clock = match device.tick {
            None => None,
            Some(_) => {
                let queries = device.checked("a clock", 0, |device| {
                    device.create_query_set(&wgpu::QuerySetDescriptor {
                        label: None,
                        ty: wgpu::QueryType::Timestamp,
                        count: 2,
                    })
                })?;
                let usage = Usage::QUERY_RESOLVE | Usage::COPY_SRC;
                Some((queries, device.buffer("a clock", TIMESTAMPS, usage, false)?))
            }
        };
        Ok(Self { holds: needs, upload, near, own, result, kept, back, clock })
    }

    /// Begins a pass over a tile, of whose passes it is the first, the last, both or neither.
    pub(super) fn pass<'e>(
        &self,
        encoder: &'e mut wgpu::CommandEncoder,
        is_first: bool,
        is_last: bool,
    ) -> wgpu::ComputePass<'e> {
        let clock = self.clock.as_ref();
        let timestamps = clock.map(|(queries, _)| wgpu::ComputePassTimestampWrites {
            query_set: queries,
            beginning_of_pass_write_index: is_first.then_some(0),
            end_of_pass_write_index: is_last.then_some(1),
        });
        encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: None,
            // A pass that writes no timestamp may not say that it does.
            timestamp_writes: timestamps.filter(|_| is_first || is_last),
        })
    }

    /// Copies what is read back behind the last pass.
    pub(super) fn read_back(&self, encoder: &mut wgpu::CommandEncoder, needs: Needs) {
        encoder.copy_buffer_to_buffer(&self.result, 0, &self.back, 0, needs.result);
        if needs.kept > 0 {
            let start = needs.kept_start();
            encoder.copy_buffer_to_buffer(&self.kept, 0, &self.back, start, needs.kept);
        }
        if let Some((queries, resolved)) = &self.clock {
            let start = needs.timestamps_start();
            encoder.resolve_query_set(queries, 0..2, resolved, 0);
            encoder.copy_buffer_to_buffer(resolved, 0, &self.back, start, TIMESTAMPS);
        }
    }

    /// Writes what is uploaded, and unmaps it.
    pub(super) fn fill(
        &self,
        device: &Device,
        needs: Needs,
        write: impl FnOnce(wgpu::WriteOnly<'_, [u8]>),
    ) -> Result<(), GpuError> {
        {
            let range = self.upload.slice(..needs.upload());
            let view = range.get_mapped_range_mut();
            let mut view = view.map_err(|error| device.lost(&error.to_string()))?;
            write(view.slice(..));
        }
        self.upload.unmap();
        Ok(())
    }
}

/// The slots of a device.
#[derive(Default)]
pub(super) struct Slots {
    state: Mutex<State>,
    given_back: Condvar,
}

#[derive(Default)]
struct State {
    free: VecDeque<Slot>,
    leased: u64,
}

/// A slot in use. Unless it is given back whole, its buffers are dropped.
pub(super) struct Lease<'a> {
    slots: &'a Slots,
    slot: Option<Slot>,
}

impl Slots {
    /// A slot for a tile. If all are in use, waits for one, or returns `None` if
    /// the caller has one itself and would wait for ever.
    pub(super) fn lease(
        &self,
        device: &Device,
        needs: Needs,
        may_wait: bool,
    ) -> Result<Option<Lease<'_>>, GpuError> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        while state.leased == SLOTS {
            if !may_wait {
                return Ok(None);
            }
            state = self.given_back.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        state.leased += 1;
        let fitting = state.free.iter().position(|slot| slot.holds.covers(&needs));
        // A slot that is too small makes room for the one that is made now.
        let slot = match fitting {
            Some(k) => state.free.remove(k),
            None => {
                state.free.pop_front();
                None
            }
        };
        drop(state);
        let mut lease = Lease { slots: self, slot };
        if lease.slot.is_none() {
            lease.slot = Some(Slot::new(device, needs)?);
        }
        Ok(Some(lease))
    }
}

impl Lease<'_> {
    pub(super) fn slot(&self) -> &Slot {
        self.slot.as_ref().expect("a lease has its slot until it ends")
    }

    /// Ends the lease of a slot that can be used again: its buffer for uploading is
    /// mapped and its buffer for reading back is not.
    pub(super) fn give_back(mut self) {
        let slot = self.slot.take();
        let mut state = self.slots.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.free.extend(slot);
    }
}

impl Drop for Lease<'_> {
    fn drop(&mut self) {
        let mut state = self.slots.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.leased -= 1;
        self.slots.given_back.notify_one();
    }
}
