//! glTF files that are wrong, or ask for more than they have: an error, and nothing is taken
//! before.

use preshade_scenes::Variables;
use preshade_scenes::asset::mesh::Gltf;
use preshade_scenes::{Access, Outside};
use shader_text::limits::Limits;

/// Two triangles of four corners: 48 bytes of positions, then 6 indices of two bytes, as zeroes.
const FILE: &str = r#"{
  "asset": { "version": "2.0" },
  "scene": 0,
  "scenes": [{ "nodes": [0] }],
  "nodes": [{ "mesh": 0 }],
  "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
  "accessors": [
    { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1] },
    { "bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR" }
  ],
  "bufferViews": [
    { "buffer": 0, "byteOffset": 0, "byteLength": 48 },
    { "buffer": 0, "byteOffset": 48, "byteLength": 12 }
  ],
  "buffers": [{ "byteLength": 60, "uri": "data:application/octet-stream;base64,DATA" }]
}"#;

/// The file with each `from` made a `to`.
fn file(changes: &[(&str, &str)]) -> String {
    // 60 zeroes in base 64.
    let text = FILE.replace("DATA", &"A".repeat(80));
    changes.iter().fold(text, |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replacen(from, to, 1)
    })
}

fn load(text: &str) -> Result<u32, String> {
    load_mesh(text, None)
}

fn load_mesh(text: &str, mesh: Option<&str>) -> Result<u32, String> {
    let gltf = Gltf {
        file: "a.gltf".to_owned(),
        mesh: mesh.map(str::to_owned),
        ..Gltf::default()
    };
    let read = |_: &str| Ok(text.as_bytes().to_vec());
    let rigged = gltf.load("a", &read).map_err(|e| e.to_string())?;
    Ok(rigged.mesh.vertex_count)
}

#[test]
fn what_lies_about_its_data_is_an_error() {
    assert_eq!(load(&file(&[])), Ok(4));
    let sparse = |n: &str, offset: &str| {
        format!(
            r#""count": 4, "type": "VEC3", "sparse": {{ "count": {n}, "indices": {{ "bufferView": 1, "componentType": 5123, "byteOffset": {offset} }}, "values": {{ "bufferView": 0 }} }}"#
        )
    };
    let shape = r#""count": 4, "type": "VEC3""#;
    for (changes, told) in [
        (
            &[(shape, r#""count": 0, "type": "VEC3""#)][..],
            "no elements",
        ),
        (&[(shape, r#""count": 5, "type": "VEC3""#)], "do not fit"),
        (
            &[(shape, r#""count": 18446744073709551615, "type": "VEC3""#)],
            "do not fit",
        ),
        (
            &[(
                shape,
                r#""count": 4, "byteOffset": 18446744073709551615, "type": "VEC3""#,
            )],
            "do not fit",
        ),
        (
            &[(shape, r#""count": 4, "type": "VEC2""#)],
            "nothing that can stand there",
        ),
        (&[("5126", "5123")], "nothing that can stand there"),
        (&[("5123", "5126")], "nothing that can stand there"),
        (
            &[(
                r#""byteLength": 48"#,
                r#""byteStride": 4, "byteLength": 48"#,
            )],
            "lie 4 apart",
        ),
        (
            &[(
                r#""byteOffset": 48"#,
                r#""byteOffset": 18446744073709551610"#,
            )],
            "do not fit",
        ),
        (
            &[(r#""byteLength": 12"#, r#""byteLength": 1200"#)],
            "do not fit",
        ),
        (&[(shape, &sparse("5", "0"))], "5 of 4 elements are sparse"),
        (&[(shape, &sparse("0", "0"))], "0 of 4 elements are sparse"),
        (&[(shape, &sparse("4", "8"))], "do not fit"),
        (
            &[(r#""byteLength": 60"#, r#""byteLength": 61"#)],
            "60 of 61 bytes",
        ),
        (&[(r#""indices": 1"#, r#""indices": 7"#)], "no glTF 2.0"),
        (
            &[(
                r#""nodes": [{ "mesh": 0 }]"#,
                r#""nodes": [{ "mesh": 0, "children": [0] }]"#,
            )],
            "two parents",
        ),
    ] {
        let said = load(&file(changes)).unwrap_err();
        assert!(said.contains(told), "{changes:?}: {said}");
    }
    assert_eq!(load(&file(&[(shape, &sparse("4", "0"))])), Ok(4));
}

#[test]
fn a_mesh_that_no_node_draws_is_read_at_the_origin() {
    let meshes = r#""meshes": [{ "#;
    let canopy = r#""meshes": [{ "name": "Trunk", "primitives": [{ "attributes": { "POSITION": 0 } }] }, { "name": "Canopy", "#;
    let text = file(&[(meshes, canopy)]);
    assert_eq!(load_mesh(&text, Some("Trunk")), Ok(4));
    assert_eq!(load_mesh(&text, Some("Canopy")), Ok(4));
    let said = load_mesh(&text, Some("Trunc")).unwrap_err();
    assert!(said.contains("did you mean `Trunk`?"), "{said}");
}

#[test]
fn keys_select_nodes_materials_and_primitives() {
    let node = r#""nodes": [{ "mesh": 0 }]"#;
    let two = r#""nodes": [{ "name": "a", "mesh": 0, "children": [1] }, { "name": "b", "mesh": 0, "translation": [5, 0, 0] }]"#;
    let primitives = r#""primitives": ["#;
    let another = r#""primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }, "#;
    let accessors = r#""accessors""#;
    let materials = r#""materials": [{ "name": "Leaf" }], "accessors""#;
    let changes = [(node, two), (primitives, another), (accessors, materials)];
    let text = file(&changes);
    let of = |gltf: Gltf| {
        let gltf = Gltf {
            file: "a.gltf".to_owned(),
            ..gltf
        };
        let rigged = gltf.load("a", &|_: &str| Ok(text.as_bytes().to_vec()));
        let mesh = rigged.map_err(|e| e.to_string())?.mesh;
        Ok::<_, String>((mesh.vertex_count, mesh.bounds[0].x))
    };
    let name = |name: &str| Some(name.to_owned());
    assert_eq!(of(Gltf::default()), Ok((16, 0.0)));
    let node = |node: &str| Gltf {
        node: name(node),
        ..Gltf::default()
    };
    assert_eq!(of(node("a")), Ok((16, 0.0)));
    assert_eq!(of(node("b")), Ok((8, 5.0)));
    let leaf = Gltf {
        material: name("Leaf"),
        ..node("b")
    };
    assert_eq!(of(leaf), Ok((4, 5.0)));
    let second = Gltf {
        primitive: Some(1),
        ..Gltf::default()
    };
    assert_eq!(of(second), Ok((8, 0.0)));
}

#[test]
fn what_many_nodes_draw_is_counted_before_it_is_read() {
    let name = format!("preshade-gltf-{}", std::process::id());
    let folder = std::env::temp_dir().join(name);
    std::fs::create_dir_all(&folder).unwrap();
    // 100,000 nodes of one mesh.
    let nodes: Vec<String> = (0..100_000).map(|i| i.to_string()).collect();
    let many = [
        (
            r#""nodes": [0]"#,
            format!(r#""nodes": [{}]"#, nodes.join(",")),
        ),
        (
            r#""nodes": [{ "mesh": 0 }]"#,
            format!(
                r#""nodes": [{}]"#,
                vec![r#"{"mesh":0}"#; nodes.len()].join(",")
            ),
        ),
    ];
    let many: Vec<(&str, &str)> = many.iter().map(|(a, b)| (*a, b.as_str())).collect();
    std::fs::write(folder.join("a.gltf"), file(&many)).unwrap();
    // A claim of a terabyte, of which nothing is in the file.
    let claimed = file(&[(
        r#"{ "bufferView": 0, "componentType": 5126, "count": 4"#,
        r#"{ "componentType": 5126, "sparse": { "count": 1, "indices": { "bufferView": 1, "componentType": 5123 }, "values": { "bufferView": 0 } }, "count": 4000000000"#,
    )]);
    std::fs::write(folder.join("b.gltf"), claimed).unwrap();
    // One buffer again and again.
    let buffer = r#"{ "byteLength": 60, "uri": "c.bin" }"#;
    let buffers = format!(r#""buffers": [{}]"#, vec![buffer; 2000].join(","));
    let text = file(&[]);
    let at = text.find(r#""buffers""#).unwrap();
    std::fs::write(folder.join("c.gltf"), format!("{}{buffers}}}", &text[..at])).unwrap();
    std::fs::write(folder.join("c.bin"), vec![0; 1 << 20]).unwrap();
    std::fs::write(
        folder.join("a.wgsl"),
        "@vertex fn vs(@location(0) position: vec3<f32>) -> @builtin(position) vec4<f32> { \
         return vec4(position, 1.0); }\n@fragment fn fs() -> @location(0) vec4<f32> { \
         return vec4(1.0); }",
    )
    .unwrap();
    let limits = Limits {
        vertices: 300_000,
        scene_bytes: 64 << 20,
        ..Limits::default()
    };
    for (name, told) in [
        ("a", "the limit `vertices` is 300000"),
        ("b", "the limit `scene-bytes` is 67108864"),
        ("c", "the limit `scene-bytes` is 67108864"),
    ] {
        let text = format!(
            "[materials.m]\nshader = \"a.wgsl\"\n[meshes]\nm.gltf = {{ file = \"{name}.gltf\" }}\n\
             [[draws]]\nmesh = \"m\"\nmaterial = \"m\"\n[[cameras]]\neye = [0, 0, 3]\n\
             target = [0, 0, 0]\n"
        );
        let access = Access {
            outside: Outside::Refused,
            limits,
        };
        let path = folder.join("scene.toml");
        let said = preshade_scenes::read(&text, &path, &Variables::new(), access);
        let said = said.unwrap_err().to_string();
        assert!(said.contains(told), "{name}: {said}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
