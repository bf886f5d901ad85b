//! Cameras: look-at views with a perspective projection to depths of 0 to 1, forward or reversed,
//! with an optionally infinite far plane.

use glam::{Mat4, Vec3, Vec4};
use preshade_plan::state::DepthDirection;
use serde::Deserialize;

use preshade_draw::scene::Frame;

/// A perspective camera at one position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pose {
    pub eye: Vec3,
    pub target: Vec3,
    /// Vertical field of view, in degrees.
    pub fov: f32,
    /// In seconds.
    pub time: f32,
}

/// An eye on a sphere around a target, as in viewers with drag-to-rotate.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Orbit {
    /// The centre of the sphere. The origin by default.
    #[serde(default)]
    pub target: [f32; 3],
    /// Rotation around y in degrees: 0 puts the eye towards +x, 90 towards -z.
    pub yaw: f32,
    /// Degrees above the horizon.
    pub pitch: f32,
    /// Distance from eye to target, above 0.
    pub distance: f32,
}

impl Orbit {
    pub fn eye(self) -> Vec3 {
        let (yaw, pitch) = (self.yaw.to_radians(), self.pitch.to_radians());
        let out = Vec3::new(
            pitch.cos() * yaw.cos(),
            pitch.sin(),
            -pitch.cos() * yaw.sin(),
        );
        Vec3::from(self.target) + self.distance * out
    }
}

/// Distances of the clip planes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Range {
    /// Distance of the near plane, above 0.
    pub near: f32,
    /// Distance of the far plane, above `near`, or infinity.
    pub far: f32,
}

/// Right-handed perspective onto WebGPU's clip space.
pub(crate) fn perspective(fov: f32, aspect: f32, range: Range, direction: DepthDirection) -> Mat4 {
    let f = 1.0 / (fov.to_radians() * 0.5).tan();
    let Range { near, far } = range;
    // Depth is (a z + b) / -z: 0 at the near plane and 1 at the far plane, or the other way round.
    let (a, b) = match (direction, far.is_finite()) {
        (DepthDirection::Forward, true) => (far / (near - far), near * far / (near - far)),
        (DepthDirection::Forward, false) => (-1.0, -near),
        (DepthDirection::Reversed, true) => (near / (far - near), near * far / (far - near)),
        (DepthDirection::Reversed, false) => (0.0, near),
    };
    Mat4::from_cols(
        Vec4::new(f / aspect, 0.0, 0.0, 0.0),
        Vec4::new(0.0, f, 0.0, 0.0),
        Vec4::new(0.0, 0.0, a, -1.0),
        Vec4::new(0.0, 0.0, b, 0.0),
    )
}

impl Pose {
    /// The frame of this pose.
    pub fn frame(self, up: Vec3, aspect: f32, range: Range, direction: DepthDirection) -> Frame {
        Frame {
            view: Mat4::look_at_rh(self.eye, self.target, up),
            projection: perspective(self.fov, aspect, range, direction),
            eye: self.eye,
            time: self.time,
        }
    }
}

/// `frames` poses along keys spaced evenly in time, by Catmull-Rom splines through eyes and targets.
pub(crate) fn path(keys: &[Pose], frames: u32) -> Vec<Pose> {
    let last = keys.len().saturating_sub(1);
    let at = |i: isize| keys[i.clamp(0, last as isize) as usize];
    if keys.is_empty() {
        return Vec::new();
    }
    (0..frames)
        .map(|frame| {
            let t = last as f32 * frame as f32 / frames.saturating_sub(1).max(1) as f32;
            let i = (t.floor() as isize).min(last.saturating_sub(1) as isize);
            let f = t - i as f32;
            let [a, b, c, d] = [at(i - 1), at(i), at(i + 1), at(i + 2)];
            let spline = |p: fn(&Pose) -> Vec3| {
                let [a, b, c, d] = [p(&a), p(&b), p(&c), p(&d)];
                0.5 * (2.0 * b
                    + (c - a) * f
                    + (2.0 * a - 5.0 * b + 4.0 * c - d) * f * f
                    + (3.0 * b - a - 3.0 * c + d) * f * f * f)
            };
            Pose {
                eye: spline(|p| p.eye),
                target: spline(|p| p.target),
                fov: b.fov + (c.fov - b.fov) * f,
                time: b.time + (c.time - b.time) * f,
            }
        })
        .collect()
}
