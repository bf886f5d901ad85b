//! Rewrites an author's function for a compute stage: texels, derivatives and discards become
//! inputs.

use std::collections::BTreeMap;
use std::sync::Arc;

use naga::valid::FunctionInfo;
use naga::{
    AddressSpace, ArraySize, BinaryOperator, Block, DerivativeAxis, Expression, Function,
    GlobalVariable, Handle, ImageClass, ImageDimension, ImageQuery, Literal, MathFunction, Module,
    SampleLevel, ScalarKind, Span, Statement, Type, TypeInner, VectorSize,
};
use naga_edit::writer::emit_existing;
use naga_interp::{RUNTIME_ELEMENTS, Sampling};
use preshade_validate::inputs::{
    PLAIN_MOST, plain_level_weight, plain_start, plain_weight, texture_size,
};
use preshade_validate::levels::Levels;

/// Variables of ours that a rewritten function reads and writes.
pub(crate) struct Ours {
    /// Whether the fragment is discarded.
    pub killed: Handle<GlobalVariable>,
    /// Derivatives of a unit, along x and along y.
    pub slopes: Handle<GlobalVariable>,
    /// The bases and the scales of each texture's texels.
    pub textures: BTreeMap<Handle<GlobalVariable>, [Handle<GlobalVariable>; 2]>,
    /// The member of each uniform and buffer in the struct of one draw. There is an array of these
    /// structs, one for each draw, and a private variable with the draw's index.
    pub buffers: BTreeMap<Handle<GlobalVariable>, u32>,
    pub all_buffers: Handle<GlobalVariable>,
    pub draw: Handle<GlobalVariable>,
    /// The types of the sizes of textures: vectors of two and of three.
    pub sizes: [Handle<Type>; 2],
    /// Lookups with gradients and biases.
    pub levels: Arc<Levels>,
}

struct Rewriter<'a> {
    module: &'a Module,
    old: &'a Function,
    info: &'a FunctionInfo,
    ours: &'a Ours,
    new: Function,
    map: Vec<Handle<Expression>>,
    /// By old expression: the new ones that are evaluated where it is.
    evaluated: Vec<Vec<Handle<Expression>>>,
    yes: Handle<Expression>,
    killed: Handle<Expression>,
    /// The pointers to uniforms and buffers.
    buffers: BTreeMap<Handle<GlobalVariable>, Handle<Expression>>,
}

/// The function, with the same handles of functions and variables.
///
/// # Errors
///
/// The operation that a compute stage does not support, in words.
pub(crate) fn rewritten(
    module: &Module,
    old: &Function,
    info: &FunctionInfo,
    ours: &Ours,
) -> Result<Function, String> {
    for argument in &old.arguments {
        match module.types[argument.ty].inner {
            TypeInner::Image { .. } | TypeInner::Sampler { .. } => {
                return Err("it passes a texture of several to a function".to_owned());
            }
            TypeInner::Pointer { space, .. } | TypeInner::ValuePointer { space, .. }
                if !matches!(space, AddressSpace::Function | AddressSpace::Private) =>
            {
                return Err("it passes a pointer into a buffer to a function".to_owned());
            }
            _ => {}
        }
    }
    let mut new = Function {
        name: old.name.clone(),
        arguments: old.arguments.clone(),
        result: old.result.clone(),
        ..Function::default()
    };
    for argument in &mut new.arguments {
        argument.binding = None;
    }
    if let Some(result) = &mut new.result {
        result.binding = None;
    }
    let mut append = |e| new.expressions.append(e, Span::UNDEFINED);
    let yes = append(Expression::Literal(Literal::Bool(true)));
    let killed = append(Expression::GlobalVariable(ours.killed));
    let mut rewriter = Rewriter {
        module,
        old,
        info,
        ours,
        new,
        map: Vec::new(),
        evaluated: Vec::new(),
        yes,
        killed,
        buffers: BTreeMap::new(),
    };
    // These exist from the start, like global variables.
    rewriter.evaluated.push(Vec::new());
    for (_, expression) in old.expressions.iter() {
        if let Expression::GlobalVariable(global) = expression {
            rewriter.buffer(*global);
        }
    }
    let first = rewriter.evaluated.pop().unwrap_or_default();
    for (handle, _) in old.expressions.iter() {
        rewriter.evaluated.push(Vec::new());
        let new = rewriter.expression(handle)?;
        rewriter.map.push(new);
    }
    for (_, variable) in old.local_variables.iter() {
        let mut variable = variable.clone();
        variable.init = variable.init.map(|init| rewriter.map[init.index()]);
        rewriter
            .new
            .local_variables
            .append(variable, Span::UNDEFINED);
    }
    let mut body = Block::new();
    emit_existing(first, &mut body, Span::UNDEFINED);
    body.append(&mut rewriter.block(&old.body)?);
    // A discard does not return any more.
    let returns = body
        .last()
        .is_some_and(|s| matches!(s, Statement::Return { .. }));
    if let Some(result) = rewriter.new.result.as_ref().filter(|_| !returns) {
        let zero = Expression::ZeroValue(result.ty);
        let value = rewriter.new.expressions.append(zero, Span::UNDEFINED);
        body.push(Statement::Return { value: Some(value) }, Span::UNDEFINED);
    }
    rewriter.new.body = body;
    Ok(rewriter.new)
}

impl Rewriter<'_> {
    fn mapped(&self, old: Handle<Expression>) -> Handle<Expression> {
        self.map[old.index()]
    }

    /// Adds an expression that is evaluated where the current one is, if it has to be.
    fn add(&mut self, expression: Expression) -> Handle<Expression> {
        let is_evaluated =
            !expression.needs_pre_emit() && !matches!(expression, Expression::CallResult(_));
        let new = self.new.expressions.append(expression, Span::UNDEFINED);
        if let Some(list) = self.evaluated.last_mut().filter(|_| is_evaluated) {
            list.push(new);
        }
        new
    }

    fn f32(&mut self, number: f32) -> Handle<Expression> {
        self.add(Expression::Literal(Literal::F32(number)))
    }

    fn binary(
        &mut self,
        op: BinaryOperator,
        left: Handle<Expression>,
        right: Handle<Expression>,
    ) -> Handle<Expression> {
        self.add(Expression::Binary { op, left, right })
    }

    fn math(&mut self, fun: MathFunction, arguments: &[Handle<Expression>]) -> Handle<Expression> {
        let at = |i: usize| arguments.get(i).copied();
        self.add(Expression::Math {
            fun,
            arg: arguments[0],
            arg1: at(1),
            arg2: at(2),
            arg3: None,
        })
    }

    fn expression(&mut self, old: Handle<Expression>) -> Result<Handle<Expression>, String> {
        let mut expression = self.old.expressions[old].clone();
        match &expression {
            // Its uses read numbers instead.
            Expression::GlobalVariable(g)
                if self.module.global_variables[*g].space == AddressSpace::Handle =>
            {
                return Ok(self.add(Expression::Literal(Literal::U32(0))));
            }
            Expression::ImageSample { .. } | Expression::ImageLoad { .. } => {
                return self.texel(&expression);
            }
            Expression::Access { base, index } => {
                if let Some(length) = self.length_in_buffer(*base) {
                    let index = self.clamped(*index, length);
                    let base = self.mapped(*base);
                    return Ok(self.add(Expression::Access { base, index }));
                }
            }
            Expression::Derivative { axis, expr, .. } => {
                let of = self.mapped(*expr);
                return Ok(self.derivative(*axis, of));
            }
            Expression::GlobalVariable(g) if self.buffers.contains_key(g) => {
                return Ok(self.buffers[g]);
            }
            Expression::ImageQuery { image, query } => return self.query(*image, *query),
            Expression::ArrayLength(_) => return Err("it asks for a buffer's length".to_owned()),
            Expression::AtomicResult { .. }
            | Expression::WorkGroupUniformLoadResult { .. }
            | Expression::SubgroupBallotResult
            | Expression::SubgroupOperationResult { .. } => {
                return Err("it asks other invocations".to_owned());
            }
            _ => {}
        }
        let map = &self.map;
        naga_operands::map_expression(&mut expression, &mut |e| *e = map[e.index()]);
        Ok(self.add(expression))
    }

    /// How many parts a uniform or buffer has at a pointer.
    fn length_in_buffer(&self, pointer: Handle<Expression>) -> Option<u32> {
        let in_buffer = |space: &AddressSpace| {
            matches!(
                space,
                AddressSpace::Uniform | AddressSpace::Storage { .. } | AddressSpace::Immediate
            )
        };
        let types = &self.module.types;
        match self.info[pointer].ty.inner_with(types) {
            TypeInner::Pointer { base, space } if in_buffer(space) => match &types[*base].inner {
                TypeInner::Array { size, .. } => Some(match size {
                    ArraySize::Constant(n) => n.get(),
                    _ => RUNTIME_ELEMENTS,
                }),
                TypeInner::Matrix { columns, .. } => Some(*columns as u32),
                TypeInner::Vector { size, .. } => Some(*size as u32),
                _ => None,
            },
            TypeInner::ValuePointer {
                size: Some(size),
                space,
                ..
            } if in_buffer(space) => Some(*size as u32),
            _ => None,
        }
    }

    /// An index as the interpreter takes it. An adapter may read anything of a buffer instead, and
    /// the other draws are in it too.
    fn clamped(&mut self, index: Handle<Expression>, length: u32) -> Handle<Expression> {
        let expr = self.mapped(index);
        let (kind, convert) = (ScalarKind::Uint, Some(4));
        let index = self.add(Expression::As {
            expr,
            kind,
            convert,
        });
        let last = self.add(Expression::Literal(Literal::U32(length - 1)));
        self.math(MathFunction::Min, &[index, last])
    }

    /// A pointer to a uniform or buffer of this draw.
    fn buffer(&mut self, global: Handle<GlobalVariable>) {
        let (Some(index), false) = (
            self.ours.buffers.get(&global).copied(),
            self.buffers.contains_key(&global),
        ) else {
            return;
        };
        let pointer = self.add(Expression::GlobalVariable(self.ours.draw));
        let draw = self.add(Expression::Load { pointer });
        let base = self.add(Expression::GlobalVariable(self.ours.all_buffers));
        let base = self.add(Expression::Access { base, index: draw });
        let pointer = self.add(Expression::AccessIndex { base, index });
        self.buffers.insert(global, pointer);
    }

    /// As the interpreter has it.
    fn query(
        &mut self,
        image: Handle<Expression>,
        query: ImageQuery,
    ) -> Result<Handle<Expression>, String> {
        let (Expression::GlobalVariable(texture), Some(at)) =
            (&self.old.expressions[image], self.binding(image))
        else {
            return Err("it asks for the size of a texture of several".to_owned());
        };
        let u32 = |this: &mut Self, n| this.add(Expression::Literal(Literal::U32(n)));
        let size = texture_size(at);
        let TypeInner::Image { dim, .. } =
            self.module.types[self.module.global_variables[*texture].ty].inner
        else {
            return Err("it asks for the size of no texture".to_owned());
        };
        let level = match query {
            ImageQuery::Size { level } => level,
            ImageQuery::NumLevels | ImageQuery::NumSamples => return Ok(u32(self, 4)),
            ImageQuery::NumLayers => return Ok(u32(self, size[2])),
        };
        let level = level.map(|level| {
            let expr = self.mapped(level);
            let kind = ScalarKind::Uint;
            let convert = Some(4);
            let level = self.add(Expression::As {
                expr,
                kind,
                convert,
            });
            let most = u32(self, 31);
            self.math(MathFunction::Min, &[level, most])
        });
        let mut parts = Vec::new();
        for n in size {
            let mut part = u32(self, n);
            if let Some(level) = level {
                let one = u32(self, 1);
                part = self.binary(BinaryOperator::ShiftRight, part, level);
                part = self.math(MathFunction::Max, &[part, one]);
            }
            parts.push(part);
        }
        let ty = match dim {
            ImageDimension::D1 => return Ok(parts[0]),
            ImageDimension::D2 | ImageDimension::Cube => self.ours.sizes[0],
            ImageDimension::D3 => self.ours.sizes[1],
        };
        if ty == self.ours.sizes[0] {
            parts.truncate(2);
        }
        Ok(self.add(Expression::Compose {
            ty,
            components: parts,
        }))
    }

    fn derivative(&mut self, axis: DerivativeAxis, of: Handle<Expression>) -> Handle<Expression> {
        let slopes = self.add(Expression::GlobalVariable(self.ours.slopes));
        let along = |this: &mut Self, index| {
            let pointer = this.add(Expression::AccessIndex {
                base: slopes,
                index,
            });
            let slope = this.add(Expression::Load { pointer });
            this.binary(BinaryOperator::Multiply, of, slope)
        };
        match axis {
            DerivativeAxis::X => along(self, 0),
            DerivativeAxis::Y => along(self, 1),
            DerivativeAxis::Width => {
                let (x, y) = (along(self, 0), along(self, 1));
                let (x, y) = (
                    self.math(MathFunction::Abs, &[x]),
                    self.math(MathFunction::Abs, &[y]),
                );
                self.binary(BinaryOperator::Add, x, y)
            }
        }
    }

    /// As the interpreter's world gives it: `Inputs::plain_texel`.
    fn texel(&mut self, lookup: &Expression) -> Result<Handle<Expression>, String> {
        let mut levels = Vec::new();
        let (image, operands, sampling, is_compared) = match lookup {
            Expression::ImageSample {
                gather: Some(_), ..
            } => {
                return Err("it gathers texels".to_owned());
            }
            Expression::ImageSample {
                image,
                sampler,
                gather: None,
                coordinate,
                array_index,
                offset,
                level,
                depth_ref,
                clamp_to_edge,
            } => {
                let mut operands = vec![*coordinate];
                operands.extend(array_index);
                let texture = self.binding(*image);
                match level {
                    SampleLevel::Exact(level) => operands.push(*level),
                    SampleLevel::Bias(bias) if self.ours.levels.biases(texture) => {
                        levels.push(*bias);
                    }
                    SampleLevel::Gradient { x, y } if self.ours.levels.gradients(texture) => {
                        levels.extend([*x, *y]);
                    }
                    _ => {}
                }
                operands.extend(depth_ref);
                let sampling = Sampling {
                    sampler: self.binding(*sampler),
                    offset: offset.map_or(Ok([0; 3]), |o| self.offset(o))?,
                    implicit: matches!(level, SampleLevel::Auto | SampleLevel::Bias(_)),
                    clamped: *clamp_to_edge,
                    ..Sampling::default()
                };
                (*image, operands, sampling, depth_ref.is_some())
            }
            Expression::ImageLoad {
                image,
                coordinate,
                array_index,
                sample,
                level,
            } => {
                let mut operands = vec![*coordinate];
                operands.extend([array_index, sample, level].into_iter().flatten());
                (*image, operands, Sampling::default(), false)
            }
            _ => return Err("no lookup".to_owned()),
        };
        let Expression::GlobalVariable(texture) = self.old.expressions[image] else {
            return Err("it looks up in a texture of several".to_owned());
        };
        let Some([bases, scales]) = self.ours.textures.get(&texture).copied() else {
            return Err("it looks up in no texture".to_owned());
        };
        let mut sum = self.f32(plain_start(sampling));
        let weights: [fn(usize) -> f32; 2] = [plain_weight, plain_level_weight];
        for (operands, weight) in [operands, levels].into_iter().zip(weights) {
            let mut place = 0;
            for operand in operands {
                for number in self.numbers(operand)? {
                    let (low, high) = (self.f32(-PLAIN_MOST), self.f32(PLAIN_MOST));
                    let bounded = self.math(MathFunction::Clamp, &[number, low, high]);
                    let weight = self.f32(weight(place));
                    let part = self.binary(BinaryOperator::Multiply, bounded, weight);
                    sum = self.binary(BinaryOperator::Add, sum, part);
                    place += 1;
                }
            }
        }
        let sum = self.math(MathFunction::Saturate, &[sum]);
        let value = self.add(Expression::Splat {
            size: VectorSize::Quad,
            value: sum,
        });
        let load = |this: &mut Self, variable| {
            let pointer = this.add(Expression::GlobalVariable(variable));
            this.add(Expression::Load { pointer })
        };
        let (bases, scales) = (load(self, bases), load(self, scales));
        let scaled = self.binary(BinaryOperator::Multiply, value, scales);
        let texel = self.binary(BinaryOperator::Add, scaled, bases);
        let class = match self.module.types[self.module.global_variables[texture].ty].inner {
            TypeInner::Image { class, .. } => class,
            _ => return Err("it looks up in no texture".to_owned()),
        };
        let kind = match class {
            ImageClass::Depth { .. } => None,
            _ if is_compared => None,
            ImageClass::Sampled { kind, .. } => Some(kind),
            ImageClass::Storage { format, .. } => Some(naga::Scalar::from(format).kind),
            _ => return Err("it looks up in an external texture".to_owned()),
        };
        Ok(match kind {
            None => self.add(Expression::AccessIndex {
                base: texel,
                index: 0,
            }),
            Some(ScalarKind::Float) => texel,
            Some(kind) => self.add(Expression::As {
                expr: texel,
                kind,
                convert: Some(4),
            }),
        })
    }

    /// The components of an operand, as floats.
    fn numbers(&mut self, old: Handle<Expression>) -> Result<Vec<Handle<Expression>>, String> {
        let value = self.mapped(old);
        let (count, kind) = match *self.info[old].ty.inner_with(&self.module.types) {
            TypeInner::Scalar(scalar) => (None, scalar.kind),
            TypeInner::Vector { size, scalar } => (Some(size as u32), scalar.kind),
            ref other => return Err(format!("it looks up at a {other:?}")),
        };
        let parts: Vec<_> = match count {
            None => vec![value],
            Some(count) => (0..count)
                .map(|index| self.add(Expression::AccessIndex { base: value, index }))
                .collect(),
        };
        let float = |this: &mut Self, expr| match kind {
            ScalarKind::Float => expr,
            _ => this.add(Expression::As {
                expr,
                kind: ScalarKind::Float,
                convert: Some(4),
            }),
        };
        Ok(parts.into_iter().map(|part| float(self, part)).collect())
    }

    fn binding(&self, variable: Handle<Expression>) -> Option<(u32, u32)> {
        let Expression::GlobalVariable(global) = self.old.expressions[variable] else {
            return None;
        };
        let binding = self.module.global_variables[global].binding.as_ref()?;
        Some((binding.group, binding.binding))
    }

    /// The texels of an offset, which is a constant.
    fn offset(&self, offset: Handle<Expression>) -> Result<[i32; 3], String> {
        let mut texels = [0; 3];
        let literal = |e: Handle<Expression>| match self.old.expressions[e] {
            Expression::Literal(Literal::I32(texels)) => Some(texels),
            _ => None,
        };
        let parts = match &self.old.expressions[offset] {
            Expression::Compose { components, .. } => components.clone(),
            Expression::Splat { size, value } => vec![*value; *size as usize],
            _ => vec![offset],
        };
        for (to, part) in texels.iter_mut().zip(parts) {
            *to = literal(part).ok_or("it looks up beside a place, by a constant with a name")?;
        }
        Ok(texels)
    }

    fn block(&mut self, old: &Block) -> Result<Block, String> {
        let mut new = Block::new();
        for statement in old {
            match statement {
                Statement::Emit(range) => {
                    let evaluated = range.clone().flat_map(|old| &self.evaluated[old.index()]);
                    emit_existing(evaluated.copied(), &mut new, Span::UNDEFINED);
                }
                Statement::Kill => new.push(
                    Statement::Store {
                        pointer: self.killed,
                        value: self.yes,
                    },
                    Span::UNDEFINED,
                ),
                Statement::Block(_)
                | Statement::If { .. }
                | Statement::Switch { .. }
                | Statement::Loop { .. }
                | Statement::Break
                | Statement::Continue
                | Statement::Return { .. }
                | Statement::Store { .. }
                | Statement::Call { .. } => {
                    let mut made = naga_operands::shell(statement);
                    let map = &self.map;
                    naga_operands::map_statement_and_result(&mut made, &mut |e| {
                        *e = map[e.index()];
                    });
                    let inner = naga_operands::blocks(statement)
                        .into_iter()
                        .map(|block| self.block(block))
                        .collect::<Result<Vec<_>, _>>()?;
                    naga_operands::fill(&mut made, statement, inner);
                    new.push(made, Span::UNDEFINED);
                }
                other => return Err(format!("it does what a compute stage cannot: {other:?}")),
            }
        }
        Ok(new)
    }
}
