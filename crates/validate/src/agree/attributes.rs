//! Finds which attribute of the second program is which of the first.

use std::collections::BTreeMap;

use naga::{Binding, Module, TypeInner};

use super::Relation;
use super::buffers::is_previous_name;
use super::fed::plain;
use super::matching::{By, Matcher};
use crate::environment::PassStages;
use naga_edit::interface::Io;
use preshade_plan::mapping::Mapping;

/// The first location of attributes without a partner.
const OWN_LOCATION: u32 = 4096;

#[derive(Default)]
pub(super) struct Attributes {
    /// New locations by those of the second program.
    pub(super) locations: BTreeMap<u32, u32>,
    /// Those without a partner, by new location.
    pub(super) lost: BTreeMap<u32, String>,
    /// Components that a vertex format fills.
    pub(super) filled: Vec<(u32, u32)>,
    /// New locations of those that hold another frame's value, and our location of it.
    pub(super) previous: Vec<(u32, u32)>,
}

impl Matcher<'_> {
    /// Matches the attributes of two programs.
    pub(super) fn attributes(
        &mut self,
        first: PassStages<'_>,
        second: PassStages<'_>,
    ) -> Attributes {
        let attributes = |stages: PassStages<'_>| -> Vec<(u32, Io)> {
            let inputs = stages.vertex.inputs().into_iter();
            inputs
                .filter_map(|io| match io.binding {
                    Some(Binding::Location { location, .. }) => Some((location, io)),
                    _ => None,
                })
                .collect()
        };
        let (ours, theirs) = (attributes(first), attributes(second));
        let Attributes {
            mut locations,
            mut lost,
            mut filled,
            mut previous,
        } = Attributes::default();
        for (i, (location, io)) in theirs.iter().enumerate() {
            let name = |io: &Io| io.name.clone().unwrap_or_default();
            let found = self.attribute(&ours, &theirs, (*location, io));
            let taken = |l: &u32| locations.values().any(|t| t == l);
            match found {
                // The last frame's value is another one in motion.
                Some((our_location, our, by))
                    if self.relation == Relation::Velocity
                        && (by == By::Map && taken(&our_location)
                            || is_previous_name(&name(io), &name(our))) =>
                {
                    let own = OWN_LOCATION + i as u32;
                    locations.insert(*location, own);
                    previous.push((own, our_location));
                    self.found(name(io), name(our), by);
                }
                Some((new, our, by)) if !taken(&new) => {
                    locations.insert(*location, new);
                    self.found(name(io), name(our), by);
                    if new != *location {
                        self.notes.push(format!(
                            "`{}` is at location {location} there and at {new} here",
                            name(io)
                        ));
                    }
                    let count = |module: &Module, io: &Io| match module.types[io.ty].inner {
                        TypeInner::Vector { size, .. } => size as u32,
                        _ => 1,
                    };
                    let (has, wants) = (count(self.ours, our), count(self.theirs, io));
                    filled.extend((has..wants).map(|component| (new, component)));
                }
                _ => {
                    let own = OWN_LOCATION + i as u32;
                    locations.insert(*location, own);
                    lost.insert(
                        own,
                        io.name
                            .clone()
                            .unwrap_or_else(|| format!("@location({location})")),
                    );
                }
            }
        }
        Attributes {
            locations,
            lost,
            filled,
            previous,
        }
    }

    fn attribute<'o>(
        &self,
        ours: &'o [(u32, Io)],
        theirs: &[(u32, Io)],
        (location, io): (u32, &Io),
    ) -> Option<(u32, &'o Io, By)> {
        let name = |io: &Io| plain(io.name.as_deref().unwrap_or_default());
        let is_map = |map: &&Mapping| Some(map.theirs.variable.as_str()) == io.name.as_deref();
        if let Some(map) = self
            .maps
            .iter()
            .filter(|m| m.theirs.members.is_empty())
            .find(is_map)
        {
            let is_it = |(_, o): &&(u32, Io)| o.name.as_deref() == Some(&map.ours.variable);
            if let Some((l, o)) = ours.iter().find(is_it) {
                return Some((*l, o, By::Map));
            }
        }
        let (a, b) = (&self.theirs.types, &self.ours.types);
        let is_equal = |o: &Io| a[io.ty].inner == b[o.ty].inner;
        let is_alike = |o: &Io| a[io.ty].inner.scalar() == b[o.ty].inner.scalar();
        // An attribute of the last frame.
        let before = ours.iter().find(|(_, o)| {
            let [previous, now] = [io, o].map(|io| io.name.as_deref().unwrap_or_default());
            self.relation == Relation::Velocity && is_previous_name(previous, now) && is_alike(o)
        });
        if let Some((l, o)) = before {
            return Some((*l, o, By::Name));
        }
        let numbered = ours.iter().find(|(l, o)| *l == location && is_alike(o));
        let is_named = |o: &Io| !name(io).is_empty() && name(o) == name(io) && is_alike(o);
        let named = ours.iter().find(|(_, o)| is_named(o));
        // It has another attribute's number.
        let is_other = |o: &Io| {
            theirs
                .iter()
                .any(|(l, t)| *l != location && name(t) == name(o))
        };
        match (numbered, named) {
            (Some((l, o)), _) if self.relation == Relation::Same && is_equal(o) => {
                Some((*l, o, By::Number))
            }
            (Some((l, o)), Some((m, _))) if l == m => Some((*l, o, By::Number)),
            // The host's layout has not changed with the shader.
            (None, Some(_)) if self.has_locations() => None,
            (_, Some((l, o))) => Some((*l, o, By::Name)),
            (Some((l, o)), None) if !is_other(o) => Some((*l, o, By::Number)),
            _ => None,
        }
    }
}

/// Gives a binding its new location.
pub(super) fn relocate(binding: &mut Option<Binding>, locations: &BTreeMap<u32, u32>) {
    if let Some(Binding::Location { location, .. }) = binding
        && let Some(new) = locations.get(location)
    {
        *location = *new;
    }
}
