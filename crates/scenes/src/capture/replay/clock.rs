//! Measures commands with the GPU's own clock.

use crate::capture::Error;
use preshade_draw::render::Gpu;

/// Two timestamps, and the buffers to read them through.
pub(super) struct Clock {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    read: wgpu::Buffer,
}

/// Bytes of two timestamps.
const SIZE: u64 = 16;

impl Clock {
    /// `None` on adapters without timestamps. Also `None` on software adapters, whose timestamps
    /// are meaningless.
    pub fn new(gpu: &Gpu) -> Result<Option<Self>, Error> {
        if !gpu.has_timestamps() || gpu.adapter().kind == "software" {
            return Ok(None);
        }
        let buffer = |usage| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("timestamps"),
                size: SIZE,
                usage,
                mapped_at_creation: false,
            })
        };
        let made = gpu.checked("timestamps", || Self {
            queries: gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timestamps"),
                ty: wgpu::QueryType::Timestamp,
                count: 2,
            }),
            resolved: buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC),
            read: buffer(wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ),
        })?;
        Ok(Some(made))
    }

    pub fn start(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.write_timestamp(&self.queries, 0);
    }

    pub fn stop(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.write_timestamp(&self.queries, 1);
        encoder.resolve_query_set(&self.queries, 0..2, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.read, 0, SIZE);
    }

    /// Seconds from start to stop, once the commands were submitted.
    pub fn seconds(&self, gpu: &Gpu) -> Result<f64, Error> {
        let bytes = gpu.read_buffer(&self.read)?;
        let mut ticks = bytes.as_chunks::<8>().0.iter();
        let mut next = || ticks.next().map_or(0, |b| u64::from_le_bytes(*b));
        let (start, stop) = (next(), next());
        let period = f64::from(gpu.queue.get_timestamp_period());
        Ok(stop.saturating_sub(start) as f64 * period * 1e-9)
    }
}
