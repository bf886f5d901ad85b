//! Depth packed into the four bytes of an `rgba8unorm` texture, as three.js of 2022 does with
//! `packDepthToRGBA` and `unpackRGBAToDepth` in its `packing` chunk. For hosts without a bindable
//! depth texture, and for hosts that already have three.js's.
//!
//! With `v` as the depth, a texel holds the base-256 digits of `v`, the first in alpha:
//! `a = floor(256 v)`, `b = floor(256 fract(256 v))` and so on, each as `digit / 255`. The last
//! digit, in red, is rounded. three.js maps a depth of exactly 1 to 255/256; we use the largest
//! number below 1.

use naga::{Binding, BuiltIn, Expression, Scalar, ShaderStage, TypeInner, VectorSize};

use crate::rebuild::depth_only::Placed;
use crate::rebuild::snippet::{InjectError, link_snippet};
use crate::rebuild::{color, place};
use preshade_plan::plan::Attachment;
use preshade_plan::state::{ColorTarget, DepthDirection};

/// Name of the attachment with the packed depth.
pub const PREPASS_PACKED: &str = "prepass-depth-packed";

pub(crate) const FORMAT: &str = "rgba8unorm";

/// Distance between adjacent depths: one unit of the last digit.
pub(crate) const STEP: f32 = 1.0 / 4_294_967_296.0;

/// Weight of each channel (`UnpackFactors`): `255/256 / (256^3, 256^2, 256, 1)`.
pub(crate) const UNPACK: [f32; 4] = [
    255.0 * STEP,
    255.0 / 16_777_216.0,
    255.0 / 65_536.0,
    255.0 / 256.0,
];

/// `depth * (256^3, 256^2, 256, 1)` is exact, and so is everything except the last digit. 256/255
/// is `PackUpscale`.
const PACK: &str = "fn pack_depth(depth: f32) -> vec4<f32> {
    let below_one = clamp(depth, 0.0, 0.99999994);
    let shifted = vec4<f32>(fract(below_one * vec3<f32>(16777216.0, 65536.0, 256.0)), below_one);
    let digits = shifted - vec4<f32>(0.0, shifted.xyz * 0.00390625);
    return digits * 1.0039216;
}
";

/// The bytes that [`PACK`] and an `rgba8unorm` store produce, in the shader's arithmetic.
pub fn stored(depth: f32) -> [u8; 4] {
    let v = depth.clamp(0.0, 0.999_999_94);
    let shifted = [16_777_216.0, 65_536.0, 256.0].map(|factor: f32| (v * factor).fract());
    let [x, y, z] = shifted;
    [x, y - x / 256.0, z - y / 256.0, v - z / 256.0]
        .map(|digit| (digit * 1.003_921_6 * 255.0).round().clamp(0.0, 255.0) as u8)
}

/// The attachment, cleared to the far plane.
pub(crate) fn attachment(direction: DepthDirection) -> Attachment {
    let far = f64::from(direction.clear_depth());
    Attachment::color(PREPASS_PACKED, FORMAT, [far; 4])
}

/// The colour target of the pre-pass.
pub(crate) fn target() -> ColorTarget {
    ColorTarget {
        attachment: Some(PREPASS_PACKED.to_owned()),
        ..ColorTarget::opaque(FORMAT)
    }
}

/// The depth-only program with a fragment stage that also writes the packed depth to location 0.
/// `name` is the entry point's name if there was none.
///
/// # Errors
/// Our own text does not parse or link.
pub(crate) fn write(placed: Placed, name: &str) -> Result<Placed, InjectError> {
    let Placed {
        mut module,
        vertex,
        fragment,
    } = placed;
    let name = fragment.unwrap_or_else(|| {
        module.entry_points.push(color::empty_fragment(name));
        name.to_owned()
    });
    let (module, pack) = link_snippet(module, PACK)?;
    let entry = module
        .entry_points
        .iter()
        .position(|e| e.stage == ShaderStage::Fragment && e.name == name)
        .ok_or_else(|| InjectError(format!("there is no fragment stage `{name}`")))?;
    let result = module.entry_points[entry].function.result.as_ref();
    let depth_type = result.map(|r| r.ty);
    let mut position = None;
    let mut module = place::prologue(&module, entry, |build| {
        if depth_type.is_none() {
            let vec4 = build.ty(TypeInner::Vector {
                size: VectorSize::Quad,
                scalar: Scalar::F32,
            });
            position = Some(build.input(
                "position",
                vec4,
                &Binding::BuiltIn(BuiltIn::Position { invariant: false }),
            ));
        }
    });
    // Packs the `frag_depth`, or else the position's depth.
    let names = ["PackedDepth", "packed_depth"];
    color::return_color(
        &mut module,
        entry,
        names,
        depth_type,
        &mut |writer, _, written| {
            let depth = match (written, position) {
                (Some(depth), _) => depth,
                (None, base) => writer.expression(Expression::AccessIndex {
                    base: base?,
                    index: 2,
                }),
            };
            Some((writer.call(pack, vec![depth]), Some(depth)))
        },
    );
    Ok(Placed {
        module,
        vertex,
        fragment: Some(name),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unpacked(texel: [u8; 4]) -> f32 {
        let products = texel.iter().zip(UNPACK);
        products
            .map(|(b, factor)| f32::from(*b) / 255.0 * factor)
            .sum()
    }

    #[test]
    fn digits_are_those_of_base_256() {
        assert_eq!(stored(0.0), [0, 0, 0, 0]);
        assert_eq!(stored(0.5), [0, 0, 0, 128]);
        assert_eq!(stored(1.0 / 256.0), [0, 0, 0, 1]);
        assert_eq!(stored(258.0 / 65_536.0), [0, 0, 2, 1]);
        assert_eq!(stored(1.0), [0, 255, 255, 255]);
    }

    #[test]
    fn unpacking_stays_within_what_the_tolerance_allows() {
        for i in 0..=100_000_u32 {
            // Steps that match neither the digits nor the binades.
            let depth = (i as f32 / 100_000.0).powf(3.7);
            let error = (unpacked(stored(depth)) - depth).abs();
            let allowed = depth * f32::EPSILON * 4.0 + 2.0 * STEP;
            assert!(error <= allowed, "{depth}: {error} of {allowed}");
        }
    }
}
