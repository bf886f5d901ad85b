//! Generated meshes are sound: unit normals, outward counter-clockwise triangles, closed where they
//! claim to be.

use std::collections::BTreeMap;

use glam::{Vec3, Vec4};
use preshade_draw::scene::{Mesh, Stream};
use preshade_scenes::mesh::{
    Arch, Column, Cuboid, Curtain, Morph, Plane, Skin, Sphere, Stairs, Teapot, WireSphere, merged,
    positions, transformed,
};

fn floats<'a>(mesh: &'a Mesh, name: &str) -> &'a [f32] {
    match &mesh.streams[name] {
        Stream::Float { data, .. } => data,
        Stream::Uint { .. } => panic!("{name} is not float"),
    }
}

fn check(mesh: &Mesh) {
    let p: Vec<Vec3> = positions(mesh).collect();
    let n: Vec<Vec3> = floats(mesh, "normal")
        .chunks(3)
        .map(Vec3::from_slice)
        .collect();
    let t: Vec<Vec4> = floats(mesh, "tangent")
        .chunks(4)
        .map(Vec4::from_slice)
        .collect();
    assert_eq!(p.len(), mesh.vertex_count as usize);
    assert_eq!(n.len(), p.len());
    assert_eq!(floats(mesh, "uv").len(), p.len() * 2);
    for i in 0..p.len() {
        assert!(
            (n[i].length() - 1.0).abs() < 1e-4,
            "{} normal {i}: {}",
            mesh.name,
            n[i]
        );
        assert!(
            (t[i].truncate().length() - 1.0).abs() < 1e-4,
            "{} tangent {i}",
            mesh.name
        );
        assert!(
            t[i].truncate().dot(n[i]).abs() < 1e-3,
            "{} tangent {i}",
            mesh.name
        );
        assert_eq!(t[i].w.abs(), 1.0);
    }
    for tri in mesh.indices.as_ref().unwrap().chunks(3) {
        let [a, b, c] = [tri[0] as usize, tri[1] as usize, tri[2] as usize];
        let face = (p[b] - p[a]).cross(p[c] - p[a]);
        assert!(
            face.length() > 0.0,
            "{} has a triangle without area",
            mesh.name
        );
        let mean = n[a] + n[b] + n[c];
        assert!(
            face.dot(mean) > 0.0,
            "{}: triangle {a} {b} {c} turns its back to its normals: {} {} {}, {mean}",
            mesh.name,
            p[a],
            p[b],
            p[c]
        );
    }
}

/// Every edge is run once in each direction, positions compared to the bit; and the volume is
/// positive.
fn check_closed(mesh: &Mesh) {
    let p: Vec<Vec3> = positions(mesh).collect();
    let key = |i: u32| p[i as usize].to_array().map(|v| (v + 0.0).to_bits());
    let mut edges: BTreeMap<_, i32> = BTreeMap::new();
    let mut volume = 0.0;
    for tri in mesh.indices.as_ref().unwrap().chunks(3) {
        for (i, j) in [(0, 1), (1, 2), (2, 0)] {
            *edges.entry((key(tri[i]), key(tri[j]))).or_default() += 1;
        }
        let at = |i: usize| p[tri[i] as usize];
        volume += at(0).dot(at(1).cross(at(2)));
    }
    for ((a, b), count) in &edges {
        assert_eq!(*count, 1, "{}", mesh.name);
        assert!(edges.contains_key(&(*b, *a)), "{} is open", mesh.name);
    }
    assert!(volume > 0.0, "{} is inside out", mesh.name);
}

#[test]
fn solids_are_closed_and_face_outward() {
    let sphere = Sphere::default().mesh("sphere");
    for mesh in [
        Cuboid::default().mesh("box"),
        Cuboid {
            size: [2.0, 0.5, 3.0],
            segments: 3,
            tiling: 1.0,
        }
        .mesh("cells"),
        sphere.clone(),
        Stairs::default().mesh("stairs"),
        Arch::default().mesh("arch"),
    ] {
        check(&mesh);
        check_closed(&mesh);
    }
    let radius = positions(&sphere)
        .map(|p| p.length())
        .fold(0.0_f32, f32::max);
    assert!((radius - 0.5).abs() < 1e-6);
}

#[test]
fn surfaces_agree_with_their_normals() {
    for mesh in [
        Plane::default().mesh("plane"),
        Column::default().mesh("column"),
        Curtain::default().mesh("curtain"),
        Teapot::default().mesh("teapot"),
    ] {
        check(&mesh);
    }
    let teapot = Teapot {
        size: 2.0,
        segments: [6, 6],
    }
    .mesh("teapot");
    assert!((teapot.bounds[1].y - 2.0).abs() < 1e-5 && teapot.bounds[0].y.abs() < 1e-5);
    assert_eq!(teapot.vertex_count, 32 * 49);
}

#[test]
fn the_teapot_of_the_article_has_15704_triangles() {
    let teapot = Teapot {
        size: 2.222,
        segments: [13, 19],
    }
    .mesh("teapot");
    check(&teapot);
    assert_eq!(teapot.indices.as_ref().unwrap().len(), 3 * 15_704);
    // Its only borders are the rims: of the bowl, the lid, both ends of handle and spout. So no
    // patch has other points on an edge than its neighbour.
    let p: Vec<Vec3> = positions(&teapot).collect();
    let cell = |i: u32| (p[i as usize] * 1e4).round().as_ivec3();
    let mut edges: BTreeMap<_, i32> = BTreeMap::new();
    for t in teapot.indices.as_ref().unwrap().chunks(3) {
        for (i, j) in [(0, 1), (1, 2), (2, 0)] {
            let (a, b) = (cell(t[i]).to_array(), cell(t[j]).to_array());
            *edges.entry((a.min(b), a.max(b))).or_default() += 1;
        }
    }
    let border = edges.values().filter(|count| **count == 1).count();
    let (bowl, tube_end) = (4 * 13, 2 * 13);
    assert_eq!(border, 2 * bowl + 4 * tube_end);
}

#[test]
fn a_mirror_keeps_triangles_facing_outward() {
    let mirror = glam::Mat4::from_scale(Vec3::new(-1.0, 1.0, 2.0));
    let mesh = transformed(Stairs::default().mesh("stairs"), mirror);
    check(&mesh);
    check_closed(&mesh);
}

#[test]
fn merging_keeps_every_triangle_where_it_was() {
    let moved = transformed(
        Sphere::default().mesh("sphere"),
        glam::Mat4::from_translation(Vec3::X * 3.0),
    );
    let both = merged("both", vec![Cuboid::default().mesh("box"), moved.clone()]);
    check(&both);
    check_closed(&both);
    assert_eq!(both.bounds[1].x, 3.5);
    assert_eq!(both.vertex_count, 24 + moved.vertex_count);
}

#[test]
fn weights_sum_to_one_and_an_unbent_pose_is_the_identity() {
    let mut mesh = Column::default().mesh("column");
    let rest = Skin {
        joints: 5,
        bend: 0.0,
        twist: 0.0,
    }
    .apply(&mut mesh);
    for joint in &rest {
        assert!(joint.abs_diff_eq(glam::Mat4::IDENTITY, 1e-5));
    }
    for w in floats(&mesh, "weights").chunks(4) {
        assert!((w.iter().sum::<f32>() - 1.0).abs() < 1e-5);
    }
    let bent = Skin {
        joints: 5,
        bend: 90.0,
        twist: 0.0,
    }
    .apply(&mut mesh);
    assert!(!bent[4].abs_diff_eq(glam::Mat4::IDENTITY, 0.1));
    Morph::default().apply(&mut mesh);
    let moved = floats(&mesh, "morph_position_1")
        .iter()
        .any(|v| v.abs() > 0.01);
    assert!(moved);
}

#[test]
fn a_wire_sphere_is_lines() {
    let mesh = WireSphere {
        radius: 1.0,
        segments: 8,
        rings: 4,
    }
    .mesh("wire");
    // Four spans of eight meridians, and three parallels.
    assert_eq!(mesh.indices.unwrap().len(), 2 * (8 * 4 + 8 * 3));
}
