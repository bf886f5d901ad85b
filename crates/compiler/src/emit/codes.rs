//! The error codes of emission.

use shader_text::refusals::refusals;

refusals! {
    INEXPRESSIBLE = "inexpressible":
        "The target language can't express part of the shader. preshade skips this language, \
         writes the others, and exits with 2.",
        "The message names that part and a remedy.";
    WRITER = "writer":
        "naga failed to write the text, so nothing was written.",
        "Try another `--emit`, and please report the shader.";
    DIFFERS = "differs":
        "preshade read the emitted text back and got another program, so it wrote nothing. This \
         is a bug.",
        "Please report the shader.";
    NOT_BUILT = "not-built":
        "This build lacks the Cargo feature that the message names.",
        "`cargo install preshade-cli --features ..`.";
}
