//! The author's names for values.

use crate::analysis::values::{Node, ValueId, Values};

/// Where a value is in the author's source.
pub(crate) fn span(values: &Values<'_, '_>, id: ValueId) -> Option<naga::Span> {
    let (context, e, _) = values.expression(id)?;
    Some(values.function(context).function.expressions.get_span(e))
}

/// The author's name for a value, or for the call that returns it.
pub(crate) fn name(values: &Values<'_, '_>, id: ValueId) -> Option<String> {
    let (context, e, _) = values.expression(id)?;
    let f = values.function(context).function;
    if let Some(name) = f.named_expressions.get(&e) {
        return Some(name.clone());
    }
    match f.expressions[e] {
        naga::Expression::AccessIndex { base, index } => {
            let vector = values.named(context, base)?;
            let letter = ["x", "y", "z", "w"].get(index as usize)?;
            Some(format!("{}_{letter}", own_name(values, vector)?))
        }
        naga::Expression::Swizzle {
            size,
            vector,
            pattern,
        } => {
            let vector = values.named(context, vector)?;
            let letters = pattern.iter().take(size as usize);
            let letters: String = letters
                .filter_map(|c| ["x", "y", "z", "w"].get(*c as usize).copied())
                .collect();
            Some(format!("{}_{letters}", own_name(values, vector)?))
        }
        naga::Expression::CallResult(callee) => {
            values.graph.module().functions[callee].name.clone()
        }
        naga::Expression::Load { pointer } => match f.expressions[pointer] {
            naga::Expression::LocalVariable(v) => f.local_variables[v].name.clone(),
            _ => None,
        },
        _ => None,
    }
}

/// The author's name for an input, or for a value.
fn own_name(values: &Values<'_, '_>, id: ValueId) -> Option<String> {
    match values.values[id].node {
        Node::Input(i) => values.inputs.get(i)?.name.clone(),
        _ => name(values, id),
    }
}

/// A suffix of letters: `a` to `z`, `aa` and so on. naga's writers append their own number to a
/// name that ends in a digit.
pub(crate) fn letters(index: usize) -> String {
    let last = char::from(b'a' + (index % 26) as u8);
    match index / 26 {
        0 => last.to_string(),
        rest => format!("{}{last}", letters(rest - 1)),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::letters;

    #[test]
    fn letters_differ() {
        let few = [0, 1, 25, 26, 51, 52, 701, 702].map(letters);
        assert_eq!(few, ["a", "b", "z", "aa", "az", "ba", "zz", "aaa"]);
        let all: BTreeSet<String> = (0..1000).map(letters).collect();
        assert_eq!(all.len(), 1000);
    }
}
