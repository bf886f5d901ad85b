//! The values that preshade made up, as a note: inputs of a bare shader, and inputs that a scene
//! file leaves open.

use std::collections::BTreeMap;

use preshade_draw::scene::Scene;
use preshade_draw::scene::bind::{Guess, Guessed, guessed};

use crate::output;

/// Prints the note, if a value was made up.
pub fn tell(scene: &Scene) {
    for note in &scene.notes {
        output::message(&format!("note: {note}"));
    }
    let note = match scene.is_made_up {
        true => of_shader(scene),
        false => of_scene(scene),
    };
    note.iter().for_each(|note| output::message(note));
}

/// The guessed inputs of a bare shader.
fn of_shader(scene: &Scene) -> Option<String> {
    let guessed = guessed(scene);
    let widest = guessed.iter().map(|g| g.name.len()).max()?;
    let mut lines = vec![format!(
        "note: a scene was made up for `{}`, with these inputs guessed (a scene file says them: \
         docs/reference/scenes.md)",
        scene.name
    )];
    lines.extend(
        guessed
            .iter()
            .map(|g| format!("  {:<widest$}  {}", g.name, g.guess)),
    );
    Some(lines.join("\n"))
}

/// Inputs that a scene file leaves open and whose names give no value, as the lines that set them.
fn of_scene(scene: &Scene) -> Option<String> {
    let mut open: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for of in guessed(scene) {
        if let Some(line) = line(&of) {
            open.entry(of.material).or_default().push(line);
        }
    }
    if open.is_empty() {
        return None;
    }
    let mut lines = vec![format!(
        "note: the scene `{}` leaves inputs open, and preshade made these up. Errors are measured \
         with them; `specialize` assumes none of them. To set them, change these lines and add \
         them to the scene file:",
        scene.name
    )];
    for (material, own) in open {
        lines.push(format!("[materials.{}]", key(&material)));
        lines.extend(own);
    }
    Some(lines.join("\n"))
}

/// The line of a scene file that sets the guessed value. `None`: a name or the mesh gives the
/// value.
fn line(of: &Guessed) -> Option<String> {
    let name = key(&of.name);
    match &of.guess {
        Guess::UniformMadeUp { numbers } => Some(format!("values.{name} = {}", value(numbers))),
        Guess::TextureGenerated => Some(format!(
            "textures.{name} = {{ file = \"{}.png\" }}  # a pattern now",
            of.name
        )),
        Guess::AttributeByUse { stream } => {
            Some(format!("attributes.{name} = \"{stream}\"  # by its use"))
        }
        Guess::AttributeSynthesised => Some(format!(
            "attributes.{name} = \"uv\"  # the mesh's stream; it has none of this name"
        )),
        Guess::UniformByUse { value } => Some(format!("values.{name} = {value:?}  # by its use")),
        Guess::UniformByName { .. } | Guess::TextureCleared | Guess::BufferFromMesh => None,
    }
}

/// A key, quoted where TOML demands it.
fn key(name: &str) -> String {
    let is_bare = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-');
    match !name.is_empty() && name.chars().all(is_bare) {
        true => name.to_owned(),
        false => format!("{name:?}"),
    }
}

fn value(numbers: &[f64]) -> String {
    let rounded: Vec<String> = numbers
        .iter()
        .map(|n| ((n * 1e3).round() / 1e3).to_string())
        .collect();
    match rounded.as_slice() {
        [one] => one.clone(),
        _ => format!("[{}]", rounded.join(", ")),
    }
}
