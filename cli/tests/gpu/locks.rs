//! `plan --lock` writes the lock files that build scripts read.

use std::fs;

use crate::hostile_support::{run, stderr};
use crate::trees::{fixture, tree};

/// What `plan` decides on a scene is what a build script makes of the shader.
#[test]
fn a_decision_is_kept_for_builds() {
    let tree = tree("many-lock");
    let scene = fs::read_to_string(fixture("scenes/first.toml")).unwrap();
    fs::create_dir_all(tree.join("scenes")).unwrap();
    let scene = scene.replace(
        "[materials.stone]\n",
        "[materials.stone]\ndefines = { FOG = 1 }\n",
    );
    assert!(scene.contains("FOG"));
    fs::write(tree.join("scenes/first.toml"), scene).unwrap();
    for shader in ["textured.wgsl", "foliage.wgsl"] {
        fs::copy(
            fixture("shaders").join(shader),
            tree.join("shaders").join(shader),
        )
        .unwrap();
    }
    let args = [
        "plan",
        "scenes/first.toml",
        "--lock",
        "--one",
        "--size",
        "48x32",
        "--frames",
        "1",
        "--seconds",
        "0.05",
        "--runners",
        "1",
        "--model",
        "model.json",
    ];
    let output = run(&tree, &args);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let path = tree.join("shaders/preshade.lock");
    let lock = preshade_compiler::lock::Lock::read(&path).unwrap().unwrap();
    let names: Vec<&String> = lock.materials.keys().collect();
    assert_eq!(names, ["leaves", "stone"]);
    assert!(lock.materials["stone"].measured.is_some());
    let build = |builder: preshade_compiler::build_script::BuildConfig| {
        let builder = builder.name("stone").out_dir(tree.join("out"));
        builder
            .build(&[&tree.join("shaders/textured.wgsl")])
            .unwrap()
    };
    let built = build(
        preshade_compiler::build_script::configure()
            .define("FOG", "1")
            .vertex("vs_main"),
    );
    assert_eq!(built.warnings, [""; 0]);
    let otherwise = build(preshade_compiler::build_script::configure());
    assert!(otherwise.warnings[0].contains("other definitions (FOG)"));
    assert_eq!(built.read.last(), Some(&path));
    let predicted = run(&tree, &[&args[..], &["--time", "no"]].concat());
    assert_eq!(predicted.status.code(), Some(2));

    // Another preshade's is written anew; what is no lock stays as it is, and nothing is measured
    // in vain.
    fs::write(&path, r#"{"schema": "preshade.lock.v9", "materials": {}}"#).unwrap();
    let output = run(&tree, &args);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(
        stderr(&output).contains("it is written anew"),
        "{}",
        stderr(&output)
    );
    assert_eq!(
        preshade_compiler::lock::Lock::read(&path)
            .unwrap()
            .unwrap()
            .materials
            .len(),
        2
    );
    let merged = "<<<<<<< ours\n{}\n=======\n{}\n>>>>>>> theirs\n";
    fs::write(&path, merged).unwrap();
    let output = run(&tree, &args);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        stderr(&output).contains("help: mend it, or remove it"),
        "{}",
        stderr(&output)
    );
    assert_eq!(fs::read_to_string(&path).unwrap(), merged);
}

/// Folders may have shaders of one name, and a shader may be composed of modules.
#[test]
fn a_decision_is_kept_beside_its_own_shader() {
    let tree = tree("many-lock-beside");
    let scene = fs::read_to_string(fixture("scenes/first.toml")).unwrap();
    for folder in ["scenes", "assets/shaders", "oil"] {
        fs::create_dir_all(tree.join(folder)).unwrap();
    }
    let more = "[materials.moss]\nshader = \"../assets/shaders/textured.wgsl\"\n[materials.oiled]\n\
                shader = \"../oil/oiled.wgsl\"\n";
    let at = scene.find("[materials.stone]").unwrap();
    let scene = format!("{}{more}{}", &scene[..at], &scene[at..]);
    fs::write(tree.join("scenes/first.toml"), scene).unwrap();
    for (from, to) in [
        ("textured.wgsl", "shaders/textured.wgsl"),
        ("foliage.wgsl", "shaders/foliage.wgsl"),
        ("textured.wgsl", "assets/shaders/textured.wgsl"),
    ] {
        fs::copy(fixture("shaders").join(from), tree.join(to)).unwrap();
    }
    fs::write(
        tree.join("oil/tint.wgsl"),
        "#define_import_path tint\nfn tinted(c: vec4<f32>) -> vec4<f32> { return c * 0.5; }\n",
    )
    .unwrap();
    fs::write(
        tree.join("oil/oiled.wgsl"),
        "#import tint::tinted\n@vertex fn vs(@location(0) position: vec3<f32>) -> \
         @builtin(position) vec4<f32> { return vec4<f32>(position, 1.0); }\n\
         @fragment fn fs() -> @location(0) vec4<f32> { return tinted(vec4<f32>(1.0)); }\n",
    )
    .unwrap();
    let args =
        "plan scenes/first.toml --lock --one --size 48x32 --frames 1 --seconds 0.05 --runners 1";
    let output = run(&tree, &args.split(' ').collect::<Vec<_>>());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    for (folder, names) in [
        ("shaders", &["leaves", "stone"][..]),
        ("assets/shaders", &["moss"]),
        ("oil", &["oiled"]),
    ] {
        let path = tree.join(folder).join("preshade.lock");
        let lock = preshade_compiler::lock::Lock::read(&path).unwrap().unwrap();
        let kept: Vec<&String> = lock.materials.keys().collect();
        assert_eq!(kept, names, "{folder}");
    }
    let builder = preshade_compiler::build_script::configure()
        .name("oiled")
        .out_dir(tree.join("out"));
    let built = builder.build(&[&tree.join("oil/oiled.wgsl")]).unwrap();
    assert_eq!(built.warnings, [""; 0]);
}
