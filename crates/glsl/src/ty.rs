//! GLSL types.

use std::collections::HashMap;

use glsl_lang::ast::{TypeSpecifierNonArray, TypeSpecifierNonArrayData};
use glsl_lang::transpiler::glsl::{FormattingState, show_type_specifier_non_array};
use naga::Span;

/// The component type of a scalar, vector or matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Component {
    Bool,
    Int,
    Uint,
    /// 16 bits (GL_EXT_shader_explicit_arithmetic_types_float16).
    Half,
    Float,
    Double,
}

impl Component {
    /// The prefix of vector names.
    fn prefix(self) -> &'static str {
        match self {
            Self::Bool => "b",
            Self::Int => "i",
            Self::Uint => "u",
            Self::Half => "f16",
            Self::Float => "",
            Self::Double => "d",
        }
    }

    fn scalar(self) -> &'static str {
        match self {
            Self::Bool => "bool",
            Self::Int => "int",
            Self::Uint => "uint",
            Self::Half => "float16_t",
            Self::Float => "float",
            Self::Double => "double",
        }
    }

    /// The rank in implicit conversions.
    pub(super) fn power(self) -> u8 {
        match self {
            Self::Bool => 0,
            Self::Int => 1,
            Self::Uint => 2,
            Self::Half => 3,
            Self::Float => 4,
            Self::Double => 5,
        }
    }
}

/// The length of an array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Length {
    /// The number of elements. For a specialisation constant, its default.
    pub n: u32,
    /// The `constant_id`, if it is a specialisation constant.
    pub constant: Option<u32>,
}

impl From<u32> for Length {
    fn from(n: u32) -> Self {
        Self { n, constant: None }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Ty {
    Void,
    Scalar(Component),
    Vector(Component, u8),
    /// Number of columns, then of rows.
    Matrix(Component, u8, u8),
    /// Outermost dimension first. `None`: unsized.
    Array(Box<Ty>, Option<Length>),
    /// By name in [`Structs`].
    Struct(String),
    /// A combined texture and sampler by name: `sampler2D`, `usamplerCube`, `sampler2DShadow`.
    Combined(String),
    /// Another opaque type by name: `texture2D`, `sampler`, `image2D`.
    Opaque(String),
}

impl Ty {
    pub(super) const FLOAT: Self = Self::Scalar(Component::Float);
    pub(super) const INT: Self = Self::Scalar(Component::Int);
    pub(super) const UINT: Self = Self::Scalar(Component::Uint);
    pub(super) const BOOL: Self = Self::Scalar(Component::Bool);

    /// The built-in type of that name.
    pub(super) fn named(name: &str) -> Self {
        let scalar = match name {
            "void" => return Self::Void,
            "bool" => Some(Component::Bool),
            "int" | "int32_t" => Some(Component::Int),
            "uint" | "uint32_t" => Some(Component::Uint),
            "float16_t" => Some(Component::Half),
            "float" | "float32_t" => Some(Component::Float),
            "double" | "float64_t" => Some(Component::Double),
            _ => None,
        };
        if let Some(kind) = scalar {
            return Self::Scalar(kind);
        }
        // GL_EXT_shader_explicit_arithmetic_types adds a second name for every type.
        for (prefix, kind) in [
            ("b", Component::Bool),
            ("i", Component::Int),
            ("i32", Component::Int),
            ("u", Component::Uint),
            ("u32", Component::Uint),
            ("f16", Component::Half),
            ("d", Component::Double),
            ("f64", Component::Double),
            ("", Component::Float),
            ("f32", Component::Float),
        ] {
            if let Some(rest) = name.strip_prefix(prefix) {
                let digit = |s: &str| s.parse::<u8>().ok().filter(|n| (2..=4).contains(n));
                if let Some(size) = rest.strip_prefix("vec").and_then(digit) {
                    return Self::Vector(kind, size);
                }
                if let Some(size) = rest.strip_prefix("mat") {
                    if let Some(n) = digit(size) {
                        return Self::Matrix(kind, n, n);
                    }
                    if let Some((c, r)) = size.split_once('x')
                        && let (Some(c), Some(r)) = (digit(c), digit(r))
                    {
                        return Self::Matrix(kind, c, r);
                    }
                }
            }
        }
        let after = name.trim_start_matches(['i', 'u']);
        if after.starts_with("sampler") && after.len() > "sampler".len() && after != "samplerShadow"
        {
            return Self::Combined(name.to_owned());
        }
        Self::Opaque(name.to_owned())
    }

    /// A vector of `module_size` components, or a scalar for 1.
    pub(super) fn vector(kind: Component, size: u8) -> Self {
        match size {
            1 => Self::Scalar(kind),
            _ => Self::Vector(kind, size),
        }
    }

    pub(super) fn kind(&self) -> Option<Component> {
        match self {
            Self::Scalar(k) | Self::Vector(k, _) | Self::Matrix(k, ..) => Some(*k),
            _ => None,
        }
    }

    /// The same shape with another component type.
    pub(super) fn with_kind(&self, kind: Component) -> Self {
        match self {
            Self::Scalar(_) => Self::Scalar(kind),
            Self::Vector(_, n) => Self::Vector(kind, *n),
            Self::Matrix(_, c, r) => Self::Matrix(kind, *c, *r),
            other => other.clone(),
        }
    }

    /// Number of components of a scalar or vector.
    pub(super) fn components(&self) -> Option<u8> {
        match self {
            Self::Scalar(_) => Some(1),
            Self::Vector(_, n) => Some(*n),
            _ => None,
        }
    }

    /// The type's name; for an array, that of its innermost element.
    pub(super) fn base_name(&self) -> String {
        match self {
            Self::Void => "void".to_owned(),
            Self::Scalar(k) => k.scalar().to_owned(),
            Self::Vector(k, n) => format!("{}vec{n}", k.prefix()),
            Self::Matrix(k, c, r) if c == r => format!("{}mat{c}", k.prefix()),
            Self::Matrix(k, c, r) => format!("{}mat{c}x{r}", k.prefix()),
            Self::Array(of, _) => of.base_name(),
            Self::Struct(name) | Self::Combined(name) | Self::Opaque(name) => name.clone(),
        }
    }

    /// The array dimensions, outermost first, such as `[2][3]`; empty for other types.
    fn dimensions(&self) -> String {
        match self {
            Self::Array(of, Some(length)) => format!("[{}]{}", length.n, of.dimensions()),
            Self::Array(of, None) => format!("[]{}", of.dimensions()),
            _ => String::new(),
        }
    }

    /// The name in a constructor: `float[3]`.
    pub(super) fn name(&self) -> String {
        self.base_name() + &self.dimensions()
    }

    /// A declaration: `float x[3]`.
    pub(super) fn declare(&self, name: &str) -> String {
        format!("{} {name}{}", self.base_name(), self.dimensions())
    }

    /// The innermost element type of an array.
    pub(super) fn innermost(&self) -> &Self {
        match self {
            Self::Array(of, _) => of.innermost(),
            other => other,
        }
    }
}

/// A type's name as written; `struct` for an inline definition.
pub(super) fn spelled(ty: &TypeSpecifierNonArray) -> String {
    match &ty.content {
        TypeSpecifierNonArrayData::TypeName(name) => name.as_str().to_owned(),
        TypeSpecifierNonArrayData::Struct(_) => "struct".to_owned(),
        _ => {
            let mut name = String::new();
            let shown =
                show_type_specifier_non_array(&mut name, ty, &mut FormattingState::default());
            debug_assert!(shown.is_ok());
            name
        }
    }
}

/// A member of a struct or block.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct GlslMember {
    pub name: String,
    pub ty: Ty,
    /// Whether `layout(row_major)` applies.
    pub row_major: bool,
    pub place: Option<Span>,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Struct {
    pub name: String,
    pub members: Vec<GlslMember>,
    /// Whether its members have [`stored`] types.
    pub in_uniform_block: bool,
    /// Whether a block contains it by std140, so that it is laid out by these rules.
    pub is_hosted: bool,
    /// Whether it is the std430 copy of a struct, which is never padded.
    pub tight: bool,
}

impl Struct {
    /// Whether its members have exactly these names and types.
    pub(super) fn has(&self, members: &[GlslMember]) -> bool {
        let alike = |(a, b): (&GlslMember, &GlslMember)| a.name == b.name && a.ty == b.ty;
        self.members.len() == members.len() && self.members.iter().zip(members).all(alike)
    }
}

/// The structs of a stage, by name.
#[derive(Clone, Debug, Default)]
pub(super) struct Structs {
    /// In declaration order.
    pub order: Vec<String>,
    pub by_name: HashMap<String, Struct>,
    /// Sizes of the structs, by name.
    counts: HashMap<String, Count>,
}

/// The size of a type.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Count {
    /// Scalars, vectors and opaque values, times array lengths.
    pub elements: u64,
    /// As `elements`, counting each array once.
    pub members: u64,
}

impl Structs {
    pub(super) fn get(&self, name: &str) -> Option<&Struct> {
        self.by_name.get(name)
    }

    pub(super) fn insert(&mut self, of: Struct) {
        if !self.by_name.contains_key(&of.name) {
            self.order.push(of.name.clone());
        }
        let count = self.count_of(of.members.iter().map(|m| &m.ty));
        self.counts.insert(of.name.clone(), count);
        self.by_name.insert(of.name.clone(), of);
    }

    /// The size of a type, from the recorded sizes of its structs.
    pub(super) fn count(&self, ty: &Ty) -> Count {
        match ty {
            Ty::Array(of, n) => {
                let of = self.count(of);
                let n = n.map_or(1, |length| u64::from(length.n));
                Count {
                    elements: of.elements.saturating_mul(n),
                    ..of
                }
            }
            Ty::Struct(name) => self.counts.get(name).copied().unwrap_or_default(),
            _ => Count {
                elements: 1,
                members: 1,
            },
        }
    }

    /// The total size of several types.
    pub(super) fn count_of<'a>(&self, types: impl Iterator<Item = &'a Ty>) -> Count {
        types
            .map(|ty| self.count(ty))
            .fold(Count::default(), |all, one| Count {
                elements: all.elements.saturating_add(one.elements),
                members: all.members.saturating_add(one.members),
            })
    }

    /// Marks the structs of a uniform's type as `is_hosted` and `in_uniform_block`.
    pub(super) fn host(&mut self, ty: &Ty) {
        let Ty::Struct(name) = ty.innermost() else {
            return;
        };
        let members = match self.by_name.get_mut(name) {
            Some(of) if !of.is_hosted => {
                of.is_hosted = true;
                of.in_uniform_block = true;
                of.members.clone()
            }
            _ => return,
        };
        for member in members {
            self.host(&member.ty);
        }
    }

    /// Whether the type is, or contains, one for which `is` holds. Arrays count as their elements.
    pub(super) fn any(&self, ty: &Ty, is: &dyn Fn(&Ty) -> bool) -> bool {
        let ty = ty.innermost();
        let members = |name: &String| self.get(name).into_iter().flat_map(|of| &of.members);
        is(ty) || matches!(ty, Ty::Struct(name) if members(name).any(|m| self.any(&m.ty, is)))
    }

    /// Whether the type contains combined samplers.
    pub(super) fn has_samplers(&self, ty: &Ty) -> bool {
        self.any(ty, &|ty| matches!(ty, Ty::Combined(_)))
    }

    /// Whether the type contains anything but samplers.
    pub(super) fn has_data(&self, ty: &Ty) -> bool {
        self.any(ty, &|ty| !matches!(ty, Ty::Combined(_) | Ty::Struct(_)))
    }

    /// Whether the type contains 16-bit floats.
    pub(super) fn has_halves(&self, ty: &Ty) -> bool {
        self.any(ty, &|ty| ty.kind() == Some(Component::Half))
    }

    /// Whether the type contains a matrix.
    pub(super) fn has_matrices(&self, ty: &Ty) -> bool {
        self.any(ty, &|ty| matches!(ty, Ty::Matrix(..)))
    }

    /// Lists the samplers in a value at `path`, with path and type: `material.maps[1]`.
    pub(super) fn samplers(&self, ty: &Ty, path: &str, out: &mut Vec<(String, String)>) {
        match ty {
            Ty::Combined(name) => out.push((path.to_owned(), name.clone())),
            Ty::Array(of, n) if self.has_samplers(of) => {
                for i in 0..n.map_or(0, |length| length.n) {
                    self.samplers(of, &format!("{path}[{i}]"), out);
                }
            }
            Ty::Struct(name) => {
                if let Some(of) = self.get(name) {
                    for member in &of.members {
                        self.samplers(&member.ty, &format!("{path}.{}", member.name), out);
                    }
                }
            }
            _ => {}
        }
    }
}

/// A scalar or vector in a value.
#[derive(Clone, Debug)]
pub(super) struct ValueLeaf {
    /// The path to it, outermost step first.
    pub path: Vec<Step>,
    pub ty: Ty,
}

/// A step of a path into a value.
#[derive(Clone, Debug)]
pub(super) enum Step {
    Index(u32),
    Member(String),
}

impl ValueLeaf {
    /// The path as text: `[1].color`.
    pub(super) fn ending(&self) -> String {
        let step = |step: &Step| match step {
            Step::Index(n) => format!("[{n}]"),
            Step::Member(name) => format!(".{name}"),
        };
        self.path.iter().map(step).collect()
    }
}

impl Structs {
    /// Lists the scalars and vectors of a value.
    pub(super) fn leaf_paths(&self, ty: &Ty) -> Vec<ValueLeaf> {
        let below = |of: &Ty, step: Step| {
            let leaves = self.leaf_paths(of).into_iter();
            leaves.map(move |mut leaf| {
                leaf.path.insert(0, step.clone());
                leaf
            })
        };
        match ty {
            Ty::Array(of, n) => (0..n.map_or(0, |length| length.n))
                .flat_map(|i| below(of, Step::Index(i)))
                .collect(),
            Ty::Matrix(kind, columns, rows) => (0..u32::from(*columns))
                .flat_map(|c| below(&Ty::Vector(*kind, *rows), Step::Index(c)))
                .collect(),
            Ty::Struct(name) => {
                let members = self.get(name).into_iter().flat_map(|s| &s.members);
                members
                    .flat_map(|m| below(&m.ty, Step::Member(m.name.clone())))
                    .collect()
            }
            other => vec![ValueLeaf {
                path: Vec::new(),
                ty: other.clone(),
            }],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_types_go_both_ways() {
        for name in [
            "bool",
            "uint",
            "vec3",
            "bvec2",
            "uvec4",
            "ivec2",
            "dvec3",
            "mat3",
            "mat4x3",
            "dmat2",
            "float16_t",
            "f16vec3",
            "f16mat2x3",
        ] {
            assert_eq!(Ty::named(name).name(), name);
        }
        assert_eq!(Ty::named("i32vec2").name(), "ivec2");
        assert_eq!(Ty::named("float64_t").name(), "double");
        assert_eq!(
            Ty::named("usampler2DArray"),
            Ty::Combined("usampler2DArray".into())
        );
        assert_eq!(Ty::named("sampler"), Ty::Opaque("sampler".into()));
        assert_eq!(Ty::named("texture2D"), Ty::Opaque("texture2D".into()));
    }
}
