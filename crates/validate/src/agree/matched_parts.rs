//! The scalars, vectors and matrices of two partners, side by side.

use naga::{GlobalVariable, Handle, Module, Type, TypeInner};

use super::fed::Cast;

/// A part of a buffer.
#[derive(Clone)]
pub(super) struct MatchedPart<'m> {
    module: &'m Module,
    ty: Handle<Type>,
    path: String,
}

impl<'m> MatchedPart<'m> {
    /// The part of a variable that `steps` lead to.
    pub(super) fn of(module: &'m Module, global: Handle<GlobalVariable>, steps: &[usize]) -> Self {
        let variable = &module.global_variables[global];
        let whole = Self {
            module,
            ty: variable.ty,
            path: variable.name.clone().unwrap_or_default(),
        };
        steps.iter().fold(whole, |part, step| {
            let element = part.element().map(|element| Self {
                path: format!("{}[{step}]", part.path),
                ..element
            });
            part.member(*step).or(element).unwrap_or(part)
        })
    }

    fn member(&self, index: usize) -> Option<Self> {
        let TypeInner::Struct { members, .. } = &self.module.types[self.ty].inner else {
            return None;
        };
        let member = members.get(index)?;
        let name = member.name.as_deref().unwrap_or_default();
        let dot = match self.path.is_empty() || name.is_empty() {
            true => "",
            false => ".",
        };
        Some(Self {
            ty: member.ty,
            path: format!("{}{dot}{name}", self.path),
            ..*self
        })
    }

    fn element(&self) -> Option<Self> {
        let TypeInner::Array { base, .. } = self.module.types[self.ty].inner else {
            return None;
        };
        let path = format!("{}[]", self.path);
        Some(Self {
            ty: base,
            path,
            ..*self
        })
    }

    fn len(&self) -> usize {
        match &self.module.types[self.ty].inner {
            TypeInner::Struct { members, .. } => members.len(),
            _ => 0,
        }
    }
}

/// Their paths and ours: `spots[].tint` and `lights[].color`.
pub(super) fn paired_paths(
    cast: &Cast,
    theirs: &MatchedPart<'_>,
    ours: &MatchedPart<'_>,
) -> Vec<(String, String)> {
    let mut all = Vec::new();
    let mut pair = |cast: &Cast, theirs: Option<MatchedPart<'_>>, ours: Option<MatchedPart<'_>>| {
        if let (Some(theirs), Some(ours)) = (theirs, ours) {
            all.extend(paired_paths(cast, &theirs, &ours));
        }
    };
    match cast {
        Cast::Same if theirs.len() > 0 => {
            (0..theirs.len()).for_each(|i| pair(cast, theirs.member(i), ours.member(i)));
        }
        Cast::Same => match (theirs.element(), ours.element()) {
            (Some(theirs), Some(ours)) => pair(cast, Some(theirs), Some(ours)),
            _ => return vec![(theirs.path.clone(), ours.path.clone())],
        },
        Cast::Members(members) => {
            let members = members.iter();
            members.for_each(|(i, j, cast)| pair(cast, theirs.member(*i), ours.member(*j)));
        }
        Cast::Bytes(_) => return vec![(theirs.path.clone(), ours.path.clone())],
        Cast::Elements(cast) => pair(cast, theirs.element(), ours.element()),
        Cast::Wrapped(cast) => pair(cast, theirs.member(0), Some(ours.clone())),
        Cast::Unwrapped(cast) => pair(cast, Some(theirs.clone()), ours.member(0)),
    }
    all
}
