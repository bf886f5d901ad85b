//! Finds numbers that no frame changes. Reads the scene's frames and needs no adapter.

use std::collections::{BTreeMap, BTreeSet};

use preshade_plan::guard::{Assumed, Bounds, Place, ScalarType};
use preshade_plan::pass::{Changing, Constant, Facts};
use preshade_plan::plan::{GpuPass, Plan};
use preshade_plan::uniforms::{UniformScalar, uniform_scalars};

use super::{changing, originals};
use preshade_draw::scene::bind::{self, DrawBindings, TextureContent};
use preshade_draw::scene::{Image, Material, Scene, SceneError};

/// Everything that is computed once for all draws of a scene.
pub(crate) struct Looked<'s> {
    scene: &'s Scene,
    changing: Vec<Changing>,
    /// The plans of its materials, as their authors wrote them.
    pub plans: Vec<Plan>,
    /// By material, textures whose texels are all equal.
    textures: Vec<Vec<Assumed>>,
}

/// Scalars that are constant, each with its bounds over the draws of the material: scalars of
/// uniforms that follow neither camera nor time, and vertex attributes and textures with one value
/// everywhere. Values that preshade made up are left out.
///
/// # Errors
///
/// A value that does not fit its variable.
pub fn constants(scene: &Scene) -> Result<Vec<Constant>, SceneError> {
    constants_beside(scene, changing(scene)?)
}

/// [`Looked::at`], with the changing uniforms already known.
pub(super) fn constants_beside(
    scene: &Scene,
    changing: Vec<Changing>,
) -> Result<Vec<Constant>, SceneError> {
    let looked = Looked::beside(scene, changing)?;
    let mut found = Vec::new();
    for (index, plan) in looked.plans.iter().enumerate() {
        let draws = scene.draws.iter().enumerate();
        let draws = draws.filter(|(_, d)| d.material == index).map(|(i, _)| i);
        let mut of: Option<BTreeMap<Place, Assumed>> = None;
        for draw in draws {
            let values = looked.of_draw(draw)?;
            of = Some(match of {
                None => values,
                Some(before) => both(before, &values),
            });
        }
        found.extend(of.unwrap_or_default().into_values().map(|value| Constant {
            material: plan.material.clone(),
            value,
        }));
    }
    Ok(found)
}

/// Scalars that are bounded in both, with bounds that include both.
pub(super) fn both(
    before: BTreeMap<Place, Assumed>,
    now: &BTreeMap<Place, Assumed>,
) -> BTreeMap<Place, Assumed> {
    let joined = |(place, assumed): (Place, Assumed)| {
        let bounds = assumed.bounds.or(now.get(&place)?.bounds);
        Some((place, Assumed { bounds, ..assumed }))
    };
    before.into_iter().filter_map(joined).collect()
}

impl<'s> Looked<'s> {
    /// Reads the frames and textures of a scene.
    ///
    /// # Errors
    ///
    /// A value that does not fit its variable.
    pub fn at(scene: &'s Scene) -> Result<Self, SceneError> {
        Self::beside(scene, changing(scene)?)
    }

    /// [`Looked::at`], with the changing uniforms already known.
    fn beside(scene: &'s Scene, changing: Vec<Changing>) -> Result<Self, SceneError> {
        let plans = originals(scene);
        let first = scene.frames().next().map(|(_, frame)| frame);
        let mut all = Vec::new();
        for (index, plan) in plans.iter().enumerate() {
            let draw = scene.draws.iter().find(|d| d.material == index);
            let parts = (plan.main(), draw, first, scene.materials.get(index));
            all.push(match parts {
                (Some(pass), Some(draw), Some(frame), Some(material)) => {
                    textures(pass, &bind::draw(scene, material, pass, draw, frame)?)
                }
                _ => Vec::new(),
            });
        }
        Ok(Self {
            scene,
            changing,
            plans,
            textures: all,
        })
    }

    /// The numbers of one draw that no frame changes, by place.
    ///
    /// # Errors
    /// A value that does not fit its variable.
    pub fn of_draw(&self, draw: usize) -> Result<BTreeMap<Place, Assumed>, SceneError> {
        let scene = self.scene;
        let first = scene.frames().next().map(|(_, frame)| frame);
        let (Some(frame), Some(draw)) = (first, scene.draws.get(draw)) else {
            return Ok(BTreeMap::new());
        };
        let material = scene.materials.get(draw.material);
        let pass = self.plans.get(draw.material).and_then(Plan::main);
        let (Some(material), Some(pass)) = (material, pass) else {
            return Ok(BTreeMap::new());
        };
        let bound = bind::draw(scene, material, pass, draw, frame)?;
        let mut found = match draw.captured.is_some() {
            true => uniforms(material, &bound, &[], is_setting),
            false => uniforms(material, &bound, &self.changing, |_, _| true),
        };
        found.extend(attributes(pass, &bound));
        found.extend(self.textures[draw.material].iter().cloned());
        Ok(found.into_iter().map(|a| (a.place.clone(), a)).collect())
    }

    /// [`Looked::of_draw`] without elements of matrices. Matrices differ between many draws, but
    /// branches seldom depend on them. Without them fewer draws differ.
    pub fn telling(&self, draw: usize) -> Result<BTreeMap<Place, Assumed>, SceneError> {
        let mut values = self.of_draw(draw)?;
        let draw = self.scene.draws.get(draw);
        let plan = draw.and_then(|d| self.plans.get(d.material));
        let program = plan.and_then(|p| p.program(p.main()?));
        let scalars = program.map(|p| uniform_scalars(p.module()));
        for element in scalars.iter().flatten().filter(|s| s.is_of_matrix) {
            values.remove(&element.place());
        }
        Ok(values)
    }
}

/// Whether a number of a captured draw may be a setting, such as a switch or the strength of an
/// effect. One frame does not show which values the next one changes, so this is a guess: the guard
/// catches a wrong one. Numbers of cameras, clocks and objects are seldom whole.
fn is_setting(scalar: &UniformScalar, number: f64) -> bool {
    !scalar.is_of_matrix && (scalar.ty != ScalarType::F32 || [-1.0, 0.0, 1.0].contains(&number))
}

/// The scalars of uniforms that do not change and whose number `keep` accepts.
fn uniforms(
    material: &Material,
    bound: &DrawBindings,
    changing: &[Changing],
    keep: impl Fn(&UniformScalar, f64) -> bool,
) -> Vec<Assumed> {
    let module = material.program.module();
    // Members that change, by their path.
    let moving: BTreeSet<(u32, u32, Option<&str>)> = changing
        .iter()
        .filter(|c| c.material == material.name)
        .map(|c| (c.group, c.binding, c.member.as_deref()))
        .collect();
    let global = |group: u32, binding: u32| {
        let mut all = module.global_variables.iter().map(|(_, g)| g);
        all.find(|g| {
            g.binding
                .is_some_and(|b| (b.group, b.binding) == (group, binding))
        })
        .and_then(|g| g.name.as_deref())
        .unwrap_or("")
    };
    uniform_scalars(module)
        .into_iter()
        .filter_map(|scalar| {
            let (group, binding) = (scalar.group, scalar.binding);
            let path = scalar.name.strip_prefix(global(group, binding))?;
            let member = path.trim_start_matches('.');
            let member = member.split(['.', '[']).next();
            if moving.contains(&(group, binding, None))
                || moving.contains(&(group, binding, member))
            {
                return None;
            }
            let buffer = bound
                .buffers
                .iter()
                .find(|b| (b.group, b.binding) == (group, binding))?;
            let at = scalar.offset as usize;
            if buffer.is_invented(&(at..at + 4)) {
                return None;
            }
            let bytes = buffer.data.bytes.get(at..)?;
            let number = scalar.ty.read(*bytes.first_chunk::<4>()?);
            (number.is_finite() && keep(&scalar, number)).then(|| Assumed {
                place: scalar.place(),
                name: scalar.name,
                ty: scalar.ty,
                bounds: Bounds::one(number),
            })
        })
        .collect()
}

/// Components of attributes that are the same at every vertex and instance.
fn attributes(pass: &GpuPass, bound: &DrawBindings) -> Vec<Assumed> {
    let mut found = Vec::new();
    for buffer in &bound.vertex_buffers {
        for attribute in buffer.attributes.iter().filter(|a| !a.is_invented) {
            let Some(used) = pass
                .attributes
                .iter()
                .find(|a| a.location == attribute.location)
            else {
                continue;
            };
            let format = format!("{:?}", attribute.format);
            let ty = match () {
                () if format.starts_with("Float32") => ScalarType::F32,
                () if format.starts_with("Uint32") => ScalarType::U32,
                () if format.starts_with("Sint32") => ScalarType::I32,
                () => continue,
            };
            for component in 0..(attribute.format.size() / 4) as u32 {
                let at = attribute.offset as usize + 4 * component as usize;
                let rows = buffer
                    .data
                    .bytes
                    .chunks_exact(buffer.stride.max(1) as usize);
                let mut words = rows.map(|r| r.get(at..).and_then(|w| w.first_chunk::<4>()));
                let Some(Some(first)) = words.next() else {
                    continue;
                };
                let number = ty.read(*first);
                if !number.is_finite() || !words.all(|w| w == Some(first)) {
                    continue;
                }
                let letter = ["x", "y", "z", "w"][component.min(3) as usize];
                found.push(Assumed {
                    name: format!("{}.{letter}", used.name),
                    place: Place::Attribute {
                        location: attribute.location,
                        component,
                    },
                    ty,
                    bounds: Bounds::one(number),
                });
            }
        }
    }
    found
}

/// Channels of textures that are the same in every texel.
fn textures(pass: &GpuPass, bound: &DrawBindings) -> Vec<Assumed> {
    let mut found = Vec::new();
    for texture in bound.textures.iter().filter(|t| !t.is_invented) {
        let TextureContent::Image(image) = &texture.content else {
            continue;
        };
        let at = (texture.group, texture.binding);
        let used = pass.bindings.iter().find(|b| (b.group, b.binding) == at);
        let Some(used) = used else { continue };
        for channel in 0..4 {
            let Some(bounds) = one_value(image, channel) else {
                continue;
            };
            let letter = ["r", "g", "b", "a"][channel as usize];
            found.push(Assumed {
                name: format!("{}.{letter}", used.name),
                place: Place::Texture {
                    group: texture.group,
                    binding: texture.binding,
                    channel,
                },
                ty: ScalarType::F32,
                bounds,
            });
        }
    }
    found
}

/// Bounds of a channel after decoding and filtering, if all its texels are equal. The ends of the
/// scale are exact. `None` also for a compressed format, which we do not read.
fn one_value(image: &Image, channel: u32) -> Option<Bounds> {
    let mut texels = image.texels()?.all().map(|t| t[channel as usize]);
    let first = texels.next().filter(|t| t.is_finite())?;
    if !texels.all(|t| t == first) {
        return None;
    }
    let value = f64::from(first);
    // Allowed for filtering equal texels and for decoding sRGB.
    let slack = value.abs().max(1.0) / 1024.0;
    Some(match value {
        0.0 | 1.0 => Bounds::one(value),
        _ => Bounds {
            low: value - slack,
            high: value + slack,
        },
    })
}

/// Values of a material's draws as facts, and nothing else.
pub(super) fn as_facts(plan: &Plan, values: &BTreeMap<Place, Assumed>) -> Facts {
    let constants = values.values().map(|value| Constant {
        material: plan.material.clone(),
        value: value.clone(),
    });
    Facts {
        constants: constants.collect(),
        ..Facts::default()
    }
}
