//! Finds uniforms that change from frame to frame. Reads the scene's frames and needs no adapter.
//!
//! A host moves its camera and runs its clock even if the scene's camera stands still. So
//! everything that follows the view or the time counts as changing.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::{Mat4, Vec3};
use naga::TypeInner;
use preshade_plan::pass::Changing;
use preshade_plan::plan::BindingKind;

use super::originals;
use preshade_draw::scene::{Frame, Material, Scene, SceneError, bind};

/// The bytes of uniforms, by group and binding.
type Buffers = BTreeMap<(u32, u32), Arc<[u8]>>;

/// The uniforms, or their members, whose bytes differ between frames in any draw of the material.
/// Besides the frames of all cameras, one frame from another place at another time is compared.
///
/// # Errors
///
/// A value that does not fit its variable.
pub fn changing(scene: &Scene) -> Result<Vec<Changing>, SceneError> {
    let plans = originals(scene);
    let mut found = BTreeSet::new();
    for draw in &scene.draws {
        let (Some(material), Some(plan)) =
            (scene.materials.get(draw.material), plans.get(draw.material))
        else {
            continue;
        };
        let Some(pass) = plan.main() else { continue };
        if draw.captured.is_some() {
            // One frame does not show which values the next one changes.
            let uniforms = pass.bindings.iter();
            let uniforms = uniforms.filter(|b| b.kind == BindingKind::Uniform);
            found.extend(uniforms.map(|b| Changing {
                material: material.name.clone(),
                group: b.group,
                binding: b.binding,
                member: None,
            }));
            continue;
        }
        let buffers = |frame| -> Result<Buffers, SceneError> {
            let of_frame = bind::frame_buffers(scene, material, pass, draw, frame)?;
            let bytes = of_frame.into_iter();
            Ok(bytes
                .map(|b| ((b.group, b.binding), b.data.bytes))
                .collect())
        };
        let mut first: Option<Buffers> = None;
        let moved = scene.frames().next().map(|(_, frame)| moved(frame));
        let frames = scene.frames().map(|(_, frame)| frame);
        for frame in frames.chain(&moved) {
            let now = buffers(frame)?;
            let Some(first) = &first else {
                first = Some(now);
                continue;
            };
            for (at, bytes) in &now {
                let before = first.get(at).map_or(&[][..], |b| b);
                found.extend(differing(material, *at, before, bytes));
            }
        }
    }
    Ok(found.into_iter().collect())
}

/// The frame at another time, from another place, through another lens.
fn moved(frame: &Frame) -> Frame {
    let aside = Vec3::new(0.37, 0.61, 0.83);
    Frame {
        view: Mat4::from_rotation_y(0.7)
            * Mat4::from_rotation_x(0.4)
            * frame.view
            * Mat4::from_translation(-aside),
        projection: frame.projection * Mat4::from_scale(Vec3::new(0.9, 0.8, 1.1)),
        eye: frame.eye + aside,
        time: frame.time + 1.0,
    }
}

/// The parts of one uniform that differ between two contents.
fn differing(
    material: &Material,
    (group, binding): (u32, u32),
    before: &[u8],
    now: &[u8],
) -> Vec<Changing> {
    if before == now {
        return Vec::new();
    }
    let module = material.program.module();
    let changed = |member: Option<String>| Changing {
        material: material.name.clone(),
        group,
        binding,
        member,
    };
    let is_it = |g: &&naga::GlobalVariable| {
        let at = g.binding.map(|b| (b.group, b.binding));
        at == Some((group, binding))
    };
    let variable = module.global_variables.iter().map(|(_, g)| g).find(is_it);
    let Some(TypeInner::Struct { members, span }) = variable.map(|g| &module.types[g.ty].inner)
    else {
        return vec![changed(None)];
    };
    let ends = members.iter().skip(1).map(|m| m.offset).chain([*span]);
    members
        .iter()
        .zip(ends)
        .filter(|(member, end)| {
            let bytes = member.offset as usize..*end as usize;
            before.get(bytes.clone()) != now.get(bytes)
        })
        .map(|(member, _)| changed(member.name.clone()))
        .collect()
}
