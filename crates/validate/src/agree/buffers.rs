//! Finds which buffer, or part of one, of the second program is which of the first.

use naga::{AddressSpace, GlobalVariable, Handle, Module, Type};

use super::Relation;
use super::fed::{Cast, Rule, cast, cast_by, offsets, plain};
use super::matched_parts::{MatchedPart, paired_paths};
use super::matching::{By, Matcher};
use preshade_plan::mapping;

/// A data part of the first program.
pub(super) struct BufferLeaf {
    pub(super) global: Handle<GlobalVariable>,
    pub(super) steps: Vec<usize>,
    pub(super) ty: Handle<Type>,
    pub(super) name: String,
}

/// Members at any depth outside of arrays, and whole buffers, of the first program.
pub(super) fn leaves(module: &Module) -> Vec<BufferLeaf> {
    fn open(module: &Module, leaf: BufferLeaf, all: &mut Vec<BufferLeaf>) {
        for (i, (name, ty)) in mapping::members(module, leaf.ty).into_iter().enumerate() {
            let steps = [&leaf.steps[..], &[i]].concat();
            let global = leaf.global;
            open(
                module,
                BufferLeaf {
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
        if naga_interp::place(variable).is_some() && variable.space != AddressSpace::Handle {
            let name = variable.name.clone().unwrap_or_default();
            let leaf = BufferLeaf {
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

/// Leaves that are the bias of a depth by their name.
pub(super) fn biases(module: &Module) -> Vec<((u32, u32), Vec<usize>)> {
    let leaves = leaves(module).into_iter();
    let biases = leaves.filter(|leaf| {
        let name = leaf.name.to_lowercase();
        let is_level = ["lod", "mip"].iter().any(|word| name.contains(word));
        name.contains("bias") && !is_level && mapping::members(module, leaf.ty).is_empty()
    });
    let placed = biases.filter_map(|leaf| {
        let at = naga_interp::place(&module.global_variables[leaf.global])?;
        Some((at, leaf.steps))
    });
    placed.collect()
}

impl Matcher<'_> {
    /// Finds the partner of a buffer, or of its parts.
    pub(super) fn data(&mut self, global: Handle<GlobalVariable>) {
        let variable = &self.theirs.global_variables[global];
        let ty = variable.ty;
        let mapped: Vec<(mapping::MappedPlace, mapping::MappedPlace)> = self
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
            let (a, b) = ((self.theirs, ty), (self.ours, v.ty));
            let is_by_offset = self.is_bound_by_number(variable, v);
            (is_data && is_kind)
                .then(|| cast_by(a, b, is_by_offset))
                .flatten()
        };
        // A value of the last frame has no partner of the same name: that one holds this frame's
        // value.
        let name = mapping::name_of(self.theirs, global, &[]);
        let is_split = self.is_of_two_frames(ty)
            || self.relation == Relation::Velocity && is_previous_path(&name);
        let whole = self.partner(global, &fits).filter(|_| !is_split);
        let name = name.to_string();
        if let Some((our, cast, _)) = &whole {
            self.tell_offsets((global, ty), *our, cast);
        }
        let given = mapped.iter().map(|(their, _)| their.steps.clone());
        let given = [given.collect(), self.parts_of_products(global)].concat();
        if let Some((our, Cast::Same, by)) = &whole
            && given.is_empty()
            && self.is_same_space(global, *our)
            && self.take(global, *our)
        {
            let ours = mapping::name_of(self.ours, *our, &[]).to_string();
            let theirs = MatchedPart::of(self.theirs, global, &[]);
            let parts = paired_paths(&Cast::Same, &theirs, &MatchedPart::of(self.ours, *our, &[]));
            self.found_parts(name, ours, *by, parts);
            return;
        }
        let to = self.own_binding(global);
        match whole {
            Some((our, cast, by)) => self.rule((global, to, &[]), (our, &[]), cast, by),
            None => self.part(global, to, &mut Vec::new(), ty, &given),
        }
        for (their, our) in mapped {
            if let Some(cast) = cast((self.theirs, their.ty), (self.ours, our.ty)) {
                let theirs = (global, to, &their.steps[..]);
                self.rule(theirs, (our.global, &our.steps), cast, By::Map);
            }
        }
    }

    /// Notes members of one binding that are not where the other program has them.
    fn tell_offsets(
        &mut self,
        (global, ty): (Handle<GlobalVariable>, Handle<Type>),
        our: Handle<GlobalVariable>,
        cast: &Cast,
    ) {
        let variable = &self.ours.global_variables[our];
        if !self.is_one_block(global, our) {
            return;
        }
        let (theirs, ours) = (offsets(self.theirs, ty), offsets(self.ours, variable.ty));
        let names = mapping::members(self.theirs, ty);
        let pairs: Vec<(usize, usize)> = match cast {
            Cast::Same => (0..theirs.len().min(ours.len())).map(|i| (i, i)).collect(),
            Cast::Members(all) => all.iter().map(|(i, j, _)| (*i, *j)).collect(),
            _ => return,
        };
        let moved = pairs.into_iter().filter(|(i, j)| theirs[*i] != ours[*j]);
        let moved = moved.map(|(i, j)| {
            format!(
                "`{}` is at byte {} there and at byte {} here",
                names[i].0, theirs[i], ours[j]
            )
        });
        let moved: Vec<String> = moved.take(3).collect();
        self.notes.extend(moved);
    }

    /// Whether two variables are one block, whose bytes one host fills. A light's struct of its own
    /// has an order of its own, and OpenGL's uniforms outside of blocks have no bytes.
    fn is_one_block(&self, theirs: Handle<GlobalVariable>, ours: Handle<GlobalVariable>) -> bool {
        let [our_program, their_program] = self.programs;
        let theirs = &self.theirs.global_variables[theirs];
        let ours = &self.ours.global_variables[ours];
        theirs.binding == ours.binding
            && theirs.name == ours.name
            && !our_program.declared().is_loose(ours.binding)
            && !their_program.declared().is_loose(theirs.binding)
    }

    /// Whether a type of the second program's has values of two frames.
    fn is_of_two_frames(&self, ty: Handle<Type>) -> bool {
        self.relation == Relation::Velocity && holds_previous(self.theirs, ty)
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
        let Some(from) = naga_interp::place(&self.ours.global_variables[our]) else {
            return;
        };
        let theirs = mapping::name_of(self.theirs, global, to_steps);
        let ours = mapping::name_of(self.ours, our, from_steps);
        let parts = paired_paths(
            &cast,
            &MatchedPart::of(self.theirs, global, to_steps),
            &MatchedPart::of(self.ours, our, from_steps),
        );
        self.rules.push(Rule {
            to,
            to_steps: to_steps.to_vec(),
            from,
            from_steps: from_steps.to_vec(),
            times: Vec::new(),
            cast,
            is_of_view: plain(&theirs.variable) != plain(&ours.variable) && by != By::Number,
            is_previous: self.relation == Relation::Velocity
                && is_previous_path(&theirs)
                && !is_previous_path(&ours),
        });
        self.found_parts(theirs.to_string(), ours.to_string(), by, parts);
    }

    /// A part of a buffer whose whole has no partner.
    fn part(
        &mut self,
        global: Handle<GlobalVariable>,
        to: (u32, u32),
        steps: &mut Vec<usize>,
        ty: Handle<Type>,
        given: &[Vec<usize>],
    ) {
        if given.iter().any(|own| steps.starts_with(own)) {
            return;
        }
        let is_split = self.is_of_two_frames(ty) || given.iter().any(|own| own.starts_with(steps));
        if !is_split && let Some((our, from, cast)) = self.named(global, steps, ty) {
            let variables = [
                &self.theirs.global_variables[global],
                &self.ours.global_variables[our],
            ];
            let there = offset(self.theirs, variables[0].ty, steps);
            let here = offset(self.ours, variables[1].ty, &from);
            if self.is_one_block(global, our)
                && there != here
                && self.relation != Relation::Velocity
            {
                let path = mapping::name_of(self.theirs, global, steps);
                self.notes.push(format!(
                    "`{}` is at byte {there} there and at byte {here} here",
                    last_name(&path)
                ));
            }
            return self.rule((global, to, &steps[..]), (our, &from), cast, By::Name);
        }
        let members = mapping::members(self.theirs, ty);
        if members.is_empty() {
            return self.lose(global, to, steps.clone(), ty);
        }
        for (i, (_, member)) in members.iter().enumerate() {
            steps.push(i);
            self.part(global, to, steps, *member, given);
            steps.pop();
        }
    }

    /// Whether a host that fills our part fills theirs: in one binding, the bytes must be the same.
    fn is_where_it_was(
        &self,
        (global, steps): (Handle<GlobalVariable>, &[usize]),
        leaf: &BufferLeaf,
    ) -> bool {
        let (theirs, ours) = (
            &self.theirs.global_variables[global],
            &self.ours.global_variables[leaf.global],
        );
        theirs.binding != ours.binding
            || !self.is_bound_by_number(theirs, ours)
            || offset(self.theirs, theirs.ty, steps) == offset(self.ours, ours.ty, &leaf.steps)
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
            Relation::Velocity => plain(&without_previous(text)),
            _ => plain(text),
        };
        let last = word(path.members.last().unwrap_or(&path.variable));
        let fits: Vec<_> = self
            .leaves
            .iter()
            .filter(|leaf| !last.is_empty() && plain(&leaf.name) == last)
            .filter(|leaf| self.is_where_it_was((global, steps), leaf))
            .filter_map(|leaf| Some((leaf, cast((self.theirs, ty), (self.ours, leaf.ty))?)))
            .collect();
        let is_same_path = |leaf: &BufferLeaf| {
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

/// Where a part outside of arrays begins.
fn offset(module: &Module, ty: Handle<Type>, steps: &[usize]) -> u32 {
    let (mut at, mut ty) = (0, ty);
    for step in steps {
        at += offsets(module, ty).get(*step).copied().unwrap_or(0);
        match mapping::members(module, ty).get(*step) {
            Some((_, member)) => ty = *member,
            None => break,
        }
    }
    at
}

/// Parts of names of values from the last frame.
const PREVIOUS: [&str; 6] = ["prev", "previous", "last", "old", "history", "before"];

/// A name without such words: `prevViewProj` and `view_proj_last` are `view_proj`. Empty if it has no
/// other word.
fn without_previous(name: &str) -> String {
    let mut words: Vec<String> = Vec::new();
    let mut was_lower = false;
    for c in name.chars() {
        if c == '_' || c.is_ascii_uppercase() && was_lower {
            words.push(String::new());
        }
        if c != '_' {
            match words.last_mut() {
                Some(word) => word.push(c.to_ascii_lowercase()),
                None => words.push(c.to_ascii_lowercase().to_string()),
            }
        }
        was_lower = c.is_ascii_lowercase();
    }
    words.retain(|word| !PREVIOUS.contains(&word.as_str()));
    words.join("_")
}

/// Whether a name is one of a value from the last frame.
fn is_previous(name: &str) -> bool {
    let bare = without_previous(name);
    plain(&bare) != plain(name)
}

/// The last name of a path, without the numbers of elements.
pub(super) fn last_name(path: &mapping::Path) -> &str {
    let is_number = |name: &&String| name.starts_with(|c: char| c.is_ascii_digit());
    let mut members = path.members.iter().rev();
    members.find(|n| !is_number(n)).unwrap_or(&path.variable)
}

/// Whether a path names the last frame's value of `name`.
pub(super) fn is_previous_of(path: &mapping::Path, name: &str) -> bool {
    is_previous_path(path) && plain(&without_previous(last_name(path))) == plain(name)
}

/// Whether an attribute of the one name is the last frame's of the other.
pub(super) fn is_previous_name(previous: &str, name: &str) -> bool {
    is_previous(previous) && plain(&without_previous(previous)) == plain(name)
}

fn is_previous_path(path: &mapping::Path) -> bool {
    std::iter::once(&path.variable)
        .chain(&path.members)
        .any(|name| is_previous(name))
}

/// Whether a type has a member of the last frame, outside of arrays.
fn holds_previous(module: &Module, ty: Handle<Type>) -> bool {
    let members = mapping::members(module, ty);
    let mut members = members.iter();
    members.any(|(name, ty)| is_previous(name) || holds_previous(module, *ty))
}
