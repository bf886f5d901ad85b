//! From a material's main shaders to those of its pre-pass: text in, text out.

use std::fmt::Write as _;

use preshade::{
    BindingSource, BindingUse, Facts, GpuPass, Language, MaterialState, Options, Recipe, Shader,
    Source, Target, rewrite,
};

#[path = "previous.rs"]
mod previous;

/// What a stage is composed to.
#[derive(Clone, Debug)]
pub struct Composed {
    /// WGSL with one entry point.
    pub text: String,
    /// Name of the entry point.
    pub entry: String,
    /// Where the shader was loaded from.
    pub path: String,
}

/// What a view's pre-pass asks for beside depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub struct Wanted {
    /// Bevy's `NormalPrepass`.
    pub normal: bool,
    /// Bevy's `MotionVectorPrepass`.
    pub motion: bool,
    /// Whether the mesh has the skin of the previous frame.
    pub previous_skin: bool,
    /// Whether the mesh has the morph weights of the previous frame.
    pub previous_morph: bool,
    /// Whether alpha says how much of a pixel is covered.
    pub alpha_covers: bool,
}

/// A derived shader.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Derived {
    /// WGSL of both stages, with the bindings of the pre-pass.
    pub text: String,
    /// Entry point of the vertex stage.
    pub vertex: String,
    /// Entry point of the fragment stage; `None`: nothing is cut out, and only depth is written.
    pub fragment: Option<String>,
    /// Whether it reads the material's bind group.
    pub reads_material: bool,
    /// Whether its normals are those of triangles.
    pub is_flat: bool,
}

/// Why nothing is derived. Bevy's own pre-pass draws the material then.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refused {
    /// The compiler's code, or one of ours.
    pub code: String,
    /// The reason.
    pub reason: String,
    /// What you can do about it.
    pub remedy: String,
}

impl Refused {
    pub(crate) fn new(code: &str, reason: impl Into<String>, remedy: &str) -> Self {
        Self {
            code: code.to_owned(),
            reason: reason.into(),
            remedy: remedy.to_owned(),
        }
    }
}

/// What has less alpha is not drawn: `PREMULTIPLIED_ALPHA_CUTOFF` in `bevy_pbr`'s
/// `pbr_prepass_functions.wgsl`.
const CUTOFF: &str = "0.05";

/// The group of the material's bindings.
const MATERIAL: u32 = 3;

/// Bindings of the main view that the pre-pass view has too, and where it has them: `bevy_pbr`'s
/// `mesh_view_bindings.wgsl` and `prepass_bindings.wgsl`.
const VIEW: [(u32, u32); 3] = [(0, 0), (11, 1), (14, 14)];

/// Binding of the previous frame's view in group 0.
const PREVIOUS_VIEW: u32 = 2;

/// Derives the shader of a pre-pass.
///
/// # Errors
/// The compiler refuses, or the result reads what the pre-pass view does not have.
pub fn derive(vertex: &Composed, fragment: &Composed, wanted: Wanted) -> Result<Derived, Refused> {
    let material = Material::of(vertex, fragment);
    let result = material.first(wanted);
    match result {
        // The material writes no alpha.
        Err(refused) if refused.code == NO_ALPHA => material.first(Wanted {
            alpha_covers: false,
            ..wanted
        }),
        result => result,
    }
}

/// Where the normal comes from.
#[derive(Clone, Debug)]
enum Normal {
    /// The compiler finds it by its role.
    Found,
    /// A value of this name.
    Named(String),
    /// The triangle, for a material without one.
    Face,
}

/// What the compiler is asked for.
struct Choice<'n> {
    wanted: Wanted,
    normal: &'n Normal,
    /// Whether the matrix of temporal antialiasing is left out of the motion.
    has_jitter: bool,
}

/// The compiler's code where the position does not read that matrix.
const UNREAD_JITTER: &str = "unread-jitter";

/// The permission for arrays of bindings.
const ARRAYS: &str = "enable wgpu_binding_array;\n";

/// The compiler's codes where it finds no normal, none of the name that it is given, and no position in the world.
const NO_NORMAL: &str = "no-normal";
const NO_SUCH_NAME: &str = "no-such-name";
const NO_POSITION: &str = "no-position";

/// How much a refusal says of a material, among those for different normals: that the compiler finds no normal says
/// more than that it finds none of a name, and with a normal that is found, the refusal is about the rest.
fn weight(refused: &Refused) -> u32 {
    match refused.code.as_str() {
        NO_SUCH_NAME | NO_POSITION => 0,
        NO_NORMAL => 1,
        _ => FOUND,
    }
}

/// The weight where there is a normal.
const FOUND: u32 = 2;

/// The compiler's code where the fragment stage writes no alpha.
const NO_ALPHA: &str = "alpha-decides";

struct Material {
    sources: [Source; 2],
    options: Options,
    /// The name of the fragment stage's argument.
    argument: Option<String>,
}

impl Material {
    fn of(vertex: &Composed, fragment: &Composed) -> Self {
        let source = |composed: &Composed, stage: &str| {
            let name = format!("{} ({stage})", composed.path);
            // Bevy's naga needs no permission for them, and the compiler's does.
            let head = match composed.text.contains("binding_array<") {
                true => ARRAYS,
                false => "",
            };
            Source::new(name, format!("{head}{}", composed.text)).with_language(Language::Wgsl)
        };
        let head = format!("fn {}(", fragment.entry);
        let argument = fragment.text.split_once(&head).and_then(|(_, after)| {
            let name: String = after
                .chars()
                .take_while(|c| c.is_alphanumeric() || *c == '_')
                .collect();
            (!name.is_empty()).then_some(name)
        });
        Self {
            sources: [source(vertex, "vertex"), source(fragment, "fragment")],
            options: Options {
                vertex: Some(vertex.entry.clone()),
                fragment: Some(fragment.entry.clone()),
                ..Options::default()
            },
            argument,
        }
    }

    /// Normals, the best first.
    fn normals(&self, wanted: Wanted) -> Vec<Normal> {
        if !wanted.normal {
            return vec![Normal::Found];
        }
        let mut all = Vec::new();
        let has = |word| self.sources[1].text.contains(word);
        // What a physically based material lights with; else what the vertex stage hands over.
        if has("pbr_input") {
            all.push(Normal::Named("pbr_input.N".to_owned()));
        }
        all.push(Normal::Found);
        if has("world_normal") {
            let varying = |of| Normal::Named(format!("{of}.world_normal"));
            all.extend(self.argument.iter().map(varying));
        }
        all.push(Normal::Face);
        all
    }

    /// With the best normal that there is.
    fn first(&self, wanted: Wanted) -> Result<Derived, Refused> {
        let mut most: Option<Refused> = None;
        for normal in self.normals(wanted) {
            // The triangle's normal is flat: it is for materials without one.
            if matches!(normal, Normal::Face) && most.as_ref().is_some_and(|m| weight(m) == FOUND) {
                break;
            }
            match self.derive(wanted, &normal) {
                Ok(derived) => return Ok(derived),
                Err(refused) => {
                    if most.as_ref().is_none_or(|m| weight(m) < weight(&refused)) {
                        most = Some(refused);
                    }
                }
            }
        }
        Err(most.unwrap_or_else(|| Refused::new("nothing", "there is nothing to derive", "")))
    }

    fn derive(&self, wanted: Wanted, normal: &Normal) -> Result<Derived, Refused> {
        let mut choice = Choice {
            wanted,
            normal,
            has_jitter: wanted.motion && self.sources[0].text.contains("clip_from_world"),
        };
        let mut output = self.rewrite(&choice);
        if output.as_ref().is_err_and(|e| e.code == UNREAD_JITTER) {
            choice.has_jitter = false;
            output = self.rewrite(&choice);
        }
        let (pass, text) = output?;
        let mut text = text.replacen(ARRAYS, "", 1);
        if wanted.motion {
            text = previous::apply(&text, &pass, wanted, PREVIOUS_VIEW)?;
            if !wanted.normal {
                // Bevy has a target for normals before that of motion, with or without normals.
                text = second(&text, pass.fragment.as_deref())
                    .ok_or_else(|| Refused::new("unwritten", "the motion has no target", REPORT))?;
            }
        }
        for binding in pass
            .bindings
            .iter()
            .filter(|b| b.source == BindingSource::Author)
        {
            text = moved(text, binding)?;
        }
        Ok(Derived {
            text,
            vertex: pass.vertex.clone(),
            fragment: pass.fragment.clone(),
            reads_material: pass.bindings.iter().any(|b| b.group == MATERIAL),
            is_flat: wanted.normal && matches!(normal, Normal::Face),
        })
    }

    fn rewrite(&self, choice: &Choice) -> Result<(GpuPass, String), Refused> {
        let Choice {
            wanted,
            normal,
            has_jitter,
        } = choice;
        let mut write = vec!["depth"];
        write.extend(wanted.normal.then_some("normal"));
        write.extend(wanted.motion.then_some("velocity"));
        let mut recipe = format!("outputs:write={}", write.join("+"));
        if wanted.normal {
            recipe += ",unsigned=true";
        }
        match normal {
            Normal::Found => {}
            Normal::Named(name) => {
                let _ = write!(recipe, ",normal={name}");
            }
            Normal::Face => recipe += ",faces=right-handed",
        }
        if *has_jitter {
            recipe += ",jitter=view.unjittered_clip_from_world=view.clip_from_world";
        }
        let mut state = MaterialState::default();
        if wanted.alpha_covers {
            let _ = write!(recipe, ",cutoff={CUTOFF}");
            // For blending too: both have the compiler test alpha.
            state.multisample.count = 4;
            state.multisample.alpha_to_coverage = true;
        }
        let recipe = Recipe::parse_list(&recipe)
            .map_err(|e| Refused::new("recipe", e.to_string(), REPORT))?;
        let shader = Shader {
            name: "prepass",
            sources: &self.sources,
            options: &self.options,
            state: &state,
        };
        let output = rewrite(shader, &recipe, &Facts::default(), &[Target::Wgsl])
            .map_err(|e| Refused::new("unread", e.to_string(), "see if Bevy draws it itself"))?;
        if let Some(skipped) = output.skipped.first() {
            let refusal = &skipped.refusal;
            return Err(Refused {
                code: refusal.code.to_owned(),
                reason: refusal.reason.clone(),
                remedy: remedy(&refusal.code).to_owned(),
            });
        }
        let pass = output.plan.passes.iter().find(|p| p.program == "outputs");
        let file = output
            .files
            .iter()
            .find(|f| f.name == "prepass.outputs.wgsl");
        let (Some(pass), Some(file)) = (pass, file) else {
            let why = output.errors.first().map(ToString::to_string);
            let why = why.unwrap_or_else(|| "nothing was written".to_owned());
            return Err(Refused::new("unwritten", why, REPORT));
        };
        let text = String::from_utf8_lossy(&file.bytes).into_owned();
        Ok((pass.clone(), text))
    }
}

const REPORT: &str = "report it to preshade";

/// What the author of a material can do about a refusal. The compiler's own remedies are parameters, which the plugin
/// chooses.
fn remedy(code: &str) -> &'static str {
    match code {
        NO_NORMAL | NO_SUCH_NAME | NO_POSITION => {
            "hand the normal over as `world_normal`, or multiply the position in the world by `view.clip_from_world`"
        }
        "several-normals" | "several-calls" | "ambiguous-name" => {
            "hand the normal that you mean over as `world_normal`"
        }
        "no-previous" => "read what moves the vertices from a buffer that no shader writes",
        "internal" => REPORT,
        _ => "give the material a pre-pass shader of its own",
    }
}

/// The text with the one output of its fragment stage at location 1.
fn second(text: &str, fragment: Option<&str>) -> Option<String> {
    let head = format!("fn {}(", fragment?);
    let start = text.find(&head)?;
    let end = start + text[start..].find('{')?;
    let result = start + text[start..end].rfind("->")?;
    let (from, to) = match text[result..end].contains(FIRST) {
        true => (result, end),
        // It writes depth too, so the outputs are a struct.
        false => {
            let name = text[result..end].trim_start_matches("->").trim();
            let from = text.find(&format!("struct {name} {{"))?;
            (from, from + text[from..].find('}')?)
        }
    };
    let at = from + text[from..to].find(FIRST)?;
    let rest = &text[at + FIRST.len()..];
    Some(format!("{}@location(1){rest}", &text[..at]))
}

const FIRST: &str = "@location(0)";

/// The text with a binding where the pre-pass has it.
fn moved(text: String, binding: &BindingUse) -> Result<String, Refused> {
    let at = |number: u32| format!("@group({}) @binding({number}) ", binding.group);
    match binding.group {
        0 => match VIEW.iter().find(|(main, _)| *main == binding.binding) {
            Some((main, own)) if main == own => Ok(text),
            Some((main, own)) => Ok(text.replacen(&at(*main), &at(*own), 1)),
            None => Err(lacks(&binding.name)),
        },
        1 => Err(lacks(&binding.name)),
        _ => Ok(text),
    }
}

fn lacks(name: &str) -> Refused {
    Refused::new(
        "view-lacks",
        format!(
            "position, discards, normal or motion read `{name}`, which the pre-pass view does not have"
        ),
        "decide the discard by what the pre-pass has too (the mesh, the material, the view, the time), or \
         give the material a pre-pass shader of its own",
    )
}
