//! The previous frame of Bevy in place of preshade's copies.
//!
//! preshade evaluates the position twice, the second time from copies of the buffers. Bevy keeps the
//! previous frame in other places: the view in a uniform, transforms beside the current ones,
//! skins and weights in buffers of their own, and the time as a difference.

use preshade::{BindingSource, GpuPass};

use super::{Refused, Wanted};

/// `bevy_pbr`'s `prepass_bindings.wgsl`.
const PREVIOUS_VIEW: &str = "struct PreviousViewUniforms {
    view_from_world: mat4x4<f32>,
    clip_from_world: mat4x4<f32>,
    clip_from_view: mat4x4<f32>,
    world_from_clip: mat4x4<f32>,
    view_from_clip: mat4x4<f32>,
}
";

/// Members of the view, and their values in the previous frame. Others count as unchanged.
const VIEW: [(&str, &str); 8] = [
    ("clip_from_world", "previous_view_uniforms.clip_from_world"),
    (
        "unjittered_clip_from_world",
        "previous_view_uniforms.clip_from_world",
    ),
    ("view_from_world", "previous_view_uniforms.view_from_world"),
    ("clip_from_view", "previous_view_uniforms.clip_from_view"),
    ("world_from_clip", "previous_view_uniforms.world_from_clip"),
    ("view_from_clip", "previous_view_uniforms.view_from_clip"),
    (
        "world_from_view",
        "(previous_view_uniforms.world_from_clip * previous_view_uniforms.clip_from_view)",
    ),
    (
        "world_position",
        "(previous_view_uniforms.world_from_clip * previous_view_uniforms.clip_from_view)[3].xyz",
    ),
];

/// Members of the globals, as above; `$` is their variable.
const GLOBALS: [(&str, &str); 2] = [
    ("time", "($.time - $.delta_time)"),
    ("frame_count", "($.frame_count - 1u)"),
];

/// Members of a mesh, as above.
const MESH: [(&str, &str); 1] = [("world_from_local", "previous_world_from_local")];

/// Members of a mesh's morph targets, as above.
const MORPH: [(&str, &str); 1] = [("current_weights_offset", "prev_weights_offset")];

/// Replaces the copies.
///
/// # Errors
/// The position reads a copy as a whole.
pub fn apply(text: &str, pass: &GpuPass, wanted: Wanted, view: u32) -> Result<String, Refused> {
    let mut text = text.to_owned();
    let mut reads_view = false;
    for binding in &pass.bindings {
        let BindingSource::Previous {
            of,
            group,
            binding: number,
        } = &binding.source
        else {
            continue;
        };
        let at = (binding.group, binding.binding);
        // The writer may give a variable another name than the plan has.
        let own = number.map(|number| (group.unwrap_or_default(), number));
        let of = own
            .and_then(|own| declared(&text, own))
            .unwrap_or(of)
            .to_owned();
        let name = declared(&text, at).unwrap_or(&binding.name).to_owned();
        let copy = Copy {
            name: &name,
            of: &of,
        };
        text = match (group, number) {
            (Some(0), Some(0)) => {
                reads_view = true;
                let value = |member: &str| {
                    let known = VIEW.iter().find(|(name, _)| *name == member);
                    known.map_or_else(
                        || format!("{of}.{member}"),
                        |(_, value)| (*value).to_owned(),
                    )
                };
                copy.members(&without(&text, at), &value)?
            }
            (Some(0), Some(11)) => {
                let value = |member: &str| {
                    let known = GLOBALS.iter().find(|(name, _)| *name == member);
                    let value =
                        known.map_or_else(|| format!("$.{member}"), |(_, v)| (*v).to_owned());
                    value.replace('$', &of)
                };
                copy.members(&without(&text, at), &value)?
            }
            (Some(2), Some(0)) => copy.elements(&without(&text, at), &MESH)?,
            (Some(2), Some(8)) => copy.elements(&without(&text, at), &MORPH)?,
            // Without a skin or weights of the previous frame, the mesh has none that moved.
            (Some(2), Some(1)) if wanted.previous_skin => moved(&text, at, 6),
            (Some(2), Some(2)) if wanted.previous_morph => moved(&text, at, 7),
            // A material's values count as unchanged, as they do in Bevy's own motion vectors.
            _ => copy.renamed(&without(&text, at)),
        };
    }
    if reads_view {
        let declared = format!(
            "{PREVIOUS_VIEW}\n@group(0) @binding({view}) var<uniform> previous_view_uniforms: PreviousViewUniforms;\n"
        );
        // Behind the comment at the start.
        let at = text
            .find("\nstruct ")
            .or_else(|| text.find("\n@group"))
            .map_or(0, |at| at + 1);
        text.insert_str(at, &declared);
    }
    Ok(text)
}

/// The start of a declaration.
fn declaration((group, binding): (u32, u32)) -> String {
    format!("@group({group}) @binding({binding}) ")
}

/// The name of the variable at a binding.
fn declared(text: &str, at: (u32, u32)) -> Option<&str> {
    let start = declaration(at);
    let line = text.lines().find_map(|line| line.strip_prefix(&start))?;
    let (head, _) = line.split_once(':')?;
    head.split([' ', '>']).next_back()
}

/// The text without a declaration.
fn without(text: &str, at: (u32, u32)) -> String {
    let start = declaration(at);
    let kept = text.lines().filter(|line| !line.starts_with(&start));
    kept.flat_map(|line| [line, "\n"]).collect()
}

/// The text with a declaration at another binding.
fn moved(text: &str, at: (u32, u32), binding: u32) -> String {
    text.replacen(&declaration(at), &declaration((at.0, binding)), 1)
}

/// A copy of a buffer.
struct Copy<'a> {
    name: &'a str,
    of: &'a str,
}

impl Copy<'_> {
    /// Puts something in place of each use: the function gets the text after the name, and returns
    /// the replacement with the rest.
    fn replace(
        &self,
        text: &str,
        put: &dyn Fn(&str) -> Option<(String, usize)>,
    ) -> Result<String, Refused> {
        let mut out = String::with_capacity(text.len());
        let mut rest = text;
        while let Some(at) = rest.find(self.name) {
            let (before, found) = rest.split_at(at);
            let after = &found[self.name.len()..];
            let is_part = |c: char| c.is_alphanumeric() || c == '_';
            let is_word = !before.ends_with(is_part) && !after.starts_with(is_part);
            out.push_str(before);
            if !is_word {
                out.push_str(self.name);
                rest = after;
                continue;
            }
            let (instead, taken) = put(after).ok_or_else(|| self.whole())?;
            out.push_str(&instead);
            rest = &after[taken..];
        }
        out.push_str(rest);
        Ok(out)
    }

    fn whole(&self) -> Refused {
        Refused::new(
            "no-previous",
            format!(
                "the position reads `{}` as a whole, and its previous value is elsewhere",
                self.of
            ),
            "read the members that the position needs",
        )
    }

    /// `copy.member`.
    fn members(&self, text: &str, value: &dyn Fn(&str) -> String) -> Result<String, Refused> {
        self.replace(text, &|after| {
            let member = member(after)?;
            Some((value(member), member.len() + 1))
        })
    }

    /// `copy[index].member`.
    fn elements(&self, text: &str, members: &[(&str, &str)]) -> Result<String, Refused> {
        self.replace(text, &|after| {
            let end = closing(after)? + 1;
            let name = member(&after[end..])?;
            let other = members.iter().find(|(from, _)| *from == name);
            let other = other.map_or(name, |(_, to)| to);
            // An index may read the copy as well.
            let index = self.elements(&after[..end], members).ok()?;
            Some((format!("{}{index}.{other}", self.of), end + 1 + name.len()))
        })
    }

    /// The original in its place.
    fn renamed(&self, text: &str) -> String {
        let same = |_: &str| Some((self.of.to_owned(), 0));
        self.replace(text, &same)
            .unwrap_or_else(|_| text.to_owned())
    }
}

/// The name behind a dot.
fn member(text: &str) -> Option<&str> {
    let name = text.strip_prefix('.')?;
    let end = name
        .find(|c: char| !c.is_alphanumeric() && c != '_')
        .unwrap_or(name.len());
    Some(&name[..end])
}

/// Where the bracket that the text begins with is closed.
fn closing(text: &str) -> Option<usize> {
    let mut depth = 0_usize;
    for (at, c) in text.char_indices() {
        match c {
            '[' => depth += 1,
            ']' => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return (c == ']').then_some(at);
        }
    }
    None
}
