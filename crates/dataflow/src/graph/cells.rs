//! Splits variables into cells, the units of memory that have versions.
//!
//! A cell is a variable and a constant access path into it. The cells of one variable cover it
//! without overlap. Cells are as coarse as the function's accesses permit; a dynamically indexed
//! part is one cell.

use std::collections::BTreeMap;

use naga::{
    AddressSpace, Expression, Function, GlobalVariable, Handle, LocalVariable, Module,
    StorageAccess, TypeInner,
};

/// A variable, as seen in a function.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Root {
    Local(Handle<LocalVariable>),
    /// The memory that this pointer argument refers to.
    Argument(u32),
    Global(Handle<GlobalVariable>),
}

/// A constant access path into a variable: struct member, array element, matrix column or vector
/// component at each step.
pub type Path = Vec<u32>;

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Cell {
    pub root: Root,
    pub path: Path,
}

impl Cell {
    /// Whether one of two paths into the same variable is a prefix of the other.
    pub fn overlaps(&self, root: Root, path: &[u32]) -> bool {
        self.root == root && self.path.iter().zip(path).all(|(a, b)| a == b)
    }
}

/// The target of a pointer expression.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    pub root: Root,
    /// The constant part of the access path.
    pub path: Path,
    /// Whether a dynamic index follows the constant part. The place is then somewhere below the
    /// path.
    pub dynamic: bool,
}

/// Whether shaders can write to the address space of a global variable.
pub(crate) fn is_written_space(module: &Module, global: Handle<GlobalVariable>) -> bool {
    let variable = &module.global_variables[global];
    match variable.space {
        AddressSpace::Uniform | AddressSpace::Immediate => false,
        AddressSpace::Storage { access } => access.contains(StorageAccess::STORE),
        AddressSpace::Handle => {
            let inner = match module.types[variable.ty].inner {
                TypeInner::BindingArray { base, .. } => &module.types[base].inner,
                ref inner => inner,
            };
            matches!(inner, TypeInner::Image { class: naga::ImageClass::Storage { access, .. }, .. }
                if access.intersects(StorageAccess::STORE | StorageAccess::ATOMIC))
        }
        _ => true,
    }
}

/// The target of a pointer (or a writable image). `None` for memory that nobody writes.
pub fn place(module: &Module, function: &Function, pointer: Handle<Expression>) -> Option<Place> {
    let mut steps = Vec::new();
    let mut at = pointer;
    let root = loop {
        match function.expressions[at] {
            Expression::AccessIndex { base, index } => {
                steps.push(Some(index));
                at = base;
            }
            Expression::Access { base, index } => {
                steps.push(naga_operands::constant_index(module, function, index));
                at = base;
            }
            Expression::LocalVariable(v) => break Root::Local(v),
            Expression::FunctionArgument(i) => break Root::Argument(i),
            Expression::GlobalVariable(g) if is_written_space(module, g) => break Root::Global(g),
            _ => return None,
        }
    };
    steps.reverse();
    // A resource that other invocations may write is a single cell.
    if let Root::Global(g) = root
        && module.global_variables[g].space != AddressSpace::Private
    {
        return Some(Place {
            root,
            path: Vec::new(),
            dynamic: true,
        });
    }
    let path: Path = steps.iter().map_while(|s| *s).collect();
    let dynamic = path.len() < steps.len();
    Some(Place {
        root,
        path,
        dynamic,
    })
}

/// How a variable's accesses split it.
#[derive(Clone, Debug, Default)]
struct Split {
    frozen: bool,
    children: BTreeMap<u32, Split>,
}

/// Longer arrays are one cell, even if all indices are constant.
const LONGEST_SPLIT_ARRAY: u32 = 64;

/// Collects the accesses of a function and then lists its cells.
#[derive(Clone, Debug, Default)]
pub(crate) struct Splitter {
    roots: BTreeMap<Root, Split>,
}

impl Splitter {
    pub fn access(&mut self, place: &Place) {
        let mut at = self.roots.entry(place.root).or_default();
        for step in &place.path {
            at = at.children.entry(*step).or_default();
        }
        at.frozen |= place.dynamic;
    }

    /// The cells in order of root and path, so that those of a root are adjacent.
    pub fn cells(&self, module: &Module, function: &Function) -> Vec<Cell> {
        let mut cells = Vec::new();
        for (&root, split) in &self.roots {
            let ty = match root {
                Root::Local(v) => Some(function.local_variables[v].ty),
                Root::Argument(i) => match module.types[function.arguments[i as usize].ty].inner {
                    TypeInner::Pointer { base, .. } => Some(base),
                    _ => None,
                },
                Root::Global(g) => Some(module.global_variables[g].ty),
            };
            let shape = ty.map_or(CellShape::Leaf, CellShape::Type);
            list(module, root, split, shape, &mut Vec::new(), &mut cells);
        }
        cells
    }
}

#[derive(Clone, Copy)]
enum CellShape {
    Type(Handle<naga::Type>),
    /// A matrix column with this many components.
    Column(u32),
    Leaf,
}

fn list(
    module: &Module,
    root: Root,
    split: &Split,
    shape: CellShape,
    path: &mut Path,
    cells: &mut Vec<Cell>,
) {
    let count = match shape {
        _ if split.frozen || split.children.is_empty() => 0,
        CellShape::Leaf => 0,
        CellShape::Column(rows) => rows,
        CellShape::Type(ty) => match &module.types[ty].inner {
            TypeInner::Struct { members, .. } => members.len() as u32,
            TypeInner::Vector { size, .. } => *size as u32,
            TypeInner::Matrix { columns, .. } => *columns as u32,
            TypeInner::Array {
                size: naga::ArraySize::Constant(n),
                ..
            } if n.get() <= LONGEST_SPLIT_ARRAY => n.get(),
            // An argument that is a vector behind a value pointer, a runtime array, an opaque type.
            _ => 0,
        },
    };
    if count == 0 {
        cells.push(Cell {
            root,
            path: path.clone(),
        });
        return;
    }
    let whole = Split::default();
    for i in 0..count {
        let inner = match shape {
            CellShape::Type(ty) => match &module.types[ty].inner {
                TypeInner::Struct { members, .. } => CellShape::Type(members[i as usize].ty),
                TypeInner::Array { base, .. } => CellShape::Type(*base),
                TypeInner::Matrix { rows, .. } => CellShape::Column(*rows as u32),
                _ => CellShape::Leaf,
            },
            _ => CellShape::Leaf,
        };
        path.push(i);
        list(
            module,
            root,
            split.children.get(&i).unwrap_or(&whole),
            inner,
            path,
            cells,
        );
        path.pop();
    }
}

/// The steps of a cell's path in source notation: `.uv`, `.x`, `[3]`.
pub(crate) fn path_names(module: &Module, function: &Function, cell: &Cell) -> Vec<String> {
    let mut ty = match cell.root {
        Root::Local(v) => Some(function.local_variables[v].ty),
        Root::Argument(i) => match module.types[function.arguments[i as usize].ty].inner {
            TypeInner::Pointer { base, .. } => Some(base),
            _ => None,
        },
        Root::Global(g) => Some(module.global_variables[g].ty),
    };
    let mut names = Vec::new();
    for step in &cell.path {
        let (name, next) = match ty.map(|ty| &module.types[ty].inner) {
            Some(TypeInner::Struct { members, .. }) => {
                let member = &members[*step as usize];
                let name = member.name.clone().unwrap_or_else(|| step.to_string());
                (format!(".{name}"), Some(member.ty))
            }
            Some(TypeInner::Array { base, .. }) => (format!("[{step}]"), Some(*base)),
            Some(TypeInner::Vector { .. }) => {
                let letter = "xyzw".chars().nth(*step as usize).unwrap_or('?');
                (format!(".{letter}"), None)
            }
            _ => (format!("[{step}]"), None),
        };
        names.push(name);
        ty = next;
    }
    names
}
