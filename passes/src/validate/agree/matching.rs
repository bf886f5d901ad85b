//! Finds which resource and attribute of the second program is which of the first, and renames the
//! second program's accordingly: group, binding and location become the first's.
//!
//! A buffer with another layout keeps a binding of its own and is fed by [`Rule`]s.

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    AddressSpace, Expression, GlobalVariable, Handle, Module, ResourceBinding, Type, TypeInner,
};
use serde::Serialize;

use super::fed::{Cast, Rule, cast, plain};
use super::{Mismatch, Relation};
use crate::core::mapping::{self, Mapping};
use crate::core::program::Program;
use crate::core::reflect;
use crate::evaluate;
use crate::validate::world::PassStages;

/// The group of buffers that keep a binding of their own.
const OWN_GROUP: u32 = 4096;

/// Two names of one thing.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, schemars::JsonSchema)]
pub struct Partner {
    /// In the second program.
    pub theirs: String,
    /// In the first.
    pub ours: String,
    /// How they were found.
    pub by: By,
}

/// How two partners were found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum By {
    /// Group and binding, or location.
    Number,
    /// Name and type.
    Name,
    /// A mapping says so.
    Map,
    /// The texture that a sampler is used with.
    Texture,
}

/// A part of a variable of the second program without a partner.
#[derive(Clone, Debug)]
pub(super) struct Lost {
    /// The variable's group and binding in the renamed program.
    pub(super) at: (u32, u32),
    pub(super) steps: Vec<usize>,
    pub(super) name: String,
    pub(super) ty: String,
    /// Parts of the first program with this type.
    pub(super) candidates: Vec<String>,
}

/// The second program in the first one's terms.
pub(super) struct Matching {
    pub(super) program: Program,
    pub(super) rules: Vec<Rule>,
    pub(super) partners: Vec<Partner>,
    pub(super) lost: Vec<Lost>,
    /// Attributes of the second program without a partner, by location in the renamed program.
    pub(super) lost_inputs: BTreeMap<u32, String>,
    /// Attribute components that the first program does not read: a vertex format fills them.
    pub(super) filled: Vec<(u32, u32)>,
}

/// A data part of the first program.
struct Leaf {
    global: Handle<GlobalVariable>,
    steps: Vec<usize>,
    ty: Handle<Type>,
    name: String,
}

/// How a variable of ours fits, by its number if so told.
type Fits<'a, T> = dyn Fn(&GlobalVariable, bool) -> Option<T> + 'a;

/// The search.
pub(super) struct Matcher<'a> {
    pub(super) ours: &'a Module,
    pub(super) theirs: &'a Module,
    pub(super) relation: Relation,
    pub(super) maps: &'a [Mapping],
    /// Named parts of our buffers.
    leaves: Vec<Leaf>,
    /// New bindings of their variables.
    pub(super) bindings: BTreeMap<Handle<GlobalVariable>, ResourceBinding>,
    rules: Vec<Rule>,
    partners: Vec<Partner>,
    lost: Vec<Lost>,
    /// Our place, and the place of theirs that has it now.
    taken: BTreeMap<(u32, u32), Option<(u32, u32)>>,
    own: u32,
}

/// Matches the second program with the first.
pub(super) fn matched(
    first: PassStages<'_>,
    second: PassStages<'_>,
    relation: Relation,
    maps: &[Mapping],
) -> Result<Matching, Mismatch> {
    let (ours, theirs) = (first.vertex.module(), second.vertex.module());
    check(ours, theirs, (first, second), maps)?;
    let mut matcher = Matcher {
        ours,
        theirs,
        relation,
        maps,
        leaves: leaves(ours),
        bindings: BTreeMap::new(),
        rules: Vec::new(),
        partners: Vec::new(),
        lost: Vec::new(),
        taken: BTreeMap::new(),
        own: 0,
    };
    let used = used(second);
    // A sampler may follow its texture.
    let is_sampler = |g: Handle<GlobalVariable>| {
        let ty = theirs.global_variables[g].ty;
        matches!(theirs.types[ty].inner, TypeInner::Sampler { .. })
    };
    for global in used.iter().filter(|g| !is_sampler(**g)) {
        match theirs.global_variables[*global].space {
            AddressSpace::Handle => matcher.resource(*global),
            _ => matcher.data(*global),
        }
    }
    for global in used.iter().filter(|g| is_sampler(**g)) {
        matcher.resource(*global);
    }
    let (locations, lost_inputs, filled) = matcher.attributes(first, second);
    let is_strange =
        matcher.partners.is_empty() && !(matcher.lost.is_empty() && lost_inputs.is_empty());
    if is_strange {
        return Err(Mismatch::Nothing);
    }
    let module = matcher.renamed(second, &locations)?;
    let program = second.vertex.program.with_module(module);
    let program = program.map_err(|e| Mismatch::Renamed(e.to_string()))?;
    Ok(Matching {
        program,
        rules: matcher.rules,
        partners: matcher.partners,
        lost: matcher.lost,
        lost_inputs,
        filled,
    })
}

/// The variables that its stages use, in order.
fn used(stages: PassStages<'_>) -> BTreeSet<Handle<GlobalVariable>> {
    let module = stages.vertex.module();
    let of_stages = [Some(stages.vertex), stages.fragment].into_iter().flatten();
    of_stages
        .flat_map(|stage| {
            let info = stage.program.info().get_entry_point(stage.entry);
            let globals = module.global_variables.iter();
            globals.filter(move |(handle, global)| {
                evaluate::place(global).is_some() && !info[*handle].is_empty()
            })
        })
        .map(|(handle, _)| handle)
        .collect()
}

/// Refuses mappings of names that are not there.
fn check(
    ours: &Module,
    theirs: &Module,
    (first, second): (PassStages<'_>, PassStages<'_>),
    maps: &[Mapping],
) -> Result<(), Mismatch> {
    let is_input = |stages: PassStages<'_>, path: &mapping::Path| {
        let mut inputs = stages.vertex.inputs().into_iter();
        path.members.is_empty() && inputs.any(|io| io.name.as_deref() == Some(&path.variable))
    };
    for map in maps {
        for (module, stages, path, side) in [
            (theirs, second, &map.theirs, "second"),
            (ours, first, &map.ours, "first"),
        ] {
            match path.resolve(module) {
                Err(why) if !is_input(stages, path) => {
                    return Err(Mismatch::Map {
                        map: map.to_string(),
                        side,
                        why: why.to_string(),
                    });
                }
                _ => {}
            }
        }
        if let (Ok(their), Ok(our)) = (map.theirs.resolve(theirs), map.ours.resolve(ours)) {
            let is_data = |module: &Module, g: Handle<GlobalVariable>| {
                module.global_variables[g].space != AddressSpace::Handle
            };
            let fits = match is_data(theirs, their.global) {
                true => cast((theirs, their.ty), (ours, our.ty)).is_some(),
                false => ours.types[our.ty].inner == theirs.types[their.ty].inner,
            };
            if !fits {
                return Err(Mismatch::Map {
                    map: map.to_string(),
                    side: "second",
                    why: format!(
                        "`{}` is {}, and `{}` is {}",
                        map.theirs,
                        type_text(theirs, their.ty),
                        map.ours,
                        type_text(ours, our.ty)
                    ),
                });
            }
        }
    }
    Ok(())
}

/// Members at any depth outside of arrays, and whole buffers, of the first program.
fn leaves(module: &Module) -> Vec<Leaf> {
    fn open(module: &Module, leaf: Leaf, all: &mut Vec<Leaf>) {
        for (i, (name, ty)) in mapping::members(module, leaf.ty).into_iter().enumerate() {
            let steps = [&leaf.steps[..], &[i]].concat();
            let global = leaf.global;
            open(
                module,
                Leaf {
                    global,
                    steps,
                    ty,
                    name,
                },
                all,
            );
        }
        all.push(leaf);
    }
    let mut all = Vec::new();
    for (global, variable) in module.global_variables.iter() {
        if evaluate::place(variable).is_some() && variable.space != AddressSpace::Handle {
            let name = variable.name.clone().unwrap_or_default();
            let leaf = Leaf {
                global,
                steps: Vec::new(),
                ty: variable.ty,
                name,
            };
            open(module, leaf, &mut all);
        }
    }
    all
}

impl Matcher<'_> {
    /// The name of a variable in both forms that partners compare.
    fn their_name(&self, global: Handle<GlobalVariable>) -> String {
        plain(
            self.theirs.global_variables[global]
                .name
                .as_deref()
                .unwrap_or_default(),
        )
    }

    /// The partner of a variable among candidates: by number, or by name. Where the two disagree,
    /// the same host binds by number, and another pass has its own layout.
    fn partner<T>(
        &self,
        global: Handle<GlobalVariable>,
        fits: &Fits<'_, T>,
    ) -> Option<(Handle<GlobalVariable>, T, By)> {
        let own = &self.theirs.global_variables[global];
        let at = own.binding.map(|b| (b.group, b.binding));
        let name = self.their_name(global);
        let find = |wanted: &dyn Fn(&GlobalVariable) -> bool, is_number: bool| {
            let mut all = self.ours.global_variables.iter();
            all.find_map(|(handle, variable)| {
                let is_it = evaluate::place(variable).is_some() && wanted(variable);
                let fit = is_it.then(|| fits(variable, is_number)).flatten()?;
                Some((handle, fit))
            })
        };
        let named = |v: &GlobalVariable| v.name.as_deref().is_some_and(|n| plain(n) == name);
        let numbered =
            |v: &GlobalVariable| at.is_some() && v.binding.map(|b| (b.group, b.binding)) == at;
        let by_name = match name.is_empty() {
            true => None,
            false => find(&named, false).map(|(h, fit)| (h, fit, By::Name)),
        };
        let by_number = find(&numbered, true).map(|(h, fit)| (h, fit, By::Number));
        let same_host = self.relation == Relation::Same;
        match (by_number, by_name) {
            (Some(number), Some(name)) if number.0 == name.0 || same_host => Some(number),
            (_, Some(name)) => Some(name),
            (Some(number), None) => {
                // It is somebody else's, by name.
                let our = plain(
                    self.ours.global_variables[number.0]
                        .name
                        .as_deref()
                        .unwrap_or_default(),
                );
                let mut theirs = self.theirs.global_variables.iter();
                let is_other = !same_host
                    && theirs.any(|(other, v)| {
                        other != global
                            && !our.is_empty()
                            && v.name.as_deref().is_some_and(|n| plain(n) == our)
                    });
                (!is_other).then_some(number)
            }
            (None, None) => None,
        }
    }

    /// Gives their variable the place of ours, unless another of theirs has it.
    fn take(&mut self, theirs: Handle<GlobalVariable>, ours: Handle<GlobalVariable>) -> bool {
        let own = evaluate::place(&self.theirs.global_variables[theirs]);
        let Some(at) = self.ours.global_variables[ours].binding else {
            return false;
        };
        let place = (at.group, at.binding);
        let holder = self.taken.entry(place).or_insert(own);
        if *holder == own {
            self.bindings.insert(theirs, at);
            return true;
        }
        false
    }

    fn own_binding(&mut self, theirs: Handle<GlobalVariable>) -> (u32, u32) {
        // The stages of a linked program may each declare it.
        let place = evaluate::place(&self.theirs.global_variables[theirs]);
        let known = self.bindings.iter().find(|(other, at)| {
            at.group == OWN_GROUP
                && evaluate::place(&self.theirs.global_variables[**other]) == place
        });
        let at = match known {
            Some((_, at)) => *at,
            None => {
                self.own += 1;
                ResourceBinding {
                    group: OWN_GROUP,
                    binding: self.own,
                }
            }
        };
        self.bindings.insert(theirs, at);
        (at.group, at.binding)
    }

    pub(super) fn found(&mut self, theirs: String, ours: String, by: By) {
        let partner = Partner { theirs, ours, by };
        if !self.partners.contains(&partner) {
            self.partners.push(partner);
        }
    }

    /// A texture or sampler.
    fn resource(&mut self, global: Handle<GlobalVariable>) {
        let inner = &self.theirs.types[self.theirs.global_variables[global].ty].inner;
        let fits =
            |v: &GlobalVariable, _: bool| (self.ours.types[v.ty].inner == *inner).then_some(());
        let mapped = self.maps.iter().find_map(|map| {
            let their = map.theirs.resolve(self.theirs).ok()?;
            let our = map.ours.resolve(self.ours).ok()?;
            (their.global == global).then_some((our.global, By::Map))
        });
        let found = mapped
            .or_else(|| self.partner(global, &fits).map(|(h, (), by)| (h, by)))
            .or_else(|| Some((self.sampler_of_texture(global)?, By::Texture)));
        let name = mapping::name_of(self.theirs, global, &[]).to_string();
        match found {
            Some((our, by)) => {
                // Two samplers of theirs may be one of ours; `join` makes them one variable.
                if let Some(at) = self.ours.global_variables[our].binding {
                    self.bindings.insert(global, at);
                }
                self.found(name, mapping::name_of(self.ours, our, &[]).to_string(), by);
            }
            None => {
                let at = self.own_binding(global);
                let ty = self.theirs.global_variables[global].ty;
                self.lose(global, at, Vec::new(), ty);
            }
        }
    }

    /// Our sampler that is used with the partner of a texture that their sampler is used with.
    fn sampler_of_texture(
        &self,
        sampler: Handle<GlobalVariable>,
    ) -> Option<Handle<GlobalVariable>> {
        let their = sampled(self.theirs);
        let texture = their.iter().find(|(_, s)| *s == sampler)?.0;
        let at = self.bindings.get(&texture)?;
        let wanted = &self.theirs.types[self.theirs.global_variables[sampler].ty].inner;
        sampled(self.ours).into_iter().find_map(|(t, s)| {
            let of = self.ours.global_variables[t].binding.as_ref()?;
            let is_it =
                of == at && self.ours.types[self.ours.global_variables[s].ty].inner == *wanted;
            is_it.then_some(s)
        })
    }

    fn lose(
        &mut self,
        global: Handle<GlobalVariable>,
        at: (u32, u32),
        steps: Vec<usize>,
        ty: Handle<Type>,
    ) {
        let is_data = self.theirs.global_variables[global].space != AddressSpace::Handle;
        let candidates = self.leaves.iter().filter(|leaf| {
            is_data && cast((self.theirs, ty), (self.ours, leaf.ty)) == Some(Cast::Same)
        });
        let candidates =
            candidates.map(|l| mapping::name_of(self.ours, l.global, &l.steps).to_string());
        self.lost.push(Lost {
            at,
            name: mapping::name_of(self.theirs, global, &steps).to_string(),
            candidates: candidates.take(3).collect(),
            ty: type_text(self.theirs, ty),
            steps,
        });
    }

    /// A buffer.
    fn data(&mut self, global: Handle<GlobalVariable>) {
        let variable = &self.theirs.global_variables[global];
        let ty = variable.ty;
        let mapped: Vec<(mapping::Place, mapping::Place)> = self
            .maps
            .iter()
            .filter_map(|map| {
                let their = map.theirs.resolve(self.theirs).ok()?;
                let our = map.ours.resolve(self.ours).ok()?;
                (their.global == global).then_some((their, our))
            })
            .collect();
        let kind = std::mem::discriminant(&variable.space);
        let fits = |v: &GlobalVariable, by_number: bool| {
            let is_data = v.space != AddressSpace::Handle;
            let is_kind = !by_number || std::mem::discriminant(&v.space) == kind;
            (is_data && is_kind)
                .then(|| cast((self.theirs, ty), (self.ours, v.ty)))
                .flatten()
        };
        let whole = self.partner(global, &fits);
        let name = mapping::name_of(self.theirs, global, &[]).to_string();
        if let Some((our, Cast::Same, by)) = &whole
            && mapped.is_empty()
            && self.is_same_space(global, *our)
            && self.take(global, *our)
        {
            self.found(
                name,
                mapping::name_of(self.ours, *our, &[]).to_string(),
                *by,
            );
            return;
        }
        let to = self.own_binding(global);
        match whole {
            Some((our, cast, by)) => self.rule((global, to, &[]), (our, &[]), cast, by),
            None => self.part(global, to, &mut Vec::new(), ty, &mapped),
        }
        for (their, our) in mapped {
            if let Some(cast) = cast((self.theirs, their.ty), (self.ours, our.ty)) {
                let theirs = (global, to, &their.steps[..]);
                self.rule(theirs, (our.global, &our.steps), cast, By::Map);
            }
        }
    }

    fn is_same_space(&self, theirs: Handle<GlobalVariable>, ours: Handle<GlobalVariable>) -> bool {
        let (a, b) = (
            &self.theirs.global_variables[theirs],
            &self.ours.global_variables[ours],
        );
        std::mem::discriminant(&a.space) == std::mem::discriminant(&b.space)
            && a.binding.is_some()
            && b.binding.is_some()
    }

    fn rule(
        &mut self,
        (global, to, to_steps): (Handle<GlobalVariable>, (u32, u32), &[usize]),
        (our, from_steps): (Handle<GlobalVariable>, &[usize]),
        cast: Cast,
        by: By,
    ) {
        let Some(from) = evaluate::place(&self.ours.global_variables[our]) else {
            return;
        };
        let theirs = mapping::name_of(self.theirs, global, to_steps);
        let ours = mapping::name_of(self.ours, our, from_steps);
        self.rules.push(Rule {
            to,
            to_steps: to_steps.to_vec(),
            from,
            from_steps: from_steps.to_vec(),
            cast,
            is_of_view: plain(&theirs.variable) != plain(&ours.variable) && by != By::Number,
        });
        self.found(theirs.to_string(), ours.to_string(), by);
    }

    /// A part of a buffer whose whole has no partner.
    fn part(
        &mut self,
        global: Handle<GlobalVariable>,
        to: (u32, u32),
        steps: &mut Vec<usize>,
        ty: Handle<Type>,
        mapped: &[(mapping::Place, mapping::Place)],
    ) {
        if mapped
            .iter()
            .any(|(their, _)| steps.starts_with(&their.steps))
        {
            return;
        }
        let is_split = mapped
            .iter()
            .any(|(their, _)| their.steps.starts_with(steps));
        if !is_split && let Some((our, from, cast)) = self.named(global, steps, ty) {
            return self.rule((global, to, &steps[..]), (our, &from), cast, By::Name);
        }
        let members = mapping::members(self.theirs, ty);
        if members.is_empty() {
            return self.lose(global, to, steps.clone(), ty);
        }
        for (i, (_, member)) in members.iter().enumerate() {
            steps.push(i);
            self.part(global, to, steps, *member, mapped);
            steps.pop();
        }
    }

    /// The part of ours with the same path, or the only one with the same last name.
    fn named(
        &self,
        global: Handle<GlobalVariable>,
        steps: &[usize],
        ty: Handle<Type>,
    ) -> Option<(Handle<GlobalVariable>, Vec<usize>, Cast)> {
        let path = mapping::name_of(self.theirs, global, steps);
        let word = |text: &str| match self.relation {
            Relation::Velocity => plain(without_previous(text)),
            _ => plain(text),
        };
        let last = word(path.members.last().unwrap_or(&path.variable));
        let fits: Vec<_> = self
            .leaves
            .iter()
            .filter(|leaf| !last.is_empty() && plain(&leaf.name) == last)
            .filter_map(|leaf| Some((leaf, cast((self.theirs, ty), (self.ours, leaf.ty))?)))
            .collect();
        let is_same_path = |leaf: &Leaf| {
            let ours = mapping::name_of(self.ours, leaf.global, &leaf.steps);
            let words = |p: &mapping::Path| {
                let all = std::iter::once(&p.variable).chain(&p.members);
                all.map(|w| word(w)).collect::<Vec<_>>()
            };
            words(&ours) == words(&path)
        };
        let chosen = fits
            .iter()
            .find(|(leaf, _)| is_same_path(leaf))
            .or(match &fits[..] {
                [one] => Some(one),
                _ => None,
            });
        chosen.map(|(leaf, cast)| (leaf.global, leaf.steps.clone(), cast.clone()))
    }
}

/// A name without the habits by which it says that it holds the last frame's value.
fn without_previous(name: &str) -> &str {
    let before = ["prev_", "previous_", "last_", "old_", "prev", "previous"];
    let after = ["_prev", "_previous", "_last", "_old", "Prev", "Previous"];
    let bare = before.iter().find_map(|p| name.strip_prefix(p));
    let bare = bare.or_else(|| after.iter().find_map(|p| name.strip_suffix(p)));
    bare.filter(|b| !b.is_empty()).unwrap_or(name)
}

/// Textures and samplers that are used together, both as variables.
fn sampled(module: &Module) -> Vec<(Handle<GlobalVariable>, Handle<GlobalVariable>)> {
    let functions = module.functions.iter().map(|(_, f)| f);
    let all = functions.chain(module.entry_points.iter().map(|e| &e.function));
    all.flat_map(|f| {
        f.expressions.iter().filter_map(|(_, e)| match e {
            Expression::ImageSample { image, sampler, .. } => {
                match (&f.expressions[*image], &f.expressions[*sampler]) {
                    (Expression::GlobalVariable(t), Expression::GlobalVariable(s)) => {
                        Some((*t, *s))
                    }
                    _ => None,
                }
            }
            _ => None,
        })
    })
    .collect()
}

/// A type as text.
fn type_text(module: &Module, ty: Handle<Type>) -> String {
    match &module.types[ty].inner {
        TypeInner::Image { .. } => "a texture".to_owned(),
        TypeInner::Sampler { .. } => "a sampler".to_owned(),
        TypeInner::Array { base, .. } => format!("array<{}>", type_text(module, *base)),
        _ => reflect::wgsl_type(module, ty),
    }
}
