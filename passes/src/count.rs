//! A fragment stage that only counts: what the material's would keep, drawn as the constant 1.
//!
//! Drawn with additive blending and the depth state of the pass it stands for, it makes the overdraw picture and the number of shaded fragments per
//! covered pixel on any adapter. Fragments that the material discards are not counted: what is left is what hid each other.

use naga::{
    Binding, BuiltIn, EntryPoint, Expression, Function, FunctionResult, Literal, Module, Scalar,
    ShaderStage, Span, StructMember, Type, TypeInner, VectorSize,
};

use crate::graph::Graph;
use crate::place::{self, PositionInvariance};
use crate::plan::{GpuPass, Plan};
use crate::program::{Invalid, Program};
use crate::reflect;
use crate::returns;
use crate::slice::{self, Criterion, OutputFilter};

/// Name of the counting entry point.
pub const ENTRY: &str = "preshade_count";

/// The program of `pass` with an entry point [`ENTRY`] whose one colour output, location 0, is (1, 1, 1, 1). Depth is written where the material writes it.
///
/// # Errors
/// A slice of ours that does not validate: a bug.
pub fn program(plan: &Plan, pass: &GpuPass) -> Result<Program, Box<Invalid>> {
    let missing = |what: &str| {
        Box::new(Invalid {
            message: format!("the plan has no {what}"),
            labels: Vec::new(),
        })
    };
    let program = plan
        .program(pass)
        .ok_or_else(|| missing("program of that name"))?;
    let fragment = match &pass.fragment {
        None => None,
        Some(name) => Some(
            program
                .entry_point(ShaderStage::Fragment, name)
                .ok_or_else(|| missing("fragment entry point of that name"))?
                .0,
        ),
    };
    let mut module = program.module().clone();
    let decides = fragment.is_some_and(|f| {
        program.info().get_entry_point(f).may_kill
            || reflect::outputs(program.module(), &program.module().entry_points[f].function)
                .iter()
                .any(|o| o.binding == Some(Binding::BuiltIn(BuiltIn::FragDepth)))
    });
    match fragment.filter(|_| decides) {
        Some(entry) => {
            let graph = Graph::build(program);
            let slice = slice::backward(
                &graph,
                entry,
                &[
                    Criterion::Discard,
                    Criterion::Output(OutputFilter::FragDepth),
                ],
            );
            module = place::entry_point(
                &graph,
                &slice,
                &module,
                ENTRY,
                "count",
                PositionInvariance::AsWritten,
            );
        }
        None => module.entry_points.push(EntryPoint {
            name: ENTRY.to_owned(),
            stage: ShaderStage::Fragment,
            early_depth_test: None,
            workgroup_size: [0; 3],
            workgroup_size_overrides: None,
            function: Function::default(),
            mesh_info: None,
            task_payload: None,
            incoming_ray_payload: None,
        }),
    }
    add_color(&mut module);
    let kept = [
        (ShaderStage::Vertex, pass.vertex.as_str()),
        (ShaderStage::Fragment, ENTRY),
    ];
    program.with_module(place::retain(&module, &kept))
}

/// Makes the last entry point of `module` return the colour (1, 1, 1, 1) beside the depth it may return.
fn add_color(module: &mut Module) {
    let vec4 = module.types.insert(
        Type {
            name: None,
            inner: TypeInner::Vector {
                size: VectorSize::Quad,
                scalar: Scalar::F32,
            },
        },
        Span::UNDEFINED,
    );
    let color = Binding::Location {
        location: 0,
        interpolation: None,
        sampling: None,
        blend_src: None,
        per_primitive: false,
    };
    let Some(depth) = module
        .entry_points
        .last()
        .map(|e| e.function.result.clone())
    else {
        return;
    };
    let with_depth = depth.map(|depth| {
        let member = |name: &str, ty, binding, offset| StructMember {
            name: Some(name.to_owned()),
            ty,
            binding: Some(binding),
            offset,
        };
        let members = vec![
            member("color", vec4, color.clone(), 0),
            member("depth", depth.ty, Binding::BuiltIn(BuiltIn::FragDepth), 16),
        ];
        module.types.insert(
            Type {
                name: Some("Counted".to_owned()),
                inner: TypeInner::Struct { members, span: 32 },
            },
            Span::UNDEFINED,
        )
    });
    let Some(entry) = module.entry_points.last_mut() else {
        return;
    };
    entry.function.result = Some(match with_depth {
        Some(ty) => FunctionResult { ty, binding: None },
        None => FunctionResult {
            ty: vec4,
            binding: Some(color),
        },
    });
    returns::rewrite(&mut entry.function, &mut |emitter, depth| {
        let one = emitter.constant(Expression::Literal(Literal::F32(1.0)));
        let color = emitter.emit(Expression::Splat {
            size: VectorSize::Quad,
            value: one,
        });
        Some(match (with_depth, depth) {
            (Some(ty), Some(depth)) => emitter.emit(Expression::Compose {
                ty,
                components: vec![color, depth],
            }),
            _ => color,
        })
    });
}
