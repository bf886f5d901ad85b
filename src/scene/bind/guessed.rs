//! What a scene does not say and its binding makes up: the inputs of a bare shader, told to its author.

use serde::{Deserialize, Serialize};

use super::super::{Scene, Semantic};
use super::streams::Streams;
use super::{BindingKind, PADDING, authored, buffer, normalise, variable};
use crate::scene::layout::Leaf;

/// Where the numbers of a scalar, vector or matrix came from, when the scene does not give them as numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Origin {
    /// The scene says which value of the renderer's it is: `"$view_proj"`.
    Said,
    /// The mesh, or the draw's instances: a vertex-pulling or an instance buffer.
    Mesh,
    /// What its name means by convention.
    Convention(Semantic),
    /// Nothing: a number made from its name.
    MadeUp,
}

/// An input that the scene does not give.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Guessed {
    /// Material.
    pub material: String,
    /// Variable, `variable.member`, or attribute.
    pub name: String,
    /// How it was filled.
    #[serde(flatten)]
    pub guess: Guess,
}

/// How an input was filled.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "guess")]
pub enum Guess {
    /// A uniform or a buffer's member by its name.
    UniformByName {
        /// The renderer's value, as a scene file spells it: `$viewproj`.
        value: String,
    },
    /// A uniform or a buffer's member whose name means nothing here.
    UniformMadeUp {
        /// Its numbers, of element 0 of an array.
        numbers: Vec<f64>,
    },
    /// A storage buffer from the mesh or the instances.
    BufferFromMesh,
    /// A texture chosen by its name and generated.
    TextureGenerated,
    /// A vertex attribute that the mesh does not have.
    AttributeSynthesised,
}

impl std::fmt::Display for Guess {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::UniformByName { value } => write!(f, "{value}, by its name"),
            Self::UniformMadeUp { numbers } if is_identity(numbers) => f.write_str("the identity"),
            Self::UniformMadeUp { numbers } => {
                let numbers: Vec<String> = numbers
                    .iter()
                    .map(|n| ((n * 1e3).round() / 1e3).to_string())
                    .collect();
                write!(f, "made up: {}", numbers.join(", "))
            }
            Self::BufferFromMesh => f.write_str("the mesh's data"),
            Self::TextureGenerated => f.write_str("a generated texture"),
            Self::AttributeSynthesised => f.write_str("made up: no mesh has it"),
        }
    }
}

/// Whether numbers are an identity matrix, of 2 by 2 at least.
fn is_identity(numbers: &[f64]) -> bool {
    let side = (numbers.len() as f64).sqrt() as usize;
    side > 1
        && side * side == numbers.len()
        && (0..numbers.len()).all(|i| numbers[i] == f64::from(u8::from(i % (side + 1) == 0)))
}

/// Every input that `scene` leaves to convention or invention, by material, each once: buffers in order of binding, then textures, then
/// attributes. Where draws differ, the first draw of the material is told.
pub fn guessed(scene: &Scene) -> Vec<Guessed> {
    let mut out: Vec<Guessed> = Vec::new();
    let Some(frame) = scene.cameras.first().and_then(|c| c.frames.first()) else {
        return out;
    };
    for (index, material) in scene.materials.iter().enumerate() {
        let (Some(draw), Some(pass)) = (
            scene.draws.iter().find(|d| d.material == index),
            material.plan().passes.pop(),
        ) else {
            continue;
        };
        let Ok(streams) = Streams::new(scene, material, draw) else {
            continue;
        };
        let mut push = |name: String, guess: Guess| {
            if !out
                .iter()
                .any(|g| g.material == material.name && g.name == name)
            {
                out.push(Guessed {
                    material: material.name.clone(),
                    name,
                    guess,
                });
            }
        };
        let mut textures = Vec::new();
        for binding in authored(&pass) {
            match binding.kind {
                BindingKind::Uniform | BindingKind::StorageRead | BindingKind::StorageReadWrite => {
                    let mut observe = |leaf: &Leaf<'_>, origin: Origin, numbers: &[f64; 16]| {
                        let count = (leaf.columns * leaf.rows) as usize;
                        let name = normalise(leaf.name());
                        if PADDING.iter().any(|p| name.starts_with(p)) {
                            return;
                        }
                        let guess = match origin {
                            Origin::Said => return,
                            Origin::Mesh => Guess::BufferFromMesh,
                            Origin::Convention(semantic) => Guess::UniformByName {
                                value: format!("${}", semantic.name()),
                            },
                            Origin::MadeUp => Guess::UniformMadeUp {
                                numbers: numbers[..count].to_vec(),
                            },
                        };
                        push(leaf.text(), guess);
                    };
                    // What cannot be filled is an error of drawing, not of telling.
                    let _ = buffer(
                        scene,
                        material,
                        &streams,
                        binding,
                        draw,
                        frame,
                        &mut observe,
                    );
                }
                BindingKind::Texture | BindingKind::DepthTexture => {
                    if let Ok((name, _)) = variable(material, binding)
                        && !material.textures.contains_key(name)
                    {
                        textures.push(name.to_owned());
                    }
                }
                _ => {}
            }
        }
        for name in textures {
            push(name, Guess::TextureGenerated);
        }
        for name in streams.synthesised() {
            push(name.to_owned(), Guess::AttributeSynthesised);
        }
    }
    out
}
