//! Evaluates expressions.

use naga::{DerivativeAxis, DerivativeControl, Expression, GlobalVariable, Handle, SampleLevel};

use super::expression_kind::kind;
use super::machine::{Activation, Machine, part};
use super::number::Number;
use super::value::{self, Scalar, Value};
use super::{
    Derivative, Lookup, Sampling, Stuck, comparison_notes, constants, flips, layout, math,
    undefined,
};

impl<'a, F: Number> Machine<'a, F> {
    /// The value of an operand.
    pub fn get(
        &mut self,
        frame: &mut Activation<'a, F>,
        e: Handle<Expression>,
    ) -> Result<Value<F>, Stuck> {
        self.read_operand(frame, e)?;
        Ok(known(frame, e)?.clone())
    }

    /// Counts the work of an operand, whose value must be known afterwards.
    fn read_operand(
        &mut self,
        frame: &mut Activation<'a, F>,
        e: Handle<Expression>,
    ) -> Result<(), Stuck> {
        self.need(frame, e)?;
        self.work(known(frame, e)?.scalars())
    }

    /// Evaluates, once, an operand that needs no `Emit`.
    fn need(&mut self, frame: &mut Activation<'a, F>, e: Handle<Expression>) -> Result<(), Stuck> {
        if frame.values[e.index()].is_some() {
            return Ok(());
        }
        if !frame.function.expressions[e].needs_pre_emit() {
            return Err(Stuck::Unevaluated(e.index()));
        }
        let value = self.evaluate(frame, e)?;
        self.keep(frame, e, value)
    }

    /// Fails if a value of this type would be too large, before it is allocated.
    fn room_for(&self, ty: Handle<naga::Type>) -> Result<(), Stuck> {
        self.room(layout::scalars(self.module, ty) as usize)
    }

    pub fn evaluate(
        &mut self,
        frame: &mut Activation<'a, F>,
        e: Handle<Expression>,
    ) -> Result<Value<F>, Stuck> {
        let function = frame.function;
        Ok(match &function.expressions[e] {
            constant @ (Expression::Literal(_)
            | Expression::Constant(_)
            | Expression::Override(_)
            | Expression::ZeroValue(_)) => self.constant_value(constant)?,
            Expression::Compose { ty, components } => {
                self.room_for(*ty)?;
                let parts = components
                    .iter()
                    .map(|c| self.get(frame, *c))
                    .collect::<Result<_, _>>()?;
                value::compose(self.module, *ty, parts)
            }
            Expression::Access { base, index } => {
                let index = self.get(frame, *index)?.index()?;
                self.need(frame, *base)?;
                access(known(frame, *base)?, index)?
            }
            Expression::AccessIndex { base, index } => {
                self.need(frame, *base)?;
                access(known(frame, *base)?, *index as usize)?
            }
            Expression::Splat { size, value } => {
                Value::Composite(vec![self.get(frame, *value)?; *size as usize])
            }
            Expression::Swizzle {
                size,
                vector,
                pattern,
            } => {
                self.read_operand(frame, *vector)?;
                let parts = known(frame, *vector)?.parts()?;
                Value::Composite(
                    pattern[..*size as usize]
                        .iter()
                        .map(|c| parts[*c as usize].clone())
                        .collect(),
                )
            }
            Expression::ImageQuery { image, query } => self.query(frame, *image, *query)?,
            Expression::FunctionArgument(i) => frame.arguments[*i as usize].clone(),
            Expression::GlobalVariable(g) => self.global(*g)?,
            Expression::LocalVariable(v) => Value::Pointer {
                address: frame.locals + v.index(),
                path: Vec::new(),
            },
            Expression::Load { pointer } => {
                self.read_operand(frame, *pointer)?;
                let pointer = known(frame, *pointer)?;
                let place = self.read(pointer)?;
                self.room(place.scalars())?;
                if F::NOTES {
                    self.note_read(pointer, place);
                }
                place.clone()
            }
            operation @ (Expression::Unary { .. }
            | Expression::Binary { .. }
            | Expression::Relational { .. }
            | Expression::Math { .. }
            | Expression::As { .. }) => self.operation(frame, (e, operation))?,
            Expression::Select {
                condition,
                accept,
                reject,
            } => {
                let condition = self.get(frame, *condition)?;
                let (accept, reject) = (self.get(frame, *accept)?, self.get(frame, *reject)?);
                select(condition, accept, reject)?
            }
            Expression::Derivative { axis, ctrl, expr } => {
                let of = self.get(frame, *expr)?;
                self.derivative(*axis, *ctrl, &of)?
            }
            sample @ Expression::ImageSample { gather: None, .. } => self.sample(frame, sample)?,
            Expression::ImageLoad {
                image,
                coordinate,
                array_index,
                sample,
                level,
            } => {
                if let Some(texel) = self.given_texel(frame, *image, *coordinate)? {
                    return Ok(texel);
                }
                let mut operands = vec![*coordinate];
                operands.extend([array_index, sample, level].into_iter().flatten());
                let numbers = self.numbers(frame, &operands)?;
                let texel = self.lookup(frame, *image, (&numbers, &[]), Sampling::default())?;
                self.texel(frame, *image, texel)?
            }
            Expression::ArrayLength(array) => {
                let pointer = self.get(frame, *array)?;
                Value::u32(self.read(&pointer)?.parts()?.len() as u32)
            }
            other => return Err(Stuck::Unsupported(kind(other).to_owned())),
        })
    }

    /// An operation on the values of its operands.
    fn operation(
        &mut self,
        frame: &mut Activation<'a, F>,
        (e, operation): (Handle<Expression>, &Expression),
    ) -> Result<Value<F>, Stuck> {
        let operands = match *operation {
            Expression::Unary { expr, .. } | Expression::As { expr, .. } => {
                [Some(expr), None, None, None]
            }
            Expression::Relational { argument, .. } => [Some(argument), None, None, None],
            Expression::Binary { left, right, .. } => [Some(left), Some(right), None, None],
            Expression::Math {
                arg,
                arg1,
                arg2,
                arg3,
                ..
            } => [Some(arg), arg1, arg2, arg3],
            _ => [None; 4],
        };
        for operand in operands.into_iter().flatten() {
            self.read_operand(frame, operand)?;
        }
        let frame = &*frame;
        let operands = operands.into_iter().flatten().map(|o| known(frame, o));
        let operands = operands.collect::<Result<Vec<&Value<F>>, _>>()?;
        let value = math::operation(operation, &operands)?;
        if F::NOTES
            && let (Expression::Binary { op, .. }, [a, b]) = (operation, &operands[..])
        {
            comparison_notes::comparison(frame.function, e, *op, [a, b]);
        }
        self.flips += flips::of(operation, &operands, &value);
        if self.undefined.is_none() {
            let what = undefined::of(operation, &operands);
            let span = frame.function.expressions.get_span(e);
            self.undefined = what.map(|what| (what, span));
        }
        Ok(value)
    }

    /// A literal, constant, override or zero.
    fn constant_value(&self, constant: &Expression) -> Result<Value<F>, Stuck> {
        match constant {
            Expression::Literal(l) => Value::literal(l),
            Expression::Constant(c) => {
                let constant = &self.module.constants[*c];
                self.room_for(constant.ty)?;
                constants::default_constant(self.module, constant.init)
            }
            Expression::Override(o) => match self.module.overrides[*o].init {
                Some(init) => constants::default_constant(self.module, init),
                None => Err(Stuck::Unsupported("an override without a value".to_owned())),
            },
            Expression::ZeroValue(ty) => {
                self.room_for(*ty)?;
                Value::zero(self.module, *ty)
            }
            other => Err(Stuck::Unsupported(kind(other).to_owned())),
        }
    }

    fn derivative(
        &self,
        axis: DerivativeAxis,
        control: DerivativeControl,
        of: &Value<F>,
    ) -> Result<Value<F>, Stuck> {
        let Some(derivative) = self.environment.derivative else {
            return Err(Stuck::Unsupported(format!("Derivative of {axis:?}")));
        };
        of.map(&mut |of| match of {
            Scalar::F32(of) => Ok(Scalar::F32(derivative(Derivative { axis, control, of }))),
            other => Err(Stuck::Type(format!("a derivative of {other:?}"))),
        })
    }

    /// Samples a texture through the environment.
    fn sample(
        &mut self,
        frame: &mut Activation<'a, F>,
        sample: &Expression,
    ) -> Result<Value<F>, Stuck> {
        let Expression::ImageSample {
            image,
            sampler,
            coordinate,
            array_index,
            offset,
            level,
            depth_ref,
            clamp_to_edge,
            ..
        } = sample
        else {
            return Err(Stuck::Unsupported(kind(sample).to_owned()));
        };
        let mut sampling = Sampling {
            implicit: matches!(level, SampleLevel::Auto | SampleLevel::Bias(_)),
            clamped: *clamp_to_edge,
            ..Sampling::default()
        };
        if let Value::Resource(sampler) = self.get(frame, *sampler)? {
            sampling.sampler = self.binding(sampler);
        }
        if let Some(offset) = offset {
            let offset = self.constant(frame, *offset)?;
            let parts = match &offset {
                Value::Composite(parts) => &parts[..],
                one => std::slice::from_ref(one),
            };
            for (to, part) in sampling.offset.iter_mut().zip(parts) {
                if let Value::Scalar(Scalar::I32(texels)) = part {
                    *to = *texels;
                }
            }
        }
        let mut operands = vec![*coordinate];
        operands.extend(array_index);
        let axes = match self.get(frame, *coordinate)? {
            Value::Composite(parts) => parts.len(),
            _ => 1,
        };
        sampling.axes = axes;
        let mut footprint = Vec::new();
        match level {
            SampleLevel::Auto | SampleLevel::Zero => {}
            SampleLevel::Exact(l) => {
                sampling.level = Some(axes + array_index.iter().count());
                operands.push(*l);
            }
            SampleLevel::Bias(l) => footprint.push(*l),
            SampleLevel::Gradient { x, y } => footprint.extend([*x, *y]),
        }
        operands.extend(depth_ref);
        let mut numbers = self.numbers(frame, &operands)?;
        // A layer is clamped to those that there are (WGSL 17.7, GLSL 4.60, 8.9).
        let layer = array_index.and_then(|_| numbers.get_mut(axes));
        if let Some(layer) = layer.filter(|layer| layer.single().is_some_and(|at| at < 0.0)) {
            *layer = F::of(0.0);
        }
        let footprint = self.numbers(frame, &footprint)?;
        let texel = self.lookup(frame, *image, (&numbers, &footprint), sampling)?;
        Ok(match depth_ref {
            Some(_) => Value::number(texel[0]),
            None => self.texel(frame, *image, texel)?,
        })
    }

    /// The texel of a texture whose content is among the resources.
    fn given_texel(
        &mut self,
        frame: &mut Activation<'a, F>,
        image: Handle<Expression>,
        coordinate: Handle<Expression>,
    ) -> Result<Option<Value<F>>, Stuck> {
        let Value::Resource(texture) = self.get(frame, image)? else {
            return Ok(None);
        };
        let given = self.binding(texture);
        let given = given.and_then(|at| self.environment.resources.get(&at));
        let Some(Value::Composite(given)) = given else {
            return Ok(None);
        };
        let [_, _, _, rows] = &given[..] else {
            return Ok(None);
        };
        let outside = || Stuck::Type("a load beyond a texture".to_owned());
        let at = self.get(frame, coordinate)?;
        let mut texel = rows;
        for index in at.parts()?.iter().rev() {
            let index = index.index()?;
            texel = texel.parts()?.get(index).ok_or_else(outside)?;
        }
        Ok(Some(texel.clone()))
    }

    /// Converts the caller's texel to the texture's class: one float for depth, integers for
    /// integer textures.
    fn texel(
        &mut self,
        frame: &mut Activation<'a, F>,
        image: Handle<Expression>,
        texel: [F; 4],
    ) -> Result<Value<F>, Stuck> {
        use naga::{ImageClass, ScalarKind, TypeInner};
        let class = match self.get(frame, image)? {
            Value::Resource(texture) => {
                let types = &self.module.types;
                let mut ty = &types[self.module.global_variables[texture].ty].inner;
                if let TypeInner::BindingArray { base, .. } = ty {
                    ty = &types[*base].inner;
                }
                match ty {
                    TypeInner::Image { class, .. } => Some(*class),
                    _ => None,
                }
            }
            _ => None,
        };
        let kind = match class {
            Some(ImageClass::Depth { .. }) => return Ok(Value::number(texel[0])),
            Some(ImageClass::Sampled { kind, .. }) => kind,
            Some(ImageClass::Storage { format, .. }) => naga::Scalar::from(format).kind,
            _ => ScalarKind::Float,
        };
        let texel = Value::composite(&texel);
        match kind {
            ScalarKind::Sint | ScalarKind::Uint => math::cast(kind, Some(4), &texel),
            _ => Ok(texel),
        }
    }

    fn lookup(
        &mut self,
        frame: &mut Activation<'a, F>,
        image: Handle<Expression>,
        (coordinates, footprint): (&[F], &[F]),
        sampling: Sampling,
    ) -> Result<[F; 4], Stuck> {
        let Value::Resource(texture) = self.get(frame, image)? else {
            return Err(Stuck::Type("a lookup in no texture".to_owned()));
        };
        Ok((self.environment.texture)(&Lookup {
            binding: self.binding(texture),
            coordinates,
            footprint,
            sampling,
        }))
    }

    /// The size of a texture, or its number of levels, layers or samples. All textures have 4
    /// levels and 4 samples.
    fn query(
        &mut self,
        frame: &mut Activation<'a, F>,
        image: Handle<Expression>,
        query: naga::ImageQuery,
    ) -> Result<Value<F>, Stuck> {
        use naga::{ImageDimension as D, ImageQuery as Q};
        let Value::Resource(texture) = self.get(frame, image)? else {
            return Err(Stuck::Type("the size of no texture".to_owned()));
        };
        let given = self.binding(texture);
        let size = given.and_then(|at| self.environment.resources.get(&at));
        let Some(Value::Composite(size)) = size else {
            return Err(Stuck::Unsupported("the size of a texture".to_owned()));
        };
        let ty = &self.module.types[self.module.global_variables[texture].ty].inner;
        let naga::TypeInner::Image { dim, .. } = *ty else {
            return Err(Stuck::Type("the size of no texture".to_owned()));
        };
        Ok(match query {
            Q::Size { level } => {
                let level = match level {
                    Some(level) => self.get(frame, level)?.index()?,
                    None => 0,
                };
                let count = match dim {
                    D::D1 => return halved(&size[0], level),
                    D::D2 | D::Cube => 2,
                    D::D3 => 3,
                };
                let parts = size[..count].iter().map(|n| halved(n, level));
                Value::Composite(parts.collect::<Result<_, _>>()?)
            }
            Q::NumLevels | Q::NumSamples => Value::u32(4),
            Q::NumLayers => size[2].clone(),
        })
    }

    fn binding(&self, global: Handle<GlobalVariable>) -> Option<(u32, u32)> {
        let binding = self.module.global_variables[global].binding.as_ref();
        binding.map(|b| (b.group, b.binding))
    }

    /// All components of the operands, as floats.
    fn numbers(
        &mut self,
        frame: &mut Activation<'a, F>,
        operands: &[Handle<Expression>],
    ) -> Result<Vec<F>, Stuck> {
        let mut numbers = Vec::new();
        for operand in operands {
            let mut value = self.get(frame, *operand)?.clone();
            // GLSL only has signed coordinates. Beyond 2^31 the bits are the same, and name no
            // texel.
            if is_unsigned(&value) {
                value = math::cast(naga::ScalarKind::Sint, None, &value)?;
            }
            let floats = math::cast(naga::ScalarKind::Float, Some(4), &value)?;
            numbers.extend(floats.floats()?);
        }
        Ok(numbers)
    }
}

fn is_unsigned<F>(value: &Value<F>) -> bool {
    match value {
        Value::Scalar(Scalar::U32(_)) => true,
        Value::Composite(parts) => parts.first().is_some_and(is_unsigned),
        _ => false,
    }
}

/// The size at a mip level.
fn halved<F: Number>(size: &Value<F>, level: usize) -> Result<Value<F>, Stuck> {
    Ok(Value::u32(((size.index()? >> level.min(31)) as u32).max(1)))
}

/// The value of an evaluated expression.
fn known<'v, F>(
    frame: &'v Activation<'_, F>,
    e: Handle<Expression>,
) -> Result<&'v Value<F>, Stuck> {
    let value = frame.values[e.index()].as_ref();
    value.ok_or(Stuck::Unevaluated(e.index()))
}

fn access<F: Number>(base: &Value<F>, index: usize) -> Result<Value<F>, Stuck> {
    match base {
        Value::Pointer { address, path } => Ok(Value::Pointer {
            address: *address,
            path: path.iter().copied().chain([index]).collect(),
        }),
        Value::Composite(_) => part(base, index).cloned(),
        Value::Resource(_) => Err(Stuck::Unsupported("arrays of resources".to_owned())),
        other => Err(Stuck::Type(format!("an access into {other:?}"))),
    }
}

/// `select`, by component if the condition is a vector.
fn select<F: Number>(
    condition: Value<F>,
    accept: Value<F>,
    reject: Value<F>,
) -> Result<Value<F>, Stuck> {
    match condition {
        Value::Scalar(_) if condition.truth()? => Ok(accept),
        Value::Scalar(_) => Ok(reject),
        _ => Value::zip(&[&condition, &accept, &reject], &mut |s| match s {
            [Scalar::Bool(true), a, _] => Ok(*a),
            [Scalar::Bool(false), _, r] => Ok(*r),
            other => Err(Stuck::Type(format!("select of {other:?}"))),
        }),
    }
}
