//! One variant: its contract and verdict, its pictures, every view, its shaders against the
//! author's, its samples.

use super::diff::Diff;
use super::words::{self, or_dash};
use super::{Gallery, PageError, data_uri};
use crate::measure::record::{KeptMaterial, Picture, Pictures, VariantReport, Worst};
use crate::measure::{ErrorLadder, Shading};
use crate::report::picture::flip;
use crate::report::{contact_sheet, frontier};

/// The data for the template `variant.html`.
#[derive(Default)]
pub(crate) struct Section {
    pub id: usize,
    pub name: String,
    /// The recipe, as a command line takes it.
    pub recipe: String,
    /// Terms and their values.
    pub facts: Vec<(&'static str, String)>,
    /// Materials left as written, with the reasons.
    pub kept: Vec<(String, String)>,
    pub shots: Vec<Shot>,
    /// Rows of the table of views.
    pub views: Vec<[String; 7]>,
    pub diffs: Vec<Diff>,
    /// Samples of its time in the headline view.
    pub samples: String,
}

/// The pictures of one view.
pub(crate) struct Shot {
    pub view: String,
    /// How far it is off.
    pub error: String,
    /// Number of the original's picture in the gallery.
    pub original: usize,
    /// The text if the variant has no picture of its own.
    pub same: &'static str,
    /// The variant's picture; `None`: it looks the same.
    pub variant: Option<String>,
    /// Their FLIP map; `None`: it would be black.
    pub flip: Option<String>,
    pub before: Option<String>,
    pub after: Option<String>,
}

/// Which cameras a variant is shown from.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cameras {
    /// The first alone: of many variants a page gets heavy.
    First,
    Every,
}

/// The section of a variant. Its list of terms begins with `facts`.
pub(crate) fn section(
    id: usize,
    (name, recipe): (&str, &str),
    mut facts: Vec<(&'static str, String)>,
    variant: Option<&VariantReport>,
    pictures: Option<&Pictures>,
    cameras: Cameras,
    gallery: &mut Gallery,
) -> Result<Section, PageError> {
    facts.extend(variant.map_or_else(Vec::new, told));
    Ok(Section {
        id,
        name: name.to_owned(),
        recipe: recipe.to_owned(),
        facts,
        kept: variant.map_or_else(Vec::new, |v| {
            let kept = v.kept.iter();
            let why = |k: &KeptMaterial| match &k.without {
                Some(step) => format!("without `{step}`: {}", k.why),
                None => k.why.clone(),
            };
            kept.map(|k| (k.material.clone(), why(k))).collect()
        }),
        shots: match pictures {
            Some(pictures) => shots(variant, pictures, cameras, gallery)?,
            None => Vec::new(),
        },
        views: variant.map_or_else(Vec::new, |v| v.by_view.iter().map(view).collect()),
        diffs: Vec::new(),
        samples: variant
            .and_then(|v| v.time_ms.as_ref())
            .map_or_else(String::new, |t| {
                let samples: Vec<String> = t.samples.iter().map(|s| format!("{s:.4}")).collect();
                samples.join(" ")
            }),
    })
}

/// The terms before the pictures of a variant.
fn told(v: &VariantReport) -> Vec<(&'static str, String)> {
    let mut facts = vec![
        ("promise", words::contract(&v.contract)),
        ("verdict", words::verdict(&v.verdict)),
    ];
    if let Some(error) = v.error.as_ref().filter(|_| v.by_view.len() > 1) {
        let views = v.by_view.len();
        facts.push((
            "worst of its views",
            format!("{} ({views} views)", words::error(error)),
        ));
    }
    facts.extend(
        v.self_test
            .iter()
            .map(|t| ("self-test", words::self_test(t))),
    );
    facts.extend(v.shadow.as_ref().map(|s| {
        let [w, h] = s.map;
        let (changed, covered) = (s.depths.changed_depth, s.depths.covered);
        let time = or_dash(s.speedup, frontier::speedup);
        (
            "under the light",
            format!("{changed} of {covered} depths differ in a {w}x{h} map; shadow passes {time}"),
        )
    }));
    facts.extend(v.outputs.as_ref().map(|o| {
        let (changed, covered) = (o.depths.changed_depth, o.depths.covered);
        let time = or_dash(o.speedup, frontier::speedup);
        let right = o.velocity.as_ref().map_or_else(String::new, |v| {
            format!(
                "; velocities are right to {:.4} pixels, roundings aside",
                v.worst
            )
        });
        (
            "auxiliary pictures",
            format!("{changed} of {covered} depths differ{right}; auxiliary passes {time}"),
        )
    }));
    facts.extend(v.junctions.iter().map(|j| {
        (
            "T-junctions",
            format!(
                "{} edges of {} are edges of {} too",
                j.edges, j.divided, j.beside
            ),
        )
    }));
    facts.extend(v.by_path.iter().map(|p| {
        let order = preshade_draw::render::order::name(p.order);
        (
            "along a path",
            format!(
                "{} frames of {}, {order}: median {:.3} ms, 95 % within {:.3} ms",
                p.frames, p.camera, p.median_ms, p.p95_ms
            ),
        )
    }));
    if let Some(cost) = v.cost.as_ref().and_then(|c| c.subdivision.as_ref()) {
        facts.push((
            "new vertices",
            format!(
                "{} a frame, {} at load, {:.1} MB",
                cost.evaluations,
                cost.at_load,
                cost.bytes as f64 / 1e6
            ),
        ));
    }
    facts
}

fn view(view: &crate::measure::record::ViewReport) -> [String; 7] {
    let order = preshade_draw::render::order::name(view.order);
    [
        format!("{} {}, {order}", view.camera, view.frame),
        view.error.changed_pixels.to_string(),
        frontier::number(view.error.max_abs),
        frontier::number(view.error.flip_mean),
        or_dash(view.time_ms.as_ref(), |t| words::ms(&t.estimate)),
        or_dash(view.speedup, frontier::speedup),
        or_dash(view.shaded_per_pixel, |s| format!("{s:.2}")),
    ]
}

/// The headline view with its overdraw, then of each other camera the view that is most off.
fn shots(
    variant: Option<&VariantReport>,
    pictures: &Pictures,
    cameras: Cameras,
    gallery: &mut Gallery,
) -> Result<Vec<Shot>, PageError> {
    let scale = pictures.overdraw_scale();
    let overdraw = |shading: &Option<Shading>| {
        let picture = shading.as_ref().map(|s| contact_sheet::overdraw(s, scale));
        picture.as_ref().map(data_uri).transpose()
    };
    let headline = variant.and_then(|v| v.by_view.first());
    let name = headline.map_or_else(
        || "the headline view".to_owned(),
        |v| {
            let order = preshade_draw::render::order::name(v.order);
            format!("camera `{}` frame {} {order}", v.camera, v.frame)
        },
    );
    let mut shots = vec![Shot {
        before: overdraw(&pictures.overdraw_before)?,
        after: overdraw(&pictures.overdraw_after)?,
        ..shot(
            &name,
            headline.map(|v| &v.error),
            &pictures.original,
            Some(&pictures.variant),
            gallery,
        )?
    }];
    // The headline's own camera, in another order or frame.
    let seen = |worst: &&Worst| pictures.elsewhere.iter().any(|e| e.view == worst.view);
    if let Some(worst) = pictures.worst.as_ref().filter(|w| !seen(w)) {
        shots.push(shot(
            &format!("{}, where it is most off", worst.view),
            Some(&worst.error),
            &worst.original,
            Some(&worst.variant),
            gallery,
        )?);
    }
    let elsewhere = match cameras {
        Cameras::First => &[][..],
        Cameras::Every => &pictures.elsewhere,
    };
    for there in elsewhere {
        shots.push(shot(
            &there.view,
            Some(&there.error),
            &there.original,
            there.variant.as_ref(),
            gallery,
        )?);
    }
    Ok(shots)
}

fn shot(
    view: &str,
    error: Option<&ErrorLadder>,
    original: &Picture,
    variant: Option<&Picture>,
    gallery: &mut Gallery,
) -> Result<Shot, PageError> {
    let variant = variant.filter(|v| *v != original);
    let is_same = error.is_none_or(ErrorLadder::is_exact);
    Ok(Shot {
        same: match is_same {
            true => "the same bits",
            false => "the same in 8 bits of the first target",
        },
        view: view.to_owned(),
        error: error.map_or_else(String::new, words::error),
        original: gallery.number(original)?,
        variant: variant.map(data_uri).transpose()?,
        flip: variant.map(|v| data_uri(&flip(original, v))).transpose()?,
        before: None,
        after: None,
    })
}
