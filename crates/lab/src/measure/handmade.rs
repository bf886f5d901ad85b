//! Scenes of our own: one material, whose shaders need nothing of a scene, before one camera.

use std::collections::BTreeMap;

use preshade_compiler::front::Parsed;
use preshade_draw::scene::{Camera, Draw, DrawOrder, Frame, Material, Mesh, Scene};
use preshade_plan::state::MaterialState;

pub fn material(name: &str, parsed: Parsed, state: MaterialState) -> Material {
    Material {
        name: name.to_owned(),
        file: None,
        program: parsed.program,
        vertex: parsed.vertex,
        fragment: parsed.fragment,
        defines: BTreeMap::new(),
        state,
        values: BTreeMap::new(),
        textures: BTreeMap::new(),
        samplers: BTreeMap::new(),
        attributes: BTreeMap::new(),
        attribute_roles: BTreeMap::new(),
        value_roles: BTreeMap::new(),
        part_of: None,
    }
}

/// A draw of the only mesh.
pub fn draw(name: &str, instances: u32) -> Draw {
    Draw {
        name: name.to_owned(),
        mesh: 0,
        material: 0,
        transform: Default::default(),
        range: Default::default(),
        instances,
        instance_streams: BTreeMap::new(),
        joints: [].into(),
        morph_weights: Vec::new(),
        values: BTreeMap::new(),
        captured: None,
    }
}

pub fn scene(
    name: &str,
    size: [u32; 2],
    material: Material,
    mesh: Mesh,
    draws: Vec<Draw>,
) -> Scene {
    Scene {
        name: name.to_owned(),
        files: Vec::new(),
        is_made_up: false,
        own_size: None,
        part: None,
        initial: Default::default(),
        rows: Default::default(),
        notes: Vec::new(),
        size,
        viewport: None,
        depth_format: material.state.depth_format,
        depth_direction: material.state.depth_direction,
        samples: 1,
        clear_color: [0.0, 0.0, 0.0, 1.0],
        materials: vec![material],
        meshes: vec![mesh],
        draws,
        cameras: vec![Camera {
            name: "front".to_owned(),
            frames: vec![Frame {
                view: Default::default(),
                projection: Default::default(),
                eye: Default::default(),
                time: 0.0,
            }],
        }],
        orders: vec![DrawOrder::AsGiven],
        light: Default::default(),
    }
}
