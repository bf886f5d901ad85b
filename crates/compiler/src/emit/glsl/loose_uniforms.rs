//! Splits the front end's block of loose uniforms into variables with the author's types.
//!
//! In that block, `bool` is stored as `uint`, `float[5]` as `vec4[5]` and `mat2` as `vec4[2]`. Each
//! member becomes a private variable of the author's type, which the text then declares as a
//! `uniform`. Reads of the block become reads of the variables, with conversions. Other blocks
//! stay, but are never read as a whole, so their members need no struct.

use std::collections::{HashMap, HashSet};

use naga::proc::Layouter;
use naga::{
    AddressSpace, Arena, Block, Expression, Function, GlobalVariable, Handle, Module, Scalar,
    ScalarKind, Span, Statement, StructMember, Type, TypeInner, UniqueArena, VectorSize,
};
use naga_edit::declared::{self, Declaration, Declared};
use naga_edit::variable::private;
use naga_edit::writer::emit_existing;

/// The module and the variable of each uniform.
pub(super) struct SplitUniforms {
    pub module: Module,
    /// In the order of the block's members.
    pub uniforms: Vec<LooseUniform>,
}

/// A uniform outside of blocks.
pub(super) struct LooseUniform {
    pub name: String,
    pub variable: Handle<GlobalVariable>,
    /// The block's group and binding.
    pub binding: [u32; 2],
    /// Its offset in the block, in bytes.
    pub offset: u32,
    /// The uniform whose value of the previous frame it has.
    pub previous_of: Option<String>,
}

/// Splits the uniforms. On an error, which describes the obstacle, the module keeps its blocks.
pub(super) fn split(module: &Module, declared: &Declared) -> Result<SplitUniforms, String> {
    let mut out = module.clone();
    let mut uniforms = Vec::new();
    let mut roots = HashMap::new();
    let mut layouter = Layouter::default();
    for (handle, global) in module.global_variables.iter() {
        let TypeInner::Struct { members, .. } = &module.types[global.ty].inner else {
            continue;
        };
        if !matches!(
            global.space,
            AddressSpace::Uniform | AddressSpace::Immediate
        ) {
            continue;
        }
        let Some(at) = global.binding.filter(|at| declared.is_loose(Some(*at))) else {
            roots.insert(handle, UniformRoot::Block);
            continue;
        };
        let is_previous = declared.previous == Some(at);
        let mut variables = Vec::new();
        for member in members {
            let name = member.name.as_deref().unwrap_or_default();
            let Some(uniform) = declared.uniforms.iter().find(|u| u.name == name) else {
                // Skip padding.
                variables.push(None);
                continue;
            };
            let ty = author_type(&mut out.types, &mut layouter, &uniform.ty, member.ty)?;
            let name = match is_previous {
                true => declared.previous_name(&uniform.name),
                false => uniform.name.clone(),
            };
            let variable = private(&mut out, &name, ty, None);
            variables.push(Some((variable, ty)));
            uniforms.push(LooseUniform {
                name,
                variable,
                binding: [at.group, at.binding],
                offset: member.offset,
                previous_of: is_previous.then(|| uniform.name.clone()),
            });
        }
        roots.insert(handle, UniformRoot::LooseUniform(variables));
    }
    let Module {
        types,
        functions,
        entry_points,
        ..
    } = &mut out;
    let bodies = functions.iter_mut().map(|(_, f)| f);
    for function in bodies.chain(entry_points.iter_mut().map(|e| &mut e.function)) {
        *function = Rebuild::function(types, module, &roots, function)?;
    }
    Ok(SplitUniforms {
        module: out,
        uniforms,
    })
}

/// A uniform variable of the rebuilt module.
enum UniformRoot {
    Block,
    /// The block of loose uniforms: variable and type of each member, `None` for padding.
    LooseUniform(Vec<Option<(Handle<GlobalVariable>, Handle<Type>)>>),
}

/// The author's type of a member stored as `stored`.
fn author_type(
    types: &mut UniqueArena<Type>,
    layouter: &mut Layouter,
    declared: &declared::Type,
    stored: Handle<Type>,
) -> Result<Handle<Type>, String> {
    let add = |types: &mut UniqueArena<Type>, name: Option<String>, inner: TypeInner| {
        types.insert(Type { name, inner }, Span::UNDEFINED)
    };
    match declared {
        declared::Type::Plain(name) => {
            let inner = plain(name).ok_or_else(|| format!("the type {name}"))?;
            Ok(match types[stored].inner == inner {
                true => stored,
                false => add(types, None, inner),
            })
        }
        declared::Type::Sampler(name) => Err(format!("the type {name}")),
        declared::Type::Array(of, n) => {
            let TypeInner::Array { base, .. } = types[stored].inner else {
                return Err("an array".to_owned());
            };
            let element = author_type(types, layouter, of, base)?;
            if element == base {
                return Ok(stored);
            }
            let n = std::num::NonZeroU32::new(*n).ok_or("an empty array")?;
            let stride = layout(types, layouter, element)?.to_stride();
            let size = naga::ArraySize::Constant(n);
            Ok(add(
                types,
                None,
                TypeInner::Array {
                    base: element,
                    size,
                    stride,
                },
            ))
        }
        declared::Type::Struct(name, declared) => {
            let Type {
                inner: TypeInner::Struct { members, .. },
                name: stored_name,
            } = types[stored].clone()
            else {
                return Err(format!("the struct {name}"));
            };
            let data: Vec<&Declaration> = declared.iter().filter(|m| m.ty.has_data()).collect();
            let mut own = Vec::new();
            for member in &data {
                let stored = members
                    .iter()
                    .find(|m| m.name.as_ref() == Some(&member.name));
                let stored = stored.ok_or_else(|| format!("{name}.{}", member.name))?;
                own.push((
                    member.name.clone(),
                    author_type(types, layouter, &member.ty, stored.ty)?,
                    stored.ty,
                ));
            }
            let same = data.len() == declared.len()
                && own.len() == members.len()
                && own.iter().all(|(_, ty, stored)| ty == stored);
            if same {
                return Ok(stored);
            }
            let mut end = 0;
            let mut align = naga::proc::Alignment::ONE;
            let mut placed = Vec::new();
            for (name, ty, _) in own {
                let layout = layout(types, layouter, ty)?;
                align = align.max(layout.alignment);
                let offset = layout.alignment.round_up(end);
                end = offset + layout.size;
                placed.push(StructMember {
                    name: Some(name),
                    ty,
                    binding: None,
                    offset,
                });
            }
            let span = align.round_up(end);
            let inner = TypeInner::Struct {
                members: placed,
                span,
            };
            Ok(add(types, stored_name, inner))
        }
    }
}

fn layout(
    types: &UniqueArena<Type>,
    layouter: &mut Layouter,
    ty: Handle<Type>,
) -> Result<naga::proc::TypeLayout, String> {
    // The layouter only needs types and constant array lengths.
    let module = Module {
        types: types.clone(),
        ..Module::default()
    };
    layouter.clear();
    layouter
        .update(module.to_ctx())
        .map_err(|e| e.to_string())?;
    Ok(layouter[ty])
}

/// A scalar, vector or matrix type by name.
fn plain(name: &str) -> Option<TypeInner> {
    let scalar = |name: &str| {
        Some(match name {
            "bool" | "b" => Scalar::BOOL,
            "int" | "i" => Scalar::I32,
            "uint" | "u" => Scalar::U32,
            "float" | "" => Scalar::F32,
            "double" | "d" => Scalar::F64,
            _ => return None,
        })
    };
    let size = |digit: &str| {
        Some(match digit {
            "2" => VectorSize::Bi,
            "3" => VectorSize::Tri,
            "4" => VectorSize::Quad,
            _ => return None,
        })
    };
    if let Some((prefix, n)) = name.split_once("vec") {
        let (scalar, size) = (scalar(prefix)?, size(n)?);
        return Some(TypeInner::Vector { size, scalar });
    }
    if let Some((prefix, n)) = name.split_once("mat") {
        let (columns, rows) = n.split_once('x').unwrap_or((n, n));
        return Some(TypeInner::Matrix {
            columns: size(columns)?,
            rows: size(rows)?,
            scalar: scalar(prefix)?,
        });
    }
    Some(TypeInner::Scalar(scalar(name)?))
}

/// A part of uniform memory: how to read it, and its new and old types.
#[derive(Clone, Copy)]
struct UniformPlace {
    at: UniformBase,
    /// The type in the new module.
    own: Handle<Type>,
    /// The type that the old expressions expect.
    wanted: Handle<Type>,
}

#[derive(Clone, Copy)]
enum UniformBase {
    /// A variable for a whole block.
    UniformRoot(Handle<GlobalVariable>),
    /// The target of a pointer in the new function.
    Pointer(Handle<Expression>),
}

#[derive(Clone, Copy)]
enum Index {
    Constant(u32),
    Dynamic(Handle<Expression>),
}

struct Rebuild<'a> {
    types: &'a mut UniqueArena<Type>,
    module: &'a Module,
    roots: &'a HashMap<Handle<GlobalVariable>, UniformRoot>,
    expressions: Arena<Expression>,
    globals: HashMap<Handle<GlobalVariable>, Handle<Expression>>,
    /// Pointers into uniforms and loaded values, by old expression.
    places: HashMap<Handle<Expression>, UniformPlace>,
    values: HashMap<Handle<Expression>, Handle<Expression>>,
    /// New expressions by old expression.
    made: HashMap<Handle<Expression>, Vec<Handle<Expression>>>,
    span: Span,
}

impl<'a> Rebuild<'a> {
    fn function(
        types: &'a mut UniqueArena<Type>,
        module: &'a Module,
        roots: &'a HashMap<Handle<GlobalVariable>, UniformRoot>,
        function: &Function,
    ) -> Result<Function, String> {
        let reads = function
            .expressions
            .iter()
            .any(|(_, e)| matches!(e, Expression::GlobalVariable(g) if roots.contains_key(g)));
        if !reads {
            return Ok(function.clone());
        }
        let mut rebuild = Self {
            types,
            module,
            roots,
            expressions: Arena::new(),
            globals: HashMap::new(),
            places: HashMap::new(),
            values: HashMap::new(),
            made: HashMap::new(),
            span: Span::UNDEFINED,
        };
        let wanted = wanted(function);
        for (handle, expression) in function.expressions.iter() {
            rebuild.span = function.expressions.get_span(handle);
            let before = rebuild.expressions.len();
            rebuild.expression(function, handle, expression, &wanted)?;
            let made = rebuild.expressions.iter().skip(before).map(|(h, _)| h);
            let made = made.collect();
            rebuild.made.insert(handle, made);
        }
        let mut out = Function {
            name: function.name.clone(),
            arguments: function.arguments.clone(),
            result: function.result.clone(),
            local_variables: function.local_variables.clone(),
            diagnostic_filter_leaf: function.diagnostic_filter_leaf,
            ..Function::default()
        };
        for (_, local) in out.local_variables.iter_mut() {
            if let Some(init) = &mut local.init {
                *init = rebuild.value(*init)?;
            }
        }
        for (handle, name) in &function.named_expressions {
            if let Some(value) = rebuild.values.get(handle) {
                out.named_expressions.insert(*value, name.clone());
            }
        }
        out.body = rebuild.block(&function.body)?;
        out.expressions = rebuild.expressions;
        Ok(out)
    }

    fn append(&mut self, expression: Expression) -> Handle<Expression> {
        self.expressions.append(expression, self.span)
    }

    fn global(&mut self, global: Handle<GlobalVariable>) -> Handle<Expression> {
        if let Some(handle) = self.globals.get(&global) {
            return *handle;
        }
        let handle = self.append(Expression::GlobalVariable(global));
        self.globals.insert(global, handle);
        handle
    }

    fn value(&self, old: Handle<Expression>) -> Result<Handle<Expression>, String> {
        let value = self.values.get(&old).copied();
        value.ok_or_else(|| "a uniform block used as a whole".to_owned())
    }

    fn expression(
        &mut self,
        function: &Function,
        handle: Handle<Expression>,
        expression: &Expression,
        wanted: &HashSet<Handle<Expression>>,
    ) -> Result<(), String> {
        let place = match expression {
            Expression::GlobalVariable(global) if self.roots.contains_key(global) => {
                let ty = self.module.global_variables[*global].ty;
                Some(UniformPlace {
                    at: UniformBase::UniformRoot(*global),
                    own: ty,
                    wanted: ty,
                })
            }
            Expression::AccessIndex { base, index } => match self.places.get(base).copied() {
                Some(of) => Some(self.step(of, Index::Constant(*index))?),
                None => None,
            },
            Expression::Access { base, index } => match self.places.get(base).copied() {
                Some(of) => {
                    let index = self.value(*index)?;
                    Some(self.step(of, Index::Dynamic(index))?)
                }
                None => None,
            },
            Expression::Load { pointer } => self.places.get(pointer).copied(),
            _ => None,
        };
        let Some(place) = place else {
            let mut copy = expression.clone();
            let mut missing = None;
            naga_operands::map_expression(&mut copy, &mut |e| match self.value(*e) {
                Ok(value) => *e = value,
                Err(what) => missing = Some(what),
            });
            if let Some(what) = missing {
                return Err(what);
            }
            let copied = self.append(copy);
            self.values.insert(handle, copied);
            return Ok(());
        };
        self.places.insert(handle, place);
        if wanted.contains(&handle) && is_value(function, expression) {
            let value = self.load(place)?;
            self.values.insert(handle, value);
        }
        Ok(())
    }

    fn step(&mut self, of: UniformPlace, index: Index) -> Result<UniformPlace, String> {
        let (own, wanted) = (self.types[of.own].clone(), self.types[of.wanted].clone());
        let pointer = match (of.at, index) {
            (UniformBase::UniformRoot(global), Index::Constant(i)) => match self.roots.get(&global)
            {
                Some(UniformRoot::LooseUniform(variables)) => {
                    let (variable, own) = variables
                        .get(i as usize)
                        .copied()
                        .flatten()
                        .ok_or("the padding of a block")?;
                    return Ok(UniformPlace {
                        at: UniformBase::Pointer(self.global(variable)),
                        own,
                        wanted: member(&wanted.inner, i).ok_or("a member")?.1,
                    });
                }
                _ => self.global(global),
            },
            (UniformBase::UniformRoot(_), Index::Dynamic(_)) => {
                return Err("an indexed block".to_owned());
            }
            (UniformBase::Pointer(pointer), _) => pointer,
        };
        let (own, wanted, own_index) = match (&own.inner, &wanted.inner, index) {
            (
                TypeInner::Struct { members, .. },
                of @ TypeInner::Struct { .. },
                Index::Constant(i),
            ) => {
                let (name, wanted) = member(of, i).ok_or("a member")?;
                let j = members.iter().position(|m| m.name == name);
                let j = j.ok_or("the padding of a struct")?;
                (members[j].ty, wanted, Index::Constant(j as u32))
            }
            (TypeInner::Array { base: own, .. }, TypeInner::Array { base: wanted, .. }, index) => {
                (*own, *wanted, index)
            }
            (
                TypeInner::Matrix { rows, scalar, .. },
                TypeInner::Array { base: wanted, .. },
                index,
            ) => (self.vector(*rows, *scalar), *wanted, index),
            (TypeInner::Matrix { rows, scalar, .. }, TypeInner::Matrix { .. }, index) => {
                let column = self.vector(*rows, *scalar);
                (column, column, index)
            }
            (TypeInner::Vector { scalar, .. }, TypeInner::Vector { scalar: other, .. }, index) => {
                (self.scalar(*scalar), self.scalar(*other), index)
            }
            // The first component of a value stored as a vector.
            (
                TypeInner::Scalar(scalar),
                TypeInner::Vector { scalar: other, .. },
                Index::Constant(0),
            ) => {
                return Ok(UniformPlace {
                    at: UniformBase::Pointer(pointer),
                    own: self.scalar(*scalar),
                    wanted: self.scalar(*other),
                });
            }
            _ => return Err("a part of a uniform".to_owned()),
        };
        let expression = match own_index {
            Index::Constant(index) => Expression::AccessIndex {
                base: pointer,
                index,
            },
            Index::Dynamic(index) => Expression::Access {
                base: pointer,
                index,
            },
        };
        Ok(UniformPlace {
            at: UniformBase::Pointer(self.append(expression)),
            own,
            wanted,
        })
    }

    fn scalar(&mut self, scalar: Scalar) -> Handle<Type> {
        let inner = TypeInner::Scalar(scalar);
        self.types
            .insert(Type { name: None, inner }, Span::UNDEFINED)
    }

    fn vector(&mut self, size: VectorSize, scalar: Scalar) -> Handle<Type> {
        let inner = TypeInner::Vector { size, scalar };
        self.types
            .insert(Type { name: None, inner }, Span::UNDEFINED)
    }

    /// The value of a place, in the type that the old expressions expect.
    fn load(&mut self, place: UniformPlace) -> Result<Handle<Expression>, String> {
        let wanted = self.types[place.wanted].inner.clone();
        if let UniformBase::Pointer(pointer) = place.at
            && place.own == place.wanted
        {
            return Ok(self.append(Expression::Load { pointer }));
        }
        let own = self.types[place.own].inner.clone();
        let parts = match (&own, &wanted) {
            (_, TypeInner::Struct { members, .. }) => {
                let has = |m: &StructMember, i: usize| match (&own, place.at) {
                    (_, UniformBase::UniformRoot(global)) => match self.roots.get(&global) {
                        Some(UniformRoot::LooseUniform(variables)) => {
                            variables.get(i).is_some_and(Option::is_some)
                        }
                        _ => true,
                    },
                    (TypeInner::Struct { members, .. }, _) => {
                        members.iter().any(|o| o.name == m.name)
                    }
                    _ => false,
                };
                let there: Vec<bool> = members.iter().enumerate().map(|(i, m)| has(m, i)).collect();
                let mut parts = Vec::new();
                for (i, (member, there)) in members.iter().zip(there).enumerate() {
                    parts.push(match there {
                        true => {
                            let part = self.step(place, Index::Constant(i as u32))?;
                            self.load(part)?
                        }
                        false => self.append(Expression::ZeroValue(member.ty)),
                    });
                }
                parts
            }
            (_, TypeInner::Array { size, .. }) => {
                let naga::ArraySize::Constant(n) = size else {
                    return Err("an array without a length".to_owned());
                };
                let mut parts = Vec::new();
                for i in 0..n.get() {
                    let part = self.step(place, Index::Constant(i))?;
                    parts.push(self.load(part)?);
                }
                parts
            }
            (TypeInner::Scalar(_), TypeInner::Scalar(scalar)) => {
                return self.converted(place, *scalar);
            }
            (TypeInner::Vector { size: a, .. }, TypeInner::Vector { size: b, scalar })
                if a == b =>
            {
                return self.converted(place, *scalar);
            }
            // A smaller vector stored as a `vec4`.
            (
                TypeInner::Scalar(_) | TypeInner::Vector { .. },
                TypeInner::Vector { size, scalar },
            ) => {
                let components = match own {
                    TypeInner::Vector { size, .. } => size as usize,
                    _ => 1,
                };
                let mut parts = vec![self.converted(place, *scalar)?];
                let zero = self.scalar(*scalar);
                for _ in components..*size as usize {
                    parts.push(self.append(Expression::ZeroValue(zero)));
                }
                parts
            }
            _ => return Err("a uniform of another type".to_owned()),
        };
        Ok(self.append(Expression::Compose {
            ty: place.wanted,
            components: parts,
        }))
    }

    /// Converts a scalar or vector to another scalar type.
    fn converted(
        &mut self,
        place: UniformPlace,
        scalar: Scalar,
    ) -> Result<Handle<Expression>, String> {
        let UniformBase::Pointer(pointer) = place.at else {
            return Err("a block that is a scalar".to_owned());
        };
        let value = self.append(Expression::Load { pointer });
        let own = self.types[place.own].inner.scalar();
        if own == Some(scalar) {
            return Ok(value);
        }
        let convert = (scalar.kind != ScalarKind::Bool).then_some(scalar.width);
        Ok(self.append(Expression::As {
            expr: value,
            kind: scalar.kind,
            convert,
        }))
    }

    fn block(&mut self, block: &Block) -> Result<Block, String> {
        let mut out = Block::new();
        for (statement, span) in block.span_iter() {
            if let Statement::Emit(range) = statement {
                let made = range
                    .clone()
                    .flat_map(|old| self.made.get(&old).cloned().unwrap_or_default());
                let expressions = &self.expressions;
                let evaluated = made.filter(|new| !expressions[*new].needs_pre_emit());
                emit_existing(evaluated, &mut out, *span);
                continue;
            }
            let mut statement = statement.clone();
            let mut missing = None;
            naga_operands::map_statement_and_result(
                &mut statement,
                &mut |e| match self.value(*e) {
                    Ok(value) => *e = value,
                    Err(what) => missing = Some(what),
                },
            );
            if let Some(what) = missing {
                return Err(what);
            }
            for inner in naga_operands::blocks_mut(&mut statement) {
                *inner = self.block(inner)?;
            }
            out.push(statement, *span);
        }
        Ok(out)
    }
}

/// Whether the expression is a value: a load or a part of one.
fn is_value(function: &Function, expression: &Expression) -> bool {
    match expression {
        Expression::Load { .. } => true,
        Expression::Access { base, .. } | Expression::AccessIndex { base, .. } => {
            is_value(function, &function.expressions[*base])
        }
        _ => false,
    }
}

/// Expressions used in any way except as the base of an access.
fn wanted(function: &Function) -> HashSet<Handle<Expression>> {
    let mut out = HashSet::new();
    for (_, expression) in function.expressions.iter() {
        match expression {
            Expression::AccessIndex { .. } | Expression::Load { .. } => {}
            Expression::Access { index, .. } => {
                out.insert(*index);
            }
            other => out.extend(naga_operands::of_expression(other)),
        }
    }
    naga_operands::visit(&function.body, &mut |s| {
        out.extend(naga_operands::of_statement(s));
        out.extend(naga_operands::result(s));
    });
    out
}

/// A member's name and type.
fn member(of: &TypeInner, index: u32) -> Option<(Option<String>, Handle<Type>)> {
    match of {
        TypeInner::Struct { members, .. } => {
            let member = members.get(index as usize)?;
            Some((member.name.clone(), member.ty))
        }
        _ => None,
    }
}
