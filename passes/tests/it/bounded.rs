//! Copies of programs whose loops end.

use preshade_passes::rebuild::bounded;

use crate::common::{program, wgsl};

#[test]
fn a_replay_leaves_a_loop_that_may_not_end() {
    let text = |body: &str| {
        format!(
            "@vertex fn vs(@location(0) p: vec4f) -> @builtin(position) vec4f {{ return p; }}
@fragment fn fs(@builtin(position) at: vec4f) -> @location(0) vec4f {{ var c = at; {body} return c; }}"
        )
    };
    let ends = "for (var i = 0; i < 9; i++) { c *= 0.5; if (c.x > 3.0) { discard; } }";
    assert!(bounded::cut(&program(&text(ends))).unwrap().is_none());
    let open = "loop { c *= 1.5; if (c.x < 0.0) { discard; } if (c.x > 3.0) { break; } }";
    let cut = bounded::cut(&program(&text(open))).unwrap();
    insta::assert_snapshot!(wgsl(&cut.unwrap()));
}
