//! The draws of a scene in the frame before.

use std::collections::BTreeSet;

use glam::{Mat4, Vec3};
use preshade_plan::plan::Plan;

use super::{Variant, pass_of};
use preshade_draw::scene::bind::{self, DrawBindings};
use preshade_draw::scene::{Draw, Frame, Scene, Stream};

/// The draws a little earlier: moved, turned, bent and with another blend, and each instance too. A
/// draw makes those of these changes that `allows` accepts: it gets the draw without the change and
/// with it.
pub fn earlier(scene: &Scene, allows: &dyn Fn(&Draw, &Draw) -> bool) -> Scene {
    let try_change = |draw: &mut Draw, change: &dyn Fn(&mut Draw)| {
        let mut next = draw.clone();
        change(&mut next);
        if allows(draw, &next) {
            *draw = next;
        }
    };
    let mut earlier = scene.clone();
    for draw in &mut earlier.draws {
        for change in [moved, bent, blended] {
            try_change(draw, &change);
        }
        let names: Vec<String> = draw.instance_streams.keys().cloned().collect();
        for name in names {
            try_change(draw, &|draw| instances_moved(draw, &name));
        }
    }
    earlier
}

/// Whether a variant allows the change of a draw: it takes no changing buffer as static, and it
/// copies each attribute that changes. Both come from the recipe, so they are not checked.
pub fn allowed(
    scene: &Scene,
    originals: &[Plan],
    variant: &Variant,
    before: &Draw,
    now: &Draw,
) -> bool {
    let Some(frame) = scene.frames().next().map(|(_, frame)| frame) else {
        return false;
    };
    let (Some(material), Some(plan), Some(original)) = (
        scene.materials.get(now.material),
        variant.plans.get(now.material),
        originals.get(now.material),
    ) else {
        return false;
    };
    let (Some(pass), Some(main)) = (pass_of(plan), original.main()) else {
        return false;
    };
    let bound = |draw: &Draw, frame: &Frame| bind::draw(scene, material, main, draw, frame).ok();
    let (Some(before), Some(now)) = (bound(before, frame), bound(now, frame)) else {
        return false;
    };
    let copied: BTreeSet<u32> = pass
        .attributes
        .iter()
        .filter_map(|a| a.previous_of)
        .collect();
    let still = still(plan);
    let is_still = |at: (u32, u32)| {
        let mut globals = material.program.module().global_variables.iter();
        let variable = globals.find(|(_, g)| g.binding.map(|b| (b.group, b.binding)) == Some(at));
        let name = variable.and_then(|(_, g)| g.name.as_deref());
        let number = format!("{}:{}", at.0, at.1);
        still
            .iter()
            .any(|s| Some(s.as_str()) == name || *s == number)
    };
    let mut buffers = before.buffers.iter().zip(&now.buffers);
    attributes(&before, &now).is_subset(&copied)
        && buffers.all(|(a, b)| a.data.bytes == b.data.bytes || !is_still((a.group, a.binding)))
}

/// The buffers that a recipe calls static.
fn still(plan: &Plan) -> Vec<String> {
    let steps = plan.steps.iter();
    let words = steps.filter_map(|step| step.params.get("static")?.as_str());
    let words = words.flat_map(|text| text.split('+'));
    words.map(|word| word.trim().to_owned()).collect()
}

/// The locations of attributes that differ.
fn attributes(before: &DrawBindings, now: &DrawBindings) -> BTreeSet<u32> {
    let mut found = BTreeSet::new();
    for (a, b) in before.vertex_buffers.iter().zip(&now.vertex_buffers) {
        for attribute in &a.attributes {
            let start = attribute.offset as usize;
            let bytes = start..start + attribute.format.size() as usize;
            let elements = |of: &[u8]| -> Vec<Vec<u8>> {
                let all = of.chunks(a.stride.max(1) as usize);
                all.filter_map(|e| Some(e.get(bytes.clone())?.to_vec()))
                    .collect()
            };
            if elements(&a.data.bytes) != elements(&b.data.bytes) {
                found.insert(attribute.location);
            }
        }
    }
    found
}

fn moved(draw: &mut Draw) {
    let aside = Mat4::from_translation(Vec3::new(0.03, -0.02, 0.04));
    draw.transform = aside * draw.transform * Mat4::from_rotation_y(0.02);
}

fn bent(draw: &mut Draw) {
    let mut turn = Mat4::IDENTITY;
    let joints = draw.joints.iter().map(|joint| {
        turn *= Mat4::from_rotation_z(0.03);
        *joint * turn
    });
    draw.joints = joints.collect();
}

fn blended(draw: &mut Draw) {
    for weight in &mut draw.morph_weights {
        *weight *= 0.9;
    }
}

/// Moves each instance: a matrix by its last column, another value as a whole.
fn instances_moved(draw: &mut Draw, name: &str) {
    let Some(Stream::Float { components, data }) = draw.instance_streams.get_mut(name) else {
        return;
    };
    let changed = match *components {
        16 => 12..13,
        all => 0..all as usize,
    };
    for instance in data.chunks_mut(*components as usize) {
        for value in &mut instance[changed.clone()] {
            *value += 0.04;
        }
    }
}
