//! Rejects a module with too many expressions or too large types.

use naga::{ArraySize, Handle, Module, Type, TypeInner};

use shader_text::error::{Code, Error};
use shader_text::limits::{Exceeded, Limits};

/// Fails if the module or one of its types exceeds `limits`.
pub(super) fn check(module: &Module, limits: &Limits) -> Result<(), Error> {
    let told = |e: Exceeded| Error::new(Code::TooDeep, e.to_string()).note(e.remedy());
    let functions = module.functions.iter().map(|(_, f)| f);
    let expressions: usize = functions
        .chain(module.entry_points.iter().map(|e| &e.function))
        .map(|f| f.expressions.len())
        .sum();
    limits
        .check(
            "expressions",
            expressions as u64,
            "the number of expressions",
        )
        .map_err(told)?;
    // A type only refers to earlier ones.
    let mut elements: Vec<u64> = Vec::with_capacity(module.types.len());
    for (handle, ty) in module.types.iter() {
        let of = |h: Handle<Type>| elements.get(h.index()).copied().unwrap_or(1);
        let many = match &ty.inner {
            TypeInner::Array { base, size, .. } => {
                let times = match size {
                    ArraySize::Constant(n) => u64::from(n.get()),
                    ArraySize::Pending(_) | ArraySize::Dynamic => 1,
                };
                of(*base).saturating_mul(times)
            }
            TypeInner::Struct { members, .. } => members
                .iter()
                .fold(0, |sum: u64, m| sum.saturating_add(of(m.ty))),
            _ => 1,
        };
        let name = ty.name.as_deref().unwrap_or("a type");
        limits
            .check("array-elements", many, format!("the elements of {name}"))
            .map_err(|e| told(e).label(module.types.get_span(handle), "here"))?;
        elements.push(many);
    }
    Ok(())
}
