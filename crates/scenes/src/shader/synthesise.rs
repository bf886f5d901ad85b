//! Makes a scene for a bare shader by reflection, with enough overlapping objects to distinguish
//! good variants from bad ones.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{Mat4, Vec3};
use naga::{ArraySize, BinaryOperator, Expression, Literal, ShaderStage, TypeInner};
use preshade_plan::program::Program;
use preshade_plan::state::{MaterialState, Topology};

use super::roles::Roles;
use crate::camera::{Pose, Range};
use crate::mesh::{self, Cuboid, Morph, Plane, Skin, Sphere, Vertices, WireSphere};
use preshade_compiler::front::Parsed;
use preshade_draw::scene::bind::known_stream;
use preshade_draw::scene::globals::globals;
use preshade_draw::scene::noise::random;
use preshade_draw::scene::semantic::normalise;
use preshade_draw::scene::{
    Camera, Draw, DrawOrder, DrawRange, Light, Material, Mesh, Scene, Stream, Value,
};

/// A scene for a material of which only shader and state are known: a floor, and boxes and spheres
/// in three rows, in three draw orders.
///
/// Values, textures and attributes follow the conventions of [`bind`](preshade_draw::scene::bind).
/// If a program generates its vertices, its arrays and index comparisons determine their number.
/// Instanced programs get a field of instances; skinned or morphed ones get joints or targets.
pub fn synthesise(parsed: Parsed, state: MaterialState) -> Scene {
    let name = parsed
        .program
        .sources()
        .files()
        .first()
        .and_then(|f| Path::new(&f.name).file_stem())
        .map(|s| {
            // Drop all extensions of names such as `1.2.pbr.vert.glsl`.
            let stem = s.to_string_lossy().into_owned();
            let stages = [".vert", ".frag", ".vs", ".fs"];
            let bare = stages.iter().find_map(|s| stem.strip_suffix(s));
            bare.map(str::to_owned).unwrap_or(stem)
        })
        .filter(|s| !s.is_empty() && !s.starts_with('<'))
        .unwrap_or_else(|| "material".to_owned());
    let size = [640, 360];
    let aspect = size[0] as f32 / size[1] as f32;
    let roles = Roles::of(&parsed, &BTreeMap::new());
    let wants = Wants::of(&parsed, &roles);
    let (meshes, draws) = objects(&parsed, &state, &wants, &roles);
    let pose = Pose {
        eye: Vec3::new(2.2, 2.6, 7.0),
        target: Vec3::new(0.0, 0.8, 0.0),
        fov: 55.0,
        time: 1.0,
    };
    let range = Range {
        near: 0.1,
        far: 60.0,
    };
    Scene {
        name: name.clone(),
        size,
        viewport: None,
        depth_format: state.depth_format,
        depth_direction: state.depth_direction,
        samples: state.multisample.count,
        // A medium colour: dark and bright materials both stand out.
        clear_color: [0.3, 0.38, 0.48, 1.0],
        cameras: vec![Camera {
            name: "front".to_owned(),
            frames: vec![pose.frame(Vec3::Y, aspect, range, state.depth_direction)],
        }],
        materials: vec![Material {
            name,
            file: None,
            program: parsed.program,
            vertex: parsed.vertex,
            fragment: parsed.fragment,
            defines: BTreeMap::new(),
            state,
            values: roles.values,
            textures: roles.textures,
            samplers: BTreeMap::new(),
            attributes: roles.attributes,
            attribute_roles: BTreeMap::new(),
            value_roles: BTreeMap::new(),
            part_of: None,
        }],
        meshes,
        draws,
        orders: vec![
            DrawOrder::FrontToBack,
            DrawOrder::BackToFront,
            DrawOrder::Shuffled,
        ],
        light: Light::default(),
        files: Vec::new(),
        is_made_up: true,
        own_size: None,
        part: None,
        initial: Default::default(),
        rows: Default::default(),
        notes: Vec::new(),
    }
}

/// Meshes and draws at distinct places.
fn objects(
    parsed: &Parsed,
    state: &MaterialState,
    wants: &Wants,
    roles: &Roles,
) -> (Vec<Mesh>, Vec<Draw>) {
    let module = parsed.program.module();
    let shapes = shapes(wants, state.primitive.topology);
    let mut meshes: Vec<Mesh> = Vec::new();
    let mut draws = Vec::new();
    // Without a matrix per object, the vertices themselves are moved.
    let is_moved = !roles.is_placed && !wants.instances;
    for (shape, transform) in places(wants, shapes.len(), is_moved) {
        let transform_of_draw = if is_moved { Mat4::IDENTITY } else { transform };
        let mut built = shapes[shape].clone();
        let joints: Vec<Mat4> = match wants.skin {
            true => Skin::default().apply(&mut built),
            false => Vec::new(),
        };
        if is_moved {
            built = mesh::transformed(built, transform);
        }
        if roles.pulled.is_some() {
            built = mesh::unindexed(built);
        }
        let pulled = roles.pulled.as_ref().map(|p| p.values(module, &built));
        let known = meshes
            .iter()
            .position(|m| !is_moved && m.name == built.name);
        let index = known.unwrap_or(meshes.len());
        draws.push(Draw {
            name: format!("{}#{}", built.name, draws.len()),
            mesh: index,
            material: 0,
            transform: transform_of_draw,
            range: DrawRange::default(),
            instances: 1,
            instance_streams: BTreeMap::new(),
            joints: joints.into(),
            morph_weights: if wants.morph {
                vec![0.6, 0.4]
            } else {
                Vec::new()
            },
            values: pulled.unwrap_or_default(),
            captured: None,
        });
        if known.is_none() {
            meshes.push(built);
        }
    }
    if wants.instances {
        instance(&mut draws);
    }
    for draw in &mut draws {
        let Some(Stream::Float { data, .. }) = draw.instance_streams.get("instance_transform")
        else {
            continue;
        };
        for read in &roles.instance_matrices {
            let TypeInner::Matrix { columns, rows, .. } = module.types[read.ty].inner else {
                continue;
            };
            for (i, matrix) in data.as_chunks::<16>().0.iter().enumerate() {
                let columns = matrix.as_chunks::<4>().0.iter().take(columns as usize);
                let numbers =
                    columns.flat_map(|c| c[..rows as usize].iter().map(|n| f64::from(*n)));
                let value = Value::Numbers(numbers.collect());
                draw.values.insert(read.text_at(module, Some(i)), value);
            }
        }
    }
    (meshes, draws)
}

/// The mesh data that a program reads.
struct Wants {
    /// Whether it reads vertex data from attributes or storage.
    data: bool,
    /// Number of vertices that it generates if it reads none.
    own_vertices: u32,
    instances: bool,
    skin: bool,
    morph: bool,
}

impl Wants {
    fn of(parsed: &Parsed, roles: &Roles) -> Self {
        let program = &parsed.program;
        let module = program.module();
        let mut wants = Self {
            data: roles.has_mesh,
            own_vertices: 0,
            instances: roles.is_instanced || roles.uses_instance && !roles.is_placed,
            skin: false,
            morph: false,
        };
        if let Some((_, entry)) = program.entry_point(ShaderStage::Vertex, &parsed.vertex) {
            for io in naga_edit::interface::inputs(module, &entry.function) {
                let name = io.name.as_deref().unwrap_or("");
                if let Some(naga::Binding::Location { .. }) = io.binding {
                    wants.data = true;
                    let by_use = roles.attributes.get(name).map(String::as_str);
                    wants.skin |= by_use.or_else(|| known_stream(name)) == Some("joints");
                    wants.morph |= known_stream(name) == Some("morph");
                }
            }
        }
        wants.data |= globals(program).any(|g| {
            let name = normalise(g.name);
            let data = ["position", "vert", "indices", "points"];
            g.is_storage && data.iter().any(|d| name.starts_with(d))
        });
        wants.own_vertices = own_vertices(program);
        wants
    }
}

/// Number of vertices for a program that generates them from `vertex_index`: the length of its
/// longest vector array, or one more than the largest number that it compares an index with.
/// Rounded up to whole triangles, at least one.
fn own_vertices(program: &Program) -> u32 {
    let module = program.module();
    let arrays = module.types.iter().filter_map(|(_, t)| match t.inner {
        TypeInner::Array {
            base,
            size: ArraySize::Constant(n),
            ..
        } if matches!(module.types[base].inner, TypeInner::Vector { .. }) => Some(n.get()),
        _ => None,
    });
    let functions = module
        .entry_points
        .iter()
        .filter(|e| e.stage == ShaderStage::Vertex)
        .map(|e| &e.function)
        .chain(module.functions.iter().map(|(_, f)| f));
    let compared = functions.flat_map(|f| {
        f.expressions.iter().filter_map(|(_, e)| match *e {
            Expression::Binary {
                op:
                    BinaryOperator::Equal
                    | BinaryOperator::NotEqual
                    | BinaryOperator::GreaterEqual
                    | BinaryOperator::Greater,
                right,
                ..
            } => match f.expressions[right] {
                Expression::Literal(Literal::U32(n)) => n.checked_add(1),
                _ => None,
            },
            _ => None,
        })
    });
    let most = arrays.chain(compared).filter(|n| *n <= 65_535).max();
    most.unwrap_or(3).max(3).next_multiple_of(3)
}

fn shapes(wants: &Wants, topology: Topology) -> Vec<Mesh> {
    let mut meshes = if !wants.data {
        vec![
            Vertices {
                count: wants.own_vertices,
            }
            .mesh("vertices"),
        ]
    } else if topology == Topology::LineList {
        vec![WireSphere::default().mesh("sphere")]
    } else {
        vec![
            Plane {
                size: [12.0; 2],
                segments: [8; 2],
                tiling: 0.5,
            }
            .mesh("floor"),
            Sphere {
                radius: 0.8,
                ..Sphere::default()
            }
            .mesh("sphere"),
            Cuboid {
                size: [1.3; 3],
                segments: 4,
                tiling: 1.0,
            }
            .mesh("box"),
        ]
    };
    for mesh in &mut meshes {
        paint(mesh);
        if wants.morph {
            Morph::default().apply(mesh);
        }
        if topology != Topology::TriangleList && topology != Topology::LineList {
            mesh.indices = None;
        }
    }
    meshes
}

/// Gives a mesh colours that follow its positions. Otherwise a shader that only shows vertex
/// colours would draw plain white.
fn paint(mesh: &mut Mesh) {
    let Some(Stream::Float {
        components: 3,
        data,
    }) = mesh.streams.get("position")
    else {
        return;
    };
    let smooth = |x: f32, phase: f32| 0.65 + 0.3 * (2.1 * x + phase).sin();
    let of = |p: &[f32; 3]| {
        let [x, y, z] = *p;
        [
            smooth(x, 0.0),
            smooth(y, 1.0),
            smooth(z + 0.5 * x, 2.0),
            1.0,
        ]
    };
    let data = data.as_chunks::<3>().0.iter().flat_map(of).collect();
    let painted = Stream::Float {
        components: 4,
        data,
    };
    mesh.streams.insert("color".to_owned(), painted);
}

/// The shape and transform of each object. A shader that generates its vertices gets three places
/// if it reads a matrix per object.
fn places(wants: &Wants, meshes: usize, is_moved: bool) -> Vec<(usize, Mat4)> {
    let row = |z: f32, count: usize, width: f32| {
        (0..count).map(move |i| {
            let x = (i as f32 - (count - 1) as f32 * 0.5) * width + 0.3 * z;
            Vec3::new(x, 0.95 + 0.15 * random(i as u32, z.to_bits(), 5), z)
        })
    };
    let objects = row(1.8, 2, 2.3)
        .chain(row(-0.6, 3, 2.2))
        .chain(row(-3.2, 4, 2.1));
    if meshes == 1 {
        let count = match (wants.data, is_moved) {
            (true, _) => 9,
            (false, true) => 1,
            (false, false) => 3,
        };
        return objects
            .take(count)
            .map(|p| (0, Mat4::from_translation(p)))
            .collect();
    }
    std::iter::once((0, Mat4::from_translation(Vec3::ZERO)))
        .chain(objects.enumerate().map(|(i, p)| {
            let turn = Mat4::from_rotation_y(i as f32 * 0.7);
            (1 + i % (meshes - 1), Mat4::from_translation(p) * turn)
        }))
        .collect()
}

/// Merges the objects of each mesh into one instanced draw, after the floor.
fn instance(draws: &mut Vec<Draw>) {
    let all = std::mem::take(draws);
    for draw in all {
        match draws.iter_mut().find(|d| d.mesh == draw.mesh) {
            Some(first) => {
                push_instance(first, draw.transform);
            }
            None => {
                let mut first = Draw {
                    transform: Mat4::IDENTITY,
                    instances: 0,
                    ..draw.clone()
                };
                push_instance(&mut first, draw.transform);
                draws.push(first);
            }
        }
    }
}

fn push_instance(draw: &mut Draw, transform: Mat4) {
    let i = draw.instances;
    let color = |c: u32| 0.4 + 0.6 * random(i, c, 17);
    for (name, components, numbers) in [
        ("instance_transform", 16, transform.to_cols_array().to_vec()),
        ("instance_color", 4, vec![color(0), color(1), color(2), 1.0]),
    ] {
        let stream = draw
            .instance_streams
            .entry(name.to_owned())
            .or_insert_with(|| Stream::Float {
                components,
                data: Vec::new(),
            });
        if let Stream::Float { data, .. } = stream {
            data.extend(numbers);
        }
    }
    draw.instances += 1;
}
