//! The position slice as a function of the previous frame's buffers and attributes.

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    AddressSpace, Expression, Function, GlobalVariable, Handle, Literal, Module, Span, Statement,
    StorageAccess, Type, TypeInner,
};

use super::{Extending, Failed, Member, Velocity, pointer};
use crate::rebuild::place::{self, CodeBuilder, Rewrite};
use crate::rebuild::prologue::Ahead;
use crate::transforms::outputs::remap::{self, Pair};
use naga_edit::variable::private;
use naga_operands::calls;
use preshade_dataflow::graph::FunctionId;
use preshade_dataflow::slice::{self, Criterion, OutputFilter, Slice};
use preshade_plan::mapping::name_of;
use preshade_plan::plan::BindingSource;

/// Suffix of the copies of functions and buffers.
const PREVIOUS: &str = "previous";

/// Suffix of the functions without jitter, and of the variables that they read.
const UNJITTERED: &str = "unjittered";

/// Buffers in place of the author's.
type Buffers = BTreeMap<Handle<GlobalVariable>, Handle<GlobalVariable>>;

/// A private copy of a buffer, whose jitter is 0. The position functions read it in place of the
/// buffer, so pointers, copies, calls and dynamic indices need no care.
struct Unjittered<'j> {
    variable: Handle<GlobalVariable>,
    of: Handle<GlobalVariable>,
    /// The members that are read; `None`: the whole.
    members: Option<BTreeSet<usize>>,
    jitter: Vec<&'j Member>,
}

impl Unjittered<'_> {
    /// Fills the copy, without the members that have jitter.
    fn fill(&self, build: &mut CodeBuilder<'_>) {
        let whole: Vec<Vec<usize>> = match &self.members {
            Some(members) => members.iter().map(|member| vec![*member]).collect(),
            None => vec![Vec::new()],
        };
        let is_zero = |steps: &Vec<usize>| self.jitter.iter().any(|j| j.steps == *steps);
        for steps in whole.iter().filter(|steps| !is_zero(steps)) {
            let of = pointer(&mut |e| build.expression(e), self.of, steps);
            let value = build.expression(Expression::Load { pointer: of });
            let pointer = pointer(&mut |e| build.expression(e), self.variable, steps);
            build.statement(Statement::Store { pointer, value });
        }
        for jitter in &self.jitter {
            let is_matrix = matches!(
                build.module().types[jitter.ty].inner,
                TypeInner::Matrix { .. }
            );
            let zero = match is_matrix {
                true => build.literal(Literal::F32(0.0)),
                false => build.expression(Expression::ZeroValue(jitter.ty)),
            };
            let pointer = pointer(&mut |e| build.expression(e), self.variable, &jitter.steps);
            build.statement(Statement::Store {
                pointer,
                value: zero,
            });
        }
    }
}

impl Extending<'_, '_> {
    /// Functions that compute the position now and in the previous frame. The first is `None` where
    /// it is the author's own: then nothing is left out.
    pub(super) fn positions(
        &mut self,
        velocity: &Velocity,
    ) -> Result<(Option<Ahead>, Ahead), Failed> {
        let opaque = self.opaque;
        let position = [Criterion::Output(OutputFilter::Position)];
        let slice = slice::backward(&opaque.graph, opaque.vertex, &position);
        let has_jitter = !velocity.jitter.is_empty() || !velocity.steady.is_empty();
        let now = has_jitter
            .then(|| self.position(&slice, UNJITTERED, &Buffers::new(), velocity))
            .transpose()?;
        let buffers = self.previous_buffers(&slice, &velocity.still)?;
        let mut before = self.position(&slice, PREVIOUS, &buffers, velocity)?;
        let to = self.previous_attributes(&velocity.moving);
        before.relocate(&to, PREVIOUS);
        Ok((now, before))
    }

    /// Adds a function of the vertex stage's inputs that computes the position from other buffers.
    fn position(
        &mut self,
        slice: &Slice,
        suffix: &str,
        buffers: &Buffers,
        Velocity {
            still,
            jitter,
            steady,
            ..
        }: &Velocity,
    ) -> Result<Ahead, Failed> {
        let graph = &self.opaque.graph;
        let name = format!("position_{suffix}");
        let authors = self.module.functions.len();
        let (mut module, mut ahead) = Ahead::add(graph, slice, &self.module, &name, suffix)
            .ok_or_else(|| Failed::Built("the position is no function".to_owned()))?;
        let original = ahead.function;
        let mut called = calls::called(&module, &module.functions[original].body);
        called.insert(original);
        let functions = called.iter().map(|f| &module.functions[*f]);
        let read: Vec<_> = functions.flat_map(remap::parts_read).collect();
        let shifted = jitter.iter().chain(steady.iter().map(|[with, _]| with));
        check_jitter(&module, &read, shifted)?;
        let declared = self.opaque.program.declared();
        let is_loose = |member: &&Member| {
            let binding = module.global_variables[member.global].binding;
            binding.is_some() && binding == declared.loose && member.steps.len() == 1
        };
        // A loose uniform needs no copy of its block.
        let (loose, jitter): (Vec<_>, Vec<_>) = jitter.iter().partition(is_loose);
        let unjittered = unjittered(&mut module, buffers, &read, &jitter)?;
        let mut instead = buffers.clone();
        let with = steady.iter().map(|[with, _]| with);
        for member in loose.iter().copied().chain(with) {
            instead.entry(member.global).or_insert(member.global);
        }
        instead.extend(unjittered.iter().map(|(of, copy)| (*of, copy.variable)));
        let reads = |function: &Function| {
            let mut all = function.expressions.iter();
            all.any(|(_, e)| matches!(e, Expression::GlobalVariable(v) if instead.contains_key(v)))
        };
        let copies = place::copy_called(&mut module, &called, suffix, &reads, &mut |function| {
            for (_, expression) in function.expressions.iter_mut() {
                if let Expression::GlobalVariable(variable) = expression
                    && let Some(other) = instead.get(variable)
                {
                    *variable = *other;
                }
            }
        });
        ahead.function = copies.get(&original).copied().unwrap_or(original);
        // Values that stand still are read in place.
        let still = still.iter().filter(|still| !still.steps.is_empty());
        let is_jitter = |still: &&Member| loose.iter().any(|jitter| jitter == still);
        let still = still.filter(|still| !is_jitter(still));
        let mut theirs: Vec<(&Member, Member)> = still.map(|s| (s, s.clone())).collect();
        for [with, without] in steady {
            let global = without.global;
            let global = instead.get(&global).copied().unwrap_or(global);
            let without = without.clone();
            theirs.push((with, Member { global, ..without }));
        }
        for jitter in loose {
            let name = name_of(&module, jitter.global, &jitter.steps)
                .members
                .join("_");
            let zero = private(
                &mut module,
                &format!("{name}_{UNJITTERED}"),
                jitter.ty,
                None,
            );
            let steps = Vec::new();
            let ty = jitter.ty;
            theirs.push((
                jitter,
                Member {
                    global: zero,
                    steps,
                    ty,
                },
            ));
        }
        let pairs: Vec<Pair> = theirs
            .into_iter()
            .filter_map(|(original, theirs)| {
                let global = *instead.get(&original.global)?;
                let ours = Member {
                    global,
                    ..original.clone()
                };
                Some(Pair { ours, theirs })
            })
            .collect();
        for copy in copies.values() {
            module = remap::redirected(module, FunctionId::Function(*copy), &pairs);
        }
        if !unjittered.is_empty() {
            let function = FunctionId::Function(ahead.function);
            module = place::rewritten(&module, function, |build| {
                unjittered.values().for_each(|copy| copy.fill(build));
                Rewrite::default()
            });
        }
        for (original, copy) in copies {
            // A part of our own slice, which nothing else calls, leaves its name to its copy.
            if original.index() >= authors {
                let name = module.functions[original].name.take();
                module.functions[copy].name = name;
            }
        }
        self.module = module;
        Ok(ahead)
    }

    /// A copy of each buffer that the slice reads and that may change.
    fn previous_buffers(&mut self, slice: &Slice, still: &[Member]) -> Result<Buffers, Failed> {
        let mut copies = Buffers::new();
        let declared = self.opaque.program.declared();
        let is_still = |global: Handle<GlobalVariable>| {
            let mut all = still.iter();
            all.any(|still| still.global == global && still.steps.is_empty())
        };
        for original in slice.globals.iter().filter(|g| !is_still(**g)) {
            let variable = self.module.global_variables[*original].clone();
            let of = declared.name_of(&variable);
            match variable.space {
                AddressSpace::Uniform | AddressSpace::Immediate => {}
                AddressSpace::Storage { access } if access.contains(StorageAccess::STORE) => {
                    return Err(Failed::Previous(format!(
                        "the position reads `{of}`, a buffer that shaders write"
                    )));
                }
                AddressSpace::Storage { .. } => {}
                _ => continue,
            }
            let at = self.free_binding(variable.binding.map_or(0, |b| b.group));
            if variable.binding.is_some() && variable.binding == declared.loose {
                self.previous_loose = Some(at);
            }
            let name = (!of.is_empty()).then(|| format!("{of}_{PREVIOUS}"));
            let source = BindingSource::Previous {
                of,
                group: variable.binding.map(|b| b.group),
                binding: variable.binding.map(|b| b.binding),
            };
            self.bindings.insert((at.group, at.binding), source);
            let copy = GlobalVariable {
                name,
                space: match variable.space {
                    AddressSpace::Immediate if is_uniform(&self.module, variable.ty) => {
                        AddressSpace::Uniform
                    }
                    AddressSpace::Immediate => AddressSpace::Storage {
                        access: StorageAccess::LOAD,
                    },
                    space => space,
                },
                binding: Some(at),
                ..variable
            };
            let span = self.module.global_variables.get_span(*original);
            copies.insert(*original, self.module.global_variables.append(copy, span));
        }
        Ok(copies)
    }

    /// New locations for the attributes that change.
    fn previous_attributes(&mut self, moving: &BTreeSet<u32>) -> BTreeMap<u32, u32> {
        let to: BTreeMap<u32, u32> = moving
            .iter()
            .copied()
            .zip(self.free_attribute()..)
            .collect();
        self.attributes
            .extend(to.iter().map(|(of, location)| (*location, *of)));
        to
    }
}

/// Fails if no function of the position reads a jitter.
fn check_jitter<'m>(
    module: &Module,
    read: &[(Handle<GlobalVariable>, Vec<usize>)],
    mut jitter: impl Iterator<Item = &'m Member>,
) -> Result<(), Failed> {
    let is_read = |jitter: &Member| {
        read.iter().any(|(global, steps)| {
            let meets = steps.starts_with(&jitter.steps) || jitter.steps.starts_with(steps);
            *global == jitter.global && meets
        })
    };
    let unread = jitter.find(|jitter| !is_read(jitter));
    unread.map_or(Ok(()), |jitter| {
        let name = name_of(module, jitter.global, &jitter.steps);
        Err(Failed::Unread(name.to_string()))
    })
}

/// Adds a private variable for each buffer with jitter.
fn unjittered<'j>(
    module: &mut Module,
    buffers: &Buffers,
    read: &[(Handle<GlobalVariable>, Vec<usize>)],
    jitter: &[&'j Member],
) -> Result<BTreeMap<Handle<GlobalVariable>, Unjittered<'j>>, Failed> {
    let mut copies: BTreeMap<_, Unjittered<'j>> = BTreeMap::new();
    for member in jitter {
        let original = member.global;
        let of = buffers.get(&original).copied().unwrap_or(original);
        let GlobalVariable { name, ty, .. } = &module.global_variables[of];
        if module.types[*ty].inner.is_dynamically_sized(&module.types) {
            let name = name.as_deref().unwrap_or_default();
            return Err(Failed::Previous(format!(
                "the jitter is in `{name}`, a buffer with an array of any length"
            )));
        }
        let copy = GlobalVariable {
            name: name.as_ref().map(|name| format!("{name}_{UNJITTERED}")),
            space: AddressSpace::Private,
            binding: None,
            ty: *ty,
            init: None,
            memory_decorations: naga::MemoryDecorations::empty(),
        };
        let of_it = read.iter().filter(|(global, _)| *global == original);
        let is_struct = matches!(module.types[*ty].inner, TypeInner::Struct { .. });
        let members = of_it.map(|(_, steps)| steps.first().copied().filter(|_| is_struct));
        let members: Option<BTreeSet<usize>> = members.collect();
        let known = copies.entry(original).or_insert_with(|| Unjittered {
            variable: module.global_variables.append(copy, Span::UNDEFINED),
            of,
            members,
            jitter: Vec::new(),
        });
        known.jitter.push(member);
    }
    Ok(copies)
}

/// Whether a type of push constants may be that of a uniform: in a uniform, elements of arrays and
/// structs begin at multiples of 16 bytes.
fn is_uniform(module: &Module, ty: Handle<Type>) -> bool {
    match &module.types[ty].inner {
        TypeInner::Array { .. } => false,
        TypeInner::Struct { members, .. } => members.iter().all(|member| {
            !matches!(
                module.types[member.ty].inner,
                TypeInner::Array { .. } | TypeInner::Struct { .. }
            )
        }),
        _ => true,
    }
}
