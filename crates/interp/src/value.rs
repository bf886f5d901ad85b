//! Values of the interpreter.

use naga::{Handle, Literal, Module, ScalarKind, Type, TypeInner};

use super::Stuck;
use super::number::Number;
pub use super::scalar::Scalar;

/// A function of one scalar component per operand.
pub(crate) type ScalarFunction<'f, F> = dyn FnMut(&[Scalar<F>]) -> Result<Scalar<F>, Stuck> + 'f;

/// Bitwise: a NaN equals itself, and 0.0 is not -0.0.
impl<F: Number> PartialEq for Scalar<F> {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::F32(a), Self::F32(b)) => a.is_same(*b),
            (Self::I32(a), Self::I32(b)) => a == b,
            (Self::U32(a), Self::U32(b)) => a == b,
            (Self::Bool(a), Self::Bool(b)) => a == b,
            _ => false,
        }
    }
}

/// A value.
#[derive(Clone, Debug)]
pub enum Value<F = f32> {
    /// A scalar.
    Scalar(Scalar<F>),
    /// Components of a vector, columns of a matrix, elements of an array, members of a struct.
    Composite(Vec<Value<F>>),
    /// A pointer.
    Pointer {
        /// Index of the variable in memory.
        address: usize,
        /// Indices from the variable to the part.
        path: Vec<usize>,
    },
    /// A texture or sampler.
    Resource(Handle<naga::GlobalVariable>),
}

impl<F: Number> PartialEq for Value<F> {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Scalar(a), Self::Scalar(b)) => a == b,
            (Self::Composite(a), Self::Composite(b)) => a == b,
            (
                Self::Pointer { address, path },
                Self::Pointer {
                    address: other,
                    path: along,
                },
            ) => (address, path) == (other, along),
            (Self::Resource(a), Self::Resource(b)) => a == b,
            _ => false,
        }
    }
}

impl Value {
    /// An `f32`.
    pub const fn f32(value: f32) -> Self {
        Self::Scalar(Scalar::F32(value))
    }

    /// A vector of `f32`.
    pub fn vector(components: &[f32]) -> Self {
        Self::composite(components)
    }
}

impl<F: Number> Value<F> {
    /// A float.
    pub const fn number(value: F) -> Self {
        Self::Scalar(Scalar::F32(value))
    }

    /// A vector of floats.
    pub fn composite(components: &[F]) -> Self {
        Self::Composite(components.iter().map(|c| Self::number(*c)).collect())
    }

    /// An `i32`.
    pub const fn i32(value: i32) -> Self {
        Self::Scalar(Scalar::I32(value))
    }

    /// A `u32`.
    pub const fn u32(value: u32) -> Self {
        Self::Scalar(Scalar::U32(value))
    }

    /// The zero value of a type.
    ///
    /// # Errors
    ///
    /// If the interpreter has no values of the type.
    pub fn zero(module: &Module, ty: Handle<Type>) -> Result<Self, Stuck> {
        Ok(match &module.types[ty].inner {
            TypeInner::Scalar(s) => Self::Scalar(zero_scalar(s.kind, s.width)?),
            TypeInner::Vector { size, scalar } => {
                Self::zeros(*size as usize, zero_scalar(scalar.kind, scalar.width)?)
            }
            TypeInner::Matrix {
                columns,
                rows,
                scalar,
            } => {
                let column = Self::zeros(*rows as usize, zero_scalar(scalar.kind, scalar.width)?);
                Self::Composite(vec![column; *columns as usize])
            }
            TypeInner::Array {
                base,
                size: naga::ArraySize::Constant(n),
                ..
            } => Self::Composite(vec![Self::zero(module, *base)?; n.get() as usize]),
            TypeInner::Struct { members, .. } => Self::Composite(
                members
                    .iter()
                    .map(|m| Self::zero(module, m.ty))
                    .collect::<Result<_, _>>()?,
            ),
            other => return Err(Stuck::Unsupported(format!("a zero of {other:?}"))),
        })
    }

    /// Number of scalars in it. Each step of a pointer's path counts as one.
    pub fn scalars(&self) -> usize {
        match self {
            Self::Scalar(_) | Self::Resource(_) => 1,
            Self::Composite(parts) => parts.iter().map(Self::scalars).sum(),
            Self::Pointer { path, .. } => 1 + path.len(),
        }
    }

    fn zeros(count: usize, zero: Scalar<F>) -> Self {
        Self::Composite(vec![Self::Scalar(zero); count])
    }

    /// A literal's value.
    ///
    /// # Errors
    /// A width the interpreter does not have.
    pub fn literal(literal: &Literal) -> Result<Self, Stuck> {
        Ok(Self::Scalar(match literal {
            Literal::F32(v) => Scalar::F32(F::of(*v)),
            Literal::I32(v) => Scalar::I32(*v),
            Literal::U32(v) => Scalar::U32(*v),
            Literal::Bool(v) => Scalar::Bool(*v),
            other => return Err(Stuck::Unsupported(format!("{other:?}"))),
        }))
    }

    /// The scalar.
    ///
    /// # Errors
    ///
    /// If it is not a scalar.
    pub fn scalar(&self) -> Result<Scalar<F>, Stuck> {
        match self {
            Self::Scalar(s) => Ok(*s),
            other => Err(Stuck::Type(format!("{other:?} where a scalar belongs"))),
        }
    }

    /// The parts of a composite.
    ///
    /// # Errors
    ///
    /// If it is not a composite.
    pub fn parts(&self) -> Result<&[Self], Stuck> {
        match self {
            Self::Composite(parts) => Ok(parts),
            other => Err(Stuck::Type(format!("{other:?} where a composite belongs"))),
        }
    }

    /// The boolean.
    ///
    /// # Errors
    ///
    /// If it is not a boolean.
    pub fn truth(&self) -> Result<bool, Stuck> {
        match self.scalar()? {
            Scalar::Bool(b) => Ok(b),
            other => Err(Stuck::Type(format!("{other:?} where a bool belongs"))),
        }
    }

    /// The float.
    ///
    /// # Errors
    ///
    /// If it is not a float.
    pub fn float(&self) -> Result<F, Stuck> {
        match self.scalar()? {
            Scalar::F32(v) => Ok(v),
            other => Err(Stuck::Type(format!("{other:?} where an f32 belongs"))),
        }
    }

    /// An index from an integer. A negative one becomes the largest.
    ///
    /// # Errors
    ///
    /// The value is not an integer.
    pub fn index(&self) -> Result<usize, Stuck> {
        match self.scalar()? {
            Scalar::U32(v) => Ok(v as usize),
            Scalar::I32(v) => Ok(usize::try_from(v).unwrap_or(usize::MAX)),
            other => Err(Stuck::Type(format!("{other:?} where an index belongs"))),
        }
    }

    /// The components of a float vector, or the single float.
    ///
    /// # Errors
    ///
    /// If it contains anything else.
    pub fn floats(&self) -> Result<Vec<F>, Stuck> {
        match self {
            Self::Composite(parts) => parts.iter().map(Self::float).collect(),
            one => Ok(vec![one.float()?]),
        }
    }

    /// Applies `f` to each scalar, at any depth.
    ///
    /// # Errors
    ///
    /// Those of `f`.
    pub fn map(
        &self,
        f: &mut dyn FnMut(Scalar<F>) -> Result<Scalar<F>, Stuck>,
    ) -> Result<Self, Stuck> {
        match self {
            Self::Scalar(s) => f(*s).map(Self::Scalar),
            Self::Composite(parts) => parts
                .iter()
                .map(|p| p.map(f))
                .collect::<Result<_, _>>()
                .map(Self::Composite),
            other => Err(Stuck::Type(format!("arithmetic on {other:?}"))),
        }
    }

    /// Applies `f` to the scalars of several values of the same shape. A single scalar is used for
    /// all components.
    ///
    /// # Errors
    ///
    /// Those of `f`, or the shapes differ.
    pub fn zip(values: &[&Self], f: &mut ScalarFunction<'_, F>) -> Result<Self, Stuck> {
        let count = values.iter().find_map(|v| match v {
            Self::Composite(parts) => Some(parts.len()),
            _ => None,
        });
        if values.len() > MOST_OPERANDS {
            return Err(Stuck::Type(format!("{} operands", values.len())));
        }
        let Some(count) = count else {
            let mut scalars = [Scalar::Bool(false); MOST_OPERANDS];
            for (scalar, value) in scalars.iter_mut().zip(values) {
                *scalar = value.scalar()?;
            }
            return f(&scalars[..values.len()]).map(Self::Scalar);
        };
        let mut parts = Vec::with_capacity(count);
        for i in 0..count {
            let mut at = [values[0]; MOST_OPERANDS];
            for (part, value) in at.iter_mut().zip(values) {
                *part = match value {
                    Self::Composite(parts) => parts
                        .get(i)
                        .ok_or_else(|| Stuck::Type("vectors of two sizes".to_owned()))?,
                    one => one,
                };
            }
            parts.push(Self::zip(&at[..values.len()], f)?);
        }
        Ok(Self::Composite(parts))
    }
}

/// Most operands of a componentwise operation.
const MOST_OPERANDS: usize = 4;

fn zero_scalar<F: Number>(kind: ScalarKind, width: u8) -> Result<Scalar<F>, Stuck> {
    Ok(match (kind, width) {
        (ScalarKind::Float, 4) => Scalar::F32(F::of(0.0)),
        (ScalarKind::Sint, 4) => Scalar::I32(0),
        (ScalarKind::Uint, 4) => Scalar::U32(0),
        (ScalarKind::Bool, _) => Scalar::Bool(false),
        other => return Err(Stuck::Unsupported(format!("a zero of {other:?}"))),
    })
}

/// Composes a value. A vector may be given in pieces.
pub(crate) fn compose<F: Number>(
    module: &Module,
    ty: Handle<Type>,
    parts: Vec<Value<F>>,
) -> Value<F> {
    if let TypeInner::Vector { .. } = module.types[ty].inner {
        let flat = parts
            .into_iter()
            .flat_map(|p| match p {
                Value::Composite(inner) => inner,
                one => vec![one],
            })
            .collect();
        return Value::Composite(flat);
    }
    Value::Composite(parts)
}
