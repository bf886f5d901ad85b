//! Every command that the README tells of is run, on files of the names it uses.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// What the README's files stand for; `grass.toml` is the scene of that name.
const FILES: [(&str, &str); 3] = [
    ("model.gltf", "gltf/panes.gltf"),
    ("lit.wgsl", "shaders/toon.wgsl"),
    ("scene.toml", "scenes/first.toml"),
];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .unwrap()
        .to_owned()
}

/// The fixtures, with the README's files beside the scenes.
fn project() -> PathBuf {
    let project = Path::new(env!("CARGO_TARGET_TMPDIR")).join("readme");
    let _ = fs::remove_dir_all(&project);
    for folder in ["scenes", "shaders", "glsl", "gltf", "shaders/two-files"] {
        fs::create_dir_all(project.join(folder)).unwrap();
        for entry in fs::read_dir(root().join("fixtures").join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.is_file() {
                fs::copy(&path, project.join(folder).join(path.file_name().unwrap())).unwrap();
            }
        }
    }
    for (name, from) in FILES {
        fs::copy(project.join(from), project.join("scenes").join(name)).unwrap();
    }
    fs::write(project.join("scenes/page.html"), PAGE).unwrap();
    project
}

/// A page that draws a triangle in every frame.
const PAGE: &str = "<!doctype html><canvas id=c width=64 height=48></canvas><script>
const gl = document.getElementById('c').getContext('webgl2');
const stage = (type, text) => { const s = gl.createShader(type); gl.shaderSource(s, text); gl.compileShader(s); return s; };
const program = gl.createProgram();
gl.attachShader(program, stage(gl.VERTEX_SHADER, `#version 300 es
void main() { gl_Position = vec4(gl_VertexID & 1, gl_VertexID >> 1, 0.5, 1.0); }`));
gl.attachShader(program, stage(gl.FRAGMENT_SHADER, `#version 300 es
precision highp float; out vec4 c; void main() { c = vec4(1.0, 0.5, 0.2, 1.0); }`));
gl.linkProgram(program);
const draw = () => {
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(program);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    requestAnimationFrame(draw);
};
requestAnimationFrame(draw);
</script>";

/// The lines of the README's shell blocks that call preshade, without comments and what the output
/// is piped to.
fn commands() -> Vec<String> {
    let readme = fs::read_to_string(root().join("README.md")).unwrap();
    let blocks = readme.split("```sh\n").skip(1);
    let lines = blocks.flat_map(|b| b.split("```").next().unwrap().lines());
    let lines = lines.filter(|l| l.starts_with("preshade "));
    lines
        .map(|l| {
            l.split(" #")
                .next()
                .unwrap()
                .split(" | ")
                .next()
                .unwrap()
                .trim()
                .to_owned()
        })
        .collect()
}

#[test]
fn every_command_in_the_readme_runs() {
    let scenes = project().join("scenes");
    let commands = commands();
    assert!(commands.len() >= 3, "{commands:?}");
    for command in commands {
        // Fewer blades of grass than are worth measuring, and levels.
        let small = command.replace("50000..400000", "500..1000:2");
        let small = small.replace("level=1..8", "level=1..2");
        // Both forms of glTF are read alike.
        let small = small.replace("model.glb", "model.gltf");
        let words: Vec<&str> = small.split_whitespace().skip(1).collect();
        let mut run = Command::new(env!("CARGO_BIN_EXE_preshade"));
        run.args(&words).current_dir(&scenes).stdin(Stdio::null());
        let draws = ["verify", "explore", "plan"].contains(&words[0]) || words.contains(&"--scene");
        if draws {
            // As small as it gets: what is shown elsewhere is that the figures are right.
            run.env("PRESHADE_SIZE", "32x24");
            run.envs([("PRESHADE_FRAMES", "1"), ("PRESHADE_SECONDS", "0.05")]);
            run.env("PRESHADE_ORDER", "front-to-back");
        }
        let output = run.output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{command}\n{said}");
        let quiet = words[0] == "rewrite";
        assert!(quiet || !output.stdout.is_empty(), "{command} says nothing");
    }
}
