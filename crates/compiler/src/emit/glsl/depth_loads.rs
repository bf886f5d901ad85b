//! Declares depth textures that a shader only loads from as textures of floats, for GLSL.
//!
//! GLSL reads a depth texture through `sampler2DShadow`, which has no `texelFetch`, or through
//! `sampler2D`, as if it held floats. OpenGL and WebGL 2 return the depth there if the texture does
//! not compare (`TEXTURE_COMPARE_MODE` is `NONE`), Vulkan in any case. The plan keeps its depth
//! texture: WGSL and SPIR-V load from it as it is.

use std::collections::BTreeSet;

use naga::{
    Expression, Function, GlobalVariable, Handle, ImageClass, Module, ScalarKind, Type, TypeInner,
};
use naga_edit::copy::{CopyFunction, Copying};
use naga_edit::writer::FunctionWriter;
use preshade_plan::program::Program;

/// The program with such textures as textures of floats. `None` if it has none. A texture that is
/// also sampled, or passed to a function, stays as it is.
pub(super) fn as_floats(program: &Program) -> Option<Program> {
    let module = program.module();
    let loaded = loaded(module);
    if loaded.is_empty() {
        return None;
    }
    let mut out = module.clone();
    for global in &loaded {
        let ty = out.global_variables[*global].ty;
        let float = float(&mut out, ty);
        out.global_variables[*global].ty = float;
    }
    let copy = |function: &Function| {
        let copying = Copying::new(function, FunctionWriter::like(function));
        let mut copy = FloatLoads {
            copying,
            loaded: &loaded,
        };
        copy.unevaluated();
        copy.copying.initialisers();
        copy.block(&function.body);
        copy.copying.finish()
    };
    for (handle, function) in module.functions.iter() {
        out.functions[handle] = copy(function);
    }
    for (to, entry) in out.entry_points.iter_mut().zip(&module.entry_points) {
        to.function = copy(&entry.function);
    }
    program.with_module(out).ok()
}

/// The depth textures that are loaded from, and used in no other way than for their size.
fn loaded(module: &Module) -> BTreeSet<Handle<GlobalVariable>> {
    let is_depth = |g: Handle<GlobalVariable>| {
        let ty = module.global_variables[g].ty;
        let class = ImageClass::Depth { multi: false };
        let multi = ImageClass::Depth { multi: true };
        matches!(module.types[ty].inner, TypeInner::Image { class: c, .. } if c == class || c == multi)
    };
    let functions = module.functions.iter().map(|(_, f)| f);
    let functions = functions.chain(module.entry_points.iter().map(|e| &e.function));
    let (mut loaded, mut others) = (BTreeSet::new(), BTreeSet::new());
    for function in functions {
        let global = |e: Handle<Expression>| match function.expressions[e] {
            Expression::GlobalVariable(g) if is_depth(g) => Some(g),
            _ => None,
        };
        for (_, expression) in function.expressions.iter() {
            match expression {
                Expression::ImageLoad { image, .. } => loaded.extend(global(*image)),
                Expression::ImageQuery { .. } => {}
                other => {
                    let operands = naga_operands::of_expression(other);
                    others.extend(operands.into_iter().filter_map(global));
                }
            }
        }
        naga_operands::visit(&function.body, &mut |statement| {
            let operands = naga_operands::of_statement(statement);
            others.extend(operands.into_iter().filter_map(global));
        });
    }
    loaded.difference(&others).copied().collect()
}

/// The image type with floats in place of depths.
fn float(module: &mut Module, ty: Handle<Type>) -> Handle<Type> {
    let mut float = module.types[ty].clone();
    if let TypeInner::Image { class, .. } = &mut float.inner
        && let ImageClass::Depth { multi } = *class
    {
        let kind = ScalarKind::Float;
        *class = ImageClass::Sampled { kind, multi };
    }
    module.types.insert(float, naga::Span::UNDEFINED)
}

/// Takes the first component of each load from these textures.
struct FloatLoads<'a> {
    copying: Copying<'a>,
    loaded: &'a BTreeSet<Handle<GlobalVariable>>,
}

impl<'a> CopyFunction<'a> for FloatLoads<'a> {
    fn copying(&mut self) -> &mut Copying<'a> {
        &mut self.copying
    }

    fn expression(&mut self, e: Handle<Expression>) {
        let original = self.copying.original;
        let expression = &original.expressions[e];
        let copy = self.copying.copies.with_operands(expression);
        if let Expression::ImageLoad { image, .. } = expression
            && let Expression::GlobalVariable(g) = original.expressions[*image]
            && self.loaded.contains(&g)
        {
            let span = original.expressions.get_span(e);
            let base = self.copying.writer.append(copy, span);
            self.copying
                .append(e, Expression::AccessIndex { base, index: 0 });
        } else {
            self.copying.append(e, copy);
        }
    }
}
