//! Refuses numbers that no camera, place or shape can have. A shader's own `values` may be any
//! number.

use std::ops::Range;

use toml::de::{DeTable, DeValue};

use preshade_draw::scene::SceneError;

/// Keys that are lengths in scene units and must be above 0.
const LENGTHS: [&str; 8] = [
    "depth",
    "height",
    "radius",
    "rise",
    "run",
    "size",
    "thickness",
    "width",
];

/// Keys that count parts of a shape.
const COUNTS: [&str; 5] = ["count", "joints", "rings", "segments", "steps"];

/// Whether the table at this path belongs to a shader, a preprocessor or a sweep. The scene does
/// not restrict those numbers.
fn is_their_own(path: &[&str]) -> bool {
    matches!(
        path,
        ["variables"] | ["materials", _, "values" | "defines"] | ["draws", "values"]
    )
}

/// Fails at the first number that is NaN, infinite, or too large for 32 bits (`far` may be
/// infinite), at a length of 0 or less, and at a shape with 0 parts. `text` has already been parsed
/// as a scene.
///
/// # Errors
/// The number and its range in the text.
pub fn check(text: &str) -> Result<(), (SceneError, Range<usize>)> {
    match DeTable::parse(text) {
        Ok(table) => in_table(table.get_ref(), &mut Vec::new()),
        // The parser has already reported this.
        Err(_) => Ok(()),
    }
}

type Checked = Result<(), (SceneError, Range<usize>)>;

fn in_table<'a>(table: &'a DeTable<'_>, path: &mut Vec<&'a str>) -> Checked {
    for (key, value) in table {
        let key: &str = key.get_ref();
        path.push(key);
        if !is_their_own(path) {
            in_value(value.get_ref(), value.span(), path)?;
        }
        path.pop();
    }
    Ok(())
}

fn in_value<'a>(value: &'a DeValue<'_>, at: Range<usize>, path: &mut Vec<&'a str>) -> Checked {
    let number = match value {
        DeValue::Table(table) => return in_table(table, path),
        DeValue::Array(values) => {
            return values
                .iter()
                .try_for_each(|v| in_value(v.get_ref(), v.span(), path));
        }
        DeValue::Float(f) => f.as_str().replace('_', "").parse::<f64>().ok(),
        DeValue::Integer(i) => {
            let digits = i.as_str().replace('_', "");
            i64::from_str_radix(&digits, i.radix())
                .ok()
                .map(|i| i as f64)
        }
        _ => None,
    };
    // The parser has already checked numbers in this syntax.
    let Some(number) = number else { return Ok(()) };
    let key = path.last().copied().unwrap_or_default();
    let wrong = |help: &str| {
        let said = SceneError::new(format!("`{key}` of {number}")).help(help);
        Err((said.about(key), at.clone()))
    };
    let is_endless = path.first() == Some(&"cameras") && key == "far" && number == f64::INFINITY;
    if !(number as f32).is_finite() && !is_endless {
        return wrong("it is a finite number, of 32 bits");
    }
    if let ["meshes", _, shape, _] = path[..]
        && shape != "merge"
        && shape != "gltf"
    {
        if LENGTHS.contains(&key) && number as f32 <= 0.0 {
            return wrong(
                "lengths of a shape are above 0; `scale` of a draw may mirror or flatten it",
            );
        }
        if COUNTS.contains(&key) && number < 1.0 {
            return wrong("a shape has at least 1 of them");
        }
    }
    Ok(())
}
