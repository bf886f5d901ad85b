//! The fragment stage of a pass that draws depth alone, in GLSL ES: WebGL links no program without one (OpenGL ES 3.0, section 2.12.3).

use naga::ShaderStage;
use preshade_passes::plan::{Plan, Role};

use super::plan_json::StageFile;
use super::{File, Target, Written, written_key};

/// A fragment stage that does nothing, after its first line.
const TEXT: &str = "precision highp float;
// Depth alone is drawn.
void main() {}
";

/// The languages in which a program has one, with how a text begins and what its file's name ends with.
const LANGUAGES: [(Target, &str, &str); 2] = [
    (Target::GlslEs300, "#version 300 es", "es.frag"),
    (Target::GlslEs100, "#version 100", "es100.frag"),
];

const WITH_MAIN: &str = "// The vertex stage is the main pass's own.\n";

/// The key under which `plan.json` finds the stage of a pass that has none.
pub(super) fn key() -> Written {
    written_key(ShaderStage::Fragment, "")
}

/// Such a stage, with the program that it belongs to.
pub(super) struct Blank {
    pub program: String,
    pub target: Target,
    pub file: File,
    pub said: StageFile,
}

/// One file a pass that has no fragment stage, `MATERIAL.ROLE.es.frag`. Nothing where GLSL ES is not asked for.
pub(super) fn files(plan: &Plan, targets: &[Target]) -> Vec<Blank> {
    let mut all = Vec::new();
    for (target, version, extension) in LANGUAGES {
        if !targets.contains(&target) {
            continue;
        }
        for pass in plan.passes.iter().filter(|pass| pass.fragment.is_none()) {
            let name = format!("{}.{}.{extension}", plan.material, pass.role.name());
            let said = StageFile::new(&name, "main");
            // Without a program of its own it has no vertex stage of its own name beside it.
            let vertex = match pass.role {
                Role::Prepass if pass.program == Role::Main.name() => WITH_MAIN,
                _ => "",
            };
            let bytes = format!("{version}\n{TEXT}{vertex}").into_bytes();
            all.push(Blank {
                program: pass.program.clone(),
                target,
                file: File { name, bytes },
                said,
            });
        }
    }
    all
}
