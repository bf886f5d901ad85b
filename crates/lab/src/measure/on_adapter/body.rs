//! A function's body, expression by expression, each evaluated where it is added.

use naga::{
    ArraySize, BinaryOperator, Expression, Function, GlobalVariable, Handle, Literal, Module,
    Scalar, ScalarKind, Span, Statement, Type, TypeInner, VectorSize,
};
use naga_edit::writer::emit_existing;

/// A 32-bit word of a buffer.
pub(crate) const WORD: TypeInner = TypeInner::Scalar(Scalar::U32);

pub(crate) fn ty(module: &mut Module, inner: TypeInner) -> Handle<Type> {
    module
        .types
        .insert(Type { name: None, inner }, Span::UNDEFINED)
}

/// A function that is being written. Types are the module's.
pub(crate) struct Body<'m> {
    pub module: &'m mut Module,
    pub function: Function,
}

impl<'m> Body<'m> {
    pub fn new(module: &'m mut Module, name: &str) -> Self {
        let function = Function {
            name: Some(name.to_owned()),
            ..Function::default()
        };
        Self { module, function }
    }

    pub fn add(&mut self, expression: Expression) -> Handle<Expression> {
        let is_emitted =
            !expression.needs_pre_emit() && !matches!(expression, Expression::CallResult(_));
        let handle = self
            .function
            .expressions
            .append(expression, Span::UNDEFINED);
        if is_emitted {
            emit_existing([handle], &mut self.function.body, Span::UNDEFINED);
        }
        handle
    }

    pub fn push(&mut self, statement: Statement) {
        self.function.body.push(statement, Span::UNDEFINED);
    }

    pub fn u32(&mut self, number: u32) -> Handle<Expression> {
        self.add(Expression::Literal(Literal::U32(number)))
    }

    pub fn binary(
        &mut self,
        op: BinaryOperator,
        left: Handle<Expression>,
        right: Handle<Expression>,
    ) -> Handle<Expression> {
        self.add(Expression::Binary { op, left, right })
    }

    /// A word of the array, at an offset from the invocation's first.
    fn word(
        &mut self,
        of: Handle<GlobalVariable>,
        base: Handle<Expression>,
        offset: u32,
    ) -> Handle<Expression> {
        let offset = self.u32(offset);
        let index = self.binary(BinaryOperator::Add, base, offset);
        let base = self.add(Expression::GlobalVariable(of));
        self.add(Expression::Access { base, index })
    }

    /// A value of this type out of words, which `offset` is moved past.
    ///
    /// # Errors
    /// It has values that no words are.
    pub fn read(
        &mut self,
        (of, base): (Handle<GlobalVariable>, Handle<Expression>),
        ty: Handle<Type>,
        offset: &mut u32,
    ) -> Result<Handle<Expression>, String> {
        if let TypeInner::Scalar(scalar) = self.module.types[ty].inner {
            let pointer = self.word(of, base, *offset);
            *offset += 1;
            let word = self.add(Expression::Load { pointer });
            return Ok(match scalar.kind {
                ScalarKind::Uint => word,
                ScalarKind::Bool => {
                    let zero = self.u32(0);
                    self.binary(BinaryOperator::NotEqual, word, zero)
                }
                kind => self.add(Expression::As {
                    expr: word,
                    kind,
                    convert: None,
                }),
            });
        }
        let components = parts(self.module, ty)?
            .into_iter()
            .map(|part| self.read((of, base), part, offset))
            .collect::<Result<_, _>>()?;
        Ok(self.add(Expression::Compose { ty, components }))
    }

    /// Writes a value of this type to words, which `offset` is moved past.
    pub fn write(
        &mut self,
        (of, base): (Handle<GlobalVariable>, Handle<Expression>),
        (value, ty): (Handle<Expression>, Handle<Type>),
        offset: &mut u32,
    ) -> Result<(), String> {
        if let TypeInner::Scalar(scalar) = self.module.types[ty].inner {
            let value = match scalar.kind {
                ScalarKind::Uint => value,
                kind => self.add(Expression::As {
                    expr: value,
                    kind: ScalarKind::Uint,
                    convert: (kind == ScalarKind::Bool).then_some(4),
                }),
            };
            let pointer = self.word(of, base, *offset);
            *offset += 1;
            self.push(Statement::Store { pointer, value });
            return Ok(());
        }
        for (index, part) in (0..).zip(parts(self.module, ty)?) {
            let value = self.add(Expression::AccessIndex { base: value, index });
            self.write((of, base), (value, part), offset)?;
        }
        Ok(())
    }
}

/// The types of a value's parts, in order; none for a scalar.
///
/// # Errors
///
/// A runtime-sized array, or a type that is no value.
pub(crate) fn parts(module: &mut Module, of: Handle<Type>) -> Result<Vec<Handle<Type>>, String> {
    let scalar = |module: &mut Module, scalar: Scalar| match scalar.width {
        4 | 1 => Ok(ty(module, TypeInner::Scalar(scalar))),
        _ => Err("it has numbers that are not of 32 bits".to_owned()),
    };
    let times = |size: VectorSize, part| vec![part; size as usize];
    Ok(match module.types[of].inner.clone() {
        TypeInner::Scalar(_) => Vec::new(),
        TypeInner::Vector { size, scalar: s } => times(size, scalar(module, s)?),
        TypeInner::Matrix {
            columns,
            rows,
            scalar,
        } => times(
            columns,
            ty(module, TypeInner::Vector { size: rows, scalar }),
        ),
        TypeInner::Array {
            base,
            size: ArraySize::Constant(count),
            ..
        } if count.get() <= MOST_ELEMENTS => vec![base; count.get() as usize],
        TypeInner::Array { .. } => {
            return Err(format!(
                "it reads an array of more than {MOST_ELEMENTS} elements"
            ));
        }
        TypeInner::Struct { members, .. } => members.iter().map(|m| m.ty).collect(),
        other => return Err(format!("it reads a {other:?}")),
    })
}

/// Elements of an array that are read one by one.
const MOST_ELEMENTS: u32 = 512;
