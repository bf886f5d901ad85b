//! Functions that receive textures, written once for each texture: a compute stage has numbers for
//! variables alone.

use std::collections::BTreeMap;

use naga::{AddressSpace, Arena, Expression, Function, GlobalVariable, Handle, Module, Statement};

/// The variable that a call passes for each argument, if it is a texture or a sampler.
type PassedTextures = Vec<Option<Handle<GlobalVariable>>>;

/// Functions that a module may have in the end.
const MOST_FUNCTIONS: usize = 4096;

struct Settling<'m> {
    old: &'m Module,
    functions: Arena<Function>,
    known: BTreeMap<(Handle<Function>, PassedTextures), Handle<Function>>,
}

/// The module with functions that read their callers' textures and samplers as variables.
///
/// # Errors
///
/// There are too many combinations.
pub(crate) fn settled(module: &Module) -> Result<Module, String> {
    let mut settling = Settling {
        old: module,
        functions: Arena::new(),
        known: BTreeMap::new(),
    };
    let mut made = module.clone();
    for entry in &mut made.entry_points {
        entry.function = settling.function(&entry.function, &Vec::new())?;
    }
    made.functions = settling.functions;
    Ok(made)
}

impl Settling<'_> {
    fn function(&mut self, old: &Function, given: &PassedTextures) -> Result<Function, String> {
        let mut new = old.clone();
        let variable = |i: usize| given.get(i).copied().flatten();
        let mut index = 0..;
        new.arguments
            .retain(|_| index.next().is_none_or(|i| variable(i).is_none()));
        for (_, expression) in new.expressions.iter_mut() {
            if let Expression::FunctionArgument(i) = expression {
                let before = given.iter().take(*i as usize).flatten().count();
                match variable(*i as usize) {
                    Some(global) => *expression = Expression::GlobalVariable(global),
                    None => *i -= before as u32,
                }
            }
        }
        let expressions = &mut new.expressions;
        let mut result = Ok(());
        naga_operands::visit_mut(&mut new.body, &mut |statement| {
            let Statement::Call {
                function,
                arguments,
                result: value,
            } = statement
            else {
                return;
            };
            let resource = |argument: &Handle<Expression>| match expressions[*argument] {
                Expression::GlobalVariable(global)
                    if self.old.global_variables[global].space == AddressSpace::Handle =>
                {
                    Some(global)
                }
                _ => None,
            };
            let given: PassedTextures = arguments.iter().map(resource).collect();
            let mut each = given.iter();
            arguments.retain(|_| each.next().is_none_or(Option::is_none));
            match self.called(*function, given) {
                Ok(called) => *function = called,
                Err(why) => result = Err(why),
            }
            if let Some(value) = value {
                expressions[*value] = Expression::CallResult(*function);
            }
        });
        result.map(|()| new)
    }

    fn called(
        &mut self,
        function: Handle<Function>,
        given: PassedTextures,
    ) -> Result<Handle<Function>, String> {
        let key = (function, given);
        if let Some(known) = self.known.get(&key) {
            return Ok(*known);
        }
        let made = self.function(&self.old.functions[function], &key.1)?;
        if self.functions.len() == MOST_FUNCTIONS {
            return Err("it passes too many combinations of textures to functions".to_owned());
        }
        let span = self.old.functions.get_span(function);
        let made = self.functions.append(made, span);
        self.known.insert(key, made);
        Ok(made)
    }
}
