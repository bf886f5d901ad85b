//! Whether a scene's pictures can tell anything: of a picture of one colour nothing can be wrong but the outline.

use std::collections::BTreeSet;

use preshade_passes::plan::Plan;
use preshade_passes::state::CullMode;

use super::{CountProgram, Counter, Error};
use crate::render::{Rendered, SceneInputs, ShaderForm};
use crate::scene::bind::{Guess, Guessed};
use crate::scene::{DrawOrder, Frame};

/// The colours that were seen, as far as they are few.
#[derive(Clone, Debug, Default)]
pub(crate) struct Colours {
    seen: BTreeSet<[u8; 4]>,
    pictures: usize,
}

/// One for the surfaces, one for what is behind them.
const PLAIN: usize = 2;

impl Colours {
    /// Looks at what was drawn. A frame without a colour target says nothing.
    pub(crate) fn look(&mut self, drawn: &Rendered) {
        let Some(Some(image)) = drawn.colors.first() else {
            return;
        };
        self.pictures += 1;
        if self.seen.len() > PLAIN {
            return;
        }
        for texel in image.to_rgba8().as_chunks::<4>().0 {
            self.seen.insert(*texel);
            if self.seen.len() > PLAIN {
                return;
            }
        }
    }

    /// What to say of pictures in which no colour can be wrong.
    pub(crate) fn warning(&self) -> Option<String> {
        (self.pictures > 0 && self.seen.len() <= PLAIN).then(|| {
            "every picture of the original has one colour in front of another: no wrong colour would be seen, so that what holds here was tested for its outline alone"
                .to_owned()
        })
    }
}

/// What to say of attributes that a material reads and no mesh has.
pub(crate) fn missing_attributes(guessed: &[Guessed]) -> Vec<String> {
    let missing = guessed
        .iter()
        .filter(|g| g.guess == Guess::AttributeSynthesised);
    missing
        .map(|g| {
            format!(
                "`{}` reads the vertex attribute `{}`, which its mesh does not have: it is the same made-up value at every vertex",
                g.material, g.name
            )
        })
        .collect()
}

/// Whether something is seen once no face is dropped: every triangle faces away. `plans` are the original ones.
pub(crate) fn faces_away(
    inputs: &SceneInputs<'_>,
    plans: &[Plan],
    form: ShaderForm,
    count: &dyn Fn(&Plan, &preshade_passes::plan::GpuPass) -> CountProgram,
    frames: &[(&Frame, DrawOrder)],
) -> Result<bool, Error> {
    let culls = |plan: &Plan| {
        plan.passes
            .iter()
            .any(|p| p.primitive.cull != CullMode::None)
    };
    if !plans.iter().any(culls) {
        return Ok(false);
    }
    let mut open = plans.to_vec();
    for pass in open.iter_mut().flat_map(|p| &mut p.passes) {
        pass.primitive.cull = CullMode::None;
    }
    let mut counter = Counter::shaded(inputs, &open, form, count)?;
    for (frame, order) in frames {
        inputs.set_frame(frame)?;
        if counter.count(frame, *order)?.covered > 0 {
            return Ok(true);
        }
    }
    Ok(false)
}

/// What to say of a scene in which every triangle faces away.
pub(crate) const FACES_AWAY: &str = "every triangle faces away and is culled: draw both sides (`--cull none`, or `state.primitive.cull = \"none\"` in a scene), or say which side is the front (`front_face`)";
