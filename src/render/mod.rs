//! The renderer: draws a frame of material plans on wgpu, headlessly, and reads back colour and depth.
//!
//! It knows nothing about a variant but the data of its plan. Data flows through the modules in this order:
//!
//! 1. [`gpu`]: an adapter is chosen and opened;
//! 2. [`shader`]: a plan goes through its JSON, its programs through the text that is emitted (or as IR);
//! 3. [`inputs`]: what a scene's draws bind, uploaded once and shared by every variant;
//! 4. [`state`], `layout`, `limits`: a plan's pipeline state and bindings in wgpu's terms;
//! 5. [`frame`]: `targets`, `pipeline`s, `compute` passes, `subdivided` meshes, `drawn` ids and bind groups of one frame, built once, encoded as often as needed;
//! 6. [`readback`]: colour bytes and depth at full precision, as [`picture`]s.
//!
//! [`mod@self_test`] executes a plan's self-test as a host does at load, by way of 2 to 5.

mod compute;
mod drawn;
pub mod frame;
pub mod gpu;
pub mod inputs;
mod layout;
mod limits;
pub mod order;
pub mod picture;
mod pipeline;
pub mod readback;
pub mod self_test;
pub mod shader;
pub mod state;
mod subdivided;
mod targets;
mod trusted;

pub use frame::{ComputedVertices, FrameSettings, Prepared, Rendered};
pub use gpu::{AdapterChoice, AdapterReport, Gpu, adapters};
pub use inputs::SceneInputs;
pub use picture::{ColorImage, DepthImage};
pub use self_test::{SelfTestResult, self_test};
pub use shader::{ShaderForm, Variant};
pub use subdivided::{DrawSubdivision, SubdivisionCost, Surplus};
pub use trusted::Trust;

/// Why nothing was drawn.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// No adapter, or none by that name.
    #[error("{}", no_adapter(.wanted, .found))]
    NoAdapter {
        /// What was asked for; `None`: anything.
        wanted: Option<String>,
        /// Names of the adapters there are.
        found: Vec<String>,
    },
    /// The adapter would not open, or was lost while drawing. What was measured before stands.
    #[error("the graphics device was lost: {0}")]
    Lost(String),
    /// The adapter cannot do what a plan or a scene asks for.
    #[error("{what} needs {feature}, which the adapter `{adapter}` does not have")]
    Unsupported {
        /// What needs it.
        what: String,
        /// The missing feature or format.
        feature: String,
        /// Name of the adapter.
        adapter: String,
    },
    /// wgpu or a driver refused what preshade asked of it. For an emitted shader this is always a bug in preshade.
    #[error("{what} was refused: {message}")]
    Refused {
        /// What was being made.
        what: String,
        /// The validation message.
        message: String,
    },
    /// The adapter ran out of memory.
    #[error("out of graphics memory while making {0}")]
    OutOfMemory(String),
    /// A plan names something that it does not hold, or that a scene's frame has no place for.
    #[error("the plan of material `{material}` cannot be drawn: {message}")]
    Plan {
        /// Material.
        material: String,
        /// What is wrong with it.
        message: String,
    },
    /// The plans of a scene's materials do not fit into one frame.
    #[error(transparent)]
    Frame(#[from] preshade_passes::frame::FrameError),
    /// The scene gives a draw something it cannot be drawn with.
    #[error("draw `{draw}`: {message}")]
    Scene {
        /// Draw.
        draw: String,
        /// What is wrong with it.
        message: String,
    },
    /// The draws of a scene, all together, are more than a frame's ids or buffers hold.
    #[error("the draws of scene `{scene}`: {message}")]
    Draws {
        /// Name of the scene.
        scene: String,
        /// What is too much.
        message: String,
    },
    /// An attachment of a plan that cannot be.
    #[error("attachment `{name}`: {message}")]
    Attachment {
        /// Attachment.
        name: String,
        /// What is wrong with it.
        message: String,
    },
    /// The frame has no pixels, or more than the adapter can hold.
    #[error("cannot draw a frame of {0}x{1} pixels")]
    Size(u32, u32),
}

impl Error {
    /// What kind of error it is, as messages have it in brackets; stable.
    pub fn code(&self) -> &'static str {
        match self {
            Self::NoAdapter { .. } => "no-adapter",
            Self::Lost(_) => "device-lost",
            Self::Unsupported { .. } => "no-feature",
            Self::Refused { .. } => "driver-refused",
            Self::OutOfMemory(_) => "out-of-memory",
            Self::Plan { .. } => "broken-plan",
            Self::Frame(_) => "frame",
            Self::Scene { .. } => "draw",
            Self::Draws { .. } => "draws",
            Self::Attachment { .. } => "attachment",
            Self::Size(..) => "frame-size",
        }
    }
}

fn no_adapter(wanted: &Option<String>, found: &[String]) -> String {
    match wanted {
        Some(wanted) if !found.is_empty() => format!(
            "no graphics adapter's name, driver or backend contains `{wanted}`; there are: {}",
            found.join(", ")
        ),
        _ => "no graphics adapter was found; on Debian and Ubuntu `apt-get install mesa-vulkan-drivers libvulkan1` \
              installs one that needs no graphics card"
            .to_owned(),
    }
}
