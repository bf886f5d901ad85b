//! The meshes of a scene file: shapes, merged meshes in dependency order, skins and morph targets.

use std::cell::Cell;
use std::collections::BTreeMap;

use glam::{Mat4, Quat, Vec3};
use toml::Spanned;

use super::place::Folder;
use super::size::{self, SCENE_BYTES};
use crate::asset::mesh::Rigged;
use crate::file::entries::{Field, FieldOrder, MergedMesh, MeshEntry, transform};
use crate::file::text::SceneText;
use crate::file::variables::Variables;
use crate::mesh;
use preshade_draw::scene::noise::{hash, random};
use preshade_draw::scene::{Mesh, SceneError};
use shader_text::limits::Limits;

pub(super) struct FieldCopy {
    pub transform: Mat4,
    /// A tint near white.
    pub color: [f32; 4],
    /// x, z, rotation around y in radians, and scale: enough for a copy on flat ground.
    pub on_ground: [f32; 4],
}

/// The cells of a field: count and spacing along each axis, and the number of cells with a copy.
struct Grid {
    count: [u32; 3],
    spacing: Vec3,
    jitter: Vec3,
    copies: u64,
}

impl Grid {
    fn new(field: &Field, variables: &Variables, limits: &Limits) -> Result<Self, SceneError> {
        let jitter = Vec3::from(field.jitter);
        let grid = match (field.count, field.spacing, &field.copies, field.area) {
            (Some(count), Some(spacing), None, None) => Self {
                count,
                spacing: spacing.into(),
                jitter,
                copies: count
                    .into_iter()
                    .fold(1, |n: u64, c| n.saturating_mul(c.into())),
            },
            (None, None, Some(copies), Some(area)) => {
                let copies = copies.number(variables)?;
                let [width, depth] = area.map(|a| a.max(f32::MIN_POSITIVE));
                // Choose cells that are nearly square.
                let across = (f64::from(copies) * f64::from(width / depth)).sqrt();
                let nx = (across.round() as u32).clamp(1, copies.max(1));
                let nz = copies.div_ceil(nx);
                let spacing = Vec3::new(width / nx as f32, 0.0, depth / nz.max(1) as f32);
                Self {
                    count: [nx, 1, nz],
                    spacing,
                    jitter: jitter * spacing,
                    copies: u64::from(copies),
                }
            }
            _ => {
                return Err(SceneError::new(
                    "a field needs `count` and `spacing`, or `copies` and `area`",
                ));
            }
        };
        // Copies have 32-bit indices, whatever the limits.
        let most = limits.copies.min(u32::MAX.into());
        match grid.copies {
            n if (1..=most).contains(&n) => Ok(grid),
            total => Err(SceneError::new(format!("a field of {total} copies"))
                .help(format!("1 to {most} are allowed; count is [x, y, z]"))),
        }
    }

    fn place(&self, field: &Field, at: u32) -> FieldCopy {
        let [nx, ny, nz] = self.count;
        let (x, y, z) = (at % nx, at / nx % ny, at / nx / ny);
        let r = |channel: u32| random(at, channel, field.seed);
        let cell = Vec3::new(
            x as f32 - (nx - 1) as f32 * 0.5,
            y as f32,
            z as f32 - (nz - 1) as f32 * 0.5,
        );
        let jitter = Vec3::new(r(0) - 0.5, r(1) - 0.5, r(2) - 0.5) * 2.0;
        let place = cell * self.spacing + jitter * self.jitter;
        let scale = field.scale[0] + (field.scale[1] - field.scale[0]) * r(3);
        let turn = (field.turn * (r(4) * 2.0 - 1.0)).to_radians();
        FieldCopy {
            transform: Mat4::from_scale_rotation_translation(
                Vec3::splat(scale),
                Quat::from_rotation_y(turn),
                place,
            ),
            color: [0.4 + 0.6 * r(5), 0.4 + 0.6 * r(6), 0.4 + 0.6 * r(7), 1.0],
            on_ground: [place.x, place.z, turn, scale],
        }
    }
}

/// Number of copies in a field, computed before any is created.
pub(super) fn copies(
    field: &Field,
    variables: &Variables,
    limits: &Limits,
) -> Result<u64, SceneError> {
    Ok(Grid::new(field, variables, limits)?.copies)
}

/// The copies of a field, centred in x and z and starting at y = 0. x varies fastest unless the
/// field has another order.
pub(super) fn field(
    field: &Field,
    variables: &Variables,
    limits: &Limits,
) -> Result<Vec<FieldCopy>, SceneError> {
    let grid = Grid::new(field, variables, limits)?;
    let mut numbers: Vec<u32> = (0..grid.copies as u32).collect();
    match field.order.order(variables)? {
        FieldOrder::Ascending => {}
        FieldOrder::Descending => numbers.reverse(),
        FieldOrder::Shuffled => numbers.sort_by_key(|n| hash(*n ^ hash(field.seed))),
    }
    Ok(numbers
        .into_iter()
        .map(|at| grid.place(field, at))
        .collect())
}

/// All meshes by name. The textures already use `bytes`. A merged mesh may name meshes that follow
/// it; cycles are errors.
pub(super) fn build(
    source: &SceneText<'_>,
    folder: &Folder,
    variables: &Variables,
    entries: &BTreeMap<String, Spanned<MeshEntry>>,
    limits: &Limits,
    bytes: u64,
) -> Result<Vec<Rigged>, SceneError> {
    let builder = SceneMeshes {
        source,
        folder,
        variables,
        entries,
        limits,
        vertices: Cell::new(0),
        bytes: Cell::new(bytes),
    };
    let mut planned = BTreeMap::new();
    let vertices = entries
        .keys()
        .map(|name| builder.planned(name, &mut planned))
        .fold(0, u64::saturating_add);
    limits.check("vertices", vertices, "the vertices of all meshes")?;
    let mut done = BTreeMap::new();
    for name in entries.keys() {
        builder.mesh(name, &mut done, &mut Vec::new())?;
    }
    Ok(done.into_values().collect())
}

struct SceneMeshes<'a> {
    source: &'a SceneText<'a>,
    folder: &'a Folder,
    variables: &'a Variables,
    entries: &'a BTreeMap<String, Spanned<MeshEntry>>,
    limits: &'a Limits,
    /// Number of vertices so far.
    vertices: Cell<u64>,
    /// Bytes of textures and of meshes that are read or copied.
    bytes: Cell<u64>,
}

impl SceneMeshes<'_> {
    /// Counts vertices against the limit before they are created.
    fn take(&self, vertices: u64) -> Result<(), SceneError> {
        let all = self.vertices.get().saturating_add(vertices);
        self.vertices.set(all);
        Ok(self
            .limits
            .check("vertices", all, "the vertices of all meshes")?)
    }

    /// Counts bytes against the limit before they are allocated.
    fn hold(&self, bytes: u64) -> Result<(), SceneError> {
        let all = self.bytes.get().saturating_add(bytes);
        self.bytes.set(all);
        Ok(self.limits.check("scene-bytes", all, SCENE_BYTES)?)
    }

    /// Vertices of a mesh, before any is created. Files, unknown meshes and cycles count as 0.
    fn planned<'n>(&'n self, name: &'n str, known: &mut BTreeMap<&'n str, u64>) -> u64 {
        if let Some(known) = known.get(name) {
            return *known;
        }
        known.insert(name, 0);
        let Some(entry) = self.entries.get(name).map(Spanned::get_ref) else {
            return 0;
        };
        let mut all = size::vertices(entry);
        for part in entry.merge.iter().flatten().map(Spanned::get_ref) {
            let copies = part.field.as_ref().map_or(Ok(1), |field| {
                copies(field.get_ref(), self.variables, self.limits)
            });
            let one = self.planned(part.mesh.get_ref(), known);
            // A wrong field is an error when its mesh is built.
            all = all.saturating_add(one.saturating_mul(copies.unwrap_or(0)));
        }
        known.insert(name, all);
        all
    }

    fn mesh(
        &self,
        name: &str,
        done: &mut BTreeMap<String, Rigged>,
        inside: &mut Vec<String>,
    ) -> Result<(), SceneError> {
        if done.contains_key(name) {
            return Ok(());
        }
        let Some(spanned) = self.entries.get(name) else {
            return Err(SceneError::new(format!("there is no mesh `{name}`"))
                .suggest(name, self.entries.keys().map(String::as_str)));
        };
        let at = |e: SceneError| self.source.at(e, spanned.span());
        if inside.iter().any(|n| n == name) {
            return Err(at(SceneError::new(format!(
                "mesh `{name}` is merged of itself"
            ))));
        }
        inside.push(name.to_owned());
        let entry = spanned.get_ref();
        for part in entry.merge.iter().flatten() {
            let part = &part.get_ref().mesh;
            self.mesh(part.get_ref(), done, inside)
                .map_err(|e| self.source.at(e, part.span()))?;
        }
        inside.pop();
        let mut rigged = self.shape(name, entry, done).map_err(at)?;
        if let Some(skin) = entry.skin {
            self.hold(size::of_joints(skin.joints.clamp(1, 256) as usize))?;
            rigged.joints = skin.apply(&mut rigged.mesh).into();
        }
        if let Some(morph) = entry.morph {
            morph.apply(&mut rigged.mesh);
            rigged.morph_weights = vec![0.5, 0.5];
        }
        if rigged.mesh.vertex_count == 0 {
            return Err(at(SceneError::new(format!(
                "mesh `{name}` has no vertices"
            ))));
        }
        done.insert(name.to_owned(), rigged);
        Ok(())
    }

    /// The one shape of an entry.
    fn shape(
        &self,
        name: &str,
        entry: &MeshEntry,
        done: &BTreeMap<String, Rigged>,
    ) -> Result<Rigged, SceneError> {
        self.take(size::vertices(entry))?;
        let mut shapes: Vec<Mesh> = Vec::new();
        shapes.extend(entry.cuboid.map(|s| s.mesh(name)));
        shapes.extend(entry.plane.map(|s| s.mesh(name)));
        shapes.extend(entry.sphere.map(|s| s.mesh(name)));
        shapes.extend(entry.teapot.map(|s| s.mesh(name)));
        shapes.extend(entry.stairs.map(|s| s.mesh(name)));
        shapes.extend(entry.arch.map(|s| s.mesh(name)));
        shapes.extend(entry.column.map(|s| s.mesh(name)));
        shapes.extend(entry.curtain.map(|s| s.mesh(name)));
        shapes.extend(entry.cards.map(|s| s.mesh(name)));
        shapes.extend(entry.wire_sphere.map(|s| s.mesh(name)));
        shapes.extend(entry.vertices.map(|s| s.mesh(name)));
        let mut rigged: Vec<Rigged> = shapes
            .into_iter()
            .map(|mesh| Rigged {
                mesh,
                joints: [].into(),
                morph_weights: Vec::new(),
            })
            .collect();
        if let Some(gltf) = &entry.gltf {
            let read = |file: &str| self.folder.read(file).map(|(_, bytes)| bytes);
            let (vertices, bytes) = (self.vertices.get(), self.bytes.get());
            let take = |more: u64, held: u64| {
                // This counts a whole file at a time.
                self.vertices.set(vertices);
                self.bytes.set(bytes);
                self.hold(held)?;
                self.take(more)
            };
            let loaded = gltf.get_ref().load_within(name, &read, &take);
            rigged.push(loaded.map_err(|e| self.source.at(e, gltf.span()))?);
        }
        if let Some(parts) = &entry.merge {
            let mut meshes = Vec::new();
            for part in parts {
                self.part(part.get_ref(), done, &mut meshes)
                    .map_err(|e| self.source.at(e, part.span()))?;
            }
            rigged.push(Rigged {
                mesh: mesh::merged(name, meshes),
                joints: [].into(),
                morph_weights: Vec::new(),
            });
        }
        let count = rigged.len();
        match rigged.pop() {
            Some(one) if count == 1 => Ok(one),
            _ => Err(SceneError::new(format!("mesh `{name}` has {count} shapes"))
                .help("give exactly one, `box = { size = [1, 1, 1] }` say")),
        }
    }

    fn part(
        &self,
        part: &MergedMesh,
        done: &BTreeMap<String, Rigged>,
        out: &mut Vec<Mesh>,
    ) -> Result<(), SceneError> {
        let Some(built) = done.get(part.mesh.get_ref()) else {
            return Err(SceneError::new(format!(
                "there is no mesh `{}`",
                part.mesh.get_ref()
            )));
        };
        let outer = transform(part.translate, part.rotate, part.scale.as_ref());
        let places = match &part.field {
            None => vec![Mat4::IDENTITY],
            Some(f) => field(f.get_ref(), self.variables, self.limits)
                .map_err(|e| self.source.at(e, f.span()))?
                .into_iter()
                .map(|p| p.transform)
                .collect(),
        };
        let copies = places.len() as u64;
        self.take(copies.saturating_mul(built.mesh.vertex_count.into()))?;
        self.hold(copies.saturating_mul(size::of_mesh(&built.mesh)))?;
        out.extend(
            places
                .into_iter()
                .map(|p| mesh::transformed(built.mesh.clone(), outer * p)),
        );
        Ok(())
    }
}
