//! The rest of variables, results of calls, and parts of vectors and structs, without the viewer.

use std::collections::BTreeSet;

use naga::{Expression, Handle, Statement, TypeInner};

use super::without_viewer::{Author, Joined, Mode, Rest, Search};
use super::{At, Changes, Instead};
use preshade_dataflow::graph::memory::{Origin, VersionId};
use preshade_dataflow::graph::{Root, StmtId, cells};

/// A store that a load may see.
#[derive(Clone, Copy, Debug)]
struct ReachingStore {
    statement: StmtId,
    value: Handle<Expression>,
    /// Whether it writes exactly the part that the load reads.
    exact: bool,
}

/// The values that a load may see.
#[derive(Clone, Debug, Default)]
struct Reaching {
    stores: Vec<ReachingStore>,
    /// Whether it may see the variable's first value.
    initial: bool,
    /// Whether it may see a value that we do not follow.
    other: bool,
}

impl Search<'_, '_, '_> {
    /// A load, or the `part` of one, that the expression `at` reads. `load` is the load.
    pub(super) fn loaded(
        &mut self,
        at: At,
        pointer: Handle<Expression>,
        part: &[u32],
        load: Handle<Expression>,
    ) -> Rest {
        let context = at.0;
        let Some((root, seen)) = self.reaching((context, load), pointer, part) else {
            return self.wall(at);
        };
        if seen.other {
            return self.wall(at);
        }
        let is_viewer = |s: &&ReachingStore| self.is_chosen(context, s.statement);
        let author: Vec<ReachingStore> = seen
            .stores
            .iter()
            .filter(|s| !is_viewer(s))
            .copied()
            .collect();
        if author.len() == seen.stores.len() {
            let values: Vec<At> = author.iter().map(|s| (context, s.value)).collect();
            let rest = self.in_place(at, &values);
            // A variable that was given one value alone is that value.
            return match (rest, &author[..]) {
                (Rest::Author(rest), [only]) if only.exact && !seen.initial => {
                    let root = match self.is_in_scope(context, only.statement, load) {
                        true => self.root((context, only.value)),
                        false => None,
                    };
                    Rest::Author(Author { root, ..rest })
                }
                (rest, _) => rest,
            };
        }
        // The value from before the viewer's.
        let initial = match root {
            Root::Local(local) if seen.initial && part.is_empty() => {
                self.stage.f(context).function.local_variables[local].init
            }
            _ => None,
        };
        let before = match (&author[..], seen.initial) {
            ([only], false) if only.exact && self.is_in_scope(context, only.statement, load) => {
                Some(only.value)
            }
            ([], true) => initial,
            _ => None,
        };
        match before.map(|value| (context, value)) {
            Some(value) if self.is_worth(value) => self.take(at, value, Joined::Choice),
            _ => self.wall(at),
        }
    }

    /// Whether a value may be the author's from before the viewer took part.
    fn is_worth(&self, value: At) -> bool {
        self.stage.depends(value) || self.mode == Mode::Threshold || self.stage.is_varying(value)
    }

    /// The value that a value is without any operation.
    fn root(&mut self, value: At) -> Option<At> {
        match self.remainder(value) {
            Rest::Author(author) => author.root,
            _ => None,
        }
    }

    /// The only value that a load can see.
    pub(super) fn only_store(&self, (context, load): At) -> Option<At> {
        let Expression::Load { pointer } = self.stage.f(context).function.expressions[load] else {
            return None;
        };
        let (_, seen) = self.reaching((context, load), pointer, &[])?;
        match seen.stores[..] {
            [only] if only.exact && !seen.initial && !seen.other => Some((context, only.value)),
            _ => None,
        }
    }

    /// The stores that a load may see. `None`: it reads no variable of the function's.
    fn reaching(
        &self,
        (context, load): At,
        pointer: Handle<Expression>,
        part: &[u32],
    ) -> Option<(Root, Reaching)> {
        let f = self.stage.f(context);
        let module = self.stage.values.graph.module();
        let place = cells::place(module, f.function, pointer)?;
        if place.dynamic || !matches!(place.root, Root::Local(_)) {
            return None;
        }
        let mut path = place.path.clone();
        path.extend(part);
        let versions = f.memory.loads.get(&load)?;
        let mut work: Vec<VersionId> = versions
            .iter()
            .copied()
            .filter(|v| f.memory.cell(*v).overlaps(place.root, &path))
            .collect();
        let mut known: BTreeSet<VersionId> = work.iter().copied().collect();
        let mut found = Reaching::default();
        let mut statements = BTreeSet::new();
        while let Some(version) = work.pop() {
            let mut more = Vec::new();
            match f.memory.origin(version) {
                Origin::Initial => found.initial = true,
                Origin::Phi { operands, .. } => more.extend(operands.iter().copied()),
                Origin::Written { by, over } => {
                    more.extend(*over);
                    match f.statements.get(*by).statement {
                        Statement::Store { pointer, value } => {
                            let to = cells::place(module, f.function, *pointer);
                            let exact = to.is_some_and(|to| !to.dynamic && to.path == path);
                            if statements.insert(*by) {
                                found.stores.push(ReachingStore {
                                    statement: *by,
                                    value: *value,
                                    exact,
                                });
                            }
                        }
                        _ => found.other = true,
                    }
                }
            }
            work.extend(more.into_iter().filter(|v| known.insert(*v)));
        }
        Some((place.root, found))
    }

    /// Whether the value of a store may be read where a load is.
    fn is_in_scope(&self, context: usize, store: StmtId, load: Handle<Expression>) -> bool {
        let statements = &self.stage.f(context).statements;
        let Some(at) = statements.evaluated_at(load) else {
            return false;
        };
        let parent = statements.get(store).parent;
        store < at && parent.is_none_or(|p| statements.ancestors(at).any(|a| a == p))
    }

    /// The result of a call, or some components `of` it. Its root is the value that the caller has
    /// already, if there is one.
    pub(super) fn called(&mut self, result: At, of: Option<&[u32]>) -> Rest {
        let Some(child) = self.stage.callee(result) else {
            return self.wall(result);
        };
        let returns = self.stage.returns(child);
        let (mut all, mut roots) = (Author::default(), BTreeSet::new());
        let (mut nothing, mut base) = (false, false);
        for (_, value) in &returns {
            let rest = match of {
                Some(of) => self.component(*value, of),
                None => self.remainder(*value),
            };
            match rest {
                Rest::Author(author) => {
                    base |= self.stage.depends(*value) || self.stage.is_varying(*value);
                    roots.insert(author.root.map(|root| self.stage.origin(root)));
                    all.joined = all.joined.max(author.joined);
                    all.changes.extend(author.changes);
                }
                Rest::Nothing => nothing = true,
                Rest::Unclear => return Rest::Unclear,
            }
        }
        if let (Some(Some(root)), 1, false) = (roots.first(), roots.len(), nothing)
            && !self.stage.is_below(root.0, child)
        {
            all.root = Some(*root);
            return Rest::Author(all);
        }
        let is_chosen = returns
            .iter()
            .any(|(statement, _)| self.is_chosen(child, *statement));
        match (nothing, base) {
            (true, false) => Rest::Nothing,
            (false, _) if !is_chosen => Rest::Author(all),
            _ if self.mode == Mode::Coordinates => Rest::Unclear,
            _ => self.wall(result),
        }
    }

    /// Whether the viewer decides, in its own function, whether a statement runs.
    fn is_chosen(&self, context: usize, statement: StmtId) -> bool {
        let f = self.stage.f(context);
        let (mut work, mut known) = (vec![statement], BTreeSet::from([statement]));
        while let Some(at) = work.pop() {
            for predicate in f.control.of(at) {
                let of = f.statements.get(*predicate).statement;
                let is_jump = matches!(of, Statement::Return { .. });
                let mut values = naga_operands::of_statement(of).into_iter();
                if !is_jump && values.any(|e| self.stage.depends((context, e))) {
                    return true;
                }
                if known.insert(*predicate) {
                    work.push(*predicate);
                }
            }
        }
        false
    }

    /// A value whose root takes its place, if the function has it.
    pub(super) fn lifted(&self, at: At, rest: Rest) -> Rest {
        match rest {
            Rest::Author(author) => match author.root {
                Some(root) if root.0 == at.0 && self.is_alike(at, root) => Rest::Author(Author {
                    changes: Changes::from([(at, Instead::Other(root.1))]),
                    ..author
                }),
                _ => Rest::Author(author),
            },
            rest => rest,
        }
    }

    /// Some components of a vector, or a member of a struct, that the expression `at` reads.
    pub(super) fn part(&mut self, at: At, base: At, of: &[u32]) -> Rest {
        let rest = self.component(base, of);
        self.lifted(at, rest)
    }

    /// The rest of some components of a vector, or of a member of a struct. Its root is the
    /// component's.
    fn component(&mut self, base: At, of: &[u32]) -> Rest {
        let (context, e) = base;
        let f = self.stage.f(context);
        let module = self.stage.values.graph.module();
        let whole = |search: &mut Self| match search.remainder(base) {
            Rest::Author(author) => Rest::Author(Author {
                root: None,
                ..author
            }),
            rest => rest,
        };
        match &f.function.expressions[e] {
            Expression::Compose { ty, components } => {
                let is_struct = matches!(module.types[*ty].inner, TypeInner::Struct { .. });
                let mut at = 0;
                for component in components {
                    let count = match f.ty(module, *component) {
                        TypeInner::Vector { size, .. } if !is_struct => *size as u32,
                        _ => 1,
                    };
                    if of.iter().copied().eq(at..at + count) {
                        return self.remainder((context, *component));
                    }
                    at += count;
                }
                whole(self)
            }
            Expression::CallResult(_) => self.called(base, Some(of)),
            Expression::Load { pointer } if of.len() == 1 => self.loaded_part(base, *pointer, of),
            Expression::FunctionArgument(i) => match self.stage.argument(context, *i) {
                Some(outer) => self.component(outer, of),
                None => self.wall(base),
            },
            _ => whole(self),
        }
    }

    /// A part of a loaded value. A replacement of the part cannot replace the whole, so only its
    /// root counts.
    fn loaded_part(&mut self, base: At, pointer: Handle<Expression>, of: &[u32]) -> Rest {
        match self.loaded(base, pointer, of, base.1) {
            Rest::Author(author) if author.changes.contains_key(&base) => match author.root {
                Some(_) => Rest::Author(author),
                None => self.wall(base),
            },
            rest => rest,
        }
    }
}
