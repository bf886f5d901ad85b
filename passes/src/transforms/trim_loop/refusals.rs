//! The refusals of `trim-loop`.

use shader_text::refusals::refusals;

refusals! {
    NO_LOOP = "no-loop":
        "The fragment stage has no counted loop that may lose an iteration. A loop keeps all of \
         them if it decides a discard, a depth or a coverage, writes memory, runs in the vertex \
         stage too, or reads the scene's data by its counter (`lights[i]`) without a weight that \
         shrinks.",
        "`preshade explain` lists the loops, and why each keeps its iterations.";
}
