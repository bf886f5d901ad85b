//! Parameters that are malformed, or that can have no effect.

use naga::{Module, TypeInner};

use super::{Asked, ColourTarget, OutputsParams, Precision, Viewer, list, names};
use crate::analysis::opaque::Opaque;
use preshade_dataflow::slice::{self, Criterion, OutputFilter};
use preshade_plan::mapping::{Mapping, Unknown};
use preshade_plan::pass::Misnamed;
use preshade_plan::state::DepthFormat;

/// A mistake in the parameters, whatever the material is.
pub(crate) fn slip(params: &OutputsParams) -> Option<Misnamed> {
    let said = |message: String| {
        Some(Misnamed {
            message,
            name: String::new(),
            known: Vec::new(),
        })
    };
    let words: Vec<&str> = list(Some(&params.write)).collect();
    if words.is_empty() {
        return said("`write` names nothing".to_owned());
    }
    let mut sorted = words.clone();
    sorted.sort_unstable();
    if let Some(twice) = sorted.windows(2).find(|pair| pair[0] == pair[1]) {
        return said(format!("`write` names `{}` twice", twice[0]));
    }
    if let Err(malformed) = params.mappings() {
        return said(format!("in `map`, {malformed}"));
    }
    if let Some(cutoff) = params.cutoff
        && !(0.0..=1.0).contains(&cutoff)
    {
        return said(format!(
            "`cutoff` is an alpha from 0 to 1, and not {cutoff}"
        ));
    }
    if params.normal.is_some() && params.faces.is_some() {
        return said("`faces` takes the triangle's normal, and `normal` another".to_owned());
    }
    let (name, needs) = without_effect(params)?;
    said(format!("`{name}` has no effect without {needs}"))
}

/// The first parameter that has no effect, and the parameter that it needs.
fn without_effect(params: &OutputsParams) -> Option<(&'static str, &'static str)> {
    let asked = params.requested();
    let has = |of: &Asked| asked.contains(of);
    let has_faces = params.faces.is_some();
    let from_light = has(&Asked::Shadow) || has(&Asked::Distance);
    let is_named = asked.iter().any(|a| matches!(a, Asked::Named(_)));
    let of_half = is_named || has(&Asked::Normal) || has(&Asked::Velocity);
    let only_depth = asked
        .iter()
        .all(|a| matches!(a, Asked::Depth | Asked::Shadow));
    const NORMAL: &str = "`write=normal`";
    const VELOCITY: &str = "`write=velocity`";
    const DISTANCE: &str = "`write=distance`";
    const LIGHT: &str = "`write=shadow` or `write=distance`";
    let all = [
        (
            "normal",
            params.normal.is_some(),
            has(&Asked::Normal),
            NORMAL,
        ),
        ("faces", params.faces.is_some(), has(&Asked::Normal), NORMAL),
        (
            "matrix",
            params.matrix.is_some(),
            has(&Asked::Normal),
            NORMAL,
        ),
        ("octahedral", params.octahedral, has(&Asked::Normal), NORMAL),
        (
            "unsigned",
            params.unsigned,
            has(&Asked::Normal) && !params.octahedral,
            "`write=normal` without `octahedral`",
        ),
        (
            "static",
            params.still.is_some(),
            has(&Asked::Velocity),
            VELOCITY,
        ),
        (
            "moving",
            params.moving.is_some(),
            has(&Asked::Velocity),
            VELOCITY,
        ),
        (
            "jitter",
            params.jitter.is_some(),
            has(&Asked::Velocity) || from_light,
            "`write=velocity`, `write=shadow` or `write=distance`",
        ),
        (
            "y",
            params.y.is_some(),
            has(&Asked::Velocity) || has_faces,
            "`write=velocity` or `faces`",
        ),
        (
            "position",
            params.position.is_some(),
            has(&Asked::Distance) || has_faces,
            "`write=distance` or `faces`",
        ),
        (
            "light",
            params.light.is_some(),
            has(&Asked::Distance),
            DISTANCE,
        ),
        (
            "range",
            params.range.is_some(),
            has(&Asked::Distance),
            DISTANCE,
        ),
        ("view", params.view == Viewer::Drop, from_light, LIGHT),
        ("viewer", params.viewer.is_some(), from_light, LIGHT),
        (
            "format",
            params.format != DepthFormat::default(),
            from_light,
            LIGHT,
        ),
        (
            "layout",
            params.layout.is_some(),
            params.map.is_some(),
            "`map`",
        ),
        (
            "precision",
            params.precision == Precision::Full,
            of_half,
            "a normal, a velocity or a value by its name",
        ),
        (
            "colour-target",
            params.colour_target == ColourTarget::Bound,
            only_depth,
            "a pass that writes depth alone",
        ),
    ];
    let mut idle = all
        .into_iter()
        .filter(|(_, given, used, _)| *given && !used);
    idle.next().map(|(name, _, _, needs)| (name, needs))
}

/// The first buffer of `static` that the position does not read.
pub(crate) fn of_static(opaque: &Opaque<'_>, params: &OutputsParams) -> Option<Misnamed> {
    let position = [Criterion::Output(OutputFilter::Position)];
    let slice = slice::backward(&opaque.graph, opaque.vertex, &position);
    let idle = list(params.still.as_deref()).find(|name| {
        let found = names::still(opaque.program, std::iter::once(*name));
        found.is_ok_and(|found| found.iter().all(|m| !slice.globals.contains(&m.global)))
    })?;
    Some(Misnamed {
        message: format!("`static={idle}` has no effect: the position does not read `{idle}`"),
        name: String::new(),
        known: Vec::new(),
    })
}

/// The first name of `map` that the material, or the layout, lacks.
pub(crate) fn of_map(module: &Module, params: &OutputsParams) -> Option<Misnamed> {
    let mappings = params.mappings().ok()?;
    let unknown = |place: &str, e: Unknown| Misnamed {
        message: format!("in {place}, {e}"),
        name: e.name.clone(),
        known: e.known,
    };
    let layout = match params.layout.as_deref().map(naga::front::wgsl::parse_str) {
        Some(Ok(layout)) => Some(layout),
        Some(Err(e)) => {
            return Some(Misnamed {
                message: format!("the layout is no WGSL: {}", e.message()),
                name: String::new(),
                known: Vec::new(),
            });
        }
        None => None,
    };
    let wrong = |mapping: &Mapping| {
        let ours = match mapping.ours.resolve(module) {
            Ok(ours) => &module.types[ours.ty].inner,
            Err(e) => return Some(unknown("the material", e)),
        };
        let layout = layout.as_ref()?;
        let theirs = match mapping.theirs.resolve(layout) {
            Ok(theirs) => &layout.types[theirs.ty].inner,
            Err(e) => return Some(unknown("the layout", e)),
        };
        let is_plain = |inner: &TypeInner| inner.scalar().is_some();
        let differ = is_plain(ours) && is_plain(theirs) && ours != theirs;
        differ.then(|| Misnamed {
            message: format!(
                "`{}` and `{}` are not of one type",
                mapping.theirs, mapping.ours
            ),
            name: String::new(),
            known: Vec::new(),
        })
    };
    mappings.iter().find_map(wrong)
}
