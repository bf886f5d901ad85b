//! Which combined image samplers of the author come out as one resource again in Vulkan's
//! languages, and at which binding. The IR has a texture and a sampler for each.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use naga::{Expression, Function, GlobalVariable, Handle, Module, ResourceBinding, TypeInner};
use naga_edit::declared::{CombinedSampler, Declared, Type};
use naga_operands::calls;
use preshade_plan::plan::Plan;
use preshade_plan::program::Program;

#[cfg(feature = "spirv")]
use preshade_plan::plan_file::GlslTexture;

/// A resource's set and binding, with an order.
pub(super) type BindingPlace = (u32, u32);

/// A combined image sampler, or an element of an array of them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Combined {
    /// Path in the author's text: `map`, `maps[2]`.
    pub(super) path: String,
    /// The texture in the IR.
    pub(super) texture: BindingPlace,
    /// The sampler in the IR.
    pub(super) sampler: BindingPlace,
    /// Set and binding in the text: the author's, if they are free.
    pub(super) place: BindingPlace,
    /// Index and length, if an array has that place.
    pub(super) element: Option<(u32, u32)>,
}

impl Combined {
    /// The array's name, or that of the only variable.
    pub(super) fn root(&self) -> &str {
        match self.element {
            Some(_) => self.path.split('[').next().unwrap_or_default(),
            None => &self.path,
        }
    }

    /// The entry of `plan.json`.
    #[cfg(feature = "spirv")]
    pub(super) fn listed(&self) -> GlslTexture {
        GlslTexture {
            name: self.path.clone(),
            texture: self.texture.into(),
            sampler: Some(self.sampler.into()),
            unit: Some(self.place.1),
            size: None,
        }
    }
}

/// The combined image samplers of a program.
#[derive(Clone, Debug, Default)]
pub(super) struct CombinedSamplers {
    pub(super) all: Vec<Combined>,
    /// A sentence on each texture and sampler that stay separate.
    pub(super) notes: Vec<String>,
}

fn place(binding: ResourceBinding) -> BindingPlace {
    (binding.group, binding.binding)
}

impl CombinedSamplers {
    /// The combined samplers of `program`, a program of `plan`. All programs of a plan agree on
    /// places.
    pub(super) fn of(plan: &Plan, program: &Program) -> Self {
        let declared = program.declared();
        let mut out = Self::default();
        if declared.samplers.is_empty() {
            return out;
        }
        let mixed = mixed(program);
        let own: BTreeSet<BindingPlace> = bound(program.module()).collect();
        for mut combined in placed(plan, declared) {
            if !own.contains(&combined.texture) {
                continue;
            }
            if let Some(mixed) = &mixed
                && !mixed.contains(&combined.texture)
            {
                out.all.push(combined);
                continue;
            }
            combined.element = None;
            out.notes.push(format!(
                "`{}` stays a texture and a sampler in Vulkan's languages: the program also reads \
                 it with another sampler, or its sampler with another texture",
                combined.path
            ));
        }
        out
    }
}

fn bound(module: &Module) -> impl Iterator<Item = BindingPlace> {
    let globals = module.global_variables.iter();
    globals.filter_map(|(_, g)| g.binding.map(place))
}

/// All combined samplers with their places. An author's place goes to the first resource that has
/// it: OpenGL numbers textures and blocks separately, Vulkan does not.
fn placed(plan: &Plan, declared: &Declared) -> Vec<Combined> {
    let plans = plan.original.as_deref().into_iter().chain([plan]);
    let modules = plans.flat_map(|p| p.programs.values().map(Program::module));
    let mut taken: BTreeSet<BindingPlace> = modules.flat_map(bound).collect();
    for CombinedSampler {
        texture, sampler, ..
    } in &declared.samplers
    {
        taken.remove(&place(*texture));
        taken.remove(&place(*sampler));
    }
    // Keyed by the author's place. The elements of an array stay together.
    let mut wanted: BTreeMap<(Option<BindingPlace>, String), Vec<Combined>> = BTreeMap::new();
    for CombinedSampler {
        path,
        texture,
        sampler,
    } in &declared.samplers
    {
        let mut combined = Combined {
            path: path.clone(),
            texture: place(*texture),
            sampler: place(*sampler),
            place: place(*texture),
            element: element(declared, path),
        };
        let number = declared.numbers.iter().find(|n| n.binding == *texture);
        let first = combined.element.map_or(0, |(index, _)| index);
        let own = number.map(|n| (texture.group, n.number.saturating_sub(first)));
        // Without a number, each element has a place of its own.
        if own.is_none() {
            combined.element = None;
        }
        let key = (own, combined.root().to_owned());
        wanted.entry(key).or_default().push(combined);
    }
    let mut out = Vec::new();
    let mut others = Vec::new();
    for ((own, _), mut all) in wanted {
        match own.filter(|own| taken.insert(*own)) {
            Some(own) => {
                all.iter_mut().for_each(|c| c.place = own);
                out.extend(all);
            }
            None => others.extend(all),
        }
    }
    for mut other in others {
        other.element = None;
        while !taken.insert(other.place) {
            other.place.1 += 1;
        }
        out.push(other);
    }
    out
}

/// Index and length of `maps[2]`. `None` if it is not an element of an array, or one of an array of
/// arrays or structs.
pub(super) fn element(declared: &Declared, path: &str) -> Option<(u32, u32)> {
    let (root, index) = path.strip_suffix(']')?.split_once('[')?;
    let uniform = declared.uniforms.iter().find(|u| u.name == root)?;
    match &uniform.ty {
        Type::Array(of, length) if matches!(**of, Type::Sampler(_)) => {
            Some((index.parse().ok()?, *length))
        }
        _ => None,
    }
}

/// How a function receives a texture and a sampler.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Received {
    Combined,
    Apart,
}

/// The textures that the program uses with another sampler than their own. `None` if a function
/// receives both combined samplers and others.
fn mixed(program: &Program) -> Option<BTreeSet<BindingPlace>> {
    let module = program.module();
    let samplers = &program.declared().samplers;
    let at = |handle: Handle<GlobalVariable>| module.global_variables[handle].binding;
    let mut mixed = BTreeSet::new();
    for index in 0..module.entry_points.len() {
        for key in &program.info().get_entry_point(index).sampling_set {
            let [image, sampler] = [at(key.image)?, at(key.sampler)?];
            let meets = |s: &&CombinedSampler| (s.texture == image) != (s.sampler == sampler);
            mixed.extend(samplers.iter().filter(meets).map(|s| place(s.texture)));
        }
    }
    let is_pair = |texture: Handle<GlobalVariable>, sampler: Handle<GlobalVariable>| {
        let [texture, sampler] = [at(texture), at(sampler)];
        samplers.iter().any(|s| {
            Some(s.texture) == texture
                && Some(s.sampler) == sampler
                && !mixed.contains(&place(s.texture))
        })
    };
    let mut received: HashMap<(Handle<Function>, usize), Received> = HashMap::new();
    let mut agree = true;
    calls::visit(module, &mut |call| {
        let (caller, function) = call.caller;
        for (i, argument) in module.functions[call.callee].arguments.iter().enumerate() {
            if !matches!(module.types[argument.ty].inner, TypeInner::Sampler { .. }) {
                continue;
            }
            let passed = |i: usize| &function.expressions[call.arguments[i]];
            let how = match (i.checked_sub(1).map(passed), passed(i)) {
                (
                    Some(Expression::GlobalVariable(texture)),
                    Expression::GlobalVariable(sampler),
                ) if is_pair(*texture, *sampler) => Received::Combined,
                (
                    Some(Expression::FunctionArgument(texture)),
                    Expression::FunctionArgument(sampler),
                ) if texture + 1 == *sampler => caller
                    .and_then(|c| received.get(&(c, *sampler as usize)))
                    .copied()
                    .unwrap_or(Received::Apart),
                _ => Received::Apart,
            };
            agree &= *received.entry((call.callee, i)).or_insert(how) == how;
        }
    });
    agree.then_some(mixed)
}
