//! The leaf is drawn with a depth pre-pass; the shaders in their forms that need no scene come
//! beside it, to be compared.

use preshade::{ColorTarget, CullMode, MaterialState};

fn main() -> Result<(), preshade::build_script::BuildError> {
    let mut state = MaterialState::default();
    state.primitive.cull = CullMode::None;
    state.targets = vec![Some(ColorTarget::opaque("bgra8unorm"))];
    preshade::configure()
        .state(state)
        .pass("depth-prepass")
        .variant("early_discard", ["early-discard"])
        .variant("shadow", ["shadow"])
        .variant("still", ["specialize:set=frame.time=0"])
        .compile("shaders/leaf.wgsl")?;
    preshade::compile("shaders/ground.wgsl")
}
