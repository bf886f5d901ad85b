//! A frame of a camera in one draw order.

use std::fmt;

use serde::{Deserialize, Serialize};

use preshade_draw::render::order;
use preshade_draw::scene::{DrawOrder, Frame, Scene};

/// A frame of a camera in one draw order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct View {
    pub camera: String,
    /// Index of the frame in the camera's path.
    pub frame: usize,
    /// Order of the opaque draws.
    pub order: DrawOrder,
}

impl fmt::Display for View {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.camera)?;
        if self.frame > 0 {
            write!(f, "[{}]", self.frame)?;
        }
        write!(f, ", {}", order::name(self.order))
    }
}

impl View {
    /// The view in words, with every part named.
    pub fn described(&self) -> String {
        let order = order::name(self.order);
        format!("camera `{}` frame {} {order}", self.camera, self.frame)
    }

    pub fn frame_of<'s>(&self, scene: &'s Scene) -> Option<&'s Frame> {
        let camera = scene.cameras.iter().find(|c| c.name == self.camera)?;
        camera.frames.get(self.frame)
    }

    /// The views of a scene with their frames: of each camera's path at most `frames_per_camera`
    /// frames, evenly spaced from its first, in every order of the scene. The first is the
    /// headline.
    pub fn all(scene: &Scene, frames_per_camera: usize) -> Vec<(Self, &Frame)> {
        let orders = match scene.orders.as_slice() {
            [] => &[DrawOrder::AsGiven],
            orders => orders,
        };
        let mut views = Vec::new();
        for camera in &scene.cameras {
            let frames = camera.frames.len();
            let taken = frames.min(frames_per_camera.max(1));
            for index in (0..taken).map(|i| i * frames / taken) {
                views.extend(orders.iter().map(|order| {
                    let view = Self {
                        camera: camera.name.clone(),
                        frame: index,
                        order: *order,
                    };
                    (view, &camera.frames[index])
                }));
            }
        }
        views
    }
}
