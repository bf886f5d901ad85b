//! A scene on an adapter: uploaded once, and then drawn, counted and timed as often as you like.

use preshade_plan::plan::Plan;

use super::originals;
use preshade_draw::render::{self, FrameSettings, Gpu, Prepared, Rendered, SceneInputs};
use preshade_draw::scene::{DrawOrder, Frame, Scene};
use preshade_scenes::ShaderForm;

/// A scene on an adapter.
#[derive(Debug)]
pub struct Session<'a> {
    inputs: SceneInputs<'a>,
    originals: Vec<Plan>,
    form: ShaderForm,
}

impl<'a> Session<'a> {
    /// Uploads `scene`. Shaders reach the driver in `form`.
    pub fn new(gpu: &'a Gpu, scene: &'a Scene, form: ShaderForm) -> Result<Self, render::Error> {
        Ok(Self {
            inputs: SceneInputs::new(gpu, scene)?,
            originals: originals(scene),
            form,
        })
    }

    /// As [`Self::new`], for a search: its frames share shaders and pipelines, so that their
    /// [`Prepared::creation`] is shorter than a host's.
    pub fn sharing(
        gpu: &'a Gpu,
        scene: &'a Scene,
        form: ShaderForm,
    ) -> Result<Self, render::Error> {
        let session = Self::new(gpu, scene, form)?;
        Ok(Self {
            inputs: session.inputs.sharing(),
            ..session
        })
    }

    pub fn gpu(&self) -> &'a Gpu {
        self.inputs.gpu()
    }

    pub fn scene(&self) -> &'a Scene {
        self.inputs.scene()
    }

    pub fn inputs(&self) -> &SceneInputs<'a> {
        &self.inputs
    }

    /// The plans that draw each material as its author wrote it.
    pub fn originals(&self) -> &[Plan] {
        &self.originals
    }

    /// The form in which shaders reach the driver.
    pub fn form(&self) -> ShaderForm {
        self.form
    }

    /// Builds everything that drawing `plans` needs, one plan a material.
    pub fn prepare(&self, plans: &[Plan]) -> Result<Prepared<'_>, render::Error> {
        let variant = preshade_scenes::variant(plans, self.form)?;
        Prepared::new(&self.inputs, &variant, &FrameSettings::of(self.scene()))
    }

    /// Draws one frame and reads it back.
    pub fn draw(
        &self,
        prepared: &mut Prepared<'_>,
        frame: &Frame,
        order: DrawOrder,
    ) -> Result<Rendered, render::Error> {
        self.inputs.set_frame(frame)?;
        prepared.aim(frame, order);
        prepared.render()
    }

    /// Draws `plans` in each of `frames`.
    pub fn pictures(
        &self,
        plans: &[Plan],
        frames: &[&Frame],
        order: DrawOrder,
    ) -> Result<Vec<Rendered>, render::Error> {
        let mut prepared = self.prepare(plans)?;
        let mut draw = |frame: &&Frame| self.draw(&mut prepared, frame, order);
        frames.iter().map(&mut draw).collect()
    }
}
