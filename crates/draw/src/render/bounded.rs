//! Draws bounded copies of shaders whose loops may not end before the frame itself, so that no loop
//! hangs the GPU.

use std::sync::atomic::Ordering;
use std::sync::{Mutex, PoisonError};

use preshade_plan::plan::{
    BindingKind, BindingSource, BindingUse, FrameBuffer, FrameWords, GeometryPart, Plan,
};
use preshade_plan::reflect;
use preshade_plan::safety::{Bounded, MOST_TURNS};
use preshade_plan::uniforms::UniformScalar;

use super::inputs::SceneInputs;
use super::shader::{Bound, Variant};
use super::{Error, FrameSettings, Prepared};
use crate::scene::bind;

/// The frame's buffer that bounded copies write to.
const BUFFER: &str = "preshade_loops";

/// A loop that counts up to a uniform of at most this value needs no guard.
const SMALL: f64 = MOST_TURNS as f64;

/// A frame of bounded copies.
pub(super) struct Guard<'a> {
    frame: Box<Prepared<'a>>,
    /// Descriptions of the loops by number, from 1.
    loops: Vec<String>,
    /// [`SceneInputs::serial`] of the last frame in which all copies ended.
    ended: Mutex<Option<u64>>,
}

impl<'a> Guard<'a> {
    /// The guard of a variant. `None` if all loops end.
    ///
    /// # Errors
    /// As [`Prepared::new`].
    pub fn new(
        inputs: &'a SceneInputs<'a>,
        variant: &Variant,
        settings: &FrameSettings,
    ) -> Result<Option<Self>, Error> {
        let mut loops = Vec::new();
        let mut plans = Vec::new();
        let Some((open, bound)) = variant.looping() else {
            return Ok(None);
        };
        for plan in open {
            let is_small = |scalar: &UniformScalar| is_small(inputs, &plan.material, scalar);
            plans.push(bounded_plan(plan, *bound, &mut loops, &is_small)?);
        }
        if loops.is_empty() {
            return Ok(None);
        }
        let copies = Variant::bounded(&plans)?.in_passes(variant.frame().passes.clone());
        let frame = Prepared::new(inputs, &copies, settings)?;
        let this = Self {
            frame: Box::new(frame),
            loops,
            ended: Mutex::new(None),
        };
        // Some copies run while the frame is built.
        this.tell()?;
        Ok(Some(this))
    }

    /// Draws the copies, unless all of them already ended in this frame of the scene.
    ///
    /// # Errors
    /// [`Error::Endless`], or as [`Prepared::draw`].
    pub fn check(&self) -> Result<(), Error> {
        let now = self.frame.inputs().serial.load(Ordering::Relaxed);
        let mut ended = self.ended.lock().unwrap_or_else(PoisonError::into_inner);
        if *ended == Some(now) {
            return Ok(());
        }
        self.frame.draw()?;
        self.tell()?;
        *ended = Some(now);
        Ok(())
    }

    fn tell(&self) -> Result<(), Error> {
        let met = self.frame.first_word(BUFFER)?;
        match met.checked_sub(1) {
            None => Ok(()),
            Some(i) => Err(Error::Endless {
                which: self.loops.get(i as usize).or(self.loops.first()).cloned(),
            }),
        }
    }
}

/// A plan in which bounded copies replace the programs that need them. Adds their loops to `loops`.
fn bounded_plan(
    plan: &Plan,
    bound: Bound,
    loops: &mut Vec<String>,
    is_small: &dyn Fn(&UniformScalar) -> bool,
) -> Result<Plan, Error> {
    let mut copy = plan.clone();
    copy.original = None;
    for (key, program) in &plan.programs {
        let first = loops.len() as u32 + 1;
        let made = bound(program, first, is_small).map_err(|e| Error::Plan {
            material: plan.material.clone(),
            message: format!("its bounded copy `{key}` is invalid: {e}"),
        })?;
        let Some(Bounded {
            program,
            binding,
            loops: found,
        }) = made
        else {
            continue;
        };
        loops.extend(found);
        let part = GeometryPart::Frame {
            buffer: BUFFER.to_owned(),
        };
        let flag = BindingUse::new(
            [binding.group, binding.binding],
            BindingKind::StorageReadWrite,
            BindingSource::Geometry { part },
        );
        for pass in copy.passes.iter_mut().filter(|p| p.program == *key) {
            pass.bindings.push(flag.clone());
            reflect::fill(pass, &program);
        }
        for pass in copy.compute.iter_mut().filter(|p| p.program == *key) {
            pass.bindings.push(flag.clone());
            reflect::fill_compute(pass, &program);
        }
        copy.programs.insert(key.clone(), program);
    }
    copy.frame_buffers.push(FrameBuffer {
        name: BUFFER.to_owned(),
        holds: FrameWords::Draws,
    });
    Ok(copy)
}

/// Whether a uniform of a material is at most [`SMALL`] in every draw and frame of the scene.
fn is_small(inputs: &SceneInputs<'_>, material: &str, scalar: &UniformScalar) -> bool {
    let scene = inputs.scene();
    let Some(index) = scene.materials.iter().position(|m| m.name == material) else {
        return false;
    };
    let (of, pass) = (&scene.materials[index], inputs.authored(index));
    let mut draws = scene.draws.iter().filter(|d| d.material == index);
    let frame = scene.frames().next();
    draws.all(|draw| {
        let bound = frame
            .and_then(|(_, frame)| bind::uniform_buffers(scene, of, pass?, draw, frame).ok())
            .unwrap_or_default();
        let at = |b: &&bind::BufferBinding| {
            (b.group, b.binding) == (scalar.group, scalar.binding) && b.rate != bind::Rate::Frame
        };
        let number = bound.iter().find(at).and_then(|b| {
            let bytes = b.data.bytes.get(scalar.offset as usize..)?;
            Some(scalar.ty.read(*bytes.first_chunk::<4>()?))
        });
        number.is_some_and(|n| n <= SMALL)
    })
}
