//! Materials that displace, cut, skin, morph and turn, each with a pre-pass shader by hand as the
//! reference.

use bevy::asset::uuid::Uuid;
use bevy::asset::{AssetId, RenderAssetUsages};
use bevy::image::{ImageSampler, ImageSamplerDescriptor};
use bevy::light::{DirectionalLightShadowMap, PointLightShadowMap};
use bevy::mesh::morph::{MeshMorphWeights, MorphAttributes};
use bevy::mesh::skinning::{SkinnedMesh, SkinnedMeshInverseBindposes};
use bevy::mesh::{MeshVertexBufferLayoutRef, VertexAttributeValues};
use bevy::pbr::{ExtendedMaterial, MaterialExtension, MaterialPipeline, MaterialPipelineKey};
use bevy::prelude::*;
use bevy::render::render_resource::{
    AsBindGroup, Extent3d, Face, RenderPipelineDescriptor, SpecializedMeshPipelineError,
    TextureDimension, TextureFormat,
};
use bevy::shader::{Shader, ShaderRef};

/// Names of the cases, and their main and hand-written shaders.
pub const CASES: [(&str, &str, &str); 10] = [
    (
        "grass",
        include_str!("../shaders/grass.wgsl"),
        include_str!("../shaders/grass.prepass.wgsl"),
    ),
    (
        "fence",
        include_str!("../shaders/fence.wgsl"),
        include_str!("../shaders/fence.prepass.wgsl"),
    ),
    (
        "jelly",
        include_str!("../shaders/jelly.wgsl"),
        include_str!("../shaders/jelly.prepass.wgsl"),
    ),
    (
        "skin",
        include_str!("../shaders/skin.wgsl"),
        include_str!("../shaders/skin.prepass.wgsl"),
    ),
    (
        "morph",
        include_str!("../shaders/morph.wgsl"),
        include_str!("../shaders/morph.prepass.wgsl"),
    ),
    (
        "sign",
        include_str!("../shaders/sign.wgsl"),
        include_str!("../shaders/sign.prepass.wgsl"),
    ),
    ("holes", include_str!("../shaders/holes.wgsl"), ""),
    ("lit", include_str!("../shaders/lit.wgsl"), ""),
    (
        "leaf",
        include_str!("../shaders/leaf.wgsl"),
        include_str!("../shaders/leaf.prepass.wgsl"),
    ),
    (
        "bubble",
        include_str!("../shaders/bubble.wgsl"),
        include_str!("../shaders/bubble.prepass.wgsl"),
    ),
];

pub const GRASS: usize = 0;
pub const FENCE: usize = 1;
pub const JELLY: usize = 2;
pub const SKIN: usize = 3;
pub const MORPH: usize = 4;
pub const SIGN: usize = 5;
pub const HOLES: usize = 6;
pub const LIT: usize = 7;
pub const LEAF: usize = 8;
pub const BUBBLE: usize = 9;

/// Bevy's physically based material with holes.
pub type Holey = ExtendedMaterial<StandardMaterial, Holes>;

/// The holes.
#[derive(Asset, TypePath, AsBindGroup, Clone, Debug)]
pub struct Holes {
    #[uniform(100)]
    pub holes: Vec2,
}

impl MaterialExtension for Holes {
    fn fragment_shader() -> ShaderRef {
        shader(HOLES, false).into()
    }
}

/// A material of a case. `HAND`: with the pre-pass shader by hand.
#[derive(Asset, TypePath, AsBindGroup, Clone, Debug)]
pub struct Case<const CASE: usize, const HAND: bool> {
    #[uniform(0)]
    pub values: Vec4,
    #[texture(1)]
    #[sampler(2)]
    pub texture: Handle<Image>,
}

fn shader(case: usize, is_hand: bool) -> Handle<Shader> {
    let number = 0x7072_6573_6861_6465_0000 + (case as u128) * 2 + u128::from(is_hand);
    Handle::Uuid(Uuid::from_u128(number), std::marker::PhantomData)
}

impl<const CASE: usize, const HAND: bool> Material for Case<CASE, HAND> {
    fn vertex_shader() -> ShaderRef {
        match CASE {
            // It has the mesh's own vertex stage.
            FENCE | LIT | LEAF => ShaderRef::Default,
            _ => shader(CASE, false).into(),
        }
    }

    fn fragment_shader() -> ShaderRef {
        shader(CASE, false).into()
    }

    fn prepass_vertex_shader() -> ShaderRef {
        match HAND {
            true => shader(CASE, true).into(),
            false => ShaderRef::Default,
        }
    }

    fn prepass_fragment_shader() -> ShaderRef {
        Self::prepass_vertex_shader()
    }

    fn specialize(
        _: &MaterialPipeline,
        descriptor: &mut RenderPipelineDescriptor,
        _: &MeshVertexBufferLayoutRef,
        _: MaterialPipelineKey<Self>,
    ) -> Result<(), SpecializedMeshPipelineError> {
        // Bevy culls nothing in the pre-pass of a material of one's own, though the main pass does.
        if HAND {
            descriptor.primitive.cull_mode = Some(Face::Back);
        }
        Ok(())
    }

    fn alpha_mode(&self) -> AlphaMode {
        // Without it Bevy has no fragment stage of a hand-written pre-pass that only writes depth.
        match (HAND, CASE) {
            (true, _) => AlphaMode::Mask(0.5),
            (false, LEAF) if self.values.w < 0.0 => AlphaMode::Mask(0.5),
            (false, LEAF) => AlphaMode::AlphaToCoverage,
            (false, _) => AlphaMode::Opaque,
        }
    }
}

/// The text of a main shader, for a test that changes it.
pub fn set_shader(app: &mut App, case: usize, text: String) {
    let (name, ..) = CASES[case];
    let Handle::Uuid(uuid, _) = shader(case, false) else {
        return;
    };
    let mut shaders = app.world_mut().resource_mut::<Assets<Shader>>();
    let shader = Shader::from_wgsl(text, format!("{name}.wgsl"));
    shaders.insert(AssetId::Uuid { uuid }, shader).unwrap();
}

/// Adds the material's plugin, shaders, a mesh with it, and lights with shadows.
pub fn set_up<const CASE: usize, const HAND: bool>(app: &mut App) {
    app.add_plugins(MaterialPlugin::<Case<CASE, HAND>>::default());
    add_shaders(app, CASE);
    // Small enough to be read into a buffer.
    app.insert_resource(DirectionalLightShadowMap { size: 256 });
    app.insert_resource(PointLightShadowMap { size: 256 });
    app.add_systems(Startup, spawn::<CASE, HAND>);
    app.add_systems(Update, (turn, morph));
}

fn add_shaders(app: &mut App, case: usize) {
    let (name, main, hand) = CASES[case];
    let mut shaders = app.world_mut().resource_mut::<Assets<Shader>>();
    for (is_hand, text, path) in [
        (false, main, format!("{name}.wgsl")),
        (true, hand, format!("{name}.prepass.wgsl")),
    ] {
        let Handle::Uuid(uuid, _) = shader(case, is_hand) else {
            continue;
        };
        shaders
            .insert(AssetId::Uuid { uuid }, Shader::from_wgsl(text, path))
            .unwrap();
    }
}

/// Adds a sphere of Bevy's material with holes of that width; `0.0`: none.
pub fn set_up_holes(app: &mut App, width: f32) {
    app.add_plugins(MaterialPlugin::<Holey>::default());
    add_shaders(app, HOLES);
    let spawn = move |mut commands: Commands,
                      mut meshes: ResMut<Assets<Mesh>>,
                      mut materials: ResMut<Assets<Holey>>| {
        let material = materials.add(Holey {
            base: StandardMaterial::from(Color::srgb(0.7, 0.5, 0.3)),
            extension: Holes {
                holes: Vec2::new(8.0, width),
            },
        });
        let mesh = meshes.add(Sphere::new(1.0).mesh().uv(24, 16));
        commands.spawn((
            Mesh3d(mesh),
            MeshMaterial3d(material),
            Transform::default(),
            Turning,
        ));
        commands.spawn((
            DirectionalLight::default(),
            Transform::from_xyz(2.0, 4.0, 1.0),
        ));
    };
    app.add_systems(Startup, spawn);
    app.add_systems(Update, turn);
}

/// An object that moves, so that it has motion of its own.
#[derive(Component)]
struct Turning;

fn turn(time: Res<Time>, mut turning: Query<&mut Transform, With<Turning>>) {
    for mut transform in &mut turning {
        let angle = time.elapsed_secs() * 0.3;
        transform.rotation = Quat::from_rotation_y(angle);
        transform.translation.x = angle * 0.2;
    }
}

/// Weights that change each frame.
fn morph(time: Res<Time>, mut all: Query<&mut MeshMorphWeights>) {
    for mut weights in &mut all {
        let t = time.elapsed_secs();
        *weights = MeshMorphWeights::Value {
            weights: vec![0.2 + t, 0.5 - t * 0.5],
        };
    }
}

fn checkers() -> Image {
    let texel = |i: u32| {
        let (x, y) = (i % 16, i / 16);
        let alpha = if (x / 4 + y / 4) % 2 == 0 { 255 } else { 40 };
        [90 + x as u8 * 8, 160, 60 + y as u8 * 8, alpha]
    };
    let mut image = Image::new(
        Extent3d {
            width: 16,
            height: 16,
            depth_or_array_layers: 1,
        },
        TextureDimension::D2,
        (0..256).flat_map(texel).collect(),
        TextureFormat::Rgba8Unorm,
        RenderAssetUsages::RENDER_WORLD,
    );
    image.sampler = ImageSampler::Descriptor(ImageSamplerDescriptor::nearest());
    image
}

fn spawn<const CASE: usize, const HAND: bool>(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut images: ResMut<Assets<Image>>,
    mut materials: ResMut<Assets<Case<CASE, HAND>>>,
    mut poses: ResMut<Assets<SkinnedMeshInverseBindposes>>,
) {
    let material = materials.add(Case {
        values: Vec4::new(0.3, 0.5, 2.0, 1.0),
        texture: images.add(checkers()),
    });
    let mut mesh = Sphere::new(1.0).mesh().uv(24, 16);
    if CASE == SKIN {
        skinned(&mut mesh);
    }
    if CASE == MORPH {
        morphed(&mut mesh);
    }
    let mut object = commands.spawn((
        Mesh3d(meshes.add(mesh)),
        MeshMaterial3d(material),
        Transform::default(),
        Turning,
    ));
    if CASE == MORPH {
        object.insert(MeshMorphWeights::Value {
            weights: vec![0.0, 0.0],
        });
    }
    if CASE == SKIN {
        let id = object.id();
        let joints = [-0.4_f32, 0.4].map(|y| {
            let joint = (Transform::from_xyz(0.0, y, 0.0), Turning);
            commands.spawn((joint, ChildOf(id))).id()
        });
        let inverse = [-0.4_f32, 0.4].map(|y| Mat4::from_translation(Vec3::new(0.0, -y, 0.0)));
        commands.entity(id).insert(SkinnedMesh {
            inverse_bindposes: poses.add(SkinnedMeshInverseBindposes::from(inverse.to_vec())),
            joints: joints.to_vec(),
        });
    }
    commands.spawn((
        DirectionalLight {
            shadow_maps_enabled: true,
            ..default()
        },
        Transform::from_xyz(2.0, 4.0, 1.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    commands.spawn((
        PointLight {
            shadow_maps_enabled: true,
            ..default()
        },
        Transform::from_xyz(-2.0, 2.0, 2.0),
    ));
}

/// Two joints, the lower and the upper half.
fn skinned(mesh: &mut Mesh) {
    let Some(VertexAttributeValues::Float32x3(positions)) =
        mesh.attribute(Mesh::ATTRIBUTE_POSITION)
    else {
        return;
    };
    let upper: Vec<f32> = positions.iter().map(|p| (p[1] + 1.0) / 2.0).collect();
    let joints = vec![[0_u16, 1, 0, 0]; upper.len()];
    let weights: Vec<[f32; 4]> = upper.iter().map(|u| [1.0 - u, *u, 0.0, 0.0]).collect();
    mesh.insert_attribute(
        Mesh::ATTRIBUTE_JOINT_INDEX,
        VertexAttributeValues::Uint16x4(joints),
    );
    mesh.insert_attribute(Mesh::ATTRIBUTE_JOINT_WEIGHT, weights);
}

/// Two targets: wider, and bent.
fn morphed(mesh: &mut Mesh) {
    let Some(VertexAttributeValues::Float32x3(positions)) =
        mesh.attribute(Mesh::ATTRIBUTE_POSITION)
    else {
        return;
    };
    let target = |of: fn(Vec3) -> Vec3| {
        let of =
            move |p: &[f32; 3]| MorphAttributes::new(of(Vec3::from(*p)), Vec3::ZERO, Vec3::ZERO);
        positions.iter().map(of).collect::<Vec<_>>()
    };
    let mut targets = target(|p| Vec3::new(p.x * 0.4, 0.0, 0.0));
    targets.extend(target(|p| Vec3::new(p.y * p.y * 0.5, 0.0, 0.1)));
    mesh.set_morph_targets(targets);
}
