//! The recorder that runs in a page: plain JavaScript, from the files of `page/`.

/// The recorder as one script. It defines `preshadeCapture.start({frames, sink})`, which resolves to a summary.
///
/// It sends base64 chunks of a tar stream to a global function `preshadeSink`, or offers a download where there is none.
pub const RECORDER: &str = concat!(
    "(() => {\n'use strict';\n",
    include_str!("page/hash.js"),
    include_str!("page/tar.js"),
    include_str!("page/folder.js"),
    include_str!("page/session.js"),
    include_str!("page/webgpu-format.js"),
    include_str!("page/webgpu-read.js"),
    include_str!("page/webgpu-encode.js"),
    include_str!("page/webgpu-record.js"),
    include_str!("page/webgpu.js"),
    include_str!("page/webgl-format.js"),
    include_str!("page/webgl-read.js"),
    include_str!("page/webgl-track.js"),
    include_str!("page/webgl-state.js"),
    include_str!("page/webgl-program.js"),
    include_str!("page/webgl-resources.js"),
    include_str!("page/webgl-record.js"),
    include_str!("page/webgl-draw.js"),
    include_str!("page/start.js"),
    "})();\n",
);
