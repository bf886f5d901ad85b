//! Texels of a scene's images for the interpreter: level 0, as WebGPU filters it. A vertex stage
//! names the level, which is 0 nearly always.

use naga_interp::Lookup;

use preshade_draw::scene::bind::{DrawBindings, TextureContent};
use preshade_draw::scene::{Address, Filter, Image, Sampler};

/// The texel of a lookup; NaN where there is no image of two
/// dimensions, and where its format is compressed.
pub(crate) fn texel(bound: &DrawBindings, lookup: &Lookup<'_>) -> [f32; 4] {
    let nothing = [f32::NAN; 4];
    let texture = bound
        .textures
        .iter()
        .find(|t| Some((t.group, t.binding)) == lookup.binding);
    let Some(TextureContent::Image(image)) = texture.map(|t| &t.content) else {
        return nothing;
    };
    let &[u, v, ..] = lookup.coordinates else {
        return nothing;
    };
    if image.layers != 1 {
        return nothing;
    }
    let Some(sampler) = lookup.sampling.sampler else {
        return at(image, [u as i64, v as i64], [Address::ClampToEdge; 2]);
    };
    let is_it = |s: &&preshade_draw::scene::bind::SamplerBinding| (s.group, s.binding) == sampler;
    let sampler = bound.samplers.iter().find(is_it).map(|s| s.sampler);
    filtered(
        image,
        [u, v],
        lookup.sampling.offset,
        sampler.unwrap_or_default(),
    )
}

fn filtered(image: &Image, uv: [f32; 2], offset: [i32; 3], sampler: Sampler) -> [f32; 4] {
    let place = |i: usize| f64::from(uv[i]) * f64::from(image.size[i]) + f64::from(offset[i]);
    let addresses = [
        sampler.address,
        sampler.address_v.unwrap_or(sampler.address),
    ];
    let texel = |x: f64, y: f64| at(image, [x as i64, y as i64], addresses);
    if sampler.filter == Filter::Nearest {
        return texel(place(0).floor(), place(1).floor());
    }
    let [x, y] = [place(0) - 0.5, place(1) - 0.5];
    let (left, top) = (x.floor(), y.floor());
    let [right, bottom] = [x - left, y - top].map(|part| part as f32);
    let mix = |a: [f32; 4], b: [f32; 4], part: f32| -> [f32; 4] {
        std::array::from_fn(|i| a[i] + (b[i] - a[i]) * part)
    };
    let row = |y: f64| mix(texel(left, y), texel(left + 1.0, y), right);
    mix(row(top), row(top + 1.0), bottom)
}

fn at(image: &Image, place: [i64; 2], addresses: [Address; 2]) -> [f32; 4] {
    let inside = |i: usize| {
        let size = i64::from(image.size[i]);
        let wrapped = match addresses[i] {
            Address::Repeat => place[i].rem_euclid(size),
            Address::ClampToEdge => place[i].clamp(0, size - 1),
            Address::MirrorRepeat => {
                let at = place[i].rem_euclid(2 * size);
                at.min(2 * size - 1 - at)
            }
        };
        wrapped as usize
    };
    let texel = image.texels();
    let texel = texel.and_then(|t| t.at(0, [inside(0) as u32, inside(1) as u32, 0]));
    texel.unwrap_or([f32::NAN; 4])
}
