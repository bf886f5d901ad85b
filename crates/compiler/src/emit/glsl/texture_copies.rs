//! Copies a texture for each sampler it is used with, because GLSL combines one texture with one
//! sampler.

use std::collections::{BTreeMap, HashMap};

use naga::{
    Arena, Block, Expression, Function, GlobalVariable, Handle, Module, Range, ResourceBinding,
    Span, Statement,
};
use preshade_plan::program::Program;

/// A program with one sampler per texture.
pub(super) struct TextureCopies {
    pub program: Program,
    /// The original texture of each copy.
    pub of: HashMap<ResourceBinding, ResourceBinding>,
}

type TextureSampler = (Handle<GlobalVariable>, Handle<GlobalVariable>);

/// A texture with several samplers that cannot be split.
pub(super) struct Inseparable;

/// Splits textures that any stage uses with several samplers: one name is one uniform in all
/// stages. `None` if there are none. Textures passed to functions keep their sampler.
pub(super) fn split(program: &Program) -> Result<Option<TextureCopies>, Inseparable> {
    let module = program.module();
    let read_with = samplers(program);
    let mut out = module.clone();
    let mut twins: HashMap<TextureSampler, Handle<GlobalVariable>> = HashMap::new();
    let mut of = HashMap::new();
    for (image, sampler) in read_with.values().flat_map(|s| s.values().skip(1)) {
        let (texture, with) = (
            &module.global_variables[*image],
            &module.global_variables[*sampler],
        );
        let binding = texture.binding.ok_or(Inseparable)?;
        let own = free(&out, binding.group);
        let name = |g: &GlobalVariable| g.name.clone().unwrap_or_else(|| "unnamed".to_owned());
        let twin = GlobalVariable {
            name: Some(format!("{}_{}", name(texture), name(with))),
            binding: Some(own),
            ..texture.clone()
        };
        of.insert(own, binding);
        let span = module.global_variables.get_span(*image);
        twins.insert((*image, *sampler), out.global_variables.append(twin, span));
    }
    if twins.is_empty() {
        return Ok(None);
    }
    let functions = out.functions.iter_mut().map(|(_, f)| f);
    for function in functions.chain(out.entry_points.iter_mut().map(|e| &mut e.function)) {
        read_twins(function, &twins);
    }
    let program = program.with_module(out).map_err(|_| Inseparable)?;
    match samplers(&program).values().any(|all| all.len() > 1) {
        true => Err(Inseparable),
        false => Ok(Some(TextureCopies { program, of })),
    }
}

type BindingKey = (u32, u32);

/// The samplers of each texture in all stages.
fn samplers(program: &Program) -> BTreeMap<BindingKey, BTreeMap<BindingKey, TextureSampler>> {
    let module = program.module();
    let at = |handle: Handle<GlobalVariable>| {
        let binding = module.global_variables[handle].binding?;
        Some((binding.group, binding.binding))
    };
    let mut out: BTreeMap<BindingKey, BTreeMap<BindingKey, TextureSampler>> = BTreeMap::new();
    for index in 0..module.entry_points.len() {
        for key in &program.info().get_entry_point(index).sampling_set {
            if let (Some(image), Some(sampler)) = (at(key.image), at(key.sampler)) {
                let pair = (key.image, key.sampler);
                out.entry(image).or_default().insert(sampler, pair);
            }
        }
    }
    out
}

/// A free binding of the group.
fn free(module: &Module, group: u32) -> ResourceBinding {
    let bound = module
        .global_variables
        .iter()
        .filter_map(|(_, g)| g.binding);
    let last = bound.filter(|b| b.group == group).map(|b| b.binding).max();
    ResourceBinding {
        group,
        binding: last.map_or(0, |last| last + 1),
    }
}

/// Replaces the textures of samples in a function.
fn read_twins(function: &mut Function, twins: &HashMap<TextureSampler, Handle<GlobalVariable>>) {
    let global = |e: Handle<Expression>| match function.expressions[e] {
        Expression::GlobalVariable(global) => Some(global),
        _ => None,
    };
    let read: HashMap<Handle<Expression>, Handle<GlobalVariable>> = function
        .expressions
        .iter()
        .filter_map(|(handle, e)| match e {
            Expression::ImageSample { image, sampler, .. } => {
                let pair = (global(*image)?, global(*sampler)?);
                Some((handle, *twins.get(&pair)?))
            }
            _ => None,
        })
        .collect();
    if read.is_empty() {
        return;
    }
    let mut expressions = Arena::new();
    let mut own = HashMap::new();
    let mut new: HashMap<Handle<Expression>, Handle<Expression>> = HashMap::new();
    let mut needed: Vec<_> = read.values().copied().collect();
    needed.sort();
    needed.dedup();
    for twin in needed {
        let handle = expressions.append(Expression::GlobalVariable(twin), Span::UNDEFINED);
        own.insert(twin, handle);
    }
    for (handle, expression) in function.expressions.iter() {
        let mut expression = expression.clone();
        naga_operands::map_expression(&mut expression, &mut |e| {
            *e = new.get(e).copied().unwrap_or(*e)
        });
        if let (Expression::ImageSample { image, .. }, Some(twin)) =
            (&mut expression, read.get(&handle))
        {
            *image = own.get(twin).copied().unwrap_or(*image);
        }
        let span = function.expressions.get_span(handle);
        new.insert(handle, expressions.append(expression, span));
    }
    let moved = |e: Handle<Expression>| new.get(&e).copied().unwrap_or(e);
    for (_, local) in function.local_variables.iter_mut() {
        local.init = local.init.map(moved);
    }
    function.named_expressions = function
        .named_expressions
        .iter()
        .map(|(e, name)| (moved(*e), name.clone()))
        .collect();
    move_block(&mut function.body, &moved);
    function.expressions = expressions;
}

fn move_block(block: &mut Block, moved: &impl Fn(Handle<Expression>) -> Handle<Expression>) {
    for statement in block.iter_mut() {
        if let Statement::Emit(range) = statement
            && let Some((first, last)) = range.first_and_last()
        {
            *range = Range::new_from_bounds(moved(first), moved(last));
        }
        naga_operands::map_statement_and_result(statement, &mut |e| *e = moved(*e));
        for inner in naga_operands::blocks_mut(statement) {
            move_block(inner, moved);
        }
    }
}
