//! The meshes of a scene file: each entry's shape, its parts merged in order of need, its skin and morph targets.

use std::collections::BTreeMap;

use glam::{Mat4, Quat, Vec3};
use toml::Spanned;

use super::file::{Field, MeshEntry, Part};
use super::load::{Source, transform};
use super::mesh::{self, Rigged};
use super::noise::random;
use super::place::Folder;
use super::{Error, Mesh};

/// Most copies a field may make.
const MAX_FIELD: u64 = 1_000_000;

/// One copy of a field.
pub(super) struct Place {
    pub transform: Mat4,
    /// A tint around white.
    pub color: [f32; 4],
}

/// The copies of a field, around the origin in x and z and upward from it in y, x fastest.
pub(super) fn field(field: &Field) -> Result<Vec<Place>, Error> {
    let [nx, ny, nz] = field.count;
    let total = u64::from(nx) * u64::from(ny) * u64::from(nz);
    if total == 0 || total > MAX_FIELD {
        return Err(Error::new(format!("a field of {total} copies"))
            .help(format!("1 to {MAX_FIELD} are allowed; count is [x, y, z]")));
    }
    let mut out = Vec::with_capacity(total as usize);
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                let at = out.len() as u32;
                let r = |channel: u32| random(at, channel, field.seed);
                let grid = Vec3::new(
                    x as f32 - (nx - 1) as f32 * 0.5,
                    y as f32,
                    z as f32 - (nz - 1) as f32 * 0.5,
                );
                let jitter = Vec3::new(r(0) - 0.5, r(1) - 0.5, r(2) - 0.5) * 2.0;
                let place = grid * Vec3::from(field.spacing) + jitter * Vec3::from(field.jitter);
                let scale = field.scale[0] + (field.scale[1] - field.scale[0]) * r(3);
                let turn = Quat::from_rotation_y((field.turn * (r(4) * 2.0 - 1.0)).to_radians());
                out.push(Place {
                    transform: Mat4::from_scale_rotation_translation(
                        Vec3::splat(scale),
                        turn,
                        place,
                    ),
                    color: [0.4 + 0.6 * r(5), 0.4 + 0.6 * r(6), 0.4 + 0.6 * r(7), 1.0],
                });
            }
        }
    }
    Ok(out)
}

/// All meshes, by name. A merged mesh may name meshes that stand after it, but not itself, however far round.
pub(super) fn build(
    source: &Source<'_>,
    folder: &Folder,
    entries: &BTreeMap<String, Spanned<MeshEntry>>,
) -> Result<Vec<Rigged>, Error> {
    let builder = Builder {
        source,
        folder,
        entries,
    };
    let mut done = BTreeMap::new();
    for name in entries.keys() {
        builder.mesh(name, &mut done, &mut Vec::new())?;
    }
    Ok(done.into_values().collect())
}

struct Builder<'a> {
    source: &'a Source<'a>,
    folder: &'a Folder,
    entries: &'a BTreeMap<String, Spanned<MeshEntry>>,
}

impl Builder<'_> {
    fn mesh(
        &self,
        name: &str,
        done: &mut BTreeMap<String, Rigged>,
        inside: &mut Vec<String>,
    ) -> Result<(), Error> {
        if done.contains_key(name) {
            return Ok(());
        }
        let Some(spanned) = self.entries.get(name) else {
            return Err(Error::new(format!("there is no mesh `{name}`"))
                .suggest(name, self.entries.keys().map(String::as_str)));
        };
        let at = |e: Error| self.source.at(e, spanned.span());
        if inside.iter().any(|n| n == name) {
            return Err(at(Error::new(format!("mesh `{name}` is merged of itself"))));
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
            rigged.joints = skin.apply(&mut rigged.mesh);
        }
        if let Some(morph) = entry.morph {
            morph.apply(&mut rigged.mesh);
            rigged.morph_weights = vec![0.5, 0.5];
        }
        if rigged.mesh.vertex_count == 0 {
            return Err(at(Error::new(format!("mesh `{name}` has no vertices"))));
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
    ) -> Result<Rigged, Error> {
        let mut shapes: Vec<Mesh> = Vec::new();
        shapes.extend(entry.cuboid.map(|s| s.mesh(name)));
        shapes.extend(entry.plane.map(|s| s.mesh(name)));
        shapes.extend(entry.sphere.map(|s| s.mesh(name)));
        shapes.extend(entry.teapot.map(|s| s.mesh(name)));
        shapes.extend(entry.stairs.map(|s| s.mesh(name)));
        shapes.extend(entry.arch.map(|s| s.mesh(name)));
        shapes.extend(entry.column.map(|s| s.mesh(name)));
        shapes.extend(entry.curtain.map(|s| s.mesh(name)));
        shapes.extend(entry.wire_sphere.map(|s| s.mesh(name)));
        shapes.extend(entry.vertices.map(|s| s.mesh(name)));
        let mut rigged: Vec<Rigged> = shapes
            .into_iter()
            .map(|mesh| Rigged {
                mesh,
                joints: Vec::new(),
                morph_weights: Vec::new(),
            })
            .collect();
        if let Some(gltf) = &entry.gltf {
            let read = |file: &str| self.folder.read(file).map(|(_, bytes)| bytes);
            let loaded = gltf.get_ref().load(name, &read);
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
                joints: Vec::new(),
                morph_weights: Vec::new(),
            });
        }
        let count = rigged.len();
        match rigged.pop() {
            Some(one) if count == 1 => Ok(one),
            _ => Err(Error::new(format!("mesh `{name}` has {count} shapes"))
                .help("give exactly one, `box = { size = [1, 1, 1] }` say")),
        }
    }

    fn part(
        &self,
        part: &Part,
        done: &BTreeMap<String, Rigged>,
        out: &mut Vec<Mesh>,
    ) -> Result<(), Error> {
        let Some(built) = done.get(part.mesh.get_ref()) else {
            return Err(Error::new(format!(
                "there is no mesh `{}`",
                part.mesh.get_ref()
            )));
        };
        let outer = transform(part.translate, part.rotate, part.scale.as_ref());
        let places = match &part.field {
            None => vec![Mat4::IDENTITY],
            Some(f) => field(f.get_ref())
                .map_err(|e| self.source.at(e, f.span()))?
                .into_iter()
                .map(|p| p.transform)
                .collect(),
        };
        out.extend(
            places
                .into_iter()
                .map(|p| mesh::transformed(built.mesh.clone(), outer * p)),
        );
        Ok(())
    }
}
