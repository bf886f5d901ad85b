//! Which parts of a value are needed.

use std::collections::BTreeMap;

use naga::{Handle, Module, Type, TypeInner};

/// The needed part of a value. Only structs are told apart by member: a vector, matrix or array is needed whole or not at all.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Need {
    /// All of it.
    All,
    /// These members of a struct. Never empty.
    Members(BTreeMap<u32, Need>),
}

impl Need {
    /// One member of a struct, and of it `inner`.
    pub fn member(index: u32, inner: Need) -> Self {
        Self::Members(BTreeMap::from([(index, inner)]))
    }

    /// The part of a value of type `ty` that lies at `path`.
    pub fn at(module: &Module, ty: Handle<Type>, path: &[u32]) -> Self {
        match (path.split_first(), &module.types[ty].inner) {
            (Some((first, rest)), TypeInner::Struct { members, .. }) => {
                Self::member(*first, Self::at(module, members[*first as usize].ty, rest))
            }
            _ => Self::All,
        }
    }

    /// What is needed of a member; `None` if nothing is.
    pub fn of(&self, index: u32) -> Option<Need> {
        match self {
            Self::All => Some(Self::All),
            Self::Members(members) => members.get(&index).cloned(),
        }
    }

    /// Whether anything at or above or below `path` is needed.
    pub fn touches(&self, path: &[u32]) -> bool {
        match (self, path.split_first()) {
            (Self::All, _) | (_, None) => true,
            (Self::Members(members), Some((first, rest))) => {
                members.get(first).is_some_and(|n| n.touches(rest))
            }
        }
    }

    /// Adds what `other` needs; tells whether that was more.
    pub fn add(&mut self, other: &Need) -> bool {
        match (&mut *self, other) {
            (Self::All, _) => false,
            (_, Self::All) => {
                *self = Self::All;
                true
            }
            (Self::Members(a), Self::Members(b)) => {
                let mut more = false;
                for (index, need) in b {
                    match a.get_mut(index) {
                        Some(have) => more |= have.add(need),
                        None => {
                            a.insert(*index, need.clone());
                            more = true;
                        }
                    }
                }
                more
            }
        }
    }

    /// Adds to a need that may not be there yet; tells whether that was more.
    pub fn add_to(slot: &mut Option<Need>, other: &Need) -> bool {
        match slot {
            Some(have) => have.add(other),
            None => {
                *slot = Some(other.clone());
                true
            }
        }
    }
}
