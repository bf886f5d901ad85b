//! A fragment stage that only counts: the material's coverage slice with the colour 1.
//!
//! Drawn with additive blending and the depth state of its pass, it gives the overdraw picture and
//! the number of shaded fragments per covered pixel on any adapter. Discarded fragments are not
//! counted; the rest hid each other.

use naga::{
    Binding, BuiltIn, EntryPoint, Expression, Function, FunctionResult, Handle, Literal, Module,
    Scalar, ShaderStage, Span, StructMember, Type, TypeInner, VectorSize,
};

use crate::analysis::coverage;
use crate::core::plan::{GpuPass, Plan};
use crate::core::program::{Invalid, Program};
use crate::core::reflect;
use crate::graph::Graph;
use crate::rebuild::place::{self, PositionInvariance};
use crate::rebuild::returns;
use crate::rebuild::writer::FunctionWriter;

/// Name of the counting entry point.
pub const ENTRY: &str = "preshade_count";

/// The program of `pass` with an entry point [`ENTRY`] whose only colour output, location 0, is (1,
/// 1, 1, 1), with the material's alpha if that decides coverage. It writes depth if the material
/// does.
///
/// # Errors
/// The slice does not validate: a bug.
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
    if let Some(name) = &pass.fragment {
        program
            .entry_point(ShaderStage::Fragment, name)
            .ok_or_else(|| missing("fragment entry point of that name"))?;
    }
    let mut module = program.module().clone();
    let graph = Graph::build(program);
    let decided = coverage::of_pass(&graph, program, pass).filter(|(_, d)| d.anything());
    match decided {
        Some((entry, decides)) => {
            module = place::entry_point(
                &graph,
                &decides.slice(&graph, entry),
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

/// The position of a coverage decision in the result.
#[derive(Clone, Copy)]
enum Part {
    /// It is the whole result.
    Whole,
    /// It is this member.
    Member(u32),
}

impl Part {
    fn of(self, writer: &mut FunctionWriter, value: Handle<Expression>) -> Handle<Expression> {
        match self {
            Self::Whole => value,
            Self::Member(index) => {
                writer.expression(Expression::AccessIndex { base: value, index })
            }
        }
    }
}

/// Makes the last entry point of `module` return the colour (1, 1, 1, 1), or (1, 1, 1, alpha) with
/// its returned alpha, beside its depth.
fn add_color(module: &mut Module) {
    let Some(entry) = module.entry_points.last() else {
        return;
    };
    let outputs = reflect::outputs(module, &entry.function);
    let bare = entry
        .function
        .result
        .as_ref()
        .is_some_and(|r| r.binding.is_some());
    let part = |wanted: &dyn Fn(&Binding) -> bool| {
        let found = |o: &reflect::Io| o.binding.as_ref().is_some_and(wanted);
        (0..).zip(&outputs).find(|(_, o)| found(o)).map(|(i, o)| {
            let part = if bare { Part::Whole } else { Part::Member(i) };
            (part, o.ty)
        })
    };
    let alpha = part(&|b| matches!(b, Binding::Location { location: 0, .. }));
    let depth = part(&|b| *b == Binding::BuiltIn(BuiltIn::FragDepth));
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
    let with_depth = depth.map(|(part, ty)| {
        let member = |name: &str, ty, binding, offset| StructMember {
            name: Some(name.to_owned()),
            ty,
            binding: Some(binding),
            offset,
        };
        let members = vec![
            member("color", vec4, color.clone(), 0),
            member("depth", ty, Binding::BuiltIn(BuiltIn::FragDepth), 16),
        ];
        let counted = Type {
            name: Some("Counted".to_owned()),
            inner: TypeInner::Struct { members, span: 32 },
        };
        (part, module.types.insert(counted, Span::UNDEFINED))
    });
    let Some(entry) = module.entry_points.last_mut() else {
        return;
    };
    entry.function.result = Some(match with_depth {
        Some((_, ty)) => FunctionResult { ty, binding: None },
        None => FunctionResult {
            ty: vec4,
            binding: Some(color),
        },
    });
    returns::rewrite(&mut entry.function, &mut |writer, returned| {
        let one = writer.expression(Expression::Literal(Literal::F32(1.0)));
        let color = match (alpha, returned) {
            (Some((part, _)), Some(returned)) => {
                let base = part.of(writer, returned);
                let alpha = writer.expression(Expression::AccessIndex {
                    base,
                    index: coverage::ALPHA,
                });
                writer.expression(Expression::Compose {
                    ty: vec4,
                    components: vec![one, one, one, alpha],
                })
            }
            _ => writer.expression(Expression::Splat {
                size: VectorSize::Quad,
                value: one,
            }),
        };
        Some(match (with_depth, returned) {
            (Some((part, ty)), Some(returned)) => {
                let depth = part.of(writer, returned);
                writer.expression(Expression::Compose {
                    ty,
                    components: vec![color, depth],
                })
            }
            _ => color,
        })
    });
}
