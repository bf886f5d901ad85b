//! `outputs`: auxiliary pictures of a material, sliced from the material itself.
//!
//! Goal: one material, every pass it needs. Renderers draw a material's depth, normals, velocities and
//! ids by shaders that somebody copied from it, and the copies drift: another alpha threshold, no
//! displacement, no skinning. Here the material is extended by the outputs that you ask for. Then it
//! is sliced to them, and to the code that decides position and coverage.
//!
//! ```text
//! before:  main     vs + fs
//!
//! after:   outputs  vs_outputs + fs_outputs      targets outputs-normal, outputs-velocity; depth outputs-depth
//!          main     vs + fs                      as it was
//! ```
//!
//! | output | target | value |
//! |---|---|---|
//! | `depth` | none | the camera's depth, as the main pass leaves it |
//! | `shadow` | none | a light's depth, as by the pass `shadow` |
//! | `distance` | `r32float` | how far the point is from a point light, divided by the light's range: 1 is at the end of it, and where no surface is |
//! | `normal` | `rgba16float` | the vector that meets the light in a dot product, or with `faces` the triangle's normal, and 1; with `octahedral` two numbers, with `unsigned` from 0 to 1 |
//! | `velocity` | `rg16float` | where the point is, less where it was in the previous frame: x to the right and y down, in parts of the picture |
//! | `id` | `rg32uint` | the host's number of the draw, `@builtin(instance_index)` |
//! | a name | by its type | that value of the fragment stage, at the end of the stage; a vector of three is filled up with 1, and truth values are 0 and 1 |
//!
//! Where a material draws nothing, the other targets keep their clear value, 0.
//!
//! `velocity` evaluates the position twice. The second time it reads copies of the buffers, which the
//! plan lists with the source `previous`: the host keeps their contents of the previous frame.
//! Textures count as unchanged. Each fragment divides by w and subtracts, so the velocity is exact
//! inside triangles too. Where a point was behind the camera (w <= 0), it had no place in the picture,
//! and the number has no meaning.
//!
//! A material without light has no normal of its own. `faces=right-handed` takes that of the triangle,
//! as displaced, from the derivatives of the position in the world.
//!
//! The six faces of a point light's shadow map hold the `distance`. It is measured from the vector
//! that the view's matrix turns into the clip position. If one matrix combines model and view (`mvp`),
//! there is no such vector: name a value of the fragment stage with `position`.
//!
//! A light draws `shadow` and `distance`, so uniforms of the viewer follow the light: the plan lists
//! them in `view_dependent`. The pass finds them by their names and types, and `viewer` names the
//! others. With `view=drop`, the viewer's part in coverage is left out instead. A texture coordinate
//! loses its parallax and keeps its tiling. A discard's condition loses the fade. The plan lists both
//! in `left_out`. If a test of a texture has no form without the viewer, the pass refuses. Positions
//! are unchanged: a billboard turns to the light.
//!
//! If the light's resources are declared differently from the camera's, `map` replaces the camera's by
//! the light's: `map=light.view_proj=camera.view_proj`. A slice that reads something without a partner
//! is refused.

use crate::analysis::implicit_inputs::PassEffect;
use crate::analysis::opaque::Opaque;
use crate::analysis::view::{self, StatedUniforms};
use crate::rebuild::depth_only::{self, Placed, VertexStage};
use crate::rebuild::depth_pass;
use crate::rebuild::place::PositionInvariance;
use preshade_dataflow::slice::OutputFilter;
use preshade_plan::contract::Contract;
use preshade_plan::limits;
use preshade_plan::pass::{
    Example, Facts, Misnamed, Outcome, Pass, PassInfo, Refusal, Refused, Use,
};
use preshade_plan::plan::{Attachment, ClearValue, Draws, GpuPass, Phase, Plan, Role};
use preshade_plan::program::Program;
use preshade_plan::state::{AttachmentOps, ColorTarget, DepthDirection, DepthState, Multisample};
use shader_text::refusals::RefusalInfo;

mod authored;
mod calls;
mod coverage;
mod cutoff;
mod distance;
mod effect;
pub mod extend;
mod jitter;
mod lit;
mod names;
mod notes;
mod other_view;
mod params;
pub mod refusals;
mod remap;
mod unwritten;
mod viewer;
mod viewer_uniforms;
mod world_position;

use coverage::{Dropped, Stays};
use extend::{Direction, Extended, ExtraPicture, Face, Failed, Normal, Shows, Velocity};
use names::refusal;
use params::list;
pub use params::{Asked, Axes, ClipY, ColourTarget, OutputsParams, Precision, Viewer};

const NAME: &str = "outputs";

const NOTHING_DROPPED: &str = "`view=drop` left nothing out: no discard reads a uniform that \
                               follows the viewer. If one does under another name, name it: \
                               `viewer=frame.e`";

/// The start of the names of attachments.
pub(crate) const ATTACHMENT: &str = "outputs-";

pub struct Outputs;

impl Pass for Outputs {
    type Params = OutputsParams;

    const INFO: PassInfo = PassInfo {
        name: NAME,
        summary: "draws other pictures of the material: depth, distances, normals, velocities, ids, \
                  or any value by its name",
        source: "the slices of depth-prepass; Cigolle et al., A Survey of Efficient \
                 Representations for Independent Unit Vectors (2014), for octahedral normals",
        when: "an effect (ambient occlusion, temporal antialiasing, motion blur, picking) needs \
               more of a material than its colour",
        hurts: "never by itself: the main pass is untouched, and the host decides when to draw it",
        reads_scene: false,
    };

    const REFUSALS: &'static [RefusalInfo] = refusals::REFUSALS;

    const EXAMPLES: &'static [Example] = &[
        Example {
            recipe: "outputs:write=velocity+id",
            uses: &[
                Use::Snapshot,
                Use::Inject,
                Use::Fuzz,
                Use::Growth,
                Use::Page("pages/leaf"),
                Use::Picture {
                    scene: "fixtures/scenes/wind.toml --size 256x144 --frames 1 --order \
                            front-to-back",
                    caption: "the main pass is as it was; velocities and ids are drawn beside it",
                    rows: 1,
                },
            ],
        },
        Example {
            recipe: "outputs:write=normal+velocity",
            uses: &[Use::Compile],
        },
        Example {
            recipe: "outputs:write=distance,view=drop",
            uses: &[Use::Compile],
        },
        Example {
            recipe: "outputs:write=depth,colour-target=bound",
            uses: &[Use::Compile],
        },
        Example {
            recipe: "outputs:write=normal,faces=right-handed",
            uses: &[Use::Compile],
        },
        Example {
            recipe: "outputs:write=normal,octahedral=true",
            uses: &[Use::Snapshot],
        },
    ];

    fn misnamed(plan: &Plan, params: &OutputsParams) -> Option<Misnamed> {
        if let Some(slip) = effect::slip(params) {
            return Some(slip);
        }
        let opaque = depth_pass::alone(plan, NAME).ok()?;
        let viewer = params.viewer.as_deref();
        let module = opaque.program.module();
        names::misnamed(&opaque, params)
            .or_else(|| viewer_uniforms::misnamed(module, viewer))
            .or_else(|| effect::of_static(&opaque, params))
            .or_else(|| effect::of_map(module, params))
    }

    fn run(plan: &Plan, _facts: &Facts, params: &OutputsParams) -> Result<Outcome, Refused> {
        let asked = params.requested();
        let from_light = asked.contains(&Asked::Shadow) || asked.contains(&Asked::Distance);
        check(plan, &asked, from_light)?;
        let tested = cutoff::tested(plan, params.cutoff)?;
        let authors = tested.as_ref().map_or(plan, |(plan, _)| plan);
        let steady = match from_light {
            true => jitter::without(authors, params)?,
            false => None,
        };
        let authors = steady.as_ref().unwrap_or(authors);
        let whole = depth_pass::alone(authors, NAME)?;
        let said = viewer_uniforms::parse(whole.program.module(), params.viewer.as_deref())?;
        let drops = from_light && params.view == Viewer::Drop;
        let dropped = match drops {
            true => without_viewer(&whole, &said)?,
            false => None,
        };
        let of_light = dropped
            .as_ref()
            .map(|d| with_main(authors, &d.program, None));
        let author = match &of_light {
            Some(plan) => depth_pass::alone(plan, NAME)?,
            None => whole,
        };
        // The author's code alone decides coverage and depth: outputs decide nothing.
        let deciding = depth_only::slice(&author, VertexStage::Sliced, &[]);
        deciding.assumptions(&author, authors, NAME, &[PassEffect::SlicesForView])?;
        let wanted = wanted(&author, (params, &said), &asked)?;
        let mut extended = match wanted.is_empty() {
            true => None,
            false => {
                Some(extend::extend(&author, &wanted, params.group).map_err(|why| failed(&why))?)
            }
        };
        let of_extended = extended.as_ref();
        let of_extended = of_extended.map(|e| with_main(authors, &e.program, Some(&e.fragment)));
        let opaque = match &of_extended {
            Some(plan) => depth_pass::alone(plan, NAME)?,
            None => author,
        };
        let locations: Vec<OutputFilter> = (0..wanted.len() as u32)
            .map(OutputFilter::Location)
            .collect();
        let slice = depth_only::slice(&opaque, VertexStage::Sliced, &locations);
        let mut placed = slice.place(&opaque, NAME, PositionInvariance::AsWritten, None);
        if let Some(extended) = &mut extended {
            extended.renumber(&mut placed);
        }
        let mut next = plan.clone();
        insert(&mut next, &opaque, placed, params, from_light)?;
        let contract = Contract::exact();
        next.steps.push(slice.step(&opaque, NAME, params, contract));
        if let Some(extended) = &extended {
            add_targets(&mut next, extended, &wanted);
        }
        next.notes.extend(notes::notes(&opaque, params, &wanted));
        next.notes
            .extend((drops && dropped.is_none()).then(|| NOTHING_DROPPED.to_owned()));
        let of_view = other_view::apply(&mut next, &opaque, (params, &said))?;
        depth_pass::finish(&mut next, "original");
        let program = next.programs.get(Role::Outputs.name());
        let program = program.filter(|_| from_light);
        let follows = program.map(|program| view::view_dependent(program, &said));
        if let Some(pass) = next.passes.iter_mut().find(is_own) {
            if let Some(extended) = &extended {
                extended.mark(&mut pass.attributes);
            }
            other_view::mark(pass, &of_view);
            pass.view_dependent = follows.unwrap_or_default();
            pass.left_out = dropped.map(|d| d.left_out).unwrap_or_default();
            if let Some((_, left_out)) = &tested {
                // Blended draws are meant too.
                pass.draws = Draws::All;
                pass.left_out.push(left_out.clone());
            }
            check_limits(pass, opaque.pass)?;
        }
        let names: Vec<&str> = list(Some(&params.write)).collect();
        let what = format!("vertex and fragment stage for {}", names.join(", "));
        Ok(slice.outcome(&opaque, what, next))
    }
}

/// Whether a pass is the new one.
fn is_own(pass: &&mut GpuPass) -> bool {
    pass.role == Role::Outputs
}

/// Fails for pictures that do not go together.
fn check(plan: &Plan, asked: &[Asked], from_light: bool) -> Result<(), Box<Refusal>> {
    if plan.passes.iter().any(|p| p.role == Role::Outputs) {
        let reason = "the plan already has a pass of outputs";
        return Err(refusal(&refusals::HAS_OUTPUTS, reason));
    }
    if from_light && (asked.contains(&Asked::Depth) || asked.contains(&Asked::Velocity)) {
        return Err(refusal(
            &refusals::MIXED_VIEWS,
            "`shadow` and `distance` are drawn from a light's view, `depth` and `velocity` from \
             the camera's",
        ));
    }
    Ok(())
}

/// Inserts the pass, with its depth.
fn insert(
    next: &mut Plan,
    opaque: &Opaque<'_>,
    placed: Placed,
    params: &OutputsParams,
    from_light: bool,
) -> Result<(), Box<Refusal>> {
    let depth = depth_state(opaque, params, from_light);
    let phase = match from_light {
        true => Phase::Shadow,
        false => Phase::Outputs,
    };
    let attachment = attachment(opaque, next, params, from_light);
    depth_pass::insert_own(next, opaque, placed, Role::Outputs, phase, depth, NAME)?;
    next.attachments.push(attachment);
    if let Some(pass) = next.passes.iter_mut().find(is_own) {
        pass.multisample = Multisample::default();
    }
    Ok(())
}

/// Adds the targets of the pass, and marks its bindings.
fn add_targets(next: &mut Plan, extended: &Extended, wanted: &[ExtraPicture]) {
    let Some(pass) = next.passes.iter_mut().find(is_own) else {
        return;
    };
    bind(pass, extended);
    for (wanted, format) in wanted.iter().zip(&extended.formats) {
        let name = format!("{ATTACHMENT}{}", wanted.name);
        next.attachments.push(Attachment {
            clear: clear_value(wanted),
            ..Attachment::color(&name, *format, [0.0; 4])
        });
        let written = !matches!(wanted.shows, Shows::Nothing);
        pass.targets.push(Some(ColorTarget {
            attachment: Some(name),
            write_mask: if written { 0b1111 } else { 0 },
            ..ColorTarget::opaque(*format)
        }));
    }
}

/// The value of a picture where no surface is.
fn clear_value(wanted: &ExtraPicture) -> ClearValue {
    let clear = match &wanted.shows {
        Shows::Distance(distance) => distance.clear_value(),
        _ => 0.0,
    };
    ClearValue::Color([clear, 0.0, 0.0, 0.0])
}

/// The pictures that the words of `write` name in this material, without depths.
fn wanted(
    opaque: &Opaque<'_>,
    (params, said): (&OutputsParams, &StatedUniforms),
    asked: &[Asked],
) -> Result<Vec<ExtraPicture>, Vec<Refusal>> {
    let (mut found, mut refusals) = (Vec::new(), Vec::new());
    for asked in asked {
        let (name, shows) = match asked {
            Asked::Depth | Asked::Shadow => continue,
            Asked::Normal => ("normal".to_owned(), normal(opaque, params, said)),
            Asked::Velocity => ("velocity".to_owned(), velocity(opaque, params)),
            Asked::Distance => (
                "distance".to_owned(),
                distance::distance(opaque, params, said),
            ),
            Asked::Id => ("id".to_owned(), Ok(Shows::Id)),
            Asked::Named(name) => (
                name.replace(['@', '.', ':'], "-"),
                names::value(opaque, name)
                    .and_then(|value| calls::single(opaque, value))
                    .map(Shows::Value),
            ),
        };
        match shows {
            Ok(shows) => found.push(ExtraPicture {
                name,
                shows,
                full: params.precision == Precision::Full,
            }),
            Err(refusal) => refusals.push(*refusal),
        }
    }
    if !refusals.is_empty() {
        return Err(refusals);
    }
    if found.is_empty() && params.colour_target == ColourTarget::Bound {
        found.push(ExtraPicture {
            name: "colour".to_owned(),
            shows: Shows::Nothing,
            full: false,
        });
    }
    Ok(found)
}

fn normal(
    opaque: &Opaque<'_>,
    params: &OutputsParams,
    said: &StatedUniforms,
) -> Result<Shows, Box<Refusal>> {
    let normal = match params.faces {
        Some(axes) => Normal::Face(Face {
            from: distance::surface(opaque, params, said)?,
            is_left_handed: axes == Axes::LeftHanded,
            is_down: is_down(opaque.program, params),
        }),
        None => {
            let value = names::normal(opaque, params.normal.as_deref())?;
            Normal::Value(calls::single(opaque, value)?)
        }
    };
    let turned = params.matrix.as_deref();
    let turned = turned
        .map(|name| names::matrix(opaque.program, name))
        .transpose()?;
    let direction = Direction {
        turned,
        octahedral: params.octahedral,
        unsigned: params.unsigned,
    };
    Ok(Shows::Direction(normal, direction))
}

/// Whether the y of the clip position points down.
fn is_down(program: &Program, params: &OutputsParams) -> bool {
    let said = params.y.map(|y| y == ClipY::Down);
    said.unwrap_or(program.declared().y_down)
}

fn velocity(opaque: &Opaque<'_>, params: &OutputsParams) -> Result<Shows, Box<Refusal>> {
    let still = list(params.still.as_deref());
    let words: Vec<&str> = list(params.jitter.as_deref()).collect();
    let (pairs, words): (Vec<&str>, Vec<&str>) = words.iter().partition(|w| w.contains('='));
    let jitter = words.iter().map(|name| jitter::of(opaque.program, name));
    let jitter: Vec<_> = jitter.collect::<Result<_, _>>()?;
    let steady = pairs.iter().map(|pair| jitter::twins(opaque.program, pair));
    Ok(Shows::Velocity(Velocity {
        still: names::still(opaque.program, still)?,
        moving: names::attributes(opaque, list(params.moving.as_deref()))?,
        jitter: jitter.into_iter().flatten().collect(),
        steady: steady.collect::<Result<_, _>>()?,
        is_down: is_down(opaque.program, params),
    }))
}

fn failed(why: &Failed) -> Box<Refusal> {
    match why {
        Failed::Type(name) => refusal(
            &refusals::OUTPUT_TYPE,
            format!("no colour target holds values of the type of `{name}`"),
        ),
        Failed::Previous(why) => refusal(&refusals::NO_PREVIOUS, why.as_str()),
        Failed::Unread(name) => refusal(
            &refusals::UNREAD_JITTER,
            format!("the position does not read `{name}`"),
        ),
        Failed::Built(why) => Box::new(Refusal::bug(NAME, why)),
    }
}

/// Limits of WebGPU that our additions may exceed, in words.
const LIMITS: [(&str, &str); 4] = [
    ("maxInterStageShaderVariables", "varyings"),
    ("maxVertexAttributes", "attributes"),
    ("maxColorAttachments", "targets"),
    (
        "maxColorAttachmentBytesPerSample",
        "bytes of colour in each pixel",
    ),
];

/// Fails if the pass needs more than every device has, and more than the author's own pass.
fn check_limits(pass: &GpuPass, author: &GpuPass) -> Result<(), Box<Refusal>> {
    for (limit, what) in LIMITS {
        let needed = pass.limits.get(limit).copied().unwrap_or(0);
        if needed <= author.limits.get(limit).copied().unwrap_or(0) {
            continue;
        }
        let most = limits::DEFAULTS.iter().find(|(name, _)| *name == limit);
        let most = most.map_or(0, |(_, most)| *most);
        let reason = format!("it needs {needed} {what}, and every device has {most}");
        return Err(refusal(&refusals::TOO_MANY, reason));
    }
    Ok(())
}

/// The material without code that depends on the viewer; `None`: nothing does.
fn without_viewer(
    opaque: &Opaque<'_>,
    said: &StatedUniforms,
) -> Result<Option<Dropped>, Box<Refusal>> {
    let stages = (Some(opaque.vertex), opaque.fragment);
    let follows = view::of_stages(&opaque.graph, stages, said);
    coverage::dropped(opaque, &follows).map_err(|why| match why {
        Stays::Built(why) => Box::new(Refusal::bug(NAME, why)),
        Stays::Discard(why) => refusal(&refusals::VIEWER_DECIDES, why),
    })
}

/// The plan with another program, and fragment stage, in its main pass.
fn with_main(plan: &Plan, program: &Program, fragment: Option<&String>) -> Plan {
    let mut plan = plan.clone();
    for pass in plan.passes.iter_mut().filter(|p| p.role == Role::Main) {
        pass.fragment = fragment.cloned().or(pass.fragment.take());
        plan.programs.insert(pass.program.clone(), program.clone());
    }
    plan
}

/// Marks the bindings that the author does not have.
fn bind(pass: &mut GpuPass, extended: &Extended) {
    for binding in &mut pass.bindings {
        if let Some(source) = extended.bindings.get(&(binding.group, binding.binding)) {
            binding.source = source.clone();
        }
    }
}

/// The depth that the pass tests and writes.
fn depth_state(opaque: &Opaque<'_>, params: &OutputsParams, from_light: bool) -> DepthState {
    let attachment = format!("{ATTACHMENT}depth");
    match from_light {
        true => depth_pass::of_light(attachment, params.format),
        false => DepthState {
            attachment,
            ops: AttachmentOps::default(),
            ..opaque.depth.clone()
        },
    }
}

fn attachment(
    opaque: &Opaque<'_>,
    plan: &Plan,
    params: &OutputsParams,
    from_light: bool,
) -> Attachment {
    let (format, direction) = match from_light {
        true => (params.format, DepthDirection::Forward),
        false => (
            plan.depth_format(&opaque.depth.attachment)
                .unwrap_or_default(),
            opaque.direction,
        ),
    };
    Attachment {
        sampled: true,
        ..Attachment::depth(format!("{ATTACHMENT}depth"), format, direction, 1)
    }
}
