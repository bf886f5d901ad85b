//! `agree --scene`: draws both programs in a scene.

use std::path::{Path, PathBuf};
use std::time::Duration;

use preshade_draw::scene::Scene;
use preshade_lab::measure::{Beside, Look, TimingSettings, parse_seconds};
use preshade_plan::plan::Plan;
use preshade_scenes::StandIn;
use preshade_scenes::Variables;
use preshade_validate::agree::{Partner, Relation};

use crate::input::ShaderArgs;
use crate::view::ViewArgs;
use crate::{Failure, output, worker};
use preshade_lab::report::picture::file_name;

/// The scene of `agree`.
#[derive(clap::Args)]
pub struct SceneArgs {
    /// Also draw both programs in this scene, from each of its cameras or from its light, and time
    /// them. The first program is that of a material. A material with the second, if there is one,
    /// has the values of what has no partner.
    #[arg(long, value_name = "FILE", conflicts_with = "pairs")]
    pub scene: Option<PathBuf>,
    /// Folder for the pictures of --scene: `CAMERA.first.png` and `CAMERA.difference.png`.
    #[arg(short, long, alias = "output", value_name = "DIR", requires = "scene")]
    out: Option<PathBuf>,
    #[command(flatten)]
    view: ViewArgs,
    /// Seconds to spend on timing both programs; 0 times nothing.
    #[arg(long, value_name = "SECONDS", default_value_t = 4.0, value_parser = parse_seconds)]
    seconds: f64,
    /// Part of an adapter's name, driver or backend.
    #[arg(long, value_name = "TEXT", requires = "scene")]
    adapter: Option<String>,
}

impl SceneArgs {
    /// Whether an argument for a scene is given without a scene.
    pub fn check(&self) -> Result<(), Failure> {
        match self.scene.is_none() && self.view.is_given() {
            true => Err(Failure(
                "error: --camera and --size are for --scene".to_owned(),
            )),
            false => Ok(()),
        }
    }

    /// Draws both programs, if there is a scene.
    pub fn drawn(
        &self,
        [shader, theirs]: [&ShaderArgs; 2],
        [first, second]: [&Plan; 2],
        relation: Relation,
        partners: &[Partner],
    ) -> Result<Vec<Beside>, Failure> {
        let Some(path) = &self.scene else {
            return Ok(Vec::new());
        };
        let scene = preshade_scenes::load_within(path, &Variables::new(), shader.limits.access())
            .map_err(|e| Failure(e.render()))?;
        let mut scene = self.view.of(scene)?;
        let index = material(&scene, path, shader)?;
        let own = with_shader(&scene, theirs).map(|i| scene.materials[i].clone());
        scene = scene.only(index);
        let of = |plan: &'_ Plan| {
            plan.main()
                .and_then(|p| Some((p.clone(), plan.program(p)?.clone())))
        };
        let (Some((pass, program)), Some((other, other_program))) = (of(first), of(second)) else {
            return Ok(Vec::new());
        };
        for own in &mut scene.materials {
            own.program.clone_from(&program);
            own.vertex.clone_from(&pass.vertex);
            own.fragment.clone_from(&pass.fragment);
        }
        let gpu = worker::open(self.adapter.as_deref(), &shader.limits.limits())?;
        let stand_in = StandIn {
            program: &other_program,
            vertex: &other.vertex,
            fragment: other.fragment.as_deref(),
            partners,
            own: own.as_ref(),
        };
        let timing = TimingSettings {
            budget: Duration::from_secs_f64(self.seconds),
            ..TimingSettings::default()
        };
        let timing = Some(&timing).filter(|_| self.seconds > 0.0);
        let drawn =
            preshade_lab::measure::comparison(&gpu, &scene, stand_in, Look::of(relation), timing)?;
        self.write(&drawn)?;
        Ok(drawn)
    }

    fn write(&self, drawn: &[Beside]) -> Result<(), Failure> {
        let Some(folder) = &self.out else {
            return Ok(());
        };
        let mut files = Vec::new();
        for beside in drawn {
            let pictures = beside.pictures.iter().flatten();
            for (picture, what) in pictures.zip(["first", "difference"]) {
                let name = format!("{}.{what}.png", file_name(&beside.camera));
                files.push(
                    picture
                        .file(&name)
                        .map_err(|e| Failure(format!("error: {name}: {e}")))?,
                );
            }
        }
        let written = shader_text::files::write(folder, &files)?;
        for path in written {
            output::message(&format!("wrote {}", path.display()));
        }
        Ok(())
    }
}

/// The scene's material with the first program: the one of its file, or the only one.
fn material(scene: &Scene, path: &Path, shader: &ShaderArgs) -> Result<usize, Failure> {
    if let Some(index) = with_shader(scene, shader) {
        return Ok(index);
    }
    match &scene.materials[..] {
        [_] => Ok(0),
        all => {
            let names: Vec<&str> = all.iter().map(|m| m.name.as_str()).collect();
            let files: Vec<String> = shader
                .files
                .iter()
                .map(|f| f.display().to_string())
                .collect();
            Err(Failure(format!(
                "error: no material of {} has {} as its shader: {}",
                path.display(),
                files.join(","),
                names.join(", ")
            )))
        }
    }
}

/// The material of a scene whose shader is the first file of a side.
fn with_shader(scene: &Scene, shader: &ShaderArgs) -> Option<usize> {
    let full = |path: &Path| path.canonicalize().ok();
    let given = shader.files.first().and_then(|f| full(f))?;
    let is_it = |file: &PathBuf| full(file).is_some_and(|f| f == given);
    let mut materials = scene.materials.iter();
    materials.position(|m| m.file.as_ref().is_some_and(is_it))
}
