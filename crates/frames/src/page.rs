//! The recorder that runs in a page: plain JavaScript, from the files of `page/`.

/// The recorder as one script. It defines `preshadeCapture.start({frames, sink})`, which resolves to a summary.
///
/// It sends base64 chunks of a tar stream to the global function `preshadeSink`. Without one, it offers a download.
pub const RECORDER: &str = concat!(
    "(() => {\n'use strict';\n",
    include_str!("page/hash.js"),
    include_str!("page/tar.js"),
    include_str!("page/folder.js"),
    include_str!("page/session.js"),
    include_str!("page/errors.js"),
    include_str!("page/webgpu-format.js"),
    include_str!("page/webgpu-read.js"),
    include_str!("page/webgpu-encode.js"),
    include_str!("page/webgpu-record.js"),
    include_str!("page/webgpu.js"),
    include_str!("page/webgl-format.js"),
    include_str!("page/webgl-read.js"),
    include_str!("page/webgl-guess.js"),
    include_str!("page/webgl-track.js"),
    include_str!("page/webgl-state.js"),
    include_str!("page/webgl-program.js"),
    include_str!("page/webgl-resources.js"),
    include_str!("page/webgl-record.js"),
    include_str!("page/webgl-draw.js"),
    include_str!("page/start.js"),
    "})();\n",
);

/// The recorder as a bookmarklet. It records one frame of the current page and offers it as
/// `frame.tar`.
pub fn bookmarklet() -> String {
    let script = format!("{RECORDER}preshadeCapture.start().then(console.log,alert);");
    let mut text = "javascript:".to_owned();
    for byte in script.bytes() {
        match byte {
            b'a'..=b'z'
            | b'A'..=b'Z'
            | b'0'..=b'9'
            | b'-'
            | b'_'
            | b'.'
            | b'!'
            | b'~'
            | b'*'
            | b'\''
            | b'('
            | b')' => {
                text.push(char::from(byte));
            }
            _ => text.push_str(&format!("%{byte:02X}")),
        }
    }
    text
}
