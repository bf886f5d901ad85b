//! Scenes measured one after the other: what is measured of each is kept on the way, and one that fails takes no other with it.

use std::path::Path;

use preshade::decide::{SceneSoFar, Unfinished, so_far};
use preshade::render::{AdapterChoice, Gpu};

use crate::Failure;
use crate::keeper::Keeper;
use crate::output;

/// What is known of the scenes of a run.
pub struct Kept {
    unfinished: Unfinished,
    keeper: Keeper,
    scenes: usize,
    failed: Vec<String>,
}

impl Kept {
    /// Of a run over `scenes`, kept in `folder` if there is one.
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

    /// Keeps what was measured of a scene of this name so far.
    pub fn keep(&mut self, scene: &str, so_far: &SceneSoFar) {
        self.unfinished.take(SceneSoFar {
            scene: scene.to_owned(),
            ..so_far.clone()
        });
        self.write();
    }

    /// Tells why a scene comes to no end; the run goes on with the next one.
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
            self.keeper.keep(so_far::FILE, json);
        }
    }

    /// The run is over. Nothing is unfinished any more, unless a scene failed: then what was measured of it stays.
    ///
    /// # Errors
    /// Which scenes failed.
    pub fn end(&self) -> Result<(), Failure> {
        if self.failed.is_empty() {
            self.keeper.done();
            return Ok(());
        }
        let (failed, scenes) = (self.failed.len(), self.scenes);
        let names = self.failed.join(", ");
        let error = format!("error: {failed} of {scenes} scenes came to no end: {names}");
        Err(self.keeper.named(Failure(error)))
    }

    /// The failure of a run's only scene, with what is kept of it.
    pub fn named(&self, failure: Failure) -> Failure {
        self.keeper.named(failure)
    }
}

/// Opens an adapter in place of one that was lost, if it was.
///
/// # Errors
/// There is none any more.
pub fn reopened(gpu: &mut Gpu, choice: &AdapterChoice) -> Result<(), Failure> {
    let Some(why) = gpu.lost() else { return Ok(()) };
    output::message(&format!(
        "warning: the graphics device was lost: {why}; the rest is measured on a new one"
    ));
    let new = Gpu::with_trust(choice, gpu.trust())?;
    // Closing one that hangs may hang.
    std::mem::forget(std::mem::replace(gpu, new));
    Ok(())
}
