//! Arguments of every command that takes a shader: files, entry points, pipeline state.

use std::io::Read;
use std::path::{Path, PathBuf};

use clap::builder::{PathBufValueParser, TypedValueParser};
use naga::{Binding, ShaderStage};
use naga_edit::interface;
use preshade_compiler::command::material::{define, name_of, reads_facing};
use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_draw::render::{Gpu, Rendered};
use preshade_draw::scene::{self, Material, Scene};
use preshade_frames::file::Api;
use preshade_frames::folder::Capture;
use preshade_lab::measure;
use preshade_lab::measure::record::Pictures;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::state::{CullMode, MaterialState};
use preshade_scenes::{Variable, Variables, capture};
use shader_text::source::Language;
use shader_text::{options, read_limited};

use crate::file_names::{self, captured, from_here, is_gltf, is_scene, is_stdin};
use crate::limits::LimitArgs;
use crate::state::StateArgs;
use crate::{Failure, output, worker};

/// A shader and its pipeline state, or a scene.
#[derive(Clone, Default, clap::Args)]
pub struct ShaderArgs {
    /// A WGSL or SPIR-V file with both entry points, or a vertex and a fragment file, or a scene
    /// (.toml, a glTF file, or the folder of a captured frame); `-` is stdin and needs --lang.
    #[arg(required = true, num_args = 1.., value_name = "FILE", value_parser = given())]
    pub files: Vec<PathBuf>,
    /// Language of the input. Required for stdin; default: by the file's ending (.wgsl, or .vert,
    /// .vs, .frag, .fs or .glsl for GLSL, .spv for SPIR-V).
    #[arg(long, value_enum)]
    pub lang: Option<Lang>,
    /// Vertex entry point, if the shader has several.
    #[arg(long, value_name = "NAME")]
    pub vertex: Option<String>,
    /// Fragment entry point, if the shader has several.
    #[arg(long, value_name = "NAME")]
    pub fragment: Option<String>,
    /// Name of a shader's material; default: the file's.
    #[arg(long)]
    pub name: Option<String>,
    /// Set a variable of a scene; may be given several times.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    pub set: Vec<String>,
    #[command(flatten)]
    pub capture: FrameArgs,
    /// Part of the name of the adapter that replays a capture.
    #[arg(skip)]
    pub replay_on: Option<String>,
    /// With a scene or a captured frame, the name of the material to take. With a glTF file, the
    /// shader that draws it in place of the built-in material.
    #[arg(long, value_name = "NAME|FILE", conflicts_with = "materials")]
    pub material: Option<PathBuf>,
    /// Draw a glTF file with the `[materials]` of this TOML file, each by the name of one of the glTF
    /// file's ("*": all others).
    #[arg(long, value_name = "FILE")]
    pub materials: Option<PathBuf>,
    #[command(flatten)]
    pub glsl: GlslArgs,
    #[command(flatten)]
    pub limits: LimitArgs,
    #[command(flatten)]
    pub state: StateArgs,
}

/// The part of a capture to draw.
#[derive(Clone, Default, clap::Args)]
pub struct FrameArgs {
    /// With a capture of several frames, the frame to take, from 0.
    #[arg(long, value_name = "N", default_value_t = 0)]
    frame: usize,
    /// With a capture, the render pass of the frame to take, from 0; default: the one that takes
    /// longest, or of `rewrite` the one that draws most vertices to a colour target.
    #[arg(long, value_name = "N")]
    render_pass: Option<usize>,
}

impl FrameArgs {
    fn choice(&self) -> capture::Choice {
        capture::Choice {
            frame: self.frame,
            pass: self.render_pass,
        }
    }
}

/// A path as given. The folder of a captured frame stands for its file.
pub fn given() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().map(|path| match preshade_frames::folder::is_folder(&path) {
        true => preshade_frames::folder::file_of(&path),
        false => path,
    })
}

/// Options for GLSL, and for WGSL with imports.
#[derive(Clone, Default, clap::Args)]
#[command(next_help_heading = "GLSL, and WGSL with imports")]
pub struct GlslArgs {
    /// A folder to search for #include (after the including file's own), and for modules of #import
    /// and WESL; may be given several times.
    #[arg(long, value_name = "DIR")]
    pub include: Vec<PathBuf>,
    /// Define a macro (as 1 without a value), or a condition of #ifdef and @if; may be given
    /// several times.
    #[arg(long, value_name = "NAME[=VALUE]")]
    pub define: Vec<String>,
    /// Depth range of clip space that the shader writes; default: OpenGL's, or Vulkan's for its
    /// GLSL.
    #[arg(long, value_enum, value_name = "RANGE")]
    pub clip: Option<Clip>,
}

/// Depth of clip space.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Clip {
    /// WebGPU's and Vulkan's.
    ZeroToOne,
    /// OpenGL's.
    MinusOneToOne,
}

impl GlslArgs {
    /// The definitions, name and value.
    fn defines(&self) -> Result<Vec<(String, String)>, Failure> {
        let all = self.define.iter().map(|text| define(text));
        all.collect::<Result<_, _>>()
            .map_err(|e| Failure(format!("error: {e}")))
    }

    fn clip_space(&self) -> Option<options::ClipSpace> {
        self.clip.map(|clip| match clip {
            Clip::ZeroToOne => options::ClipSpace::AsWritten,
            Clip::MinusOneToOne => options::ClipSpace::OpenGl,
        })
    }
}

/// Source language.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Lang {
    /// WebGPU Shading Language.
    Wgsl,
    /// GLSL of any version: desktop, ES and WebGL, Vulkan's, three.js's.
    Glsl,
    /// A SPIR-V module, which is known by its first word.
    Spirv,
}

impl From<Lang> for Language {
    fn from(lang: Lang) -> Self {
        match lang {
            Lang::Wgsl => Self::Wgsl,
            Lang::Glsl => Self::Glsl,
            Lang::Spirv => Self::SpirV,
        }
    }
}

/// How a command uses its input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Purpose {
    Read,
    /// It draws the scene, so textures that a captured frame drew are replayed.
    Draw,
}

pub enum Input {
    Shader(front::Parsed, MaterialState),
    /// A scene, with the requested depth format, direction and sample count.
    Scene(Box<Scene>),
}

/// The original plans of materials.
pub struct Materials {
    /// The requested ones: a shader's material, or a scene's materials, or the one that `--material`
    /// selects.
    pub asked: Vec<Plan>,
    /// All materials of the frame, the requested ones among them.
    pub frame: Vec<Plan>,
    /// Facts that a scene provides without being drawn, as far as the recipe needs them.
    pub known: Facts,
    pub files: Vec<PathBuf>,
    /// The scene they are of; `None` for a shader.
    pub scene: Option<Box<Scene>>,
}

impl ShaderArgs {
    /// The original plan of each material, and the facts for `recipe`.
    pub fn plans(&self, recipe: &Recipe) -> Result<Materials, Failure> {
        self.plans_of(self.input()?, recipe)
    }

    /// The same. If `recipe` specialises, each group of draws that needs its own version is a
    /// material.
    pub fn plans_by_draws(&self, recipe: &Recipe) -> Result<Materials, Failure> {
        let input = match self.input()? {
            Input::Scene(scene) => Input::Scene(Box::new(measure::grouped_for(*scene, recipe)?)),
            shader @ Input::Shader(..) => shader,
        };
        self.plans_of(input, recipe)
    }

    fn plans_of(&self, input: Input, recipe: &Recipe) -> Result<Materials, Failure> {
        let mut files = self.given();
        let scene = match input {
            Input::Shader(parsed, state) => {
                files.extend(self.included(&parsed));
                let plan = parsed.plan(&self.material_name(), &state);
                recipe.check_names(std::slice::from_ref(&plan))?;
                return Ok(Materials {
                    asked: vec![plan.clone()],
                    frame: vec![plan],
                    known: Facts::default(),
                    files,
                    scene: None,
                });
            }
            Input::Scene(scene) => scene,
        };
        files.extend(scene.files.iter().cloned());
        let plans = measure::originals(&scene);
        let known = measure::known_for(&scene, recipe);
        let asked = match self.chosen() {
            None => plans.clone(),
            Some(name) => {
                // Or its groups of draws.
                let of_name =
                    |m: &Material| m.name == *name || m.part_of.as_deref() == Some(name.as_ref());
                let each = scene.materials.iter().zip(&plans);
                let found = each.filter(|(m, _)| of_name(m));
                let found: Vec<Plan> = found.map(|(_, plan)| plan.clone()).collect();
                if found.is_empty() {
                    let names: Vec<&str> = plans.iter().map(|p| p.material.as_str()).collect();
                    return Err(Failure::unknown("material", &name, &names));
                }
                found
            }
        };
        recipe.check_names(&asked)?;
        Ok(Materials {
            asked,
            frame: plans,
            known,
            files,
            scene: Some(scene),
        })
    }

    /// The effects that a scene's draws use. Empty for a shader.
    pub fn effects(&self) -> Result<Vec<preshade_compiler::command::explain::EffectUse>, Failure> {
        Ok(match self.input()? {
            Input::Shader(..) => Vec::new(),
            Input::Scene(scene) => measure::effects(&scene).unwrap_or_default(),
        })
    }

    /// The given files, without stdin.
    fn given(&self) -> Vec<PathBuf> {
        let shader = self.material.iter().filter(|_| self.chosen().is_none());
        let more = shader.chain(&self.materials);
        let files = self.files.iter().chain(&self.state.state).chain(more);
        files.filter(|f| !is_stdin(f)).cloned().collect()
    }

    /// The files that a command with these arguments reads, even if it fails.
    pub fn reads(&self) -> Vec<PathBuf> {
        let mut files = self.given();
        match self.input() {
            Ok(Input::Scene(scene)) => files.extend(scene.files),
            Ok(Input::Shader(parsed, _)) => files.extend(self.included(&parsed)),
            Err(_) => {}
        }
        files
    }

    /// The included files of a shader.
    fn included(&self, parsed: &front::Parsed) -> Vec<PathBuf> {
        // They follow the given files. A missing path was found in another folder.
        let all = parsed.program.sources().files().iter();
        let path = |name: &str| from_here(Path::new(name)).to_owned();
        let included = all.skip(self.files.len()).map(|f| path(&f.name));
        let mut found: Vec<PathBuf> = Vec::new();
        for file in included.filter(|f| f.is_file()) {
            let is_same = |known: &PathBuf| {
                *known == file
                    || known
                        .canonicalize()
                        .is_ok_and(|k| file.canonicalize().is_ok_and(|f| f == k))
            };
            if !found.iter().any(is_same) {
                found.push(file);
            }
        }
        found
    }

    /// Whether the files can be parsed but lack an entry point of a material: functions to include,
    /// or a compute shader.
    pub fn is_no_material(&self) -> bool {
        let parsed = self.sources().map(|sources| {
            let options = self.options();
            options.map(|o| front::parse(&sources, &o))
        });
        matches!(parsed, Ok(Ok(Err(e))) if e.code() == shader_text::error::Code::NoEntryPoint)
    }

    /// Whether stdin is among the files.
    pub fn reads_stdin(&self) -> bool {
        self.files.iter().any(|f| is_stdin(f))
    }

    pub fn input(&self) -> Result<Input, Failure> {
        self.input_with(&Variables::new(), Purpose::Read)
    }

    /// The variables of `--set`, and `more`.
    fn variables(&self, more: &Variables) -> Result<Variables, Failure> {
        let mut all = Variables::new();
        for text in &self.set {
            let (name, value) = text
                .split_once('=')
                .ok_or_else(|| Failure(format!("error: --set {text}: expected NAME=VALUE")))?;
            all.insert(name.trim().to_owned(), Variable::parse(value.trim()));
        }
        all.extend(more.clone());
        Ok(all)
    }

    fn input_with(&self, more: &Variables, purpose: Purpose) -> Result<Input, Failure> {
        let variables = self.variables(more)?;
        self.check_material_flags()?;
        match self.scene_file() {
            None if !variables.is_empty() => Err(Failure(
                "error: --set and --sweep are for a scene: a shader has no variables".to_owned(),
            )),
            None => {
                let (parsed, mut state) = (self.parse()?, self.state.state()?);
                if self.state.says_no_cull() && reads_facing(&parsed) {
                    state.primitive.cull = CullMode::None;
                }
                Ok(Input::Shader(parsed, state))
            }
            Some(path) if self.files.len() == 1 => {
                self.check_scene_flags()?;
                let access = self.limits.access();
                let read = || match captured(path) {
                    Some(folder) => self.captured(folder, purpose),
                    None => {
                        let scene = match is_gltf(path) {
                            true => preshade_scenes::load_gltf(
                                path,
                                &self.shading(),
                                &variables,
                                access,
                            ),
                            false => preshade_scenes::load_within(path, &variables, access),
                        };
                        let scene = scene.map_err(|e| Failure(e.render()))?;
                        Ok(self.state.set_up(scene))
                    }
                };
                let verb = match captured(path) {
                    Some(_) if purpose == Purpose::Draw => "replaying",
                    _ => "reading",
                };
                let scene = output::working(format!("{verb} {}", path.display()), read)?;
                Ok(Input::Scene(Box::new(scene)))
            }
            Some(_) => Err(Failure(
                "error: a scene file stands alone: its materials name their shaders".to_owned(),
            )),
        }
    }

    /// The same arguments, for a command that draws on this adapter.
    pub fn on(&self, adapter: Option<&str>) -> Self {
        Self {
            replay_on: adapter.map(str::to_owned),
            ..self.clone()
        }
    }

    /// The scene, or a synthesised one for a shader.
    pub fn scene(&self) -> Result<scene::Scene, Failure> {
        self.scene_with(&Variables::new())
    }

    /// [`Self::scene`], with some of its variables set.
    pub fn scene_with(&self, variables: &Variables) -> Result<scene::Scene, Failure> {
        match self.input_with(variables, Purpose::Draw)? {
            Input::Scene(_) if self.chosen().is_some() => Err(Failure(
                "error: --material: all materials of a scene are drawn; `rewrite` and `explain` take one"
                    .to_owned(),
            )),
            Input::Scene(scene) => Ok(*scene),
            Input::Shader(parsed, state) => {
                self.check_fragment(&parsed)?;
                let mut scene = preshade_scenes::synthesise(parsed, state);
                if let (Some(name), Some(material)) = (&self.name, scene.materials.first_mut()) {
                    scene.name.clone_from(name);
                    material.name.clone_from(name);
                }
                Ok(scene)
            }
        }
    }

    /// Refuses to draw a GLSL vertex stage without its fragment stage: nothing would be visible.
    fn check_fragment(&self, parsed: &front::Parsed) -> Result<(), Failure> {
        let [file] = self.files.as_slice() else {
            return Ok(());
        };
        let program = &parsed.program;
        let vertex = program.entry_point(ShaderStage::Vertex, &parsed.vertex);
        let writes_varyings = vertex.is_some_and(|(_, entry)| {
            let outputs = interface::outputs(program.module(), &entry.function);
            let mut bindings = outputs.iter().map(|io| &io.binding);
            bindings.any(|b| matches!(b, Some(Binding::Location { .. })))
        });
        let is_glsl = program.language() == Language::Glsl;
        if parsed.fragment.is_some() || !is_glsl || !writes_varyings {
            return Ok(());
        }
        let its = match file_names::fragment_beside(file) {
            Some(beside) => beside.display().to_string(),
            None => "its .frag".to_owned(),
        };
        Err(Failure(format!(
            "error: {} has no fragment stage: give {its} too",
            file.display()
        )))
    }

    /// Whether the input is a scene.
    pub fn is_scene(&self) -> bool {
        self.scene_file().is_some()
    }

    /// The scene file, by its ending, or a captured frame's.
    fn scene_file(&self) -> Option<&Path> {
        let mut files = self.files.iter().map(PathBuf::as_path);
        files.find(|file| is_scene(file))
    }

    /// The language to write without another wish: that of a page of WebGL, and else WGSL.
    pub fn target(&self) -> Target {
        let file = self.scene_file().and_then(captured);
        // Errors of the capture are reported where its scene is read.
        let capture = file.and_then(|folder| Capture::open(folder, &self.limits.limits()).ok());
        match capture.map(|c| c.file.source.api) {
            Some(Api::WebGl2) => Target::GlslEs300,
            Some(Api::WebGl1) => Target::GlslEs100,
            _ => Target::Wgsl,
        }
    }

    /// Of a captured frame: writes the pictures of the page and of the replay, and their
    /// difference.
    pub fn write_frame(&self, dir: &Path) -> Result<(), Failure> {
        let Some(folder) = self.scene_file().and_then(captured) else {
            return Ok(());
        };
        let capture = Capture::open(folder, &self.limits.limits())?;
        let gpu = self.replay_gpu()?;
        let pictures = || capture::pictures(&capture, &gpu, self.capture.frame);
        let what = "replaying the frame for its pictures";
        let Some(shown) = output::working(what, pictures)? else {
            return Ok(());
        };
        let [page, replay] = shown.map(|image| Rendered {
            colors: vec![Some(image)],
            depth: None,
        });
        let Some(pictures) = Pictures::new("replay", &page, &replay) else {
            return Ok(());
        };
        let files = [
            pictures.original.file("frame.page.png")?,
            pictures.variant.file("frame.replay.png")?,
            pictures.difference.file("frame.difference.png")?,
        ];
        shader_text::files::write(dir, &files)?;
        Ok(())
    }

    /// The adapter that replays captured frames.
    fn replay_gpu(&self) -> Result<Gpu, Failure> {
        worker::open(self.replay_on.as_deref(), &self.limits.limits())
    }

    /// The scene of a captured frame.
    fn captured(&self, folder: &Path, purpose: Purpose) -> Result<Scene, Failure> {
        let failed =
            |e: capture::Error| Failure(format!("error[{}]: {}: {e}", e.code(), folder.display()));
        let capture = Capture::open(folder, &self.limits.limits()).map_err(|e| failed(e.into()))?;
        let gpu = match purpose {
            Purpose::Read => None,
            Purpose::Draw => Some(self.replay_gpu()?),
        };
        capture::scene(&capture, self.capture.choice(), gpu.as_ref()).map_err(failed)
    }

    /// The shaders that draw a glTF file.
    fn shading(&self) -> preshade_scenes::Shading {
        match (&self.material, &self.materials) {
            (Some(shader), _) => preshade_scenes::Shading::Shader(shader.clone()),
            (None, Some(map)) => preshade_scenes::Shading::Materials(map.clone()),
            (None, None) => preshade_scenes::Shading::BuiltIn,
        }
    }

    /// The material that `--material` takes of a scene.
    fn chosen(&self) -> Option<String> {
        let is_gltf = self.scene_file().is_some_and(is_gltf);
        let name = self.material.as_ref().filter(|_| !is_gltf)?;
        Some(name.to_string_lossy().into_owned())
    }

    /// Refuses the flags that choose materials for other files.
    fn check_material_flags(&self) -> Result<(), Failure> {
        let file = self.scene_file();
        if self.material.is_some() && file.is_none() {
            return Err(Failure(
                "error: --material is for a scene, a captured frame or a glTF file: a shader has one \
                 material"
                    .to_owned(),
            ));
        }
        if self.materials.is_some() && !file.is_some_and(is_gltf) {
            return Err(Failure(
                "error: --materials is for a glTF file (.glb, .gltf), whose materials it draws"
                    .to_owned(),
            ));
        }
        Ok(())
    }

    /// Refuses flags of a material, since a scene file defines its own.
    fn check_scene_flags(&self) -> Result<(), Failure> {
        let s = &self.state;
        if self.name.is_some() {
            return Err(Failure(
                "error: --name is for a shader; to take one material of a scene: --material"
                    .to_owned(),
            ));
        }
        let given = [
            ("--lang", self.lang.is_some()),
            ("--vertex", self.vertex.is_some()),
            ("--fragment", self.fragment.is_some()),
            ("--include", !self.glsl.include.is_empty()),
            ("--define", !self.glsl.define.is_empty()),
            ("--clip", self.glsl.clip.is_some()),
            ("--state", s.state.is_some()),
            ("--depth-compare", s.depth_compare.is_some()),
            ("--no-depth-write", s.no_depth_write),
            ("--blend", s.blend.is_some()),
            ("--cull", s.cull.is_some()),
            ("--topology", s.topology.is_some()),
            ("--alpha-to-coverage", s.alpha_to_coverage),
        ];
        match given.iter().find(|(_, given)| *given) {
            None => Ok(()),
            Some((flag, _)) => Err(Failure(format!(
                "error: {flag} belongs to one material: with a scene, say it in the scene file"
            ))),
        }
    }

    /// Reads and parses the shader.
    fn parse(&self) -> Result<front::Parsed, Failure> {
        if self.files.iter().filter(|f| is_stdin(f)).count() > 1 {
            return Err(Failure(
                "error: `-` is given twice: stdin can be read only once".to_owned(),
            ));
        }
        front::parse(&self.sources()?, &self.options()?).map_err(|e| {
            let mut told = e.render(color());
            // Two stages by their names are one material.
            let two_materials = !self.files.iter().all(|f| file_names::is_stage(f))
                && matches!(
                    e.code(),
                    shader_text::error::Code::Link
                        | shader_text::error::Code::Sources
                        | shader_text::error::Code::AmbiguousEntryPoint
                );
            if self.files.len() > 2 || self.files.len() == 2 && two_materials {
                told = format!("{}\n = {EACH_ITS_OWN}", told.trim_end());
            }
            Failure(told)
        })
    }

    fn options(&self) -> Result<options::Options, Failure> {
        Ok(options::Options {
            vertex: self.vertex.clone(),
            fragment: self.fragment.clone(),
            defines: self.glsl.defines()?,
            include: self.glsl.include.clone(),
            clip_space: self.glsl.clip_space(),
            limits: self.limits.limits(),
            ..shader_text::options::Options::default()
        })
    }

    fn sources(&self) -> Result<Vec<Source>, Failure> {
        let files = self.files.iter().enumerate();
        files.map(|(i, f)| self.source(f, i)).collect()
    }

    /// Reads the file at position `index`.
    fn source(&self, path: &Path, index: usize) -> Result<Source, Failure> {
        let language = self.lang.map(Language::from);
        if is_stdin(path) {
            if language.is_none() {
                return Err(Failure(
                    "error: stdin has no file name to tell its language from: give --lang wgsl or \
                     --lang glsl"
                        .to_owned(),
                ));
            }
            let mut bytes = Vec::new();
            // One byte more than the limit, so that the parser refuses it.
            let most = self.limits.limits().source_bytes.saturating_add(1);
            std::io::stdin()
                .lock()
                .take(most)
                .read_to_end(&mut bytes)
                .map_err(|e| Failure(format!("error: stdin: {e}")))?;
            let mut source = decoded("<stdin>".to_owned(), bytes)?;
            source.language = language;
            // Without an ending, the first of two files is the vertex stage.
            source.stage = (self.files.len() == 2).then_some(match index {
                0 => ShaderStage::Vertex,
                _ => ShaderStage::Fragment,
            });
            return Ok(source);
        }
        if path.is_dir() {
            return Err(Failure(format!(
                "error: {} is a folder, and no captured frame: it has no frame.json\n = `preshade capture` \
                 records a frame; {EACH_ITS_OWN}",
                path.display()
            )));
        }
        let bytes = read_limited::bytes(path, &self.limits.limits(), "source-bytes")
            .map_err(|e| Failure::unread(path, &e))?;
        let Some(name) = path.to_str().map(str::to_owned) else {
            return Err(Failure(format!(
                "error: {}: the name is not UTF-8, and neither a rule nor a plan could say it: \
                 rename the file",
                path.display()
            )));
        };
        let mut source = decoded(name, bytes)?;
        source.language = language;
        Ok(source)
    }

    /// Name of the material: the given one, or the file's without its endings.
    pub fn material_name(&self) -> String {
        if let Some(name) = &self.name {
            return name.clone();
        }
        let file = self.files.iter().find(|f| !is_stdin(f));
        let Some(stem) = file.and_then(|f| f.file_stem()) else {
            return "material".to_owned();
        };
        name_of(&stem.to_string_lossy()).to_owned()
    }
}

/// A hint for more files than a material has.
const EACH_ITS_OWN: &str = "`preshade rewrite .. --out-dir DIR` takes each file as a material of \
                            its own, and every shader below a folder";

fn decoded(name: String, bytes: Vec<u8>) -> Result<Source, Failure> {
    let shown = name.trim_matches(['<', '>']).to_owned();
    Source::from_bytes(name, bytes).map_err(|e| Failure(format!("error: {shown}: {e}")))
}

fn color() -> shader_text::error::Color {
    if crate::color_on_stderr() {
        shader_text::error::Color::Always
    } else {
        shader_text::error::Color::Never
    }
}
