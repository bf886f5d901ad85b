//! Finds the partner of each resource and attribute of the second program in the first. Renames the
//! second program's accordingly: group, binding and location become the first's.
//!
//! A buffer with another layout keeps a binding of its own and is fed by [`Rule`]s.

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    AddressSpace, GlobalVariable, Handle, ImageClass, Module, ResourceBinding, ScalarKind, Type,
    TypeInner,
};
use serde::Serialize;

use super::attributes::Attributes;
use super::buffers::{self, BufferLeaf, leaves};
use super::fed::{Cast, Rule, cast, plain};
use super::products::{self, Product};
use super::sampled::sampled;
use super::{Mismatch, Relation, rename};
use crate::environment::PassStages;
use naga_edit::interface;
use preshade_plan::mapping::{self, Equation, Mapping};
use preshade_plan::program::Program;
use shader_text::source::Language;

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
    /// Paths of the scalars, vectors and matrices of two buffers, theirs and ours:
    /// `spots[].tint` and `lights[].color`.
    #[serde(skip)]
    pub parts: Vec<(String, String)>,
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
    /// Number, and the order of members: no name is common.
    Order,
    /// A matrix and the product of matrices in whose place it stands.
    Product,
}

/// A part of a variable of the second program without a partner.
#[derive(Clone, Debug)]
pub struct Lost {
    /// The variable's group and binding in the renamed program.
    pub(super) at: (u32, u32),
    pub(super) steps: Vec<usize>,
    pub(super) name: String,
    pub(super) ty: String,
    /// The variable, and the type of the part.
    of: (Handle<GlobalVariable>, Handle<Type>),
    /// Parts of the first program with this type.
    pub(super) candidates: Vec<String>,
}

/// The second program in the first one's terms.
pub(super) struct Matching {
    /// The first program, if samplers of it count as one.
    pub(super) first: Option<Program>,
    pub(super) program: Program,
    pub(super) rules: Vec<Rule>,
    pub(super) partners: Vec<Partner>,
    pub(super) lost: Vec<Lost>,
    /// Attributes of the second program without a partner, by location in the renamed program.
    pub(super) lost_inputs: BTreeMap<u32, String>,
    /// Attribute components that the first program does not read: a vertex format fills them.
    pub(super) filled: Vec<(u32, u32)>,
    /// Attributes that hold another frame's value of one of the first program's, or that share one:
    /// their location in the renamed program, and ours.
    pub(super) previous_inputs: Vec<(u32, u32)>,
    /// Members of both programs with `bias` in their names, by group and binding.
    pub(super) biases: Vec<((u32, u32), Vec<usize>)>,
    /// Assumptions of the matching, a sentence each.
    pub(super) notes: Vec<String>,
}

/// How a variable of ours fits; by its number if the flag is set.
pub(super) type Fits<'a, T> = dyn Fn(&GlobalVariable, bool) -> Option<T> + 'a;

pub(super) struct Matcher<'a> {
    pub(super) ours: &'a Module,
    pub(super) theirs: &'a Module,
    /// Both programs, for facts that the IR does not hold.
    pub(super) programs: [&'a Program; 2],
    pub(super) relation: Relation,
    pub(super) maps: &'a [Mapping],
    pub(super) products: Vec<Product>,
    /// Named parts of our buffers.
    pub(super) leaves: Vec<BufferLeaf>,
    pub(super) bindings: BTreeMap<Handle<GlobalVariable>, ResourceBinding>,
    pub(super) rules: Vec<Rule>,
    partners: Vec<Partner>,
    pub(super) lost: Vec<Lost>,
    pub(super) notes: Vec<String>,
    /// A place in the first program, and the place of the second program's variable that has it
    /// now.
    taken: BTreeMap<(u32, u32), Option<(u32, u32)>>,
    own: u32,
    /// The textures and samplers that each program uses together: ours, theirs.
    sampled: [Vec<(Handle<GlobalVariable>, Handle<GlobalVariable>)>; 2],
    /// Samplers of ours that count as another one of ours.
    joined: BTreeMap<Handle<GlobalVariable>, Handle<GlobalVariable>>,
}

/// Matches the second program with the first.
pub(super) fn matched(
    first: PassStages<'_>,
    second: PassStages<'_>,
    relation: Relation,
    equations: &[Equation],
) -> Result<Matching, Mismatch> {
    let (ours, theirs) = (first.vertex.module(), second.vertex.module());
    let maps: Vec<Mapping> = equations.iter().filter_map(Equation::plain).collect();
    let maps = &maps[..];
    let products = products::given([ours, theirs], equations)?;
    check(ours, theirs, (first, second), maps)?;
    let mut matcher = Matcher {
        ours,
        theirs,
        programs: [first.vertex.program, second.vertex.program],
        relation,
        maps,
        products,
        leaves: leaves(ours),
        bindings: BTreeMap::new(),
        rules: Vec::new(),
        partners: Vec::new(),
        lost: Vec::new(),
        notes: Vec::new(),
        taken: BTreeMap::new(),
        own: 0,
        sampled: [sampled(ours), sampled(theirs)],
        joined: BTreeMap::new(),
    };
    let used = used(second);
    // A sampler may follow its texture.
    let is_sampler = |g: Handle<GlobalVariable>| {
        let ty = theirs.global_variables[g].ty;
        matches!(theirs.types[ty].inner, TypeInner::Sampler { .. })
    };
    for global in used.iter().filter(|g| !is_sampler(**g)) {
        match theirs.global_variables[*global].space {
            AddressSpace::Handle => matcher.bind(*global, matcher.resource(*global)),
            _ => matcher.data(*global),
        }
    }
    matcher.feed_products();
    // A velocity pass has products of two frames.
    if relation != Relation::Velocity {
        matcher.guess_products(first, second);
    }
    matcher.suggest(first);
    let samplers = used.iter().copied().filter(|g| is_sampler(*g));
    let samplers: Vec<_> = samplers.map(|g| (g, matcher.resource(g))).collect();
    for (theirs, found) in &samplers {
        if let Some((ours, _)) = found {
            matcher.share(*theirs, *ours);
        }
    }
    for (theirs, found) in samplers {
        matcher.bind(theirs, found);
    }
    let Attributes {
        locations,
        lost: lost_inputs,
        filled,
        previous: previous_inputs,
    } = matcher.attributes(first, second);
    let is_strange =
        matcher.partners.is_empty() && !(matcher.lost.is_empty() && lost_inputs.is_empty());
    if is_strange {
        return Err(Mismatch::Nothing);
    }
    let module = matcher.renamed(second, &locations)?;
    let renamed = |program: &Program, module| {
        let program = program.with_module(module);
        program.map_err(|e| Mismatch::Renamed(e.to_string()))
    };
    let program = renamed(second.vertex.program, module)?;
    let first = match matcher.joined.is_empty() {
        true => None,
        false => Some(renamed(first.vertex.program, matcher.joined_ours())?),
    };
    let biases = [ours, program.module()].map(buffers::biases).concat();
    Ok(Matching {
        first,
        biases,
        program,
        rules: matcher.rules,
        partners: matcher.partners,
        lost: matcher.lost,
        lost_inputs,
        filled,
        previous_inputs,
        notes: matcher.notes,
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
                naga_interp::place(global).is_some() && !info[*handle].is_empty()
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
                false => is_same_resource(
                    (theirs, &theirs.types[their.ty].inner),
                    (ours, &ours.types[our.ty].inner),
                ),
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

impl Matcher<'_> {
    /// Whether the locations of attributes are the host's in both programs. OpenGL may choose them.
    pub(super) fn has_locations(&self) -> bool {
        let mut programs = self.programs.iter();
        self.relation == Relation::Same && programs.all(|p| p.language() != Language::Glsl)
    }

    /// The name of a variable in both forms that partners compare.
    fn their_name(&self, global: Handle<GlobalVariable>) -> String {
        plain(
            self.theirs.global_variables[global]
                .name
                .as_deref()
                .unwrap_or_default(),
        )
    }

    /// Whether a variable and its next version are bound by number, whatever their names: both
    /// authors gave the numbers, and in one language. OpenGL numbers textures and buffers
    /// separately.
    pub(super) fn is_bound_by_number(
        &self,
        theirs: &GlobalVariable,
        ours: &GlobalVariable,
    ) -> bool {
        let [first, second] = self.programs;
        let is_authors = |program: &Program, variable: &GlobalVariable| {
            let declared = program.declared();
            program.language() != Language::Glsl
                || declared
                    .numbers
                    .iter()
                    .any(|n| Some(n.binding) == variable.binding)
        };
        self.relation == Relation::Same
            && first.language() == second.language()
            && is_authors(first, ours)
            && is_authors(second, theirs)
    }

    /// The partner of a variable among candidates: by number, or by name. Where the two disagree,
    /// the same host binds by number, and another pass has its own layout.
    pub(super) fn partner<T>(
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
                let is_it = naga_interp::place(variable).is_some() && wanted(variable);
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
        let same_host = by_number.as_ref().is_some_and(|(handle, ..)| {
            self.is_bound_by_number(own, &self.ours.global_variables[*handle])
        });
        match (by_number, by_name) {
            (Some(number), Some(name)) if number.0 == name.0 || same_host => Some(number),
            (_, Some(name)) => Some(name),
            (Some(number), None) => {
                // By name, it belongs to another variable.
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
    pub(super) fn take(
        &mut self,
        theirs: Handle<GlobalVariable>,
        ours: Handle<GlobalVariable>,
    ) -> bool {
        let own = naga_interp::place(&self.theirs.global_variables[theirs]);
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

    pub(super) fn own_binding(&mut self, theirs: Handle<GlobalVariable>) -> (u32, u32) {
        // The stages of a linked program may each declare it.
        let place = naga_interp::place(&self.theirs.global_variables[theirs]);
        let known = self.bindings.iter().find(|(other, at)| {
            at.group == OWN_GROUP
                && naga_interp::place(&self.theirs.global_variables[**other]) == place
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
        self.found_parts(theirs, ours, by, Vec::new());
    }

    pub(super) fn found_parts(
        &mut self,
        theirs: String,
        ours: String,
        by: By,
        parts: Vec<(String, String)>,
    ) {
        let last = |path: &str| plain(path.rsplit('.').next().unwrap_or(path));
        let mut members = parts.iter().filter(|(theirs, _)| theirs.contains('.'));
        let by = match members.any(|(theirs, ours)| last(theirs) != last(ours)) {
            true if by == By::Number => By::Order,
            _ => by,
        };
        let partner = Partner {
            theirs,
            ours,
            by,
            parts,
        };
        if !self.partners.contains(&partner) {
            self.partners.push(partner);
        }
    }

    /// The partner of a texture or sampler.
    fn resource(&self, global: Handle<GlobalVariable>) -> Option<(Handle<GlobalVariable>, By)> {
        let inner = &self.theirs.types[self.theirs.global_variables[global].ty].inner;
        let fits = |v: &GlobalVariable, _: bool| {
            let ours = &self.ours.types[v.ty].inner;
            is_same_resource((self.theirs, inner), (self.ours, ours)).then_some(())
        };
        let mapped = self.maps.iter().find_map(|map| {
            let their = map.theirs.resolve(self.theirs).ok()?;
            let our = map.ours.resolve(self.ours).ok()?;
            (their.global == global).then_some((our.global, By::Map))
        });
        let is_hidden = self.is_hidden(1, global);
        // Another sampler may filter differently, so one with a name has no partner by its texture.
        let of_texture = || {
            let all = self.samplers_of_textures(global);
            let mut all = all
                .into_iter()
                .filter(|s| is_hidden || self.is_hidden(0, *s));
            Some((all.next()?, By::Texture))
        };
        mapped
            .or_else(|| is_hidden.then(of_texture).flatten())
            .or_else(|| self.partner(global, &fits).map(|(h, (), by)| (h, by)))
            .or_else(of_texture)
    }

    /// Whether a variable is the sampler of a combined one, which has no name and number of its
    /// own. `program` is 0 for ours, 1 for theirs.
    fn is_hidden(&self, program: usize, sampler: Handle<GlobalVariable>) -> bool {
        let module = [self.ours, self.theirs][program];
        let binding = module.global_variables[sampler].binding;
        let mut combined = self.programs[program].declared().samplers.iter();
        combined.any(|c| Some(c.sampler) == binding)
    }

    /// Gives a texture or sampler the binding of its partner.
    fn bind(
        &mut self,
        global: Handle<GlobalVariable>,
        found: Option<(Handle<GlobalVariable>, By)>,
    ) {
        match found {
            Some((our, by)) => {
                // Two samplers of theirs may be one of ours; `join` makes them one variable.
                if let Some(at) = self.ours.global_variables[self.root(our)].binding {
                    self.bindings.insert(global, at);
                }
                let [theirs, ours] = [(self.theirs, global), (self.ours, our)]
                    .map(|(module, global)| mapping::name_of(module, global, &[]).to_string());
                self.found(theirs, ours, by);
            }
            None => {
                let at = self.own_binding(global);
                let ty = self.theirs.global_variables[global].ty;
                self.lose(global, at, Vec::new(), ty);
            }
        }
    }

    /// Our samplers that are used with the partners of the textures that their sampler is used with.
    fn samplers_of_textures(&self, sampler: Handle<GlobalVariable>) -> Vec<Handle<GlobalVariable>> {
        let [ours, theirs] = &self.sampled;
        let wanted = &self.theirs.types[self.theirs.global_variables[sampler].ty].inner;
        let textures = theirs.iter().filter(|(_, s)| *s == sampler);
        let places = textures.filter_map(|(texture, _)| self.bindings.get(texture));
        let of_place = |at: &ResourceBinding| {
            let at = *at;
            ours.iter().filter_map(move |(texture, sampler)| {
                let variables = &self.ours.global_variables;
                let is_it = variables[*texture].binding == Some(at)
                    && self.ours.types[variables[*sampler].ty].inner == *wanted;
                is_it.then_some(*sampler)
            })
        };
        places.flat_map(of_place).collect()
    }

    /// Makes our samplers one if theirs shares a sampler where ours has combined ones: these may all
    /// have one state.
    fn share(&mut self, theirs: Handle<GlobalVariable>, ours: Handle<GlobalVariable>) {
        for sampler in self.samplers_of_textures(theirs) {
            let [from, to] = [sampler, ours].map(|s| self.root(s));
            // Two samplers with names of their own stay two.
            match () {
                () if from == to => {}
                () if self.is_hidden(0, from) => _ = self.joined.insert(from, to),
                () if self.is_hidden(0, to) => _ = self.joined.insert(to, from),
                () => {}
            }
        }
    }

    fn root(&self, sampler: Handle<GlobalVariable>) -> Handle<GlobalVariable> {
        let next = self.joined.get(&sampler);
        next.map_or(sampler, |next| self.root(*next))
    }

    /// Our module with the samplers that count as one.
    fn joined_ours(&self) -> Module {
        let mut module = self.ours.clone();
        let roots = self.joined.keys().map(|s| (*s, self.root(*s)));
        rename::join(&mut module, &roots.collect());
        module
    }

    pub(super) fn lose(
        &mut self,
        global: Handle<GlobalVariable>,
        at: (u32, u32),
        steps: Vec<usize>,
        ty: Handle<Type>,
    ) {
        self.lost.push(Lost {
            at,
            name: self.called(1, &(global, steps.clone())),
            candidates: Vec::new(),
            of: (global, ty),
            ty: type_text(self.theirs, ty),
            steps,
        });
    }

    /// Lists candidates for each part without a partner: parts of ours of the same type that have
    /// no partner either.
    fn suggest(&mut self, first: PassStages<'_>) {
        let products = self.suggested(first);
        for i in 0..self.lost.len() {
            let (global, ty) = self.lost[i].of;
            if self.theirs.global_variables[global].space == AddressSpace::Handle {
                continue;
            }
            let fits = |leaf: &&BufferLeaf| {
                cast((self.theirs, ty), (self.ours, leaf.ty)) == Some(Cast::Same)
                    && !self.has_partner(&(leaf.global, leaf.steps.clone()))
            };
            let names = self.leaves.iter().filter(fits);
            let names = names.map(|leaf| self.called(0, &(leaf.global, leaf.steps.clone())));
            let is_matrix = matches!(self.theirs.types[ty].inner, TypeInner::Matrix { .. });
            let products = products.iter().filter(|_| is_matrix).cloned();
            self.lost[i].candidates = products.chain(names).take(3).collect();
        }
    }

    /// Whether a place of ours is one of theirs, too.
    pub(super) fn is_taken(&self, at: (u32, u32)) -> bool {
        self.taken.contains_key(&at)
    }

    /// The place of a variable of theirs.
    pub(super) fn place_or_own(&mut self, theirs: Handle<GlobalVariable>) -> (u32, u32) {
        match self.bindings.get(&theirs) {
            Some(at) => (at.group, at.binding),
            None => self.own_binding(theirs),
        }
    }
}

/// Whether two textures, samplers or arrays of them are of one type. Some languages have no depth
/// textures but for comparisons.
fn is_same_resource(
    (theirs, their): (&Module, &TypeInner),
    (ours, our): (&Module, &TypeInner),
) -> bool {
    match (their, our) {
        (
            TypeInner::BindingArray { base: a, size: n },
            TypeInner::BindingArray { base: b, size: m },
        ) => {
            let inner = [&theirs.types[*a].inner, &ours.types[*b].inner];
            n == m && is_same_resource((theirs, inner[0]), (ours, inner[1]))
        }
        (
            TypeInner::Image {
                dim,
                arrayed,
                class,
            },
            TypeInner::Image {
                dim: our_dim,
                arrayed: is_our_array,
                class: our_class,
            },
        ) => {
            dim == our_dim && arrayed == is_our_array && of_floats(*class) == of_floats(*our_class)
        }
        _ => their == our,
    }
}

/// The class of a texture, a depth as a float.
fn of_floats(class: ImageClass) -> ImageClass {
    match class {
        ImageClass::Depth { multi } => ImageClass::Sampled {
            kind: ScalarKind::Float,
            multi,
        },
        other => other,
    }
}

pub(super) fn type_text(module: &Module, ty: Handle<Type>) -> String {
    match &module.types[ty].inner {
        TypeInner::Image { .. } => "a texture".to_owned(),
        TypeInner::Sampler { .. } => "a sampler".to_owned(),
        TypeInner::Array { base, .. } => format!("array<{}>", type_text(module, *base)),
        _ => interface::wgsl_type(module, ty),
    }
}
