//! Memory layout of types in blocks.

use super::ty::{Component, GlslMember, Struct, Structs, Ty};

/// The layout of a value in memory, where it differs from the computed value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct MemoryLayout {
    /// The layout rules of the enclosing block. `None`: not in a block.
    pub rules: Option<Rules>,
    /// Row-major: matrices are declared transposed.
    pub rows: bool,
}

impl MemoryLayout {
    pub(super) fn by(rules: Rules) -> Self {
        Self {
            rules: Some(rules),
            rows: false,
        }
    }

    /// Whether array elements are padded to 16 bytes.
    pub(super) fn is_padded(self) -> bool {
        self.rules == Some(Rules::Std140)
    }

    /// Whether the rules are std430.
    pub(super) fn is_std430(self) -> bool {
        matches!(self.rules, Some(Rules::Std430 | Rules::Std430Struct))
    }

    /// Transposes a row-major matrix type.
    pub(super) fn turned(self, ty: &Ty) -> Ty {
        match ty {
            Ty::Matrix(k, c, r) if self.rows => Ty::Matrix(*k, *r, *c),
            other => other.clone(),
        }
    }

    /// The declared type of a type without structs.
    pub(super) fn stored(self, ty: &Ty) -> Ty {
        match self.rules {
            Some(rules) => stored(ty, rules),
            None => ty.clone(),
        }
    }
}

/// A declared entry of a struct or block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum BlockEntry<'a> {
    Member(&'a GlslMember),
    /// An unused float.
    Padding,
}

impl Structs {
    /// Whether the declared type has the std430 layout. `build` lays structs out by std140. Structs
    /// that are also in a uniform block have padding and [`stored`] members.
    pub(super) fn is_std430(&self, ty: &Ty) -> bool {
        match ty {
            Ty::Scalar(kind) | Ty::Vector(kind, _) => *kind != Component::Bool,
            Ty::Matrix(_, _, rows) => *rows != 2,
            Ty::Array(of, _) => {
                let stride = |(align, size): (u32, u32)| size.next_multiple_of(align);
                let (align, size) = self.std140(of);
                self.is_std430(of)
                    && stride((align.max(16), size)) == stride(self.placed(of, true, false))
            }
            Ty::Struct(name) => self.get(name).is_none_or(|s| {
                let padded = || {
                    self.laid_out(&s.members, true)
                        .contains(&BlockEntry::Padding)
                };
                s.members.iter().all(|m| self.is_std430(&m.ty)) && !(s.in_uniform_block && padded())
            }),
            _ => true,
        }
    }

    /// Alignment and size in std140 (OpenGL 4.6, 7.6.2.2).
    fn std140(&self, ty: &Ty) -> (u32, u32) {
        self.placed(ty, false, false)
    }

    /// Alignment and size by std430 if `tight`, else by std140. `by_rows`: matrices are row-major.
    pub(super) fn placed(&self, ty: &Ty, tight: bool, by_rows: bool) -> (u32, u32) {
        let width = |k: &Component| if *k == Component::Double { 8 } else { 4 };
        let align = |k: &Component, n: u8| width(k) * [1, 2, 4, 4][usize::from(n) - 1];
        let least = if tight { 1 } else { 16 };
        match ty {
            Ty::Scalar(k) => (width(k), width(k)),
            Ty::Vector(k, n) => (align(k, *n), width(k) * u32::from(*n)),
            Ty::Matrix(k, columns, rows) => {
                let (columns, rows) = match by_rows {
                    true => (rows, columns),
                    false => (columns, rows),
                };
                let stride = align(k, *rows).max(least);
                (stride, stride * u32::from(*columns))
            }
            Ty::Array(of, n) => {
                let (align, size) = self.placed(of, tight, by_rows);
                let align = align.max(least);
                let length = n.map_or(1, |length| length.n);
                (align, size.next_multiple_of(align).saturating_mul(length))
            }
            Ty::Struct(name) => {
                let members = self.get(name).into_iter().flat_map(|of| &of.members);
                let (mut most, mut end) = (least.max(4), 0u32);
                for member in members.filter(|m| self.has_data(&m.ty)) {
                    let (align, size) = self.placed(&member.ty, tight, by_rows);
                    most = most.max(align);
                    end = end.next_multiple_of(align).saturating_add(size);
                }
                (most, end.next_multiple_of(most))
            }
            _ => (16, 16),
        }
    }

    /// The alignment that `build` gives the type. It does not round a struct's up to 16.
    fn built_align(&self, ty: &Ty) -> u32 {
        match ty {
            Ty::Struct(name) => {
                let members = self.get(name).into_iter().flat_map(|of| &of.members);
                let members = members.filter(|m| self.has_data(&m.ty));
                members.map(|m| self.built_align(&m.ty)).max().unwrap_or(4)
            }
            other => self.std140(other).0,
        }
    }

    /// The data members of a struct as it is declared.
    pub(super) fn entries<'a>(&self, of: &'a Struct) -> Vec<BlockEntry<'a>> {
        if of.in_uniform_block {
            return self.laid_out(&of.members, true);
        }
        let data = of.members.iter().filter(|m| self.has_data(&m.ty));
        data.map(BlockEntry::Member).collect()
    }

    /// The data members with the padding that struct alignment needs. `whole` also pads the end to
    /// 16 bytes.
    pub(super) fn laid_out<'a>(
        &self,
        members: &'a [GlslMember],
        whole: bool,
    ) -> Vec<BlockEntry<'a>> {
        let mut out = Vec::new();
        let mut end = 0u32;
        let mut largest = 4;
        for member in members.iter().filter(|m| self.has_data(&m.ty)) {
            let (align, size) = self.std140(&member.ty);
            let at = end.next_multiple_of(align);
            let naga = self.built_align(&member.ty);
            largest = largest.max(naga);
            if end.next_multiple_of(naga) != at {
                out.extend((0..(at - end) / 4).map(|_| BlockEntry::Padding));
            }
            out.push(BlockEntry::Member(member));
            end = at + size;
        }
        if whole && largest < 16 {
            let rest = end.next_multiple_of(16) - end;
            out.extend((0..rest / 4).map(|_| BlockEntry::Padding));
        }
        out
    }

    /// Whether the stored type differs from the computed type.
    pub(super) fn is_converted(&self, ty: &Ty, lay: MemoryLayout) -> bool {
        let otherwise = lay.stored(ty) != *ty;
        otherwise
            || match ty {
                Ty::Matrix(..) => lay.rows,
                Ty::Array(of, _) => self.is_converted(of, lay),
                Ty::Struct(_) => {
                    lay.rows && self.has_matrices(ty) || lay.is_std430() && !self.is_std430(ty)
                }
                _ => false,
            }
    }

    /// The layout of a member of a struct with this layout.
    pub(super) fn member_lay(&self, name: &str, lay: MemoryLayout) -> MemoryLayout {
        let in_uniform_block = self.get(name).is_some_and(|s| s.in_uniform_block);
        MemoryLayout {
            rules: match lay.is_std430() {
                true => Some(Rules::Std430Struct),
                false => in_uniform_block.then_some(Rules::Std140),
            },
            ..lay
        }
    }

    /// Marks structs as `in_uniform_block` if `build` gives them that layout anyway: those with
    /// arrays of small elements or two-row matrices.
    pub(super) fn mark_small_elements(&mut self) {
        for of in self.by_name.values_mut().filter(|of| !of.tight) {
            of.in_uniform_block |= of.members.iter().any(|m| {
                !matches!(m.ty.kind(), Some(Component::Bool))
                    && stored(&m.ty, Rules::Std140) != m.ty
            });
        }
    }
}

/// The layout rules of a block (OpenGL 4.6, 7.6.2.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rules {
    /// No `bool`, no arrays with elements under 16 bytes, no two-row matrices.
    Std140,
    /// No `bool`.
    Std430,
    /// A struct in std430, which `build` first lays out by std140. No two-row matrices.
    Std430Struct,
}

/// The number of components to which std140 pads an array's element of this type.
pub(super) fn padded_size(element: &Ty) -> Option<u8> {
    match element {
        Ty::Scalar(Component::Double) => Some(2),
        Ty::Vector(Component::Double, _) => None,
        Ty::Scalar(_) | Ty::Vector(_, 2) => Some(4),
        _ => None,
    }
}

/// The declared type of a value in a block, with the same offsets.
pub(super) fn stored(ty: &Ty, rules: Rules) -> Ty {
    fn of_kind(kind: Component) -> Component {
        match kind {
            Component::Bool => Component::Uint,
            other => other,
        }
    }
    match ty {
        Ty::Array(of, n) => {
            let size = padded_size(of).filter(|_| rules == Rules::Std140);
            let element = match (size, of.kind()) {
                (Some(n), Some(k)) => Ty::Vector(of_kind(k), n),
                _ => stored(of, rules),
            };
            Ty::Array(Box::new(element), *n)
        }
        Ty::Matrix(Component::Float, columns, 2) if rules != Rules::Std430 => {
            let column = if rules == Rules::Std140 { 4 } else { 2 };
            let column = Ty::Vector(Component::Float, column);
            Ty::Array(Box::new(column), Some(u32::from(*columns).into()))
        }
        Ty::Scalar(k) => Ty::Scalar(of_kind(*k)),
        Ty::Vector(k, n) => Ty::Vector(of_kind(*k), *n),
        other => other.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_stored_keeps_the_stride() {
        let array = |of, n: u32| Ty::Array(Box::new(of), Some(n.into()));
        assert_eq!(
            stored(&array(Ty::FLOAT, 5), Rules::Std140).name(),
            "vec4[5]"
        );
        assert_eq!(
            stored(&array(Ty::named("bvec2"), 2), Rules::Std140).name(),
            "uvec4[2]"
        );
        assert_eq!(stored(&Ty::named("mat2"), Rules::Std140).name(), "vec4[2]");
        assert_eq!(
            stored(&Ty::named("mat2"), Rules::Std430Struct).name(),
            "vec2[2]"
        );
        assert_eq!(
            stored(&array(Ty::named("mat2"), 3), Rules::Std140).name(),
            "vec4[3][2]"
        );
        let whole = array(Ty::named("vec3"), 4);
        assert_eq!(stored(&whole, Rules::Std140), whole);
    }
}
