//! Assigns the bindings and locations that both stages share.
//!
//! The author's bindings are preserved unless they conflict: OpenGL numbers textures and blocks
//! separately, WebGPU does not. Everything else is numbered in group 0: first the block of loose
//! uniforms, then declarations of the vertex stage, then those of the fragment stage.
//!
//! The author's locations are preserved. Varyings are matched by name, or by location if both
//! stages specify one.

mod bindings;

use std::collections::{BTreeMap, HashMap, HashSet};

use naga::{ShaderStage, Span};

use self::bindings::explicit;
use super::layout::Rules;
use super::stage::{GlslStage, Qualifiers, Variable};
use super::tree::HandleTy;
use super::ty::{GlslMember, Struct, Ty};
use super::version::Dialect;
use crate::errors::unsupported;
use shader_text::error::{Code, Error};

/// Group and binding.
pub(super) type BindingSlot = (u32, u32);

/// A combined sampler, split into a texture and a sampler, with their bindings.
#[derive(Clone, Debug)]
pub(super) struct BoundSampler {
    /// The author's type, such as `sampler2D`.
    pub combined: String,
    pub texture: String,
    pub sampler: String,
    pub slots: [BindingSlot; 2],
    /// The author's binding, if there is one.
    pub number: Option<u32>,
}

/// The interface of both stages.
#[derive(Debug, Default)]
pub(super) struct Interface {
    /// Loose uniforms of both stages, without samplers.
    pub uniforms: Vec<GlslMember>,
    /// Structs that these uniforms use. A stage may lack some of them.
    pub structs: Vec<Struct>,
    pub uniform_slot: BindingSlot,
    /// Type and instance name of the block of loose uniforms.
    pub uniform_block: [String; 2],
    /// Keyed by path: `map`, `material.diffuse`, `maps[2]`.
    pub samplers: BTreeMap<String, BoundSampler>,
    /// Names of struct copies with another layout in blocks. Key: name, row-major, std430.
    pub struct_copies: HashMap<(String, bool, bool), String>,
    /// New and old names of blocks whose binding differs between the stages.
    pub renamed: Vec<(String, String)>,
    pub opaque: HashMap<String, BindingSlot>,
    pub blocks: HashMap<String, BindingSlot>,
    /// Locations of inputs and outputs by key, one map per stage.
    pub inputs: [HashMap<String, u32>; 2],
    pub outputs: [HashMap<String, u32>; 2],
    /// The fragment stage's interpolation of each varying.
    pub interpolation: HashMap<String, [Option<&'static str>; 2]>,
    pub names: HashSet<String>,
}

/// A stage's index in the arrays of [`Interface`].
pub(super) fn index(kind: ShaderStage) -> usize {
    usize::from(kind == ShaderStage::Fragment)
}

impl Interface {
    /// A name like `wanted` that no stage uses.
    pub(super) fn fresh(&mut self, wanted: &str) -> String {
        let mut name = wanted.to_owned();
        while !self.names.insert(name.clone()) {
            name.push('_');
        }
        name
    }

    pub(super) fn of(stages: &mut [GlslStage<'_>]) -> Result<Self, Error> {
        let mut out = Self::default();
        for stage in stages.iter() {
            out.names.extend(stage.unit.names.iter().cloned());
        }
        out.tell_apart(stages)?;
        out.uniforms(stages)?;
        out.bindings(stages)?;
        out.attributes(stages)?;
        out.varyings(stages)?;
        out.targets(stages)?;
        Ok(out)
    }

    /// Renames resources with one name but two bindings: in Vulkan, the binding identifies a
    /// resource.
    fn tell_apart(&mut self, stages: &mut [GlslStage<'_>]) -> Result<(), Error> {
        let [first, second] = stages else {
            return Ok(());
        };
        let differ = |a: &Qualifiers, b: &Qualifiers| matches!((explicit(a), explicit(b)), (Some(a), Some(b)) if a != b);
        for block in &mut second.blocks {
            let other = first.blocks.iter().find(|b| b.name == block.name);
            if other.is_some_and(|other| differ(&other.qualifiers, &block.qualifiers)) {
                let own = std::mem::take(&mut block.name);
                block.name = self.fresh(&format!("{own}_fragment"));
                self.renamed.push((block.name.clone(), own));
            }
        }
        let opaque = |stage: &'_ GlslStage<'_>| -> Vec<super::stage::Variable> {
            stage
                .uniforms
                .iter()
                .chain(&stage.opaque)
                .cloned()
                .collect()
        };
        let before = opaque(first);
        for variable in opaque(second) {
            let other = before.iter().find(|v| v.name == variable.name);
            let Some(other) = other.filter(|o| differ(&o.qualifiers, &variable.qualifiers)) else {
                continue;
            };
            let name = &variable.name;
            return Err(Error::new(
                Code::Link,
                format!("both stages have a `{name}`, at two bindings"),
            )
            .label_if(variable.place)
            .label_if(other.place)
            .note("rename one of them: as in OpenGL, a name is unique in a program"));
        }
        Ok(())
    }

    fn uniforms(&mut self, stages: &mut [GlslStage<'_>]) -> Result<(), Error> {
        let mut declared: HashMap<String, (Ty, Option<Span>)> = HashMap::new();
        for stage in stages.iter_mut() {
            for uniform in &stage.uniforms {
                if let Some((ty, before)) = declared.get(&uniform.name) {
                    if *ty != uniform.ty {
                        let error = Error::new(
                            Code::Link,
                            format!(
                                "the two stages declare the uniform `{}` differently",
                                uniform.name
                            ),
                        );
                        return Err(error
                            .label_if(uniform.place)
                            .label_if(*before)
                            .note("in OpenGL both stages share a uniform"));
                    }
                    continue;
                }
                declared.insert(uniform.name.clone(), (uniform.ty.clone(), uniform.place));
                if stage.structs.has_data(&uniform.ty) {
                    self.uniforms.push(GlslMember {
                        name: uniform.name.clone(),
                        ty: uniform.ty.clone(),
                        row_major: false,
                        place: uniform.place,
                    });
                }
            }
        }
        // Each stage declares the whole block and its structs.
        for stage in stages.iter() {
            for name in &stage.structs.order {
                let Some(of) = stage.structs.get(name).cloned() else {
                    continue;
                };
                match self.structs.iter().find(|s| s.name == *name) {
                    None => self.structs.push(of),
                    Some(other) if !other.has(&of.members) => {
                        let is_it = |ty: &Ty| matches!(ty, Ty::Struct(of) if of == name);
                        let mut uniforms = self.uniforms.iter();
                        let shared = uniforms.any(|u| stage.structs.any(&u.ty, &is_it));
                        if shared {
                            let place = of.members.first().and_then(|m| m.place);
                            return Err(Error::new(
                                Code::Link,
                                format!(
                                    "the two stages declare the struct `{name}` of a uniform \
                                     differently"
                                ),
                            )
                            .label_if(place));
                        }
                    }
                    Some(_) => {}
                }
            }
        }
        for uniform in &self.uniforms {
            for stage in stages.iter_mut() {
                import(&uniform.ty, &self.structs, stage);
                stage.structs.host(&uniform.ty);
            }
        }
        for stage in stages.iter_mut() {
            for block in stage.blocks.clone() {
                if block.rules() == Rules::Std140 {
                    for member in &block.members {
                        stage.structs.host(&member.ty);
                    }
                }
            }
        }
        self.uniform_block = [self.fresh("Uniforms"), self.fresh("uniforms")];
        Ok(())
    }

    fn attributes(&mut self, stages: &[GlslStage<'_>]) -> Result<(), Error> {
        if let Some(vertex) = stages.iter().find(|s| s.kind == ShaderStage::Vertex) {
            self.inputs[0] = numbered(vertex, &vertex.inputs, HashMap::new())?;
        }
        Ok(())
    }

    fn varyings(&mut self, stages: &[GlslStage<'_>]) -> Result<(), Error> {
        let vertex = stages.iter().find(|s| s.kind == ShaderStage::Vertex);
        let fragment = stages.iter().find(|s| s.kind == ShaderStage::Fragment);
        for variable in vertex
            .iter()
            .flat_map(|s| &s.outputs)
            .chain(fragment.iter().flat_map(|s| &s.inputs))
        {
            let q = &variable.qualifiers;
            // The fragment stage comes last and takes precedence.
            self.interpolation
                .insert(variable.key(), [q.interpolation, q.sampling]);
        }
        let (Some(vertex), Some(fragment)) = (vertex, fragment) else {
            if let Some(vertex) = vertex {
                self.outputs[0] = numbered(vertex, &vertex.outputs, HashMap::new())?;
            }
            if let Some(fragment) = fragment {
                self.inputs[1] = numbered(fragment, &fragment.inputs, HashMap::new())?;
            }
            return Ok(());
        };
        // A location given only in the fragment stage also applies to the output of that name.
        let given: HashMap<String, u32> = fragment
            .inputs
            .iter()
            .filter_map(|v| Some((v.key(), v.qualifiers.number("location")?)))
            .collect();
        let outputs = numbered(vertex, &vertex.outputs, given)?;
        for input in &fragment.inputs {
            let explicit = input.qualifiers.number("location");
            let by_location = explicit.and_then(|at| {
                vertex
                    .outputs
                    .iter()
                    .find(|o| o.qualifiers.number("location") == Some(at))
            });
            let by_name = || vertex.outputs.iter().find(|o| o.key() == input.key());
            let Some(output) = by_location.or_else(by_name) else {
                if fragment.used.contains(input.used_as()) {
                    let error = Error::new(
                        Code::Interface,
                        format!(
                            "the fragment stage reads `{}`, which the vertex stage does not write",
                            input.name
                        ),
                    )
                    .label_if(input.place);
                    // Older versions only have these two stages.
                    let Dialect { version, es } = fragment.unit.dialect;
                    return Err(match version >= if es { 310 } else { 150 } {
                        true => error.note(
                            "if a geometry or tessellation stage is between the two, preshade \
                             cannot take them",
                        ),
                        false => error,
                    });
                }
                continue;
            };
            if !carries(&output.ty, &input.ty) {
                return Err(Error::new(
                    Code::Interface,
                    format!(
                        "the varying `{}` is a {} in the vertex stage and a {} in the fragment \
                         stage",
                        input.name,
                        output.ty.name(),
                        input.ty.name()
                    ),
                )
                .label_if(input.place)
                .label_if(output.place));
            }
            if let Some(at) = outputs.get(&output.key()) {
                self.inputs[1].insert(input.key(), *at);
                let q = &input.qualifiers;
                self.interpolation
                    .insert(output.key(), [q.interpolation, q.sampling]);
            }
        }
        self.outputs[0] = outputs;
        Ok(())
    }

    fn targets(&mut self, stages: &[GlslStage<'_>]) -> Result<(), Error> {
        if let Some(fragment) = stages.iter().find(|s| s.kind == ShaderStage::Fragment) {
            self.outputs[1] = numbered(fragment, &fragment.outputs, HashMap::new())?;
        }
        Ok(())
    }
}

/// Whether an output can supply an input. Vulkan allows the output more components.
fn carries(output: &Ty, input: &Ty) -> bool {
    let more = output.components() >= input.components() && input.components().is_some();
    output == input || output.kind() == input.kind() && output.kind().is_some() && more
}

/// Adds missing structs of `ty` to a stage, inner ones first.
fn import(ty: &Ty, all: &[Struct], stage: &mut GlslStage<'_>) {
    let Ty::Struct(name) = ty.innermost() else {
        return;
    };
    if stage.structs.get(name).is_some() {
        return;
    }
    if let Some(of) = all.iter().find(|s| s.name == *name) {
        for member in &of.members {
            import(&member.ty, all, stage);
        }
        stage.structs.insert(of.clone());
    }
}

/// The types of a combined sampler's texture and sampler.
pub(super) fn handles(combined: &str) -> [HandleTy; 2] {
    let compares = combined.ends_with("Shadow");
    let texture = combined.replacen("sampler", "texture", 1);
    let texture = texture.trim_end_matches("Shadow");
    let sampler = if compares { "samplerShadow" } else { "sampler" };
    [texture, sampler].map(|name| HandleTy {
        name: name.to_owned(),
        compares,
    })
}

/// Converts a path to a name: `lights[1].map` to `lights_1_map`.
pub(super) fn flat(path: &str) -> String {
    path.replace(['[', '.'], "_").replace(']', "")
}

fn refuse_sampler(combined: &str, variable: &Variable) -> Result<(), Error> {
    let why = match combined.trim_start_matches(['i', 'u']) {
        "sampler2DRect" | "sampler2DRectShadow" => "rectangle textures",
        "samplerBuffer" => "buffer textures",
        "sampler2DMSArray" => "arrays of multisampled textures",
        "sampler1DShadow" | "sampler1DArray" | "sampler1DArrayShadow" => {
            "such one-dimensional textures"
        }
        _ => return Ok(()),
    };
    Err(unsupported(
        format!("`{}` is a {combined}: WebGPU has no {why}", variable.name),
        variable.place,
    ))
}

/// Assigns locations to `variables`: their own, those in `given`, or the next free ones.
fn numbered(
    stage: &GlslStage<'_>,
    variables: &[Variable],
    given: HashMap<String, u32>,
) -> Result<HashMap<String, u32>, Error> {
    let mut out: HashMap<String, u32> = HashMap::new();
    let mut taken = HashSet::new();
    let size = |v: &Variable| {
        let leaves = stage.structs.leaf_paths(&v.ty);
        leaves.len().max(1) as u32
    };
    let said = |v: &Variable| {
        v.qualifiers
            .number("location")
            .or_else(|| given.get(&v.key()).copied())
    };
    for variable in variables {
        if let Ty::Array(_, None) = variable.ty {
            return Err(unsupported(
                format!(
                    "`{}` is unsized: only geometry and tessellation shaders have such arrays",
                    variable.name
                ),
                variable.place,
            ));
        }
        if let Some(at) = said(variable) {
            out.insert(variable.key(), at);
            taken.extend(at..at.saturating_add(size(variable)));
        }
    }
    for variable in variables {
        if out.contains_key(&variable.key()) {
            continue;
        }
        let n = size(variable);
        let mut at = 0;
        while (at..at + n).any(|l| taken.contains(&l)) {
            at += 1;
        }
        out.insert(variable.key(), at);
        taken.extend(at..at + n);
    }
    Ok(out)
}
