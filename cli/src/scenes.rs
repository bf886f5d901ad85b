//! Scenes measured one after the other. Keeps the results of each on the way. A failing scene does
//! not stop the others.

use std::path::Path;

use preshade_draw::render::Gpu;
use preshade_lab::search::plan::{SceneSoFar, Unfinished, partial_results};

use crate::saved_results::Keeper;
use crate::{Failure, output};

/// The results of the scenes of a run.
pub struct KeptScenes {
    unfinished: Unfinished,
    keeper: Keeper,
    scenes: usize,
    failed: Vec<String>,
}

impl KeptScenes {
    /// For a run over `scenes`, written to `folder` if there is one.
    pub fn new(folder: Option<&Path>, gpu: &Gpu, scenes: Vec<String>) -> Self {
        let count = scenes.len();
        let command = crate::verify::command();
        Self {
            unfinished: Unfinished::new(command, gpu.adapter().clone(), scenes),
            keeper: Keeper::new(folder),
            scenes: count,
            failed: Vec::new(),
        }
    }

    /// Keeps the results of a scene so far.
    pub fn keep(&mut self, scene: &str, so_far: &SceneSoFar) {
        self.unfinished.take(SceneSoFar {
            scene: scene.to_owned(),
            ..so_far.clone()
        });
        self.write();
    }

    /// Reports why a scene failed. The run continues with the next one.
    pub fn fail(&mut self, scene: &str, Failure(why): Failure) {
        let why = why.strip_prefix("error: ").unwrap_or(&why).trim_end();
        output::message(&format!("error: {scene}: {why}"));
        self.unfinished.fail(scene, why);
        self.failed.push(scene.to_owned());
        self.write();
    }

    fn write(&mut self) {
        // These types give no error.
        if let Ok(json) = self.unfinished.to_json() {
            self.keeper.keep(partial_results::FILE, json);
        }
    }

    /// Ends the run and removes its file, unless a scene failed.
    pub fn end(&self) -> Result<(), Failure> {
        if self.failed.is_empty() {
            self.keeper.done();
            return Ok(());
        }
        let failure = Failure::of_inputs(&self.failed, self.scenes);
        Err(self.keeper.named(failure))
    }

    /// The failure of a run's only scene, with the files that have its results.
    pub fn named(&self, failure: Failure) -> Failure {
        self.keeper.named(failure)
    }
}

/// Opens an adapter in place of one that was lost, if it was.
pub fn reopened(gpu: &mut Gpu, open: impl FnOnce() -> Result<Gpu, Failure>) -> Result<(), Failure> {
    let Some(why) = gpu.lost() else { return Ok(()) };
    output::message(&format!(
        "warning: the graphics device was lost: {why}; the rest is measured on a new one"
    ));
    gpu.end_turns();
    // Closing one that hangs may hang.
    std::mem::forget(std::mem::replace(gpu, open()?));
    Ok(())
}
