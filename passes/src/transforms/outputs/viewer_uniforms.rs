//! Parses the user's list of uniforms that follow the viewer.

use naga::Module;

use super::names::refusal;
use super::{list, refusals};
use crate::analysis::view::{self, StatedUniforms};
use preshade_plan::pass::{Misnamed, Refusal};

/// The uniforms that the words of `viewer` name. A minus sign in front marks a uniform that stays.
pub(crate) fn parse(module: &Module, viewer: Option<&str>) -> Result<StatedUniforms, Box<Refusal>> {
    let mut said = StatedUniforms::default();
    for word in list(viewer) {
        let (name, found) = match word.strip_prefix('-') {
            Some(name) => (name.trim(), &mut said.stay),
            None => (word, &mut said.follow),
        };
        found.push(part(module, name)?);
    }
    Ok(said)
}

/// The first name among the words of `viewer` that the material lacks.
pub(crate) fn misnamed(module: &Module, viewer: Option<&str>) -> Option<Misnamed> {
    list(viewer).find_map(|word| {
        let name = word.trim_start_matches('-').trim();
        let refused = part(module, name).err()?;
        (refused.code == refusals::NO_SUCH_NAME.code).then(|| Misnamed {
            message: refused.reason,
            name: name.to_owned(),
            known: parts(module).collect(),
        })
    })
}

/// The paths of all uniforms. An unnamed GLSL block has no prefix.
fn parts(module: &Module) -> impl Iterator<Item = String> {
    let all = view::parts(module).into_iter();
    all.map(|path| path.trim_start_matches('.').to_owned())
        .filter(|path| !path.is_empty())
}

/// The uniform, or the member of one, of that path or of that end of one.
fn part(module: &Module, name: &str) -> Result<String, Box<Refusal>> {
    let all = view::parts(module);
    let is_whole = |path: &&String| path.trim_start_matches('.') == name;
    let end = format!(".{name}");
    let mut called: Vec<&String> = all.iter().filter(is_whole).collect();
    if called.is_empty() {
        called = all.iter().filter(|path| path.ends_with(&end)).collect();
    }
    let quoted = |names: Vec<String>| {
        let names: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
        names.join(", ")
    };
    match called[..] {
        [one] => Ok(one.clone()),
        [] => Err(refusal(
            &refusals::NO_SUCH_NAME,
            format!(
                "no uniform or member is called `{name}`: there are {}",
                quoted(parts(module).collect())
            ),
        )),
        _ => Err(refusal(
            &refusals::AMBIGUOUS_NAME,
            format!(
                "`{name}` may be {}",
                quoted(called.into_iter().cloned().collect())
            ),
        )),
    }
}
