//! The error codes of the front ends.

use crate::refusals::refusals;

refusals! {
    EMPTY = "empty":
        "No source is given, or it contains no token.",
        "Give a file with a vertex and a fragment stage.";
    UNKNOWN_LANGUAGE = "unknown-language":
        "Neither the file's ending nor `--lang` determines the language.",
        "Give `--lang`, or name the file `.wgsl`, `.vert` or `.frag`.";
    UNKNOWN_STAGE = "unknown-stage":
        "Neither the file's ending nor the text determines the stage of a GLSL file.",
        "Name it `.vert` or `.frag`.";
    SOURCES = "sources":
        "The files do not make one material: two of them have one stage, or different \
         languages.",
        "A material is one file, or a vertex and a fragment file. `rewrite --out-dir` takes \
         many materials.";
    FOREIGN = "foreign":
        "The file is no material in WGSL or GLSL: it is in another language, or an engine adds \
         what it lacks.",
        "Translate it, or capture the text that the engine compiles. The message says how.";
    UNSUPPORTED = "unsupported":
        "The file needs a feature that this build of preshade does not have.",
        "The message names the feature. Leave it out, or install a build that has it.";
    PARSE = "parse":
        "The parser rejects the text.",
        "Correct the text at the line that the message shows.";
    INVALID = "invalid":
        "The text parses, but the validator rejects it.",
        "Correct the text at the line that the message shows.";
    PANIC = "panic":
        "naga, the parser that preshade uses, panicked on the file.",
        "Please report it with the file.";
    TOO_DEEP = "too-deep":
        "The text is nested too deeply, or is too long.",
        "Split long expressions with `let`, and nested blocks into functions.";
    NO_ENTRY_POINT = "no-entry-point":
        "The file lacks an entry point for a stage that a material needs.",
        "Add it, or give the file of the other stage too.";
    UNKNOWN_ENTRY_POINT = "unknown-entry-point":
        "The requested entry point is not in the file.",
        "Choose one of those that the message lists.";
    AMBIGUOUS_ENTRY_POINT = "ambiguous-entry-point":
        "The file has several entry points of one stage.",
        "Choose with `--vertex NAME` and `--fragment NAME`.";
    INTERFACE = "interface":
        "The vertex stage's outputs do not fit the fragment stage's inputs (location, type or \
         interpolation).",
        "Let the vertex stage write every input of the fragment stage.";
    LINK = "link":
        "The vertex and the fragment file declare one name differently.",
        "Declare it alike in both files.";
}
