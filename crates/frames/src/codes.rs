//! The error codes of captured frames.

use shader_text::refusals::refusals;

refusals! {
    CAPTURE = "capture":
        "A frame folder, or a file in it, cannot be read or replayed. The message shows the place.",
        "docs/reference/frames.md describes the folder. Capture the frame again.";
    BROWSER = "browser":
        "The browser that `preshade capture` starts is missing, ended, or does not answer.",
        "Install Chromium or Chrome, or name its program by the variable CHROMIUM. For slow pages, raise --patience.";
    PAGE = "page":
        "A page cannot be recorded: it does not load, is never ready, or draws nothing. The message shows what the page says.",
        "Open the page in the browser yourself. If it needs a login or a click, record it there: docs/guides/capture.md shows how.";
}
