//! Values that the renderer provides under names such as `view_proj`: in a scene file
//! (`$view_proj`) or by convention.

use glam::{Mat4, Vec3, Vec4};

use super::{Draw, Frame, Scene};
use naga_edit::declared::Depth;

/// A value that the renderer provides. `docs/reference/scene-values.md` lists the names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Semantic {
    ViewProjection,
    ModelViewProjection,
    Model,
    NormalMatrix,
    ModelView,
    View,
    Projection,
    InverseView,
    InverseProjection,
    InverseViewProjection,
    InverseModel,
    LightViewProjection,
    CameraPosition,
    Time,
    LightDirection,
    LightPosition,
    LightColor,
    Resolution,
    Near,
    Far,
    Aspect,
    Joints,
    MorphWeights,
    VertexCount,
    InstanceCount,
}

/// A semantic's value: a matrix, or up to four components.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum SemanticValue {
    Matrix(Mat4),
    Vector(Vec4),
}

/// Names and their meanings, in the form that [`normalise`] returns.
const NAMES: &[(&str, Semantic)] = &[
    ("viewproj", Semantic::ViewProjection),
    ("viewprojection", Semantic::ViewProjection),
    ("viewprojmatrix", Semantic::ViewProjection),
    ("viewprojectionmatrix", Semantic::ViewProjection),
    ("projview", Semantic::ViewProjection),
    ("projectionview", Semantic::ViewProjection),
    ("clipfromworld", Semantic::ViewProjection),
    ("worldtoclip", Semantic::ViewProjection),
    ("vp", Semantic::ViewProjection),
    ("mvp", Semantic::ModelViewProjection),
    ("mvpmatrix", Semantic::ModelViewProjection),
    ("modelviewproj", Semantic::ModelViewProjection),
    ("modelviewprojection", Semantic::ModelViewProjection),
    ("modelviewprojectionmatrix", Semantic::ModelViewProjection),
    ("worldviewproj", Semantic::ModelViewProjection),
    ("worldviewprojection", Semantic::ModelViewProjection),
    ("transform", Semantic::ModelViewProjection),
    ("model", Semantic::Model),
    ("modelmatrix", Semantic::Model),
    ("world", Semantic::Model),
    ("worldmatrix", Semantic::Model),
    ("objecttoworld", Semantic::Model),
    ("localtoworld", Semantic::Model),
    ("worldfromlocal", Semantic::Model),
    ("normalmatrix", Semantic::NormalMatrix),
    ("normal", Semantic::NormalMatrix),
    ("modelnormal", Semantic::NormalMatrix),
    ("inversetransposemodel", Semantic::NormalMatrix),
    ("modelview", Semantic::ModelView),
    ("modelviewmatrix", Semantic::ModelView),
    ("view", Semantic::View),
    ("viewmatrix", Semantic::View),
    ("worldtoview", Semantic::View),
    ("viewfromworld", Semantic::View),
    ("projection", Semantic::Projection),
    ("projectionmatrix", Semantic::Projection),
    ("proj", Semantic::Projection),
    ("clipfromview", Semantic::Projection),
    ("inverseview", Semantic::InverseView),
    ("invview", Semantic::InverseView),
    ("viewinverse", Semantic::InverseView),
    ("worldfromview", Semantic::InverseView),
    ("inverseprojection", Semantic::InverseProjection),
    ("invprojection", Semantic::InverseProjection),
    ("invproj", Semantic::InverseProjection),
    ("viewfromclip", Semantic::InverseProjection),
    ("inverseviewprojection", Semantic::InverseViewProjection),
    ("inverseviewproj", Semantic::InverseViewProjection),
    ("invviewproj", Semantic::InverseViewProjection),
    ("worldfromclip", Semantic::InverseViewProjection),
    ("inversemodel", Semantic::InverseModel),
    ("invmodel", Semantic::InverseModel),
    ("worldtoobject", Semantic::InverseModel),
    ("localfromworld", Semantic::InverseModel),
    ("lightviewproj", Semantic::LightViewProjection),
    ("lightviewprojection", Semantic::LightViewProjection),
    ("lightspacematrix", Semantic::LightViewProjection),
    ("shadowmatrix", Semantic::LightViewProjection),
    ("cameraposition", Semantic::CameraPosition),
    ("camerapos", Semantic::CameraPosition),
    ("campos", Semantic::CameraPosition),
    ("camera", Semantic::CameraPosition),
    ("eye", Semantic::CameraPosition),
    ("eyepos", Semantic::CameraPosition),
    ("eyeposition", Semantic::CameraPosition),
    ("viewpos", Semantic::CameraPosition),
    ("viewposition", Semantic::CameraPosition),
    ("time", Semantic::Time),
    ("seconds", Semantic::Time),
    ("elapsed", Semantic::Time),
    ("elapsedtime", Semantic::Time),
    ("lightdirection", Semantic::LightDirection),
    ("lightdir", Semantic::LightDirection),
    ("sundirection", Semantic::LightDirection),
    ("sundir", Semantic::LightDirection),
    ("tolight", Semantic::LightDirection),
    ("lightposition", Semantic::LightPosition),
    ("lightpos", Semantic::LightPosition),
    ("lightcolor", Semantic::LightColor),
    ("lightcolour", Semantic::LightColor),
    ("lightradiance", Semantic::LightColor),
    ("suncolor", Semantic::LightColor),
    ("resolution", Semantic::Resolution),
    ("viewport", Semantic::Resolution),
    ("viewportsize", Semantic::Resolution),
    ("screensize", Semantic::Resolution),
    ("framesize", Semantic::Resolution),
    ("near", Semantic::Near),
    ("znear", Semantic::Near),
    ("nearplane", Semantic::Near),
    ("cameranear", Semantic::Near),
    ("far", Semantic::Far),
    ("zfar", Semantic::Far),
    ("farplane", Semantic::Far),
    ("camerafar", Semantic::Far),
    ("aspect", Semantic::Aspect),
    ("aspectratio", Semantic::Aspect),
    ("joints", Semantic::Joints),
    ("jointmatrices", Semantic::Joints),
    ("bones", Semantic::Joints),
    ("bonematrices", Semantic::Joints),
    ("skin", Semantic::Joints),
    ("morphweights", Semantic::MorphWeights),
    ("morphtargetweights", Semantic::MorphWeights),
    ("targetweights", Semantic::MorphWeights),
    ("vertexcount", Semantic::VertexCount),
    ("instancecount", Semantic::InstanceCount),
];

/// Normalises a name: removes case, underscores, and the usual prefixes of uniforms and attributes
/// (`u_`, `a_`, `in_`, `i_`, `uViewProj`, `aPosition`, `inPosition`).
pub fn normalise(name: &str) -> String {
    let mut rest = name.trim_start_matches('_');
    for prefix in ["u_", "a_", "in_", "i_", "v_", "g_", "m_"] {
        if let Some(r) = rest.strip_prefix(prefix) {
            rest = r;
            break;
        }
    }
    if let Some(r) = rest.strip_prefix("in")
        && r.starts_with(|c: char| c.is_ascii_uppercase())
    {
        rest = r;
    }
    let mut chars = rest.chars();
    if let (Some('u' | 'a' | 'i'), Some(c)) = (chars.next(), chars.next())
        && c.is_ascii_uppercase()
    {
        rest = &rest[1..];
    }
    rest.chars()
        .filter(|c| *c != '_')
        .flat_map(char::to_lowercase)
        .collect()
}

impl Semantic {
    /// The meaning of a name, if it has one.
    pub fn from_name(name: &str) -> Option<Self> {
        let name = normalise(name);
        let known = |name: &str| NAMES.iter().find(|(n, _)| *n == name).map(|(_, s)| *s);
        known(&name).or_else(|| {
            // Some names spell out the type: `worldViewProjectionMatrix`, `cameraViewProjMat`.
            let bare = ["matrix", "mat"]
                .iter()
                .find_map(|end| name.strip_suffix(end))
                .unwrap_or(&name);
            let bare = bare.replace("projection", "proj").replace("world", "model");
            match bare.strip_prefix("camera").unwrap_or(&bare) {
                "modelviewproj" => Some(Self::ModelViewProjection),
                "viewproj" => Some(Self::ViewProjection),
                other => known(other),
            }
        })
    }

    /// The meaning of a path, given from its last name to its first: that of `camera.position`
    /// together, or of the last name alone.
    pub fn of_path<'n>(mut names: impl Iterator<Item = &'n str>) -> Option<Self> {
        let (own, around) = (names.next()?, names.next());
        around
            .and_then(|a| Self::from_name(&format!("{a}_{own}")))
            .or_else(|| Self::from_name(own))
    }

    /// The primary name.
    pub fn name(self) -> &'static str {
        NAMES
            .iter()
            .find(|(_, s)| *s == self)
            .map_or("?", |(n, _)| n)
    }

    /// All names, normalised.
    pub(crate) fn names() -> impl Iterator<Item = &'static str> {
        NAMES.iter().map(|(n, _)| *n)
    }

    /// Whether the value depends on the camera or the time.
    pub fn is_per_frame(self) -> bool {
        !matches!(
            self,
            Self::Model
                | Self::NormalMatrix
                | Self::InverseModel
                | Self::LightViewProjection
                | Self::LightDirection
                | Self::LightPosition
                | Self::LightColor
                | Self::Resolution
                | Self::Aspect
                | Self::Joints
                | Self::MorphWeights
                | Self::VertexCount
                | Self::InstanceCount
        )
    }

    /// Whether the value is a list, so that array element `i` gets entry `i`.
    pub(crate) fn is_list(self) -> bool {
        matches!(self, Self::Joints | Self::MorphWeights)
    }

    /// The value for one draw in one frame, for a shader that writes this range of depths. `index`
    /// counts list elements of `components` numbers each.
    pub(crate) fn evaluate(
        self,
        scene: &Scene,
        draw: &Draw,
        frame: &Frame,
        depth: Depth,
        index: usize,
        components: usize,
    ) -> SemanticValue {
        use SemanticValue::{Matrix, Vector};
        let projection = in_range(frame.projection, depth);
        let xyz = |v: Vec3, w: f32| Vector(v.extend(w));
        let model = draw.transform;
        let vertex_count = scene.meshes.get(draw.mesh).map_or(0, |m| m.vertex_count);
        match self {
            Self::ViewProjection => Matrix(projection * frame.view),
            Self::ModelViewProjection => Matrix(projection * frame.view * model),
            Self::Model => Matrix(model),
            Self::NormalMatrix => Matrix(model.inverse().transpose()),
            Self::ModelView => Matrix(frame.view * model),
            Self::View => Matrix(frame.view),
            Self::Projection => Matrix(projection),
            Self::InverseView => Matrix(frame.view.inverse()),
            Self::InverseProjection => Matrix(projection.inverse()),
            Self::InverseViewProjection => Matrix((projection * frame.view).inverse()),
            Self::InverseModel => Matrix(model.inverse()),
            Self::LightViewProjection => {
                let light = scene.light_frame(frame.time);
                Matrix(in_range(light.projection, depth) * light.view)
            }
            Self::CameraPosition => xyz(frame.eye, 1.0),
            Self::Time => Vector(Vec4::splat(frame.time)),
            Self::LightDirection => xyz(scene.light.direction, 0.0),
            Self::LightPosition => xyz(scene.light.direction * 20.0, 1.0),
            Self::LightColor => xyz(scene.light.color, 1.0),
            Self::Resolution => {
                let [w, h] = scene.viewport.map_or(scene.size, |[_, _, w, h]| [w, h]);
                let (w, h) = (w as f32, h as f32);
                Vector(Vec4::new(w, h, 1.0 / w, 1.0 / h))
            }
            Self::Near => Vector(Vec4::splat(near_and_far(frame.projection).0)),
            Self::Far => Vector(Vec4::splat(near_and_far(frame.projection).1)),
            Self::Aspect => Vector(Vec4::splat(scene.aspect())),
            Self::Joints => Matrix(draw.joints.get(index).copied().unwrap_or(Mat4::IDENTITY)),
            Self::MorphWeights => {
                let at = |i: usize| {
                    draw.morph_weights
                        .get(index * components + i)
                        .copied()
                        .unwrap_or(0.0)
                };
                Vector(Vec4::new(at(0), at(1), at(2), at(3)))
            }
            Self::VertexCount => Vector(Vec4::splat(vertex_count as f32)),
            Self::InstanceCount => Vector(Vec4::splat(draw.instances as f32)),
        }
    }
}

/// A projection whose depths are from 0 to 1, for a shader that writes `depth`.
fn in_range(projection: Mat4, depth: Depth) -> Mat4 {
    match depth {
        Depth::AsWritten => projection,
        // z becomes 2 z - w.
        Depth::OpenGl => {
            let mut turned = Mat4::from_diagonal(Vec4::new(1.0, 1.0, 2.0, 1.0));
            turned.w_axis.z = -1.0;
            turned * projection
        }
    }
}

/// Near and far plane of a projection from `camera`, in either direction. An infinite far plane
/// returns 1e9.
fn near_and_far(projection: Mat4) -> (f32, f32) {
    let (a, b) = (projection.z_axis.z, projection.w_axis.z);
    if projection.w_axis.w == 1.0 {
        // Orthographic: depth = a z + b.
        let (p, q) = (b / a, (b - 1.0) / a);
        return (p.min(q), p.max(q));
    }
    // Depth 0 lies at distance b / a, depth 1 at b / (a + 1).
    let (zero, one) = (b / a, b / (a + 1.0));
    let finite = |v: f32| if v.is_finite() { v.abs() } else { 1e9 };
    let (p, q) = (finite(zero), finite(one));
    (p.min(q), p.max(q))
}
