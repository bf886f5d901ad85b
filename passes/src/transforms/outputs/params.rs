//! The parameters.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use preshade_plan::mapping::{Malformed, Mapping};
use preshade_plan::state::DepthFormat;

/// How precisely floats are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Precision {
    /// 16 bits a component.
    #[default]
    Half,
    /// 32 bits a component.
    Full,
}

/// The treatment of code that depends on the viewer, in a picture that a light draws.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Viewer {
    /// It follows the light: the host binds the light's view.
    #[default]
    Keep,
    /// Discards and texture coordinates are those without it, as without parallax and fades. The plan lists
    /// the omissions in `left_out`. Positions keep it.
    Drop,
}

/// Where the y of the clip position points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ClipY {
    /// To the top of the picture, as in WebGPU, OpenGL, Direct3D and Metal.
    Up,
    /// To the bottom, as in Vulkan.
    Down,
}

/// Which way the axes of a position turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Axes {
    /// x to the right, y up, z to the viewer: three.js, Bevy, Godot, Filament, glTF.
    RightHanded,
    /// x to the right, y up, z away from the viewer: Babylon.js, Unity, Unreal Engine.
    LeftHanded,
}

/// The colour target that is bound where a pass needs no colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ColourTarget {
    /// Nothing.
    #[default]
    None,
    /// A target whose colour nobody reads. WebGL refuses a draw that writes no colour to it.
    Bound,
}

/// Parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct OutputsParams {
    /// The values to write, joined by `+`: `depth`, `shadow`, `distance`, `normal`, `velocity`, `id`, or the
    /// name of a value in the fragment stage. `NAME@FUNCTION` is the value of one function, and
    /// `NAME@FUNCTION:LINE` that of one line. Depth is written with each.
    pub write: String,
    /// `normal`: the value to take, by its name. Default: the unit vector that meets a light in a
    /// dot product, if there is only one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub normal: Option<String>,
    /// `normal`: takes the normal of the triangle, on the side that the viewer sees, in place of a value. It
    /// is computed from derivatives of the position, so it is flat, and less precise far from the origin.
    /// Name the handedness of your world's axes: `right-handed` or `left-handed`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub faces: Option<Axes>,
    /// `normal`: the matrix that turns the value to other axes, by its name: `camera.view` turns it
    /// from the world's to the camera's. It must be a rotation; the result is normalised. Default:
    /// the axes of the author's value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub matrix: Option<String>,
    /// `normal`: whether to write two numbers from -1 to 1, octahedral, in place of three.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub octahedral: bool,
    /// `normal`: whether to write numbers from 0 to 1 in place of those from -1 to 1, for targets
    /// that hold no negative ones.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub unsigned: bool,
    /// `velocity`: buffers, or GLSL uniforms outside of blocks, that are the same in each frame, by
    /// the names of their variables, joined by `+`. Default: none.
    #[serde(rename = "static", skip_serializing_if = "Option::is_none")]
    pub still: Option<String>,
    /// `velocity`: attributes that change from frame to frame (transforms of instances, vertices
    /// that the CPU moves), by name, joined by `+`. A GLSL matrix is one name. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub moving: Option<String>,
    /// `velocity`, `shadow` and `distance`: uniforms, or parts of them, that shift the picture by a part of a pixel, joined
    /// by `+`: `frame.camera.jitter`. They count as 0, in both frames. Numbers of a matrix are named as
    /// in `camera.proj[2].xy`, columns first. `velocity`: `WITHOUT=WITH` names a part without the shift
    /// that takes the place of one with it, such as a matrix.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub jitter: Option<String>,
    /// `velocity` and `faces`: where the y of your clip position points in the picture. Default: that of the
    /// language, `down` for Vulkan's GLSL and SPIR-V and `up` for others. With a viewport of negative
    /// height, it is `up` in Vulkan.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub y: Option<ClipY>,
    /// `distance` and `faces`: the position that they are computed from, by the name of a value of the fragment
    /// stage; for `faces` an input of the stage. One of four components is divided by the fourth. Default: the vector
    /// that the view's matrix turns into the clip position.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position: Option<String>,
    /// `distance`: the light's position, by the name of a uniform or a member of one. Default: a
    /// uniform `point_light` that the plan lists, with the position and the range.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light: Option<String>,
    /// `distance`: a number that it is divided by, by its name. Default: the range in `point_light`;
    /// with `light`, none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range: Option<String>,
    /// `shadow` and `distance`: the treatment of code that depends on the viewer, such as parallax and fades
    /// by distance.
    #[serde(skip_serializing_if = "is_kept")]
    pub view: Viewer,
    /// `shadow` and `distance`: uniforms, or members of them, that follow the viewer though their names do
    /// not show it, joined by `+`: `viewer=frame.e+frame.q`. A minus sign names one that does not:
    /// `viewer=-material.eye_open`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub viewer: Option<String>,
    /// Resources of another view that take the place of the author's, as `THEIRS=OURS`, joined by
    /// `+`: `light.view_proj=camera.view_proj`. `GROUP:BINDING` may name their variable.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub map: Option<String>,
    /// Declarations of the other view's resources, in WGSL; on the command line, the name of a file
    /// that has them. Default: a struct of the members that `map` names, in their order, at the
    /// author's group and binding.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub layout: Option<String>,
    /// The alpha from 0 to 1 from which on alpha to coverage and blended materials cover a pixel. Such a
    /// material is refused without it. It is not applied to others.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cutoff: Option<f32>,
    /// The group of bindings that the author does not have, behind his own there. Default: copies of
    /// buffers are in the group of the original, and others in the last group.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub group: Option<u32>,
    /// How precisely floats are stored. Distances always have 32 bits.
    pub precision: Precision,
    /// The colour target that is bound where nothing but depth is written.
    #[serde(skip_serializing_if = "is_none")]
    pub colour_target: ColourTarget,
    /// `shadow`: format of the shadow map. Other depths have that of the scene's.
    pub format: DepthFormat,
}

impl Default for OutputsParams {
    fn default() -> Self {
        Self {
            write: "depth".to_owned(),
            normal: None,
            faces: None,
            matrix: None,
            octahedral: false,
            unsigned: false,
            still: None,
            moving: None,
            jitter: None,
            y: None,
            position: None,
            light: None,
            range: None,
            view: Viewer::default(),
            viewer: None,
            map: None,
            layout: None,
            cutoff: None,
            group: None,
            precision: Precision::default(),
            colour_target: ColourTarget::default(),
            format: DepthFormat::default(),
        }
    }
}

fn is_kept(view: &Viewer) -> bool {
    *view == Viewer::Keep
}

fn is_none(target: &ColourTarget) -> bool {
    *target == ColourTarget::None
}

/// A word of `write`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Asked {
    /// The camera's depth.
    Depth,
    /// A light's depth.
    Shadow,
    Normal,
    /// How far each point moved since the previous frame.
    Velocity,
    /// How far the surface is from a point light.
    Distance,
    /// Numbers of draw and instance.
    Id,
    Named(String),
}

impl OutputsParams {
    /// The mappings of `map`.
    ///
    /// # Errors
    /// One is malformed.
    pub fn mappings(&self) -> Result<Vec<Mapping>, Malformed> {
        list(self.map.as_deref()).map(str::parse).collect()
    }

    /// The words of `write`, each once.
    pub fn requested(&self) -> Vec<Asked> {
        let mut found = Vec::new();
        for word in list(Some(&self.write)) {
            let asked = match word {
                "depth" => Asked::Depth,
                "shadow" => Asked::Shadow,
                "normal" => Asked::Normal,
                "velocity" => Asked::Velocity,
                "distance" => Asked::Distance,
                "id" => Asked::Id,
                name => Asked::Named(name.to_owned()),
            };
            if !found.contains(&asked) {
                found.push(asked);
            }
        }
        found
    }
}

/// The names of a list that is joined by `+`.
pub(crate) fn list(text: Option<&str>) -> impl Iterator<Item = &str> {
    let names = text.unwrap_or_default().split('+');
    names.map(str::trim).filter(|name| !name.is_empty())
}
