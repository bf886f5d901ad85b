//! A frame of a camera in one draw order.

use std::collections::BTreeSet;
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

/// Most pixels of a candidate's pictures. Interpolation errors depend on triangles, not on pixels;
/// the budget is checked at the scene's own size.
const MOST_PIXELS: u32 = 1 << 17;

/// `scene` with fewer pixels; `None` if it has no more than [`MOST_PIXELS`].
pub(crate) fn small(scene: &Scene) -> Option<Scene> {
    let [width, height] = scene.size;
    let scale = (f64::from(MOST_PIXELS) / (f64::from(width) * f64::from(height))).sqrt();
    if scale >= 1.0 {
        return None;
    }
    let side = |n: u32| ((f64::from(n) * scale) as u32).max(1);
    Some(scene.clone().resized([side(width), side(height)]))
}

/// The frames that candidates are measured on: the first of every camera and the middle of its path.
pub(crate) fn choosing(scene: &Scene) -> Vec<&Frame> {
    spread(scene, 2)
}

/// At most `most` frames of every camera's path, evenly spaced from its first.
pub(super) fn spread(scene: &Scene, most: usize) -> Vec<&Frame> {
    let of = |frames: &'_ [Frame]| -> BTreeSet<usize> {
        (0..most).map(|i| i * frames.len() / most).collect()
    };
    let cameras = scene.cameras.iter();
    cameras
        .flat_map(|c| {
            let chosen = of(&c.frames).into_iter();
            chosen.filter_map(|i| c.frames.get(i))
        })
        .collect()
}
