//! A fragment stage that only counts: the material's coverage slice with the colour 1.
//!
//! Drawn with additive blending and the depth state of its pass, it gives the overdraw picture and
//! the number of shaded fragments per covered pixel on any adapter. Discarded fragments are not
//! counted; the rest hid each other.

use naga::{
    Binding, Block, BuiltIn, Expression, Handle, Literal, Module, ShaderStage, Span, Statement,
    VectorSize,
};
use naga_edit::interface;

use crate::analysis::coverage;
use crate::rebuild::color;
use crate::rebuild::place::{self, PositionInvariance};
use naga_edit::writer::FunctionWriter;
use preshade_dataflow::graph::Graph;
use preshade_plan::plan::{GpuPass, Plan};
use preshade_plan::program::Program;
use shader_text::source::Invalid;

/// Name of the counting entry point.
pub const ENTRY: &str = "preshade_count";

/// The program of `pass` with an entry point [`ENTRY`] whose only colour output, location 0, is (1,
/// 1, 1, 1), with the material's alpha if that decides coverage. It writes depth if the material
/// does.
///
/// # Errors
/// The slice does not validate: a bug.
pub fn program(plan: &Plan, pass: &GpuPass) -> Result<Program, Box<Invalid>> {
    let missing = |what: &str| invalid(format!("the plan has no {what}"));
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
        None => module.entry_points.push(color::empty_fragment(ENTRY)),
    }
    add_color(&mut module);
    alone(program, &module, pass)
}

/// The program of `pass` with an entry point [`ENTRY`] that covers the same pixels and is as cheap as that allows: all its
/// colours are 0. If something decides coverage, only location 0 is written, as by [`program`].
///
/// # Errors
/// As [`program`]. The material writes depth or the sample mask, or has no fragment stage.
pub fn blank(plan: &Plan, pass: &GpuPass) -> Result<Program, Box<Invalid>> {
    let authored = plan.program(pass).zip(pass.fragment.as_deref());
    let authored =
        authored.and_then(|(p, name)| Some((p, p.entry_point(ShaderStage::Fragment, name)?.1)));
    let (author, entry) =
        authored.ok_or_else(|| invalid("the plan has no fragment stage".to_owned()))?;
    let coverage = [BuiltIn::FragDepth, BuiltIn::SampleMask].map(|b| Some(Binding::BuiltIn(b)));
    let outputs = interface::outputs(author.module(), &entry.function);
    if outputs.iter().any(|o| coverage.contains(&o.binding)) {
        let why = "the material writes depth or the sample mask";
        return Err(invalid(why.to_owned()));
    }
    if decides(author, pass) {
        return program(plan, pass);
    }
    let mut module = author.module().clone();
    let mut blank = color::empty_fragment(ENTRY);
    if let Some(result) = &entry.function.result {
        let zero = blank
            .function
            .expressions
            .append(Expression::ZeroValue(result.ty), Span::UNDEFINED);
        blank.function.result = Some(result.clone());
        blank.function.body = Block::from_vec(vec![Statement::Return { value: Some(zero) }]);
    }
    module.entry_points.push(blank);
    alone(author, &module, pass)
}

/// The program of `pass` with an entry point [`ENTRY`] that computes and writes nothing. It has no
/// code that decides coverage, so it is for frames in which no fragment passes the depth test.
///
/// # Errors
/// As [`program`].
pub fn nothing(plan: &Plan, pass: &GpuPass) -> Result<Program, Box<Invalid>> {
    let author = plan
        .program(pass)
        .ok_or_else(|| invalid("the plan has no program of that name".to_owned()))?;
    let mut module = author.module().clone();
    module.entry_points.push(color::empty_fragment(ENTRY));
    alone(author, &module, pass)
}

/// The vertex stage of `pass` and [`ENTRY`], without unused items.
fn alone(author: &Program, module: &Module, pass: &GpuPass) -> Result<Program, Box<Invalid>> {
    let kept = [
        (ShaderStage::Vertex, pass.vertex.as_str()),
        (ShaderStage::Fragment, ENTRY),
    ];
    author.with_module(place::retain(module, &kept))
}

fn invalid(message: String) -> Box<Invalid> {
    Box::new(Invalid {
        message,
        labels: Vec::new(),
    })
}

/// Whether a discard, a depth or an alpha decides the coverage of a pass.
pub fn decides(program: &Program, pass: &GpuPass) -> bool {
    let graph = Graph::build(program);
    coverage::of_pass(&graph, program, pass).is_some_and(|(_, d)| d.anything())
}

/// The position of a coverage decision in the result.
#[derive(Clone, Copy)]
enum ResultPart {
    Whole,
    Member(u32),
}

impl ResultPart {
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
/// its returned alpha, in addition to its depth.
fn add_color(module: &mut Module) {
    let Some(index) = module.entry_points.len().checked_sub(1) else {
        return;
    };
    let entry = &module.entry_points[index];
    let outputs = interface::outputs(module, &entry.function);
    let bare = entry
        .function
        .result
        .as_ref()
        .is_some_and(|r| r.binding.is_some());
    let part = |wanted: &dyn Fn(&Binding) -> bool| {
        let found = |o: &interface::Io| o.binding.as_ref().is_some_and(wanted);
        (0..).zip(&outputs).find(|(_, o)| found(o)).map(|(i, o)| {
            let part = if bare {
                ResultPart::Whole
            } else {
                ResultPart::Member(i)
            };
            (part, o.ty)
        })
    };
    let alpha = part(&|b| matches!(b, Binding::Location { location: 0, .. }));
    let depth = part(&|b| *b == Binding::BuiltIn(BuiltIn::FragDepth));
    let names = ["Counted", "color"];
    let depth_type = depth.map(|(_, ty)| ty);
    color::return_color(
        module,
        index,
        names,
        depth_type,
        &mut |writer, vec4, returned| {
            let one = writer.expression(Expression::Literal(Literal::F32(1.0)));
            let color = match (alpha, returned) {
                (Some((part, _)), Some(returned)) => {
                    let base = part.of(writer, returned);
                    let index = coverage::ALPHA;
                    let alpha = writer.expression(Expression::AccessIndex { base, index });
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
            let depth = depth
                .zip(returned)
                .map(|((part, _), value)| part.of(writer, value));
            Some((color, depth))
        },
    );
}
