//! Loads glTF files: nodes, primitives, materials, cameras and lights become a scene.

use std::path::{Path, PathBuf};

use toml::Spanned;

use super::loader::Loader;
use super::place::Folder;
use crate::asset::mesh::Gltf;
use crate::file::entries::{DrawEntry, SceneFile};
use crate::file::place::Access;
use crate::file::text::{SceneText, parsed};
use crate::file::variables::Variables;
use preshade_draw::scene::{Scene, SceneError};
use shader_text::read_limited;

/// The shaders for drawing a glTF file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Shading {
    #[default]
    BuiltIn,
    /// One shader file for all materials, with both entry points.
    Shader(PathBuf),
    /// A file with the `[materials]` of a scene. Each has the name of a material in the glTF file;
    /// `"*"` stands for all others.
    Materials(PathBuf),
}

/// Loads a glTF file as a scene. `docs/reference/gltf.md` documents the supported features.
///
/// # Errors
/// The file, a shader or an image cannot be read, is too large, or requires an unsupported
/// extension; the file lacks a material that the map names.
pub fn load_gltf(
    path: &Path,
    shading: &Shading,
    variables: &Variables,
    access: Access,
) -> Result<Scene, SceneError> {
    let limits = access.limits;
    let (beside, name, text) = match shading {
        Shading::BuiltIn => (path, String::new(), String::new()),
        Shading::Shader(shader) => {
            let shader = full(shader)?;
            let shader = toml::Value::String(shader.display().to_string());
            let text = format!("[materials.\"*\"]\nshader = {shader}\n");
            (path, String::new(), text)
        }
        Shading::Materials(map) => {
            let text = read_limited::text(map, &limits, "source-bytes")
                .map_err(|e| SceneError::unread(map, e))?;
            (map.as_path(), map.display().to_string(), text)
        }
    };
    let mut folder = Folder::of(beside, access)?;
    let file = match shading {
        Shading::Materials(_) => full(path)?.display().to_string(),
        _ => path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned(),
    };
    folder.also(path)?;
    if let Shading::Shader(shader) = shading {
        folder.also(shader)?;
    }
    let source = SceneText {
        name: &name,
        text: &text,
    };
    let mut scene: SceneFile = parsed(source, limits)?;
    if let Some(draw) = scene.draws.first() {
        let error = SceneError::new("a map of materials draws nothing itself")
            .help("the glTF file's draws take its materials");
        return Err(source.at(error, draw.span()));
    }
    let gltf = Gltf {
        file,
        ..Gltf::default()
    };
    let names = scene.materials.iter();
    let names = names.map(|(name, entry)| (name.clone(), Spanned::new(entry.span(), name.clone())));
    let draw = DrawEntry {
        gltf: Some(Spanned::new(0..0, gltf)),
        materials: names.collect(),
        ..DrawEntry::default()
    };
    scene.draws.push(Spanned::new(0..0, draw));
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    Loader::new(source, folder, scene, variables, access)?.scene(stem.into_owned())
}

fn full(path: &Path) -> Result<PathBuf, SceneError> {
    path.canonicalize().map_err(|e| SceneError::read(path, &e))
}
