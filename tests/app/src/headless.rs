//! Both pictures, and whether they are the same.

use crate::grove::{Grove, Variant, device};
use crate::leaf::{self, Attachment, Pass, PipelineOptions, SelfTest, Tested};

const SIZE: wgpu::Extent3d = wgpu::Extent3d {
    width: 256,
    height: 256,
    depth_or_array_layers: 1,
};

/// Draws, compares and tells; an error where a pixel differs or a self-test fails.
pub fn run() -> Result<(), Box<dyn std::error::Error>> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let (adapter, device, queue) = pollster::block_on(device(&instance, None))?;
    println!("adapter {}", adapter.get_info().name);
    let grove = Grove::new(&device, &queue);
    grove.set_time(&queue, 0.7);
    let picture =
        |passes: &[&'static Pass], attachments| -> Result<Vec<u8>, Box<dyn std::error::Error>> {
            let variant = Variant::new(
                &device,
                &grove,
                passes,
                attachments,
                SIZE,
                &PipelineOptions::default(),
            )?;
            draw(&device, &queue, &grove, &variant)
        };
    let original = picture(leaf::original::PASSES, leaf::original::ATTACHMENTS)?;
    let covered = original
        .chunks_exact(4)
        .filter(|p| p[..3] != original[..3])
        .count();
    println!("original: {covered} pixels of leaves");
    type Made = (
        &'static str,
        &'static [&'static Pass],
        &'static [Attachment],
        &'static Option<SelfTest>,
    );
    let variants: [Made; 2] = [
        (
            leaf::RECIPE,
            leaf::PASSES,
            leaf::ATTACHMENTS,
            &leaf::SELF_TEST,
        ),
        (
            leaf::early_discard::RECIPE,
            leaf::early_discard::PASSES,
            leaf::early_discard::ATTACHMENTS,
            &leaf::early_discard::SELF_TEST,
        ),
    ];
    let mut broken = false;
    for (recipe, passes, attachments, test) in variants {
        let variant = picture(passes, attachments)?;
        let pixels = original.chunks_exact(4).zip(variant.chunks_exact(4));
        let changed = pixels.filter(|(a, b)| a != b).count();
        let test = match test {
            None => "none".to_owned(),
            Some(test) => {
                let mut draw = |pass: &Pass,
                                view: &dyn Fn(&str) -> Option<wgpu::TextureView>,
                                render: &mut wgpu::RenderPass<'_>| {
                    grove.draw(render, &grove.bind(&device, pass, view));
                };
                let tested = test.run(&device, &queue, SIZE, &[leaf::INTERLEAVED], &mut draw)?;
                // As a host that cannot wait: nothing is known before the device has been at it.
                let options = PipelineOptions::default();
                let pending = test.begin(
                    &device,
                    &queue,
                    SIZE,
                    &[leaf::INTERLEAVED],
                    &options,
                    &mut draw,
                )?;
                let at_once = pending.judge();
                device.poll(wgpu::PollType::wait_indefinitely())?;
                broken |=
                    tested != Tested::Held || at_once.is_some() || pending.judge() != Some(tested);
                format!("{tested:?}")
            }
        };
        println!(
            "{recipe}: {} passes, {changed} pixels changed, self-test {test}",
            passes.len()
        );
        broken |= changed > 0 || passes.len() < 2;
    }
    // A variant for still air holds for one time alone: `CHOICES` are made at load, and the frame's
    // own bytes choose.
    for time in [0.0, 0.7] {
        let bytes = grove.set_time(&queue, time);
        let chosen = leaf::still::variant_for(&[], |group, binding| {
            ((group, binding) == (0, 0)).then_some(&bytes[..])
        });
        let still = picture(chosen.passes, chosen.attachments)?;
        let original = picture(leaf::original::PASSES, leaf::original::ATTACHMENTS)?;
        let is_original = chosen.guard.is_empty();
        println!(
            "time {time}: {}, as the original: {}",
            chosen.recipe,
            still == original
        );
        broken |= still != original || is_original != (time != 0.0);
    }
    match broken || covered == 0 {
        true => Err("a variant is not the original".into()),
        false => Ok(()),
    }
}

fn draw(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    grove: &Grove,
    variant: &Variant,
) -> Result<Vec<u8>, Box<dyn std::error::Error>> {
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: SIZE,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Bgra8Unorm,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let read = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(SIZE.width * SIZE.height * 4),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    variant.draw(
        &mut encoder,
        grove,
        &texture.create_view(&Default::default()),
    );
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(SIZE.width * 4),
        rows_per_image: None,
    };
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo {
            buffer: &read,
            layout,
        },
        SIZE,
    );
    queue.submit([encoder.finish()]);
    read.map_async(wgpu::MapMode::Read, .., |_| ());
    device.poll(wgpu::PollType::wait_indefinitely())?;
    Ok(read.get_mapped_range(..)?.to_vec())
}
