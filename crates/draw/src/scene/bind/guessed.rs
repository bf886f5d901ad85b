//! Lists inputs that the scene does not set, to show an author which values of a bare shader
//! preshade made up.

use serde::{Deserialize, Serialize};

use super::super::globals::immediates;
use super::super::{Scene, Semantic, Value};
use super::streams::Streams;
use super::{authored, buffer, is_padding, packed, variable};
use crate::scene::layout::VariableLeaf;
use preshade_plan::plan::BindingKind;

/// The origin of a scalar, vector or matrix for which the scene gives no numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ValueOrigin {
    /// The scene names a semantic, such as `"$view_proj"`.
    Said,
    /// The mesh or the draw's instances: a vertex-pulling or instance buffer.
    Mesh,
    /// The conventional meaning of the name.
    Convention(Semantic),
    /// Its use in the shader.
    Use(Semantic),
    /// A made-up number, derived from the name.
    MadeUp,
}

/// An input that the scene does not set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Guessed {
    pub material: String,
    /// Variable, `variable.member`, or attribute.
    pub name: String,
    /// How preshade filled the input.
    #[serde(flatten)]
    pub guess: Guess,
}

/// How an input was filled.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "guess")]
pub enum Guess {
    /// A uniform or buffer member with a conventional name.
    UniformByName {
        /// The semantic in scene file syntax: `$viewproj`.
        value: String,
    },
    /// A uniform or buffer member whose purpose is known by the dataflow.
    UniformByUse {
        /// The semantic in scene file syntax (`$mvp`), or the numbers.
        value: String,
    },
    /// A uniform or buffer member with an unknown name.
    UniformMadeUp {
        /// Its numbers; for an array, those of element 0.
        numbers: Vec<f64>,
    },
    /// A storage buffer with the mesh or the instances.
    BufferFromMesh,
    /// A generated texture, chosen by name.
    TextureGenerated,
    /// A depth texture, cleared to 1.
    TextureCleared,
    /// A vertex attribute without a meaningful name, filled with a stream of the mesh.
    AttributeByUse { stream: String },
    /// A vertex attribute that the mesh does not have.
    AttributeSynthesised,
}

impl std::fmt::Display for Guess {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::UniformByName { value } => write!(f, "{value}, by its name"),
            Self::UniformByUse { value } => write!(f, "{value}, by its use"),
            Self::UniformMadeUp { numbers } if is_identity(numbers) => f.write_str("the identity"),
            Self::UniformMadeUp { numbers } => write!(f, "made up: {}", listed(numbers)),
            Self::BufferFromMesh => f.write_str("the mesh's data"),
            Self::TextureGenerated => f.write_str("a generated texture"),
            Self::TextureCleared => f.write_str("a depth texture, cleared to 1"),
            Self::AttributeByUse { stream } => write!(f, "the mesh's {stream}, by its use"),
            Self::AttributeSynthesised => f.write_str("made up: no mesh has it"),
        }
    }
}

/// Formats numbers for a note.
fn listed(numbers: &[f64]) -> String {
    let rounded = numbers.iter().map(|n| (n * 1e3).round() / 1e3);
    let texts: Vec<String> = rounded.map(|n| n.to_string()).collect();
    texts.join(", ")
}

/// Whether the numbers are an identity matrix of at least 2 by 2.
fn is_identity(numbers: &[f64]) -> bool {
    let side = (numbers.len() as f64).sqrt() as usize;
    side > 1
        && side * side == numbers.len()
        && (0..numbers.len()).all(|i| numbers[i] == f64::from(u8::from(i % (side + 1) == 0)))
}

/// Every input that `scene` leaves to convention or invention, by material and without duplicates:
/// buffers in order of binding, then textures, then attributes. If draws differ, lists those of the
/// material's first draw.
pub fn guessed(scene: &Scene) -> Vec<Guessed> {
    let mut out: Vec<Guessed> = Vec::new();
    let Some(frame) = scene.cameras.first().and_then(|c| c.frames.first()) else {
        return out;
    };
    for (index, material) in scene.materials.iter().enumerate() {
        let (Some(draw), Some(pass)) = (
            // A captured draw has no guesses.
            scene
                .draws
                .iter()
                .find(|d| d.material == index && d.captured.is_none()),
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
                    let mut observe =
                        |leaf: &VariableLeaf<'_>, origin: ValueOrigin, numbers: &[f64; 16]| {
                            if let Some(guess) = of_leaf(scene, leaf, origin, numbers) {
                                push(leaf.text(), guess);
                            }
                        };
                    // Binding errors are reported when the scene is drawn.
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
                    let guess = match binding.kind {
                        BindingKind::DepthTexture => Guess::TextureCleared,
                        _ => Guess::TextureGenerated,
                    };
                    if let Ok((name, _)) = variable(material, binding)
                        && (scene.is_made_up || !material.textures.contains_key(name))
                    {
                        textures.push((name.to_owned(), guess));
                    }
                }
                _ => {}
            }
        }
        for variable in immediates(&material.program) {
            let mut observe =
                |leaf: &VariableLeaf<'_>, origin: ValueOrigin, numbers: &[f64; 16]| {
                    if let Some(guess) = of_leaf(scene, leaf, origin, numbers) {
                        push(leaf.text(), guess);
                    }
                };
            let of = (scene, material, &streams);
            let _ = packed(of, variable, draw, frame, &mut observe);
        }
        // The scene of a bare shader sets some values from its dataflow.
        if scene.is_made_up {
            for (name, value) in &material.values {
                if let Value::Numbers(numbers) = value {
                    let value = listed(numbers);
                    push(name.clone(), Guess::UniformByUse { value });
                }
            }
            for name in draw.values.keys() {
                let array = name.split('[').next().unwrap_or(name);
                push(array.to_owned(), Guess::BufferFromMesh);
            }
        }
        for (name, guess) in textures {
            push(name, guess);
        }
        for (name, stream) in streams.by_role() {
            let stream = stream.to_owned();
            push(name.to_owned(), Guess::AttributeByUse { stream });
        }
        for name in streams.synthesised() {
            push(name.to_owned(), Guess::AttributeSynthesised);
        }
    }
    out
}

/// How a part of a buffer was filled. `None` if the scene specifies it, or nothing reads it.
fn of_leaf(
    scene: &Scene,
    leaf: &VariableLeaf<'_>,
    origin: ValueOrigin,
    numbers: &[f64; 16],
) -> Option<Guess> {
    let count = (leaf.columns * leaf.rows) as usize;
    if is_padding(leaf) {
        return None;
    }
    let named = |semantic: Semantic| format!("${}", semantic.name());
    Some(match origin {
        ValueOrigin::Said => match leaf.semantic {
            Some(semantic) if scene.is_made_up => Guess::UniformByUse {
                value: named(semantic),
            },
            _ => return None,
        },
        ValueOrigin::Mesh => Guess::BufferFromMesh,
        ValueOrigin::Convention(semantic) => Guess::UniformByName {
            value: named(semantic),
        },
        ValueOrigin::Use(semantic) => Guess::UniformByUse {
            value: named(semantic),
        },
        ValueOrigin::MadeUp => Guess::UniformMadeUp {
            numbers: numbers[..count].to_vec(),
        },
    })
}
