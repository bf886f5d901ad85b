//! Draws a material with another author's program, with the material's own values.

use std::collections::BTreeMap;
use std::sync::Arc;

use naga::{ArraySize, TypeInner};
use preshade_plan::program::Program;
use preshade_plan::state::MaterialState;
use preshade_validate::agree::Partner;

use preshade_draw::scene::bind::{self, TextureContent};
use preshade_draw::scene::globals::globals;
use preshade_draw::scene::{Draw, Frame, Material, Scene, SceneError, Value, layout};

/// A program of another author that replaces a material's.
#[derive(Clone, Copy, Debug)]
pub struct StandIn<'a> {
    pub program: &'a Program,
    /// Vertex entry point.
    pub vertex: &'a str,
    /// Fragment entry point.
    pub fragment: Option<&'a str>,
    /// Variables and attributes of the program, with the corresponding ones of the material.
    pub partners: &'a [Partner],
    /// Supplies values, textures and samplers for inputs without a partner.
    pub own: Option<&'a Material>,
}

/// A scene of one material with another program in its place.
///
/// Every number, texture and attribute of the program takes the value of its partner in `frame`.
/// Inputs without a partner get their value from `own`, or by name.
///
/// # Errors
/// As [`bind::draw`].
pub fn stand_in(
    of: &Scene,
    other: StandIn<'_>,
    state: &MaterialState,
    frame: &Frame,
) -> Result<Scene, SceneError> {
    let mut scene = of.clone();
    let Some(own) = of.materials.first() else {
        return Ok(scene);
    };
    let mut stand_in = Material {
        program: other.program.clone(),
        vertex: other.vertex.to_owned(),
        fragment: other.fragment.map(str::to_owned),
        state: state.clone(),
        ..other.own.cloned().unwrap_or_else(|| Material {
            values: BTreeMap::new(),
            textures: BTreeMap::new(),
            samplers: BTreeMap::new(),
            attributes: BTreeMap::new(),
            attribute_roles: BTreeMap::new(),
            value_roles: BTreeMap::new(),
            part_of: None,
            ..own.clone()
        })
    };
    for partner in other.partners {
        let stream = own.attributes.get(&partner.ours).unwrap_or(&partner.ours);
        if *stream != partner.theirs {
            let attribute = (partner.theirs.clone(), stream.clone());
            stand_in.attributes.extend([attribute]);
        }
    }
    if let (Some(draw), Some(pass)) = (of.draws.first(), own.plan().passes.first()) {
        let bound = bind::draw(of, own, pass, draw, frame)?;
        let place = |name: &str| {
            let mut all = globals(&own.program);
            all.find(|g| g.name == name).map(|g| (g.group, g.binding))
        };
        for partner in other.partners {
            let at = place(&partner.ours);
            let mut textures = bound.textures.iter();
            let texture = textures.find(|t| Some((t.group, t.binding)) == at);
            if let Some(TextureContent::Image(image)) = texture.map(|t| &t.content) {
                let image = Arc::clone(image);
                stand_in.textures.insert(partner.theirs.clone(), image);
            }
            let mut samplers = bound.samplers.iter();
            if let Some(sampler) = samplers.find(|s| Some((s.group, s.binding)) == at) {
                let theirs = partner.theirs.clone();
                stand_in.samplers.insert(theirs, sampler.sampler);
            }
        }
    }
    for draw in &mut scene.draws {
        draw.values = values(of, own, draw, frame, other.partners)?;
    }
    let lengths = lengths(&stand_in, &scene.draws);
    stand_in.values.extend(lengths);
    scene.materials = vec![stand_in];
    Ok(scene)
}

/// Zeros for each runtime-sized array, as many as its draws have values for.
fn lengths(stand_in: &Material, draws: &[Draw]) -> BTreeMap<String, Value> {
    let module = stand_in.program.module();
    let length = |name: &str| {
        let keys = draws.iter().flat_map(|draw| draw.values.keys());
        let indices = keys.filter_map(|key| {
            let rest = key.strip_prefix(name)?.strip_prefix('[')?;
            rest.split_once(']')?.0.parse::<usize>().ok()
        });
        indices.max().map(|last| last + 1)
    };
    let arrays = globals(&stand_in.program).filter_map(|global| {
        let TypeInner::Array {
            base,
            size: ArraySize::Dynamic,
            ..
        } = module.types[global.ty].inner
        else {
            return None;
        };
        let count = length(global.name)? * layout::scalar_count(module, base, 1);
        let zeros = Value::Numbers(vec![0.0; count]);
        Some((global.name.to_owned(), zeros))
    });
    arrays.collect()
}

/// The values of a draw, moved to their partners' paths.
fn values(
    scene: &Scene,
    own: &Material,
    draw: &Draw,
    frame: &Frame,
    partners: &[Partner],
) -> Result<BTreeMap<String, Value>, SceneError> {
    let ours = bind::numbers(scene, own, draw, frame)?;
    let parts = partners.iter().flat_map(|p| &p.parts);
    let theirs = parts.flat_map(|(theirs, our)| {
        let found = ours.iter().filter_map(move |(path, value)| {
            let indices = indices(our, path)?;
            Some((with_indices(theirs, &indices), value.clone()))
        });
        found.collect::<Vec<_>>()
    });
    Ok(theirs.collect())
}

/// The indices in a path that match the `[]` of a pattern. `None` if the path does not match.
fn indices<'p>(pattern: &str, path: &'p str) -> Option<Vec<&'p str>> {
    let mut rest = path;
    let mut found = Vec::new();
    for (i, literal) in pattern.split("[]").enumerate() {
        if i > 0 {
            let (index, after) = rest.strip_prefix('[')?.split_once(']')?;
            found.push(index);
            rest = after;
        }
        rest = rest.strip_prefix(literal)?;
    }
    rest.is_empty().then_some(found)
}

fn with_indices(pattern: &str, indices: &[&str]) -> String {
    let mut out = String::new();
    for (i, literal) in pattern.split("[]").enumerate() {
        if let Some(index) = i.checked_sub(1).and_then(|i| indices.get(i)) {
            out.push_str(&format!("[{index}]"));
        }
        out.push_str(literal);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::{indices, with_indices};

    #[test]
    fn an_index_keeps_its_place_under_another_name() {
        let found = indices("lights[].colors[]", "lights[3].colors[0]");
        assert_eq!(found, Some(vec!["3", "0"]));
        let renamed = with_indices("spots[].tints[]", &["3", "0"]);
        assert_eq!(renamed, "spots[3].tints[0]");
        assert_eq!(indices("lights[].color", "lights[3].range"), None);
        assert_eq!(indices("time", "time"), Some(Vec::new()));
    }
}
