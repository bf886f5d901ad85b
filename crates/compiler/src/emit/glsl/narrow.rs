//! Gives the outputs of the fragment stage their author's number of components. The IR fills them up
//! to four, which WebGPU needs and Vulkan does not.

use naga::{Binding, ShaderStage};
use naga_edit::declared::Located;
use naga_edit::interface;
use preshade_plan::program::Program;

/// Narrows the outputs of a text that is Vulkan's.
pub(super) fn narrowed(text: String, program: &Program, stage: ShaderStage, entry: &str) -> String {
    let Some((_, entry)) = program
        .entry_point(stage, entry)
        .filter(|_| stage == ShaderStage::Fragment)
    else {
        return text;
    };
    let outputs = interface::outputs(program.module(), &entry.function);
    let is_widened = |target: &&Located| {
        outputs.iter().any(|io| {
            let location = match io.binding {
                Some(Binding::Location { location, .. }) => Some(location),
                _ => None,
            };
            let name = io.name.as_deref().unwrap_or_default();
            location == Some(target.location) && target.is_widened_as(name)
        })
    };
    let targets = program.declared().widened().filter(is_widened);
    targets.fold(text, |text, target| one(&text, target).unwrap_or(text))
}

fn one(text: &str, target: &Located) -> Option<String> {
    let count = target.components()?;
    let start = format!("layout(location = {}) out ", target.location);
    let mut declarations = text.lines().filter_map(|l| l.strip_prefix(&start));
    let (ty, name) = declarations.next()?.strip_suffix(';')?.split_once(' ')?;
    let kind = ty.strip_suffix("vec4")?;
    let narrow = match (kind, count) {
        ("", 1) => "float".to_owned(),
        ("i", 1) => "int".to_owned(),
        ("u", 1) => "uint".to_owned(),
        (kind, count) => format!("{kind}vec{count}"),
    };
    let letters = &"xyz"[..count as usize];
    let lines = text.lines().map(|line| {
        let own = line.trim_start();
        let indent = &line[..line.len() - own.len()];
        let value = own.strip_prefix(name).and_then(|l| l.strip_prefix(" = "));
        match value.and_then(|value| value.strip_suffix(';')) {
            Some(value) => format!("{indent}{name} = ({value}).{letters};\n"),
            None if line.starts_with(&start) => format!("{start}{narrow} {name};\n"),
            None => format!("{line}\n"),
        }
    });
    Some(lines.collect())
}
