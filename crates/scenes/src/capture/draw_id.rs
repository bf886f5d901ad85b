//! The number of a draw in `WEBGL_multi_draw`.

use super::points;

/// The built-in draw number of `WEBGL_multi_draw`. A capture splits a multi-draw, and passes the
/// number as a uniform of this name.
pub(super) const NAME: &str = "gl_DrawID";
/// The uniform's name in our text: a program may not declare a name that begins with `gl_`.
pub(super) const OWN: &str = "preshade_draw_id";
const MULTI_DRAW: &str = "GL_ANGLE_multi_draw";

/// Makes a vertex stage read the draw number from a uniform.
pub(super) fn as_uniform(text: &str) -> String {
    let is_directive = |line: &&str| line.starts_with("#extension") && line.contains(MULTI_DRAW);
    let lines: Vec<&str> = text.lines().filter(|line| !is_directive(line)).collect();
    let text = lines.join("\n").replace(NAME, OWN);
    let text = text.replace(MULTI_DRAW, "preshade_multi_draw");
    let declared = format!("#define preshade_multi_draw 1\nuniform highp int {OWN};\n");
    points::declare(&text, &declared)
}
