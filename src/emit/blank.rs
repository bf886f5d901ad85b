//! The fragment stage of a pass that draws depth alone, in GLSL ES: WebGL links no program without one (OpenGL ES 3.0, section 2.12.3).

use naga::ShaderStage;
use preshade_passes::plan::{Plan, Role};

use super::plan_json::StageFile;
use super::{File, Target, Written, written_key};

/// A fragment stage that does nothing.
const TEXT: &str = "#version 300 es
precision highp float;
// Depth alone is drawn.
void main() {}
";

const WITH_MAIN: &str = "// The vertex stage is the main pass's own.\n";

/// The key under which `plan.json` finds the stage of a pass that has none.
pub(super) fn key() -> Written {
    written_key(ShaderStage::Fragment, "")
}

/// One file a pass that has no fragment stage, `MATERIAL.ROLE.es.frag`, with the program it belongs to. Nothing where GLSL ES is not asked for.
pub(super) fn files(plan: &Plan, targets: &[Target]) -> Vec<(String, File, StageFile)> {
    if !targets.contains(&Target::GlslEs300) {
        return Vec::new();
    }
    plan.passes
        .iter()
        .filter(|pass| pass.fragment.is_none())
        .map(|pass| {
            let name = format!("{}.{}.es.frag", plan.material, pass.role.name());
            let said = StageFile::new(&name, "main");
            // Without a program of its own it has no vertex stage of its own name beside it.
            let vertex = match pass.role {
                Role::Prepass if pass.program == Role::Main.name() => WITH_MAIN,
                _ => "",
            };
            let bytes = format!("{TEXT}{vertex}").into_bytes();
            (pass.program.clone(), File { name, bytes }, said)
        })
        .collect()
}
