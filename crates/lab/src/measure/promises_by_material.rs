//! Checks each material of a frame by its own promise. A picture may keep the weakest promise of
//! all materials although one material breaks its own.

use preshade_plan::contract::Contract;
use preshade_plan::plan::{Phase, Plan};
use preshade_plan::state::{Blend, BlendComponent, BlendFactor, BlendOperation, DepthDirection};

use super::error::compare;
use super::shading::counting_plan;
use super::verdict::{Promise, keeps_positions};
use super::{CountProgram, Error, Session, counting};
use preshade_compiler::command::rewrite::discards;
use preshade_draw::render::{DepthImage, FrameSettings, Prepared, Rendered};
use preshade_draw::scene::{DrawOrder, Frame, Rows};

/// How a picture breaks a promise.
pub(super) struct Broke {
    pub how: String,
    pub promise: Promise,
    /// The picture where the promise holds, and the original elsewhere; `None`: it holds everywhere.
    pub picture: Option<Rendered>,
}

/// The materials of one promise, among others with weaker ones.
pub(super) struct Group<'a> {
    promise: Promise,
    /// By material: whether it is of the group.
    members: Vec<bool>,
    /// Whether a material outside may cover other pixels than in the original.
    is_pushed: bool,
    mask: Option<Prepared<'a>>,
}

impl<'a> Group<'a> {
    /// The groups of a frame of plans. None if all promise the same.
    pub fn of(plans: &[Plan]) -> Vec<Self> {
        let mut groups: Vec<Self> = Vec::new();
        let drawn: Vec<Promise> = plans.iter().map(|p| Promise::of([p])).collect();
        for promise in &drawn {
            if groups.iter().any(|g| g.promise == *promise) {
                continue;
            }
            let members: Vec<bool> = drawn.iter().map(|p| p == promise).collect();
            let outside = || plans.iter().zip(&members).filter(|(_, m)| !**m);
            groups.push(Self {
                promise: promise.clone(),
                is_pushed: outside().any(|(plan, _)| may_cover_otherwise(plan)),
                members,
                mask: None,
            });
        }
        match groups.len() {
            0 | 1 => Vec::new(),
            _ => groups,
        }
    }

    /// How a picture breaks the group's promise where the nearest fragment of the original is the
    /// group's; `None`: it does not.
    pub fn broken(
        &mut self,
        session: &'a Session<'a>,
        (frame, order): (&Frame, DrawOrder),
        [reference, picture]: [&Rendered; 2],
    ) -> Result<Option<Broke>, Error> {
        let mask = match &mut self.mask {
            Some(mask) => mask,
            none => none.insert(mask(session, &self.members)?),
        };
        mask.aim(frame, order);
        let Some(mut owned) = mask.render_red()? else {
            return Ok(None);
        };
        if session.scene().rows == Rows::FromBottom {
            owned.turn_over();
        }
        let mut owned: Vec<bool> = owned.values.iter().map(|v| *v > 0.5).collect();
        if self.is_pushed {
            let direction = session.scene().depth_direction;
            leave_out_nearer(&mut owned, [reference, picture], direction);
        }
        let own = only(&owned, [reference, picture]);
        let error = compare(reference, &own)?;
        Ok(self.promise.broken(&error).map(|how| {
            let names = session.originals().iter().zip(&self.members);
            let names = names.filter(|(_, is_member)| **is_member);
            let names: Vec<String> = names.map(|(p, _)| format!("`{}`", p.material)).collect();
            Broke {
                how: format!(
                    "{how}, in what the original shows of {}, whose own promise is `{}`",
                    names.join(", "),
                    self.promise.contract.kind()
                ),
                promise: self.promise.clone(),
                picture: Some(own),
            }
        }))
    }
}

/// Whether a plan may cover other pixels than its original: its positions move, or a discard
/// depends on an approximated value.
fn may_cover_otherwise(plan: &Plan) -> bool {
    let turns = match &plan.contract {
        Contract::Exact { .. } => false,
        Contract::Rounding { turned, .. } => turned.is_some(),
        Contract::Approximate { .. } | Contract::Budgets { .. } => discards(plan),
    };
    turns || !keeps_positions(plan)
}

/// A frame that draws 1 where the nearest fragment is of a member, and 0 elsewhere.
fn mask<'a>(session: &'a Session<'a>, members: &[bool]) -> Result<Prepared<'a>, Error> {
    let zero = BlendComponent {
        src: BlendFactor::Zero,
        dst: BlendFactor::Zero,
        operation: BlendOperation::Add,
    };
    let format = super::shading::count_format(session.gpu(), session.originals());
    let mut plans = Vec::new();
    for (plan, is_member) in session.originals().iter().zip(members) {
        // A blended material joins its colour to the one below. So it owns no pixel, and takes the
        // pixels that it covers from others.
        let is_blended = plan.passes.iter().any(|pass| pass.phase == Phase::Blended);
        let mut plan = match is_blended {
            false => counting_plan(plan, format, &counting)?,
            true => {
                let mut opaque = plan.clone();
                for pass in &mut opaque.passes {
                    pass.phase = Phase::Opaque;
                }
                let all = |_: &Plan, _: &_| CountProgram::Constant;
                let mut plan = counting_plan(&opaque, format, &all)?;
                for pass in &mut plan.passes {
                    pass.phase = Phase::Blended;
                }
                plan
            }
        };
        let targets = plan.passes.iter_mut().flat_map(|pass| &mut pass.targets);
        for target in targets.flatten().filter(|t| t.blend.is_some()) {
            target.blend = (!is_member).then_some(Blend {
                color: zero,
                alpha: zero,
            });
            if *is_member && is_blended {
                target.write_mask = 0;
            }
        }
        plans.push(plan);
    }
    let variant = preshade_scenes::variant(&plans, session.form())?;
    let settings = FrameSettings {
        clear_color: [0.0; 4],
        initial_colors: false,
    };
    let prepared = Prepared::new(session.inputs(), &variant, &settings)?;
    Ok(prepared.keeping_samples())
}

/// Leaves out the samples whose depth is nearer in the picture than in the original: another
/// material's fragment may have come before the owner's. Without depths nothing is left.
fn leave_out_nearer(
    owned: &mut [bool],
    [reference, picture]: [&Rendered; 2],
    direction: DepthDirection,
) {
    let depths = reference.depth.as_ref().zip(picture.depth.as_ref());
    for (i, is_owned) in owned.iter_mut().enumerate() {
        let at = |depth: &DepthImage| depth.values.get(i).copied();
        let pair = depths.and_then(|(a, b)| Some((at(a)?, at(b)?)));
        let is_nearer = |(a, b): (f32, f32)| match direction {
            DepthDirection::Forward => b < a,
            DepthDirection::Reversed => b > a,
        };
        *is_owned &= pair.is_some_and(|pair| !is_nearer(pair));
    }
}

/// The picture where samples are owned, and the reference elsewhere. A pixel is owned if all of its
/// samples are.
pub(super) fn only(owned: &[bool], [reference, picture]: [&Rendered; 2]) -> Rendered {
    let mut own = picture.clone();
    for (image, original) in own.colors.iter_mut().zip(&reference.colors) {
        let (Some(image), Some(original)) = (image, original) else {
            continue;
        };
        let texel = image.texel_bytes();
        let pixels = image.bytes.len() / texel.max(1);
        let samples = (owned.len() / pixels.max(1)).max(1);
        for (i, samples) in owned.chunks(samples).enumerate() {
            if !samples.iter().all(|is_owned| *is_owned) {
                let range = i * texel..(i + 1) * texel;
                if let (Some(to), Some(from)) = (
                    image.bytes.get_mut(range.clone()),
                    original.bytes.get(range),
                ) {
                    to.copy_from_slice(from);
                }
            }
        }
    }
    if let (Some(depth), Some(original)) = (&mut own.depth, &reference.depth) {
        let values = depth.values.iter_mut().zip(&original.values);
        for ((value, original), is_owned) in values.zip(owned) {
            if !is_owned {
                *value = *original;
            }
        }
    }
    own
}
