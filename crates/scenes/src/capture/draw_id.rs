//! The number of a draw in `WEBGL_multi_draw`.

use super::points;

/// The built-in number of a draw of `WEBGL_multi_draw`: each is a draw of its own in a capture, and the number a
/// uniform of that name.
pub(super) const NAME: &str = "gl_DrawID";
/// A program may not declare a name that begins with `gl_`.
pub(super) const OWN: &str = "preshade_draw_id";
const MULTI_DRAW: &str = "GL_ANGLE_multi_draw";

/// A vertex stage that reads the number of its draw from a uniform.
pub(super) fn as_uniform(text: &str) -> String {
    let is_directive = |line: &&str| line.starts_with("#extension") && line.contains(MULTI_DRAW);
    let lines: Vec<&str> = text.lines().filter(|line| !is_directive(line)).collect();
    let text = lines.join("\n").replace(NAME, OWN);
    let text = text.replace(MULTI_DRAW, "preshade_multi_draw");
    let declared = format!("#define preshade_multi_draw 1\nuniform highp int {OWN};\n");
    points::declare(&text, &declared)
}
