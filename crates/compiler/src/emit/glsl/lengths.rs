//! Arrays whose lengths are specialisation constants, in Vulkan's GLSL.
//!
//! naga writes lengths as numbers. So it gets numbers that no other array has, and the text gets
//! the constants in their place.

use std::collections::BTreeSet;
use std::num::NonZeroU32;

use naga::valid::FunctionInfo;
use naga::{
    AddressSpace, ArraySize, Expression, Function, Handle, Literal, Module, Type, TypeInner,
};
use naga_edit::declared::LengthConstant;
use preshade_plan::program::Program;

use crate::emit::overrides::Variable;
use preshade_plan::plan_file::StageFile;

/// Whether Vulkan's GLSL can express the length. It has no initial value for such an array, and
/// naga initialises all variables; it cannot copy one either, nor have one in another array.
pub(crate) fn is_expressible(program: &Program, length: &LengthConstant) -> bool {
    let (module, info) = (program.module(), program.info());
    let has_it = |ty: Handle<Type>| length.is_in(module, ty);
    let is_inner = |(_, ty): (Handle<Type>, &Type)| match ty.inner {
        TypeInner::Array { base, .. } => match module.types[base].inner {
            TypeInner::Array { .. } => has_it(base),
            _ => false,
        },
        _ => false,
    };
    let mut private = module.global_variables.iter().map(|(_, g)| g);
    if module.types.iter().any(is_inner)
        || private.any(|g| g.space == AddressSpace::Private && has_it(g.ty))
    {
        return false;
    }
    let is_free = |function: &Function, info: &FunctionInfo| {
        let is_value = |(handle, e): (Handle<Expression>, &Expression)| match e {
            Expression::ZeroValue(ty) | Expression::Compose { ty, .. } => has_it(*ty),
            Expression::Load { .. } | Expression::CallResult(_) => {
                info[handle].ty.handle().is_some_and(has_it)
            }
            _ => false,
        };
        let mut locals = function.local_variables.iter();
        !function.expressions.iter().any(is_value) && !locals.any(|(_, local)| has_it(local.ty))
    };
    let mut functions = module.functions.iter();
    let mut entries = module.entry_points.iter().enumerate();
    functions.all(|(handle, function)| is_free(function, &info[handle]))
        && entries.all(|(n, entry)| is_free(&entry.function, info.get_entry_point(n)))
}

/// The constants, with their type names, and numbers that stand for them in naga's text: no other
/// number of the module.
fn named(program: &Program) -> impl Iterator<Item = (String, u32, &LengthConstant)> {
    let module = program.module();
    let mut taken: BTreeSet<u32> = BTreeSet::new();
    for (_, ty) in module.types.iter() {
        if let TypeInner::Array { size, .. } | TypeInner::BindingArray { size, .. } = ty.inner
            && let ArraySize::Constant(n) = size
        {
            taken.insert(n.get());
        }
    }
    let functions = module.functions.iter().map(|(_, f)| f);
    let functions = functions.chain(module.entry_points.iter().map(|e| &e.function));
    let arenas = functions.map(|f| &f.expressions);
    for (_, e) in arenas
        .chain([&module.global_expressions])
        .flat_map(|a| a.iter())
    {
        taken.extend(match e {
            Expression::Literal(Literal::I32(n)) => u32::try_from(*n).ok(),
            Expression::Literal(Literal::U32(n)) => Some(*n),
            Expression::AccessIndex { index, .. } => Some(*index),
            _ => None,
        });
    }
    let free = (1001..).filter(move |n| !taken.contains(n));
    let lengths = program.declared().lengths.iter().zip(free);
    lengths.map(|(length, number)| (length.type_name(), number, length))
}

/// The module with a number for each constant. It is valid but for these lengths.
pub(super) fn numbered(program: &Program, module: &Module) -> Option<Module> {
    if program.declared().lengths.is_empty() {
        return None;
    }
    let named: Vec<_> = named(program).collect();
    let mut out = module.clone();
    for (handle, ty) in module.types.iter() {
        let mut named = named.iter();
        let found = named.find(|(name, ..)| ty.name.as_ref() == Some(name));
        if let Some((_, number, _)) = found
            && let TypeInner::Array { base, stride, .. } = ty.inner
            && let Some(number) = NonZeroU32::new(*number)
        {
            let size = ArraySize::Constant(number);
            let name = ty.name.clone();
            let inner = TypeInner::Array { base, size, stride };
            out.types.replace(handle, Type { name, inner });
        }
    }
    Some(out)
}

/// The lengths of a stage's text.
pub struct Written<'p> {
    /// In brackets, the number in naga's text.
    number: String,
    default: u32,
    length: &'p LengthConstant,
}

/// The lengths of the arrays in a text.
pub(super) fn written<'p>(program: &'p Program, text: &str) -> Vec<Written<'p>> {
    let module = program.module();
    let of = |(name, number, length): (String, u32, &'p LengthConstant)| {
        let mut types = module.types.iter();
        let default = types.find_map(|(_, ty)| match ty.inner {
            TypeInner::Array {
                size: ArraySize::Constant(n),
                ..
            } if ty.name.as_ref() == Some(&name) => Some(n.get()),
            _ => None,
        });
        Some(Written {
            number: format!("[{number}]"),
            default: default?,
            length,
        })
    };
    let all = named(program).filter_map(of);
    all.filter(|w| text.contains(&w.number)).collect()
}

/// The text with the default lengths.
pub(super) fn with_defaults(text: &str, written: &[Written<'_>]) -> String {
    written.iter().fold(text.to_owned(), |text, w| {
        text.replace(&w.number, &format!("[{}]", w.default))
    })
}

/// The text with the constants' variables as lengths, which are declared ahead of all types. Adds
/// the variables of constants whose values the text does not read.
pub(super) fn with_variables(
    mut text: String,
    written: &[Written<'_>],
    variables: &mut Vec<Variable>,
    stage_file: &mut StageFile,
) -> String {
    for w in written {
        let constant = stage_file.add_length(w.length, w.default);
        let mut read = variables.iter();
        let read = read.find(|v| v.constant.id == w.length.id);
        let marker = match read {
            Some(variable) => variable.marker.clone(),
            None => {
                let marker = format!("{}x", w.length.type_name());
                variables.push(Variable::new(marker.clone(), constant));
                marker
            }
        };
        let is_declared = |line: &str| line.split([' ', '=']).nth(1) == Some(marker.as_str());
        let ty = if w.length.is_signed { "int" } else { "uint" };
        let suffix = if w.length.is_signed { "" } else { "u" };
        let own = format!("{ty} {marker} = {}{suffix};\n", w.default);
        let lines = text.split_inclusive('\n').filter(|line| !is_declared(line));
        let (head, rest): (Vec<&str>, Vec<&str>) = lines.partition(|line| line.starts_with('#'));
        text = head.concat() + &own + &rest.concat();
        text = text.replace(&w.number, &format!("[{marker}]"));
    }
    text
}
