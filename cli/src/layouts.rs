//! Parameters whose value is the content of a file.

use std::fs;

use preshade::unstable::recipe::Recipe;
use serde_json::Value;

use crate::Failure;

/// Puts the declarations of `layout` files in place of their names. The text becomes one line,
/// because generated files quote their recipe in a comment.
///
/// # Errors
/// A file cannot be read.
pub fn read(recipe: &mut Recipe) -> Result<(), Failure> {
    let layouts = recipe
        .steps
        .iter_mut()
        .filter(|step| step.pass == "outputs")
        .filter_map(|step| step.params.get_mut("layout"));
    for layout in layouts {
        let Value::String(file) = &*layout else {
            continue;
        };
        let text = fs::read_to_string(file)
            .map_err(|e| Failure(format!("error: the layout `{file}` cannot be read: {e}")))?;
        let lines = text.lines().map(|line| line.split("//").next());
        let words = lines.flatten().flat_map(str::split_whitespace);
        *layout = Value::String(words.collect::<Vec<_>>().join(" "));
    }
    Ok(())
}
