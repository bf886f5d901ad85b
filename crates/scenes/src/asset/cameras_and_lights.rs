//! Cameras and lights of glTF files, and a default camera for a file without one.

use glam::{Mat4, Quat, Vec3};
use gltf::camera::Projection;
use gltf::khr_lights_punctual::Kind;
use preshade_plan::state::DepthDirection;

use super::file::{Below, Nodes};
use crate::camera::{self, Range};
use preshade_draw::scene::{Camera, Frame, Value};

/// The largest number of lights that the built-in material supports.
pub(crate) const MOST_LIGHTS: usize = 16;

/// A camera of a glTF file.
pub(crate) struct Seen {
    name: String,
    world: Mat4,
    projection: Lens,
}

enum Lens {
    Perspective { fov: f32, range: Range },
    Orthographic { half: [f32; 2], range: Range },
}

/// A light of a glTF file, in world space.
#[derive(Clone, Copy)]
pub(crate) struct Lit {
    place: Vec3,
    /// Direction of the light's rays.
    pub direction: Vec3,
    /// In lux or candela.
    pub color: Vec3,
    range: f32,
    kind: Shines,
}

#[derive(Clone, Copy)]
enum Shines {
    Directional,
    Point,
    /// Cosines of the cone angles.
    Spot {
        inner: f32,
        outer: f32,
    },
}

/// The cameras among some nodes, with `place` applied to their transforms.
pub(crate) fn cameras(nodes: &[&Below<'_>], of: &Nodes<'_>, place: Mat4) -> Vec<Seen> {
    let seen = nodes.iter().filter_map(|below| {
        let node = &below.node;
        let camera = node.camera()?;
        let name = camera.name().or(node.name());
        Some(Seen {
            name: name.map_or_else(|| format!("camera-{}", camera.index()), str::to_owned),
            world: place * of.world[&node.index()],
            projection: match camera.projection() {
                Projection::Perspective(p) => Lens::Perspective {
                    fov: p.yfov().to_degrees(),
                    range: Range {
                        near: p.znear(),
                        far: p.zfar().unwrap_or(f32::INFINITY),
                    },
                },
                Projection::Orthographic(o) => Lens::Orthographic {
                    half: [o.xmag(), o.ymag()],
                    range: Range {
                        near: o.znear(),
                        far: o.zfar(),
                    },
                },
            },
        })
    });
    seen.collect()
}

impl Seen {
    pub fn camera(&self, aspect: f32, direction: DepthDirection) -> Camera {
        // A scale does not change a camera's view.
        let (_, rotation, eye) = self.world.to_scale_rotation_translation();
        let projection = match &self.projection {
            Lens::Perspective { fov, range } => {
                camera::perspective(*fov, aspect, *range, direction)
            }
            Lens::Orthographic {
                half: [x, y],
                range,
            } => {
                let (near, far) = match direction {
                    DepthDirection::Forward => (range.near, range.far),
                    DepthDirection::Reversed => (range.far, range.near),
                };
                Mat4::orthographic_rh(-x, *x, -y, *y, near, far)
            }
        };
        Camera {
            name: self.name.clone(),
            frames: vec![Frame {
                view: Mat4::from_rotation_translation(rotation, eye).inverse(),
                projection,
                eye,
                time: 0.0,
            }],
        }
    }
}

/// A camera that sees a whole box: from the front, from the right and above, with a vertical field
/// of view of 40 degrees.
pub(crate) fn framing([low, high]: [Vec3; 2], aspect: f32, direction: DepthDirection) -> Camera {
    const FOV: f32 = 40.0;
    let center = (low + high) * 0.5;
    let radius = ((high - low).length() * 0.5).max(1e-6);
    // The half angle of the narrower field of view.
    let half = (FOV.to_radians() * 0.5).tan() * aspect.min(1.0);
    let distance = radius / half.atan().sin();
    let eye = center + Vec3::new(0.6, 0.4, 1.0).normalize() * distance;
    let pose = camera::Pose {
        eye,
        target: center,
        fov: FOV,
        time: 0.0,
    };
    let range = Range {
        near: (distance - radius) * 0.5,
        far: distance + radius * 2.0,
    };
    Camera {
        name: "framing".to_owned(),
        frames: vec![pose.frame(Vec3::Y, aspect, range, direction)],
    }
}

/// The lights among some nodes.
pub(crate) fn lights(nodes: &[&Below<'_>], of: &Nodes<'_>, place: Mat4) -> Vec<Lit> {
    let lit = nodes.iter().filter_map(|below| {
        let light = below.node.light()?;
        let world = place * of.world[&below.node.index()];
        let (_, rotation, at): (_, Quat, _) = world.to_scale_rotation_translation();
        Some(Lit {
            place: at,
            direction: (rotation * Vec3::NEG_Z).normalize_or(Vec3::NEG_Y),
            color: Vec3::from(light.color()) * light.intensity(),
            range: light.range().unwrap_or(0.0),
            kind: match light.kind() {
                Kind::Directional => Shines::Directional,
                Kind::Point => Shines::Point,
                Kind::Spot {
                    inner_cone_angle,
                    outer_cone_angle,
                } => Shines::Spot {
                    inner: inner_cone_angle.cos(),
                    outer: outer_cone_angle.cos(),
                },
            },
        })
    });
    lit.collect()
}

impl Lit {
    /// A directional light with the unit vector to it.
    pub fn toward(direction: Vec3, color: Vec3) -> Self {
        Self {
            place: Vec3::ZERO,
            direction: -direction,
            color,
            range: 0.0,
            kind: Shines::Directional,
        }
    }

    pub fn is_directional(&self) -> bool {
        matches!(self.kind, Shines::Directional)
    }

    /// The values of the built-in material's light `index`.
    pub fn values(&self, index: usize) -> Vec<(String, Value)> {
        let (kind, inner, outer) = match self.kind {
            Shines::Directional => (0.0, 0.0, 0.0),
            Shines::Point => (1.0, 0.0, 0.0),
            Shines::Spot { inner, outer } => (2.0, inner, outer),
        };
        let position = match self.kind {
            Shines::Directional => -self.direction,
            _ => self.place,
        };
        let three = |v: Vec3| v.to_array().map(f64::from).to_vec();
        let one = |n: f32| vec![f64::from(n)];
        let members = [
            ("position", three(position)),
            ("kind", one(kind)),
            ("color", three(self.color)),
            ("range", one(self.range)),
            ("direction", three(self.direction)),
            ("inner", one(inner)),
            ("outer", one(outer)),
        ];
        let named = members.into_iter();
        named
            .map(|(name, n)| (format!("lights[{index}].{name}"), Value::Numbers(n)))
            .collect()
    }
}
