//! Guards taken away. Nothing is widened: what is mutated is drawn and held to the contract of what
//! it was made from.

use naga::{
    BinaryOperator, Binding, BuiltIn, Expression, Handle, Literal, Module, Scalar, ScalarKind,
    ShaderStage, Span, Type, TypeInner, VectorSize,
};
use naga_edit::returns;
use naga_edit::writer::FunctionWriter;
use preshade_compiler::recipe::Recipe;
use preshade_compiler::{emit, front};
use preshade_draw::render::Variant as Host;
use preshade_lab::measure;
use preshade_lab::measure::verdict::breaks;
use preshade_plan::contract::Contract;
use preshade_plan::pass::Facts;
use preshade_plan::plan::{Plan, Role};
use preshade_plan::plan_file::Target;
use preshade_scenes::ShaderForm;
use shader_text::options;

use super::case::{Red, Stage, contract};
use super::root;

/// How a guard is taken away.
pub enum Mutation {
    /// The plans of a recipe, changed.
    Plans(&'static str, fn(&mut [Plan])),
    /// The texts that are emitted for a recipe, with every `from` made a `to`.
    Text(&'static str, &'static [(&'static str, &'static str)]),
    /// The same beside edits of the author's own lines, which say what a driver might do: with them
    /// alone all holds.
    Driver {
        recipe: &'static str,
        does: &'static [(&'static str, &'static str)],
        edits: &'static [(&'static str, &'static str)],
    },
    /// What the guard refuses: a recipe with its parameter for it off, held to the contract of one
    /// with it on.
    Recipe(&'static str, &'static str),
    /// A recipe that is told of no ties.
    Untied(&'static str),
    /// What the guard refuses, written by hand: the scene's only material drawn with another
    /// shader, held to a contract.
    Shader(&'static str, fn() -> Contract),
    /// A recipe that shades more than so many fragments a pixel.
    Shades(&'static str, f64),
    /// Something of its own.
    Own(fn(&Stage<'_>) -> Red),
}

/// What a mutation is made of.
pub enum Plain {
    /// The original, or what was made by hand.
    Original,
    /// Nothing: every material refuses it here.
    Refused,
    /// What promises that.
    Drawn(Box<Host>, Contract),
}

impl Mutation {
    /// What of it can be said in words.
    pub fn words(&self) -> String {
        match self {
            Self::Plans(recipe, _) => format!("plans {recipe:?}"),
            Self::Text(recipe, edits) => format!("text {recipe:?} {edits:?}"),
            Self::Driver {
                recipe,
                does,
                edits,
            } => format!("driver {recipe:?} {does:?} {edits:?}"),
            Self::Recipe(without, with) => format!("recipe {without:?} {with:?}"),
            Self::Untied(recipe) => format!("untied {recipe:?}"),
            Self::Shader(file, _) => format!("shader {file:?}"),
            Self::Shades(recipe, most) => format!("shades {recipe:?} {most}"),
            Self::Own(_) => "own".to_owned(),
        }
    }

    /// What is mutated, as it is.
    pub fn plain(&self, stage: &Stage<'_>) -> Plain {
        let recipe = match self {
            Self::Plans(recipe, _) | Self::Text(recipe, _) | Self::Recipe(_, recipe) => *recipe,
            Self::Driver { recipe, .. } => *recipe,
            Self::Untied(_) | Self::Shader(..) | Self::Shades(..) | Self::Own(_) => "",
        };
        if recipe.is_empty() {
            return Plain::Original;
        }
        let variant = stage.chosen(recipe);
        match variant.is_refused() {
            true if !matches!(self, Self::Recipe(..)) => Plain::Refused,
            _ => {
                let contract = contract(&variant.plans);
                let host = match self {
                    Self::Driver { recipe, does, .. } => edited(recipe, &variant.plans, does),
                    _ => preshade_scenes::variant(&variant.plans, ShaderForm::Text).unwrap(),
                };
                Plain::Drawn(Box::new(host), contract)
            }
        }
    }

    /// Whether the judge sees what the guard is for.
    pub fn red(&self, stage: &Stage<'_>) -> Red {
        let applied = |recipe: &str| stage.chosen(recipe).plans;
        match self {
            Self::Plans(recipe, change) => {
                let mut plans = applied(recipe);
                let contract = contract(&plans);
                change(&mut plans);
                judged(stage, &plans, &contract)
            }
            Self::Text(recipe, edits) => {
                let plans = applied(recipe);
                seen(stage, &edited(recipe, &plans, edits), &contract(&plans))
            }
            Self::Driver {
                recipe,
                does,
                edits,
            } => {
                let plans = applied(recipe);
                let all = [*does, *edits].concat();
                seen(stage, &edited(recipe, &plans, &all), &contract(&plans))
            }
            Self::Recipe(without, with) => {
                let contract = match *with {
                    "" => Contract::exact(),
                    with => contract(&applied(with)),
                };
                // As asked for: nothing is chosen by measurement, which is a guard as well.
                let recipe = Recipe::parse_list(without).unwrap();
                let plans = measure::variant(&stage.originals, &recipe, &Facts::default()).plans;
                judged(stage, &plans, &contract)
            }
            Self::Untied(recipe) => {
                let recipe = Recipe::parse_list(recipe).unwrap();
                let facts = Facts::without_ties();
                let plans = measure::variant(&stage.originals, &recipe, &facts).plans;
                judged(stage, &plans, &contract(&plans))
            }
            Self::Shader(file, contract) => judged(stage, &[naive(stage, file)], &contract()),
            Self::Shades(recipe, most) => {
                let shaded = stage.shaded(&applied(recipe));
                match shaded > *most {
                    true => Red::Seen {
                        how: format!("{shaded:.2} fragments a pixel"),
                    },
                    false => Red::Unseen,
                }
            }
            Self::Own(red) => red(stage),
        }
    }
}

/// Whether `plans` break a contract.
pub fn judged(stage: &Stage<'_>, plans: &[Plan], contract: &Contract) -> Red {
    seen(
        stage,
        &preshade_scenes::variant(plans, ShaderForm::Text).unwrap(),
        contract,
    )
}

/// The texts of `plans` with every `from` made a `to`.
pub fn edited(recipe: &str, plans: &[Plan], edits: &[(&str, &str)]) -> Host {
    let mut used = vec![false; edits.len()];
    let files = plans.iter().map(|plan| {
        let mut files = emit::emit(plan, &[Target::Wgsl], &emit::Options::default()).unwrap();
        for file in files.iter_mut().filter(|f| f.name.ends_with(".wgsl")) {
            let mut text = String::from_utf8(file.bytes.clone()).unwrap();
            for ((from, to), used) in edits.iter().zip(&mut used) {
                *used |= text.contains(from);
                text = text.replace(from, to);
            }
            file.bytes = text.into_bytes();
        }
        files
    });
    let files: Vec<_> = files.collect();
    assert!(
        used.iter().all(|u| *u),
        "{recipe}: no longer in the text: {used:?}"
    );
    preshade_scenes::from_files(&files).unwrap()
}

pub fn seen(stage: &Stage<'_>, host: &Host, contract: &Contract) -> Red {
    // What cannot be drawn shows nothing of a picture.
    let error = stage.compare(host).unwrap_or_else(|e| panic!("{e}"));
    match breaks(contract, &error) {
        Some(how) => Red::Seen { how },
        None => Red::Unseen,
    }
}

/// The scene's material with another shader, under its state.
fn naive(stage: &Stage<'_>, file: &str) -> Plan {
    let path = root().join("fixtures/scenes/stability").join(file);
    let text = std::fs::read_to_string(path).unwrap();
    let source = front::Source::new(file, text);
    let parsed = front::parse(&[source], &options::Options::default())
        .unwrap_or_else(|e| panic!("{}", e.render(shader_text::error::Color::Never)));
    let [material] = &stage.inputs.scene().materials[..] else {
        panic!("one material has one shader");
    };
    let fragment = parsed.fragment.as_deref();
    Plan::original(
        &material.name,
        parsed.program,
        &parsed.vertex,
        fragment,
        &material.state,
    )
}

/// What a driver does that compiles one vertex stage in two ways: the position of every pass of
/// `role`, moved.
#[derive(Clone, Copy)]
pub enum Moved {
    /// z by so many neighbouring floats, away from 0.
    Depth(i32),
    /// y by so many pixels of 96 rows.
    Up(f32),
}

/// Moves the position of every pass of `role`, in plans that have several passes.
pub fn moved(plans: &mut [Plan], role: Role, by: Moved) {
    for plan in plans.iter_mut().filter(|p| p.passes.len() > 1) {
        let pass = plan.passes.iter().find(|p| p.role == role).unwrap();
        let program = plan.program(pass).unwrap();
        let mut module = program.module().clone();
        let entry = program.entry_point(ShaderStage::Vertex, &pass.vertex);
        move_entry(&mut module, entry.unwrap().0, by);
        let moved = program.with_module(module).unwrap();
        plan.programs.insert("moved".to_owned(), moved);
        for pass in plan.passes.iter_mut().filter(|p| p.role == role) {
            pass.program = "moved".to_owned();
        }
    }
}

fn move_entry(module: &mut Module, entry: usize, by: Moved) {
    let inner = TypeInner::Vector {
        size: VectorSize::Quad,
        scalar: Scalar::F32,
    };
    let vector = module
        .types
        .insert(Type { name: None, inner }, Span::UNDEFINED);
    let function = &mut module.entry_points[entry].function;
    let result = function.result.clone().unwrap();
    let members = match &module.types[result.ty].inner {
        TypeInner::Struct { members, .. } => Some(members.clone()),
        _ => None,
    };
    let mut moved = 0;
    returns::rewrite(function, &mut |writer, value| {
        let value = value?;
        let mut of_position = |writer: &mut FunctionWriter, base| {
            moved += 1;
            let mut components: Vec<_> = (0..4)
                .map(|index| writer.expression(Expression::AccessIndex { base, index }))
                .collect();
            match by {
                Moved::Depth(steps) => components[2] = stepped(writer, components[2], steps),
                Moved::Up(pixels) => {
                    let by = Literal::F32(2.0 * pixels / 96.0);
                    let by = writer.expression(Expression::Literal(by));
                    let w = components[3];
                    let shift = binary(writer, BinaryOperator::Multiply, w, by);
                    components[1] = binary(writer, BinaryOperator::Add, components[1], shift);
                }
            }
            writer.expression(Expression::Compose {
                ty: vector,
                components,
            })
        };
        let Some(members) = &members else {
            return Some(of_position(writer, value));
        };
        let mut components = Vec::new();
        for (index, member) in (0..).zip(members) {
            let part = writer.expression(Expression::AccessIndex { base: value, index });
            let is_position = matches!(
                member.binding,
                Some(Binding::BuiltIn(BuiltIn::Position { .. }))
            );
            components.push(match is_position {
                true => of_position(writer, part),
                false => part,
            });
        }
        Some(writer.expression(Expression::Compose {
            ty: result.ty,
            components,
        }))
    });
    assert!(moved > 0);
}

fn binary(
    writer: &mut FunctionWriter,
    op: BinaryOperator,
    left: Handle<Expression>,
    right: Handle<Expression>,
) -> Handle<Expression> {
    writer.expression(Expression::Binary { op, left, right })
}

/// A float as far from 0 as so many neighbours on.
fn stepped(
    writer: &mut FunctionWriter,
    expr: Handle<Expression>,
    steps: i32,
) -> Handle<Expression> {
    let as_kind = |writer: &mut FunctionWriter, expr, kind| {
        writer.expression(Expression::As {
            expr,
            kind,
            convert: None,
        })
    };
    let bits = as_kind(writer, expr, ScalarKind::Sint);
    let by = writer.expression(Expression::Literal(Literal::I32(steps)));
    let sum = binary(writer, BinaryOperator::Add, bits, by);
    as_kind(writer, sum, ScalarKind::Float)
}
