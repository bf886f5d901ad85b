//! Packs values into bytes: walks a host-shareable type with naga's layout and fills each scalar,
//! vector and matrix.

use std::collections::BTreeMap;
use std::ops::Range;

use naga::{ArraySize, Handle, Module, ScalarKind, Type, TypeInner, VectorSize};
use naga_edit::interface::wgsl_type;

use super::{SceneError, Semantic, Value};

/// A scalar, vector or matrix inside a variable.
pub(crate) struct VariableLeaf<'a> {
    /// The path without indices: `variable.member.member`.
    pub path: &'a [Segment<'a>],
    /// Index in the innermost enclosing array.
    pub index: Option<usize>,
    /// 1 for scalars and vectors.
    pub columns: u32,
    /// 1 for scalars.
    pub rows: u32,
    pub kind: ScalarKind,
    /// Bytes of a scalar.
    pub width: u8,
    /// The semantic in the author's values.
    pub semantic: Option<Semantic>,
    /// Byte range in the variable.
    pub bytes: Range<usize>,
}

fn counted(numbers: usize) -> String {
    match numbers {
        1 => "1 number".to_owned(),
        n => format!("{n} numbers"),
    }
}

impl VariableLeaf<'_> {
    /// Name of the member or variable.
    pub fn name(&self) -> &str {
        self.path
            .iter()
            .rev()
            .find_map(|s| match s {
                Segment::Name(n) => Some(*n),
                Segment::Index(_) => None,
            })
            .unwrap_or("")
    }
}

impl VariableLeaf<'_> {
    /// The path in the users' syntax.
    pub fn text(&self) -> String {
        join(self.path, false)
    }

    /// The path in the users' syntax, with indices.
    pub fn indexed(&self) -> String {
        join(self.path, true)
    }

    /// The conventional meaning of the name, qualified by the struct's name (`camera.position`) or
    /// alone.
    pub fn named(&self) -> Option<Semantic> {
        Semantic::of_path(self.path.iter().rev().filter_map(|s| match s {
            Segment::Name(n) => Some(*n),
            Segment::Index(_) => None,
        }))
    }
}

/// A step of a path into a variable.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Segment<'a> {
    Name(&'a str),
    Index(usize),
}

/// A path in the scene's syntax, `lights[1].color`, with or without indices.
fn join(path: &[Segment<'_>], indexed: bool) -> String {
    let mut out = String::new();
    for segment in path {
        match segment {
            Segment::Name(n) => {
                if !out.is_empty() {
                    out.push('.');
                }
                out.push_str(n);
            }
            Segment::Index(i) if indexed => out.push_str(&format!("[{i}]")),
            Segment::Index(_) => {}
        }
    }
    out
}

/// Columns and rows of a leaf type.
pub fn leaf_shape(inner: &TypeInner) -> Option<(u32, u32, naga::Scalar)> {
    Some(match *inner {
        TypeInner::Scalar(s) | TypeInner::Atomic(s) => (1, 1, s),
        TypeInner::Vector { size, scalar } => (1, size as u32, scalar),
        TypeInner::Matrix {
            columns,
            rows,
            scalar,
        } => (columns as u32, rows as u32, scalar),
        _ => return None,
    })
}

/// Number of scalars in a type; a runtime-sized array counts `dynamic` elements.
pub fn scalar_count(module: &Module, ty: Handle<Type>, dynamic: usize) -> usize {
    match &module.types[ty].inner {
        TypeInner::Array { base, size, .. } => {
            array_length(*size, dynamic) * scalar_count(module, *base, dynamic)
        }
        TypeInner::Struct { members, .. } => members
            .iter()
            .map(|m| scalar_count(module, m.ty, dynamic))
            .sum(),
        inner => leaf_shape(inner).map_or(0, |(c, r, _)| (c * r) as usize),
    }
}

/// Element type and stride of the runtime-sized array that a type is or ends in.
pub fn runtime_array(module: &Module, ty: Handle<Type>) -> Option<Handle<Type>> {
    match &module.types[ty].inner {
        TypeInner::Array {
            base,
            size: ArraySize::Dynamic,
            ..
        } => Some(*base),
        TypeInner::Struct { members, .. } => runtime_array(module, members.last()?.ty),
        _ => None,
    }
}

fn array_length(size: ArraySize, dynamic: usize) -> usize {
    match size {
        ArraySize::Constant(n) => n.get() as usize,
        ArraySize::Pending(_) | ArraySize::Dynamic => dynamic,
    }
}

/// Size in bytes of a type with `dynamic` elements in its runtime-sized array.
fn size_of(module: &Module, ty: Handle<Type>, dynamic: usize) -> usize {
    match &module.types[ty].inner {
        TypeInner::Array { size, stride, .. } => array_length(*size, dynamic) * *stride as usize,
        TypeInner::Struct { members, span } => {
            let tail = members
                .last()
                .filter(|m| runtime_array(module, m.ty).is_some());
            tail.map_or(*span as usize, |m| {
                m.offset as usize + size_of(module, m.ty, dynamic)
            })
            .max(*span as usize)
        }
        inner => leaf_shape(inner).map_or(0, leaf_size),
    }
}

/// Size in bytes of a scalar, vector or matrix.
fn leaf_size((columns, rows, scalar): (u32, u32, naga::Scalar)) -> usize {
    (columns as usize - 1) * column_stride(rows, scalar) + rows as usize * scalar.width as usize
}

/// Bytes from one matrix column to the next (WGSL section 13.4.1). Columns of three occupy the
/// space of four.
fn column_stride(rows: u32, scalar: naga::Scalar) -> usize {
    let rows = if rows == VectorSize::Tri as u32 {
        4
    } else {
        rows
    };
    rows as usize * scalar.width as usize
}

/// The scene's values, by path.
#[derive(Clone, Copy)]
pub(crate) struct SceneValues<'a> {
    /// Values of the draw. They take precedence over the material's, for whole variables and for
    /// parts.
    pub draw: &'a BTreeMap<String, Value>,
    pub material: &'a BTreeMap<String, Value>,
}

/// Fills a variable of type `ty` and returns its bytes, padded to a multiple of 16. Every level is
/// looked up in `given` by path. `leaf` provides the missing numbers in column-major order.
pub(crate) fn pack<'a>(
    module: &'a Module,
    name: &'a str,
    ty: Handle<Type>,
    dynamic: usize,
    given: SceneValues<'a>,
    leaf: &'a mut dyn FnMut(&VariableLeaf<'_>) -> Result<[f64; 16], SceneError>,
) -> Result<Vec<u8>, SceneError> {
    let size = size_of(module, ty, dynamic).next_multiple_of(16).max(16);
    let mut packer = Packer {
        module,
        bytes: vec![0; size],
        path: if name.is_empty() {
            Vec::new()
        } else {
            vec![Segment::Name(name)]
        },
        semantic: None,
        dynamic,
        given,
        leaf,
    };
    packer.write(ty, 0, false)?;
    Ok(packer.bytes)
}

struct Packer<'a> {
    module: &'a Module,
    bytes: Vec<u8>,
    path: Vec<Segment<'a>>,
    semantic: Option<Semantic>,
    dynamic: usize,
    given: SceneValues<'a>,
    leaf: &'a mut dyn FnMut(&VariableLeaf<'_>) -> Result<[f64; 16], SceneError>,
}

impl<'a> Packer<'a> {
    /// The value at the current path, and whether it comes from the draw. Only a draw's value
    /// overwrites a filled one.
    fn found(&self, is_filled: bool) -> Option<(&'a Value, bool)> {
        // The members of an unnamed GLSL block have no prefix.
        if self.path.is_empty() {
            return None;
        }
        let owners = [(self.given.draw, true), (self.given.material, false)];
        let mut owners = owners
            .into_iter()
            .filter(|(values, by_draw)| !values.is_empty() && (*by_draw || !is_filled));
        owners.find_map(|(values, by_draw)| {
            let value = values
                .get(&join(&self.path, true))
                .or_else(|| values.get(&join(&self.path, false)))?;
            Some((value, by_draw))
        })
    }

    /// Writes the scene's values, and default values unless `is_filled`.
    fn write(
        &mut self,
        ty: Handle<Type>,
        offset: usize,
        mut is_filled: bool,
    ) -> Result<(), SceneError> {
        // Skip the lookup per element for large arrays without values.
        if is_filled && self.given.draw.is_empty() {
            return Ok(());
        }
        let found = self.found(is_filled);
        let outer = self.semantic;
        match found {
            Some((Value::Numbers(numbers), by_draw)) => {
                let wanted = scalar_count(self.module, ty, self.dynamic);
                if numbers.len() != wanted && numbers.len() != 1 {
                    let ty = wgsl_type(self.module, ty);
                    return Err(SceneError::new(format!(
                        "`{}` ({ty}) holds {}, but {} given",
                        join(&self.path, true),
                        counted(wanted),
                        match numbers.len() {
                            1 => "1 is".to_owned(),
                            n => format!("{n} are"),
                        }
                    ))
                    .about(join(&self.path, true)));
                }
                let mut at = 0;
                self.fill(ty, offset, numbers, &mut at);
                if by_draw {
                    return Ok(());
                }
                is_filled = true;
            }
            Some((Value::Semantic(name), _)) => {
                is_filled = false;
                self.semantic = Some(Semantic::from_name(name).ok_or_else(|| {
                    let (path, ty) = (join(&self.path, true), wgsl_type(self.module, ty));
                    SceneError::new(format!(
                        "`{path}` ({ty}) is given the unknown value `${name}`"
                    ))
                    .suggest(name, Semantic::names())
                    .about(join(&self.path, true))
                })?);
            }
            None => {}
        }
        let module = self.module;
        match &module.types[ty].inner {
            TypeInner::Struct { members, .. } => {
                for member in members {
                    self.path
                        .push(Segment::Name(member.name.as_deref().unwrap_or("")));
                    self.write(member.ty, offset + member.offset as usize, is_filled)?;
                    self.path.pop();
                }
            }
            TypeInner::Array { base, size, stride } => {
                for i in 0..array_length(*size, self.dynamic) {
                    self.path.push(Segment::Index(i));
                    self.write(*base, offset + i * *stride as usize, is_filled)?;
                    self.path.pop();
                }
            }
            _ if is_filled => {}
            inner => {
                let Some((columns, rows, scalar)) = leaf_shape(inner) else {
                    return Err(SceneError::new(format!(
                        "`{}` is of a type that a scene cannot fill",
                        join(&self.path, true)
                    )));
                };
                let index = self.path.iter().rev().find_map(|s| match s {
                    Segment::Index(i) => Some(*i),
                    Segment::Name(_) => None,
                });
                let numbers = (self.leaf)(&VariableLeaf {
                    path: &self.path,
                    index,
                    columns,
                    rows,
                    kind: scalar.kind,
                    width: scalar.width,
                    semantic: self.semantic,
                    bytes: offset..offset + leaf_size((columns, rows, scalar)),
                })?;
                self.leaf_bytes(offset, columns, rows, scalar, &numbers);
            }
        }
        self.semantic = outer;
        Ok(())
    }

    /// Takes numbers in order, or repeats a single number.
    fn fill(&mut self, ty: Handle<Type>, offset: usize, numbers: &[f64], at: &mut usize) {
        let module = self.module;
        match &module.types[ty].inner {
            TypeInner::Struct { members, .. } => {
                for m in members {
                    self.fill(m.ty, offset + m.offset as usize, numbers, at);
                }
            }
            TypeInner::Array { base, size, stride } => {
                for i in 0..array_length(*size, self.dynamic) {
                    self.fill(*base, offset + i * *stride as usize, numbers, at);
                }
            }
            inner => {
                if let Some((columns, rows, scalar)) = leaf_shape(inner) {
                    let mut taken = [0.0; 16];
                    for n in taken.iter_mut().take((columns * rows) as usize) {
                        *n = numbers[if numbers.len() == 1 { 0 } else { *at }];
                        *at += 1;
                    }
                    self.leaf_bytes(offset, columns, rows, scalar, &taken);
                }
            }
        }
    }

    fn leaf_bytes(
        &mut self,
        offset: usize,
        columns: u32,
        rows: u32,
        scalar: naga::Scalar,
        numbers: &[f64; 16],
    ) {
        for c in 0..columns as usize {
            for r in 0..rows as usize {
                let at = offset + c * column_stride(rows, scalar) + r * scalar.width as usize;
                let n = numbers[c * rows as usize + r];
                scalar_bytes(
                    &mut self.bytes[at..at + scalar.width as usize],
                    scalar.kind,
                    n,
                );
            }
        }
    }
}

/// Writes one little-endian scalar; the slice's length is its width.
pub(crate) fn scalar_bytes(out: &mut [u8], kind: ScalarKind, n: f64) {
    match (kind, out.len()) {
        (ScalarKind::Float, 8) => out.copy_from_slice(&n.to_le_bytes()),
        (ScalarKind::Float, 2) => out.copy_from_slice(&half::f16::from_f64(n).to_le_bytes()),
        (ScalarKind::Float, _) => out.copy_from_slice(&(n as f32).to_le_bytes()),
        (ScalarKind::Sint, width) => out.copy_from_slice(&(n as i64).to_le_bytes()[..width]),
        (_, width) => out.copy_from_slice(&(n as u64).to_le_bytes()[..width]),
    }
}

/// Every path into a variable that a value may name, without indices.
pub fn paths(module: &Module, name: &str, ty: Handle<Type>) -> Vec<String> {
    let mut out = match name {
        "" => Vec::new(),
        name => vec![name.to_owned()],
    };
    let mut inner = &module.types[ty].inner;
    while let TypeInner::Array { base, .. } = inner {
        inner = &module.types[*base].inner;
    }
    if let TypeInner::Struct { members, .. } = inner {
        for m in members {
            let member = m.name.as_deref().unwrap_or("");
            let path = if name.is_empty() {
                member.to_owned()
            } else {
                format!("{name}.{member}")
            };
            out.extend(paths(module, &path, m.ty));
        }
    }
    out
}
