//! The scene's directional light, and the view from it that fills a shadow map.

use std::collections::BTreeMap;

use glam::{Mat4, Vec3};
use preshade_plan::state::DepthDirection;

use super::{Camera, Frame, Scene, SceneError, Stream, bind};

/// A directional light and the world-space box that its shadow map covers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Unit vector towards the light.
    pub direction: Vec3,
    /// RGB radiance.
    pub color: Vec3,
    /// Centre of the box in world space. `None`: the centre of the draws.
    pub center: Option<Vec3>,
    /// Width, height and depth of the box in light space, in world units. `None` fits the bounding
    /// boxes of all draws.
    pub extent: Option<Vec3>,
    /// Width and height of the shadow map, in pixels.
    pub map: u32,
}

impl Default for Light {
    fn default() -> Self {
        Self {
            direction: Vec3::new(0.4, 0.8, 0.45).normalize(),
            color: Vec3::new(2.2, 2.1, 1.9),
            center: None,
            extent: None,
            map: 1024,
        }
    }
}

/// Distance from the light's eye to its near plane, in world units. Shaders divide by it, so it is
/// not 0.
const NEAR: f32 = 1.0;

impl Scene {
    /// The light's orthographic view at a time in seconds. Depth grows away from the light.
    pub fn light_frame(&self, time: f32) -> Frame {
        let light = &self.light;
        let up = if light.direction.y.abs() > 0.99 {
            Vec3::X
        } else {
            Vec3::Y
        };
        // `direction` is zero if the scene has no light.
        let toward = light.direction.try_normalize().unwrap_or(Vec3::Y);
        let turned = Mat4::look_to_rh(Vec3::ZERO, -toward, up);
        let (low, high) = self.bounds(turned).unwrap_or((-Vec3::ONE, Vec3::ONE));
        let center = light
            .center
            .unwrap_or_else(|| turned.inverse().transform_point3((low + high) * 0.5));
        // A margin for displacement and skinning, which can move vertices out of the boxes.
        let room = Vec3::new(0.0, 0.0, 2.0);
        let extent = light
            .extent
            .unwrap_or(high - low + room)
            .max(Vec3::splat(1e-3));
        let eye = center + toward * (extent.z * 0.5 + NEAR);
        let half = extent * 0.5;
        Frame {
            view: Mat4::look_to_rh(eye, -toward, up),
            projection: Mat4::orthographic_rh(
                -half.x,
                half.x,
                -half.y,
                half.y,
                NEAR,
                NEAR + extent.z,
            ),
            eye,
            time,
        }
    }

    /// The scene from the light's view for its shadow map: one camera named `light` at a time in
    /// seconds, one sample, forward depth, the whole map.
    #[must_use]
    pub fn seen_from_light(&self, time: f32) -> Self {
        let camera = Camera {
            name: "light".to_owned(),
            frames: vec![self.light_frame(time)],
        };
        let mut scene = self
            .clone()
            .with_depth(self.depth_format, DepthDirection::Forward)
            .with_samples(1);
        scene.size = [self.light.map; 2];
        scene.viewport = None;
        scene.cameras = vec![camera];
        scene
    }

    /// The scene with the uniforms in `names` (by material) fixed at their values in `frame`. All
    /// others follow the scene's cameras. A name is a variable or a member, as in
    /// [`GpuPass::view_dependent`](preshade_plan::plan::GpuPass::view_dependent).
    ///
    /// # Errors
    /// A value of the scene does not fit its variable.
    pub fn with_uniforms_from(
        mut self,
        frame: &Frame,
        names: &BTreeMap<String, Vec<String>>,
    ) -> Result<Self, SceneError> {
        let mut held = Vec::new();
        for draw in &self.draws {
            let found = self
                .materials
                .get(draw.material)
                .and_then(|m| Some((m, names.get(&m.name)?)));
            held.push(match found {
                None => BTreeMap::new(),
                Some((material, names)) => bind::uniforms(&self, material, draw, frame, names)?,
            });
        }
        for (draw, held) in self.draws.iter_mut().zip(held) {
            draw.values.extend(held);
        }
        Ok(self)
    }

    /// Corners of the box around all draws, transformed by `turned`. `None` if no draw has a
    /// bounding box.
    fn bounds(&self, turned: Mat4) -> Option<(Vec3, Vec3)> {
        let mut bounds: Option<(Vec3, Vec3)> = None;
        for draw in &self.draws {
            let Some(mesh) = self.meshes.get(draw.mesh) else {
                continue;
            };
            let instances: Vec<Mat4> = match draw.instance_streams.get("instance_transform") {
                Some(Stream::Float { data, .. }) => data
                    .as_chunks::<16>()
                    .0
                    .iter()
                    .map(Mat4::from_cols_array)
                    .collect(),
                _ => vec![Mat4::IDENTITY],
            };
            for instance in instances {
                for corner in 0..8 {
                    let pick = |axis: usize| mesh.bounds[corner >> axis & 1][axis];
                    let p = (turned * draw.transform * instance).transform_point3(Vec3::new(
                        pick(0),
                        pick(1),
                        pick(2),
                    ));
                    let (low, high) = bounds.unwrap_or((p, p));
                    bounds = Some((low.min(p), high.max(p)));
                }
            }
        }
        bounds
    }
}
