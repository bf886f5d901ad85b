//! The fragment stage of a depth-only pass in GLSL ES. WebGL links no program without one (OpenGL
//! ES 3.0, 2.12.3).

use naga::ShaderStage;
use preshade_plan::plan::{Plan, Role};

use super::{Written, written_key};
use preshade_plan::plan_file::{StageFile, Target};
use shader_text::files::File;

/// An empty fragment stage without its first line.
const TEXT: &str = "precision highp float;
void main() {}
";

/// Languages that need a fragment stage: first line and file extension.
const LANGUAGES: [(Target, &str, &str); 2] = [
    (Target::GlslEs300, "#version 300 es", "es.frag"),
    (Target::GlslEs100, "#version 100", "es100.frag"),
];

const WITH_MAIN: &str = "// The vertex stage is the main pass's own.\n";

/// The `plan.json` key of the empty stage.
pub(super) fn key() -> Written {
    written_key(ShaderStage::Fragment, "")
}

/// The empty stage of a program.
pub(super) struct EmptyFragment {
    pub program: String,
    pub target: Target,
    pub file: File,
    pub stage_file: StageFile,
}

/// The file of each pass without a fragment stage, `MATERIAL.ROLE.es.frag`, if GLSL ES is a target.
pub(super) fn files(plan: &Plan, targets: &[Target]) -> Vec<EmptyFragment> {
    let mut all = Vec::new();
    for (target, version, extension) in LANGUAGES {
        if !targets.contains(&target) {
            continue;
        }
        for pass in plan.passes.iter().filter(|pass| pass.fragment.is_none()) {
            let name = format!("{}.{}.{extension}", plan.material, pass.role.name());
            let stage_file = StageFile::new(&name, "main");
            // A pass that shares the main program has no file named after itself.
            let vertex = match pass.role {
                Role::Prepass if pass.program == Role::Main.name() => WITH_MAIN,
                _ => "",
            };
            let bytes = format!("{version}\n{TEXT}{vertex}").into_bytes();
            all.push(EmptyFragment {
                program: pass.program.clone(),
                target,
                file: File { name, bytes },
                stage_file,
            });
        }
    }
    all
}
