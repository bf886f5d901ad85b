//! Depth packed into the four bytes of an `rgba8unorm` texture, as three.js of 2022 does with
//! `packDepthToRGBA` and `unpackRGBAToDepth` in its `packing` chunk. For hosts without a bindable
//! depth texture, and for hosts that already have three.js's.
//!
//! With `v` as the depth, a texel holds the base-256 digits of `v`, the first in alpha:
//! `a = floor(256 v)`, `b = floor(256 fract(256 v))` and so on, each as `digit / 255`. The last
//! digit, in red, is rounded. three.js maps a depth of exactly 1 to 255/256; we use the largest
//! number below 1.

use naga::{
    Binding, BuiltIn, EntryPoint, Expression, Function, FunctionResult, Handle, Module, Scalar,
    ShaderStage, Span, StructMember, Type, TypeInner, VectorSize,
};

use crate::core::plan::{Attachment, AttachmentFormat, ClearValue};
use crate::core::state::{ColorTarget, DepthDirection};
use crate::rebuild::depth_only::Placed;
use crate::rebuild::place;
use crate::rebuild::returns;
use crate::rebuild::snippet::{InjectError, link_snippet};

/// Name of the attachment with the packed depth.
pub const PREPASS_PACKED: &str = "prepass-depth-packed";

/// Format of that attachment.
pub const FORMAT: &str = "rgba8unorm";

/// Distance between adjacent depths: one unit of the last digit.
pub const STEP: f32 = 1.0 / 4_294_967_296.0;

/// Weight of each channel (`UnpackFactors`): `255/256 / (256^3, 256^2, 256, 1)`.
pub const UNPACK: [f32; 4] = [
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
pub fn attachment(direction: DepthDirection) -> Attachment {
    Attachment {
        name: PREPASS_PACKED.to_owned(),
        format: AttachmentFormat::Color(FORMAT.to_owned()),
        samples: 1,
        sampled: true,
        clear: ClearValue::Color([f64::from(direction.clear_depth()); 4]),
    }
}

/// The colour target of the pre-pass.
pub fn target() -> ColorTarget {
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
pub fn write(placed: Placed, name: &str) -> Result<Placed, InjectError> {
    let Placed {
        mut module,
        vertex,
        fragment,
    } = placed;
    let name = fragment.unwrap_or_else(|| {
        module.entry_points.push(empty_fragment(name));
        name.to_owned()
    });
    let (module, pack) = link_snippet(module, PACK)?;
    let entry = module
        .entry_points
        .iter()
        .position(|e| e.stage == ShaderStage::Fragment && e.name == name)
        .ok_or_else(|| InjectError(format!("there is no fragment stage `{name}`")))?;
    let writes_depth = module.entry_points[entry].function.result.is_some();
    let mut position = None;
    let mut module = place::prologue(&module, entry, |build| {
        if !writes_depth {
            let vec4 = build.ty(VEC4);
            position = Some(build.input(
                "position",
                vec4,
                &Binding::BuiltIn(BuiltIn::Position { invariant: false }),
            ));
        }
    });
    add_target(&mut module, entry, pack, position);
    Ok(Placed {
        module,
        vertex,
        fragment: Some(name),
    })
}

const VEC4: TypeInner = TypeInner::Vector {
    size: VectorSize::Quad,
    scalar: Scalar::F32,
};

fn empty_fragment(name: &str) -> EntryPoint {
    EntryPoint {
        name: name.to_owned(),
        stage: ShaderStage::Fragment,
        early_depth_test: None,
        workgroup_size: [0; 3],
        workgroup_size_overrides: None,
        function: Function::default(),
        mesh_info: None,
        task_payload: None,
        incoming_ray_payload: None,
    }
}

/// Makes an entry point return `pack` of its depth at location 0: of its `frag_depth`, or of the
/// position's depth.
fn add_target(
    module: &mut Module,
    entry: usize,
    pack: Handle<Function>,
    position: Option<Handle<Expression>>,
) {
    let unnamed = |inner| Type { name: None, inner };
    let vec4 = module.types.insert(unnamed(VEC4), Span::UNDEFINED);
    let color = Binding::Location {
        location: 0,
        interpolation: None,
        sampling: None,
        blend_src: None,
        per_primitive: false,
    };
    let depth = module.entry_points[entry].function.result.as_ref();
    let with_depth = depth.map(|depth| depth.ty).map(|depth| {
        let member = |name: &str, ty, binding, offset| StructMember {
            name: Some(name.to_owned()),
            ty,
            binding: Some(binding),
            offset,
        };
        let members = vec![
            member("packed_depth", vec4, color.clone(), 0),
            member("depth", depth, Binding::BuiltIn(BuiltIn::FragDepth), 16),
        ];
        module.types.insert(
            Type {
                name: Some("PackedDepth".to_owned()),
                inner: TypeInner::Struct { members, span: 32 },
            },
            Span::UNDEFINED,
        )
    });
    let function = &mut module.entry_points[entry].function;
    function.result = Some(match with_depth {
        Some(ty) => FunctionResult { ty, binding: None },
        None => FunctionResult {
            ty: vec4,
            binding: Some(color),
        },
    });
    returns::rewrite(function, &mut |writer, written| {
        let depth = match (written, position) {
            (Some(depth), _) => depth,
            (None, Some(base)) => writer.expression(Expression::AccessIndex { base, index: 2 }),
            (None, None) => return None,
        };
        let packed = writer.call(pack, vec![depth]);
        Some(match with_depth {
            Some(ty) => writer.expression(Expression::Compose {
                ty,
                components: vec![packed, depth],
            }),
            None => packed,
        })
    });
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
