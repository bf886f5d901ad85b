//! Which textures and samplers are used together.

use std::collections::BTreeMap;

use naga::{Expression, Function, GlobalVariable, Handle, Module, Statement};

/// A texture or sampler in a function.
#[derive(Clone, Copy)]
enum Resource {
    Variable(Handle<GlobalVariable>),
    Argument(u32),
}

type Pair = (Resource, Resource);

/// The pairs of variables that are used together, also in functions that get them as arguments.
pub(super) fn sampled(module: &Module) -> Vec<(Handle<GlobalVariable>, Handle<GlobalVariable>)> {
    // A function stands after those that it calls.
    let mut known: BTreeMap<Handle<Function>, Vec<Pair>> = BTreeMap::new();
    for (handle, function) in module.functions.iter() {
        let pairs = of_function(function, &known);
        known.insert(handle, pairs);
    }
    let entries = module.entry_points.iter();
    let of_entries = entries.flat_map(|entry| of_function(&entry.function, &known));
    let all = of_entries.chain(known.values().flatten().copied());
    all.filter_map(|pair| match pair {
        (Resource::Variable(texture), Resource::Variable(sampler)) => Some((texture, sampler)),
        _ => None,
    })
    .collect()
}

fn of_function(function: &Function, known: &BTreeMap<Handle<Function>, Vec<Pair>>) -> Vec<Pair> {
    let resource = |e: Handle<Expression>| match function.expressions[e] {
        Expression::GlobalVariable(variable) => Some(Resource::Variable(variable)),
        Expression::FunctionArgument(index) => Some(Resource::Argument(index)),
        _ => None,
    };
    let mut pairs: Vec<Pair> = function
        .expressions
        .iter()
        .filter_map(|(_, e)| match e {
            Expression::ImageSample { image, sampler, .. } => {
                Some((resource(*image)?, resource(*sampler)?))
            }
            _ => None,
        })
        .collect();
    naga_operands::visit(&function.body, &mut |statement| {
        let Statement::Call {
            function: called,
            arguments,
            ..
        } = statement
        else {
            return;
        };
        let given = |r: Resource| match r {
            Resource::Variable(_) => Some(r),
            Resource::Argument(index) => resource(*arguments.get(index as usize)?),
        };
        let inner = known.get(called).into_iter().flatten();
        pairs.extend(inner.filter_map(|(t, s)| Some((given(*t)?, given(*s)?))));
    });
    pairs
}
