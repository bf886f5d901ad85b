//! Replaces a program's resources by those of another view, which may have other numbers and other
//! structs.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use naga::{
    Expression, Function, GlobalVariable, Handle, Module, ResourceBinding, Scalar, ScalarKind,
    Statement, TypeInner,
};

use crate::rebuild::place::{self, CodeBuilder, Replacement, Replacements, Rewrite};
use naga_edit::link;
use preshade_dataflow::graph::FunctionId;
use preshade_plan::mapping::{MappedPlace, Mapping, Path, Unknown, name_of};

/// A program that reads another view's resources.
#[derive(Clone, Debug)]
pub(crate) struct Remapped {
    /// Its module. The author's variables are still there, and nothing reads them.
    pub module: Module,
    /// The other view's variables, by group and binding.
    pub views: BTreeMap<(u32, u32), String>,
}

/// Why resources cannot be replaced.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum Unmapped {
    /// The program reads something that the other view lacks.
    #[error("the slice reads `{read}`, which the other view lacks; it has {}", .has.join(", "))]
    Lacks {
        read: String,
        /// Parts that the other view has.
        has: Vec<String>,
    },
    /// The author's program has no resource of a name.
    #[error(transparent)]
    Unknown(#[from] Unknown),
    /// The other view's declarations are wrong or do not fit.
    #[error("{0}")]
    Unfit(String),
}

/// A source offset beyond every file.
const NOWHERE: u32 = u32::MAX / 2;

/// A part of the author's resources, and its replacement.
#[derive(Clone, Debug)]
pub(crate) struct Pair {
    /// The author's part.
    pub ours: MappedPlace,
    pub theirs: MappedPlace,
}

/// Replaces the parts that `mappings` name. `author` is the author's whole module, `module` a slice
/// of it. `layout` declares the other view's resources in WGSL.
///
/// # Errors
/// [`Unmapped`].
pub(crate) fn remap(
    author: &Module,
    module: &Module,
    mappings: &[Mapping],
    layout: Option<&str>,
) -> Result<Remapped, Unmapped> {
    let mut module = module.clone();
    let mut all = Vec::new();
    let mut ours = Vec::new();
    for mapping in mappings {
        let place = mapping.ours.resolve(author)?;
        let name = name_of(author, place.global, &place.steps);
        all.push((mapping, place));
        // A part that the slice does not read needs no partner.
        if let Ok(place) = name.resolve(&module) {
            ours.push((mapping, place));
        }
    }
    check_reads(&module, &ours)?;
    let replaced: BTreeSet<Handle<GlobalVariable>> = ours.iter().map(|(_, p)| p.global).collect();
    // Their numbers are free for the other view.
    for global in &replaced {
        let free = unused_group(&module);
        module.global_variables.get_mut(*global).binding = Some(free);
    }
    let (text, names) = match layout {
        Some(text) => (text.to_owned(), BTreeMap::new()),
        None => declared(author, &all)?,
    };
    let declared = naga::front::wgsl::parse_str(&text)
        .map_err(|e| Unmapped::Unfit(format!("the layout is no WGSL: {}", e.message())))?;
    let linked = link::link(module, &declared, NOWHERE, "view");
    let mut module = linked
        .map_err(|e| Unmapped::Unfit(e.message.clone()))?
        .module;
    let mut pairs = Vec::new();
    let mut views = BTreeMap::new();
    for (mapping, ours) in ours {
        let theirs = Path {
            variable: match names.get(&mapping.theirs.variable) {
                Some(name) => name.clone(),
                None => mapping.theirs.variable.clone(),
            },
            members: mapping.theirs.members.clone(),
        };
        let place = theirs.resolve(&declared);
        let place = place.map_err(|e| Unmapped::Unfit(format!("in the layout, {e}")))?;
        let theirs = &declared.global_variables[place.global];
        let found = module.global_variables.iter().find(|(handle, g)| {
            !replaced.contains(handle) && g.binding.is_some() && g.binding == theirs.binding
        });
        let (Some((global, variable)), Some(at)) = (found, theirs.binding) else {
            let name = &mapping.theirs.variable;
            return Err(Unmapped::Unfit(format!(
                "`{name}` of the layout has no binding"
            )));
        };
        views.insert(
            (at.group, at.binding),
            theirs.name.clone().unwrap_or_default(),
        );
        let place = place_in(&module, global, variable, &place.steps);
        let inner = |place: &MappedPlace| &module.types[place.ty].inner;
        if inner(&place) != inner(&ours) {
            return Err(Unmapped::Unfit(format!(
                "`{}` and `{}` are not of one type",
                mapping.theirs, mapping.ours
            )));
        }
        pairs.push(Pair {
            ours,
            theirs: place,
        });
    }
    let functions: Vec<_> = module.functions.iter().map(|(h, _)| h).collect();
    let functions = functions.into_iter().map(FunctionId::Function);
    let entries = (0..module.entry_points.len()).map(FunctionId::EntryPoint);
    for id in functions.chain(entries).collect::<Vec<_>>() {
        module = redirected(module, id, &pairs);
    }
    Ok(Remapped { module, views })
}

/// The module with a function that reads the others' parts in place of the author's.
pub(crate) fn redirected(module: Module, id: FunctionId, pairs: &[Pair]) -> Module {
    let parts = Parts::of(function(&module, id));
    let mut all = parts.0.values();
    if !all.any(|part| pairs.iter().any(|p| p.is_of(part))) {
        return module;
    }
    place::rewritten(&module, id, |build| Rewrite {
        replacements: replacements(build, &parts, pairs),
        arguments: BTreeMap::new(),
    })
}

fn function(module: &Module, id: FunctionId) -> &Function {
    match id {
        FunctionId::Function(h) => &module.functions[h],
        FunctionId::EntryPoint(i) => &module.entry_points[i].function,
    }
}

/// The part of a variable at the end of `steps`.
fn place_in(
    module: &Module,
    global: Handle<GlobalVariable>,
    variable: &GlobalVariable,
    steps: &[usize],
) -> MappedPlace {
    let mut ty = variable.ty;
    for step in steps {
        ty = match &module.types[ty].inner {
            TypeInner::Struct { members, .. } => members.get(*step).map_or(ty, |m| m.ty),
            TypeInner::Array { base, .. } => *base,
            _ => ty,
        };
    }
    MappedPlace {
        global,
        steps: steps.to_vec(),
        ty,
    }
}

/// A group that no variable has.
fn unused_group(module: &Module) -> ResourceBinding {
    let globals = module.global_variables.iter();
    let groups = globals.filter_map(|(_, g)| Some(g.binding?.group));
    ResourceBinding {
        group: groups.max().map_or(0, |most| most + 1),
        binding: 0,
    }
}

/// Declarations of all that the mappings name, whatever a slice reads of it, and names for the
/// variables that they number. So all slices of a material, and materials with one layout, agree on
/// them.
fn declared(
    author: &Module,
    ours: &[(&Mapping, MappedPlace)],
) -> Result<(String, BTreeMap<String, String>), Unmapped> {
    let mut names = BTreeMap::new();
    let mut variables: Vec<(&str, Vec<(&Mapping, &MappedPlace)>)> = Vec::new();
    for (mapping, place) in ours {
        let variable = mapping.theirs.variable.as_str();
        match variables.iter_mut().find(|(name, _)| *name == variable) {
            Some((_, all)) => all.push((mapping, place)),
            None => variables.push((variable, vec![(mapping, place)])),
        }
    }
    let mut text = String::new();
    let is_replaced = |global| ours.iter().any(|(_, place)| place.global == global);
    let others = author.global_variables.iter();
    let others = others.filter(|(global, _)| !is_replaced(*global));
    let mut taken: Vec<ResourceBinding> = others.filter_map(|(_, g)| g.binding).collect();
    for (i, (variable, parts)) in variables.into_iter().enumerate() {
        let given = variable.split_once(':').and_then(|(group, binding)| {
            Some(ResourceBinding {
                group: group.parse().ok()?,
                binding: binding.parse().ok()?,
            })
        });
        let name = match given {
            Some(at) => format!("view_{}_{}", at.group, at.binding),
            None => variable.to_owned(),
        };
        let first = parts.first();
        let first = first.and_then(|(_, place)| author.global_variables[place.global].binding);
        let mut at = given.or(first).unwrap_or_else(|| unused_group(author));
        while given.is_none() && taken.contains(&at) {
            at.binding += 1;
        }
        taken.push(at);
        let needs_layout = || {
            let all: Vec<String> = parts.iter().map(|(m, _)| m.theirs.to_string()).collect();
            let all = all.join("`, `");
            Unmapped::Unfit(format!("the types of `{all}` follow from a `layout` alone"))
        };
        let mut members = String::new();
        for (mapping, place) in &parts {
            let ty = written(&author.types[place.ty].inner).ok_or_else(needs_layout)?;
            match &mapping.theirs.members[..] {
                [] if parts.len() == 1 => members = ty,
                [one] if !one.starts_with(|c: char| c.is_ascii_digit()) => {
                    let _ = write!(members, "{one}: {ty}, ");
                }
                _ => return Err(needs_layout()),
            }
        }
        let is_struct = parts.iter().all(|(m, _)| !m.theirs.members.is_empty());
        let ty = match is_struct {
            true => {
                let _ = writeln!(text, "struct OtherView{i} {{ {members} }}");
                format!("OtherView{i}")
            }
            false => members,
        };
        let _ = writeln!(
            text,
            "@group({}) @binding({}) var<uniform> {name}: {ty};",
            at.group, at.binding
        );
        names.insert(variable.to_owned(), name);
    }
    Ok((text, names))
}

/// A type of uniforms in WGSL. `None`: it has a name, or is an array.
fn written(inner: &TypeInner) -> Option<String> {
    let word = |scalar: &Scalar| {
        Some(match (scalar.kind, scalar.width) {
            (ScalarKind::Float, 4) => "f32",
            (ScalarKind::Sint, 4) => "i32",
            (ScalarKind::Uint, 4) => "u32",
            _ => return None,
        })
    };
    Some(match inner {
        TypeInner::Scalar(scalar) => word(scalar)?.to_owned(),
        TypeInner::Vector { size, scalar } => format!("vec{}<{}>", *size as u8, word(scalar)?),
        TypeInner::Matrix {
            columns,
            rows,
            scalar,
        } => {
            let (columns, rows) = (*columns as u8, *rows as u8);
            format!("mat{columns}x{rows}<{}>", word(scalar)?)
        }
        _ => return None,
    })
}

/// A part of a variable that an expression is a pointer to, or the value of.
#[derive(Clone, Debug)]
struct AccessedPart {
    global: Handle<GlobalVariable>,
    steps: Vec<usize>,
    is_value: bool,
    /// Whether the expression itself is a load.
    is_load: bool,
}

/// The parts of variables among the expressions of a function.
struct Parts(BTreeMap<Handle<Expression>, AccessedPart>);

impl Parts {
    fn of(function: &Function) -> Self {
        let mut parts: BTreeMap<Handle<Expression>, AccessedPart> = BTreeMap::new();
        for (e, expression) in function.expressions.iter() {
            let part = match *expression {
                Expression::GlobalVariable(global) => Some(AccessedPart {
                    global,
                    steps: Vec::new(),
                    is_value: false,
                    is_load: false,
                }),
                Expression::Load { pointer } => parts.get(&pointer).map(|part| AccessedPart {
                    is_value: true,
                    is_load: true,
                    ..part.clone()
                }),
                Expression::AccessIndex { base, index } => parts.get(&base).map(|part| {
                    let mut part = part.clone();
                    part.steps.push(index as usize);
                    part.is_load = false;
                    part
                }),
                _ => None,
            };
            parts.extend(part.map(|part| (e, part)));
        }
        Self(parts)
    }
}

impl Pair {
    fn is_of(&self, part: &AccessedPart) -> bool {
        part.global == self.ours.global && part.steps == self.ours.steps
    }
}

/// The parts of variables that a function reads or writes: each variable, with the indices that lead
/// to the part. Of an array with an unknown index it is the whole array.
pub(crate) fn parts_read(function: &Function) -> Vec<(Handle<GlobalVariable>, Vec<usize>)> {
    let parts = Parts::of(function);
    let mut used = BTreeSet::new();
    for (e, expression) in function.expressions.iter() {
        if !parts.0.contains_key(&e) {
            used.extend(naga_operands::of_expression(expression));
        }
    }
    naga_operands::visit(&function.body, &mut |statement| {
        if !matches!(statement, Statement::Emit(_)) {
            used.extend(naga_operands::of_statement(statement));
        }
    });
    let parts = parts.0.into_iter().filter(|(e, _)| used.contains(e));
    parts.map(|(_, part)| (part.global, part.steps)).collect()
}

/// Fails if a function reads a part of a replaced variable that has no partner.
fn check_reads(module: &Module, ours: &[(&Mapping, MappedPlace)]) -> Result<(), Unmapped> {
    let functions = module.functions.iter().map(|(_, f)| f);
    let entries = module.entry_points.iter().map(|e| &e.function);
    for function in functions.chain(entries) {
        for (global, steps) in parts_read(function) {
            let mut of_it = ours.iter().filter(|(_, p)| p.global == global).peekable();
            let is_replaced = of_it.peek().is_some();
            let has_partner = of_it.any(|(_, p)| steps.starts_with(&p.steps));
            if is_replaced && !has_partner {
                return Err(Unmapped::Lacks {
                    read: name_of(module, global, &steps).to_string(),
                    has: ours
                        .iter()
                        .map(|(m, _)| format!("`{}`", m.theirs))
                        .collect(),
                });
            }
        }
    }
    Ok(())
}

/// Pointers to the other view's parts in place of pointers to the author's.
fn replacements(build: &mut CodeBuilder<'_>, parts: &Parts, pairs: &[Pair]) -> Replacements {
    let mut pointers = BTreeMap::new();
    let mut replacements = Replacements::new();
    for (e, part) in &parts.0 {
        let Some((i, pair)) = pairs.iter().enumerate().find(|(_, p)| p.is_of(part)) else {
            continue;
        };
        if part.is_load {
            // The pointer that it loads is replaced.
            continue;
        }
        let pointer = *pointers.entry(i).or_insert_with(|| {
            let variable = Expression::GlobalVariable(pair.theirs.global);
            let mut base = build.expression(variable);
            for index in &pair.theirs.steps {
                base = build.expression(Expression::AccessIndex {
                    base,
                    index: *index as u32,
                });
            }
            base
        });
        let value = match part.is_value {
            true => build.expression(Expression::Load { pointer }),
            false => pointer,
        };
        replacements.insert(*e, Replacement::Value(value));
    }
    replacements
}
