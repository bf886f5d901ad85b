//! The renderer: draws a frame of material plans headlessly on wgpu, and reads back colour and
//! depth.
//!
//! Its inputs are plans, emitted files and a scene's data; it does not depend on the compiler. Data
//! flows through the modules in this order:
//!
//! 1. [`gpu`] chooses and opens an adapter;
//! 2. [`shader`] reads plans from JSON, and their programs from the emitted text (or as IR);
//! 3. [`inputs`] uploads the resources of a scene's draws once; every variant shares them;
//! 4. [`state`], `layout`, `limits` convert a plan's state and bindings to wgpu types;
//! 5. [`frame`] builds the `targets`, `pipeline`s, `compute` passes, `subdivided` meshes, `drawn`
//!    ids and bind groups of a frame once, and encodes them as often as needed;
//! 6. [`readback`] returns colour bytes and full-precision depth as [`picture`]s.
//!
//! [`mod@self_test`] runs a plan's self-test as a host does at load, with modules 2 to 5.

mod bounded;
pub mod codes;
mod compiled;
mod compute;
pub mod depths;
pub mod frame;
mod frame_draw_table;
pub mod gpu;
mod initial;
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
mod subdivision;
mod targets;
pub mod textures;
mod trusted;
pub mod turns;
mod upload;

pub use frame::{ComputedVertices, FrameSettings, Prepared, Rendered};
pub use gpu::{AdapterChoice, AdapterReport, Card, Gpu, adapters, cards};
pub use inputs::SceneInputs;
pub use layout::binding_type;
pub use picture::{ColorImage, DepthImage};
pub use self_test::{SelfTestPlan, SelfTestResult};
pub use shader::Variant;
pub use subdivided::{DrawSubdivision, SubdivisionCost, Surplus};

/// Prefix of errors that mean only that a shader was not measured, not that it is wrong.
pub const NOT_MEASURED: &str = "not measured: ";

/// Why nothing was drawn.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// No adapter, or none that matches.
    #[error("{}", no_adapter(.wanted, .found))]
    NoAdapter {
        /// The requested name. `None`: any adapter.
        wanted: Option<String>,
        /// Names of the available adapters.
        found: Vec<String>,
    },
    /// The adapter could not be opened, or was lost while drawing. Earlier measurements remain
    /// valid.
    #[error("the graphics device was lost: {0}")]
    Lost(String),
    /// A submission did not end in time. The device counts as lost from then on.
    #[error("{what} has not ended after {} s. It is too slow for this adapter, or does not end", time.as_secs())]
    Slow {
        /// Name of the submitted work.
        what: String,
        time: std::time::Duration,
    },
    /// The lock of an adapter that several processes share failed.
    #[error("the adapter cannot be shared: {0}")]
    Shared(#[source] std::io::Error),
    /// The adapter lacks something that a plan or scene needs.
    #[error("{what} needs {feature}, which the adapter `{adapter}` does not have")]
    Unsupported {
        /// The plan, scene or pass that needs it.
        what: String,
        /// The missing feature or format.
        feature: String,
        adapter: String,
    },
    /// wgpu or a driver refused a request. For an emitted shader this is always a bug in preshade.
    #[error("{what} was refused: {message}")]
    Refused {
        /// The object that was being created.
        what: String,
        message: String,
    },
    /// The adapter ran out of memory.
    #[error("out of graphics memory while making {0}")]
    OutOfMemory(String),
    /// A plan refers to something that neither it nor the scene's frame has.
    #[error("the plan of material `{material}` cannot be drawn: {message}")]
    Plan { material: String, message: String },
    /// A loop did not end within the limit of turns. Only a bounded copy of its shader was drawn.
    #[error(
        "{NOT_MEASURED}{} did not end within {} turns, so that it would hang a GPU",
        .which.as_deref().unwrap_or("a loop"),
        preshade_plan::safety::MOST_TURNS
    )]
    Endless { which: Option<String> },
    /// The plans of a scene's materials do not fit into one frame.
    #[error(transparent)]
    Frame(#[from] preshade_plan::frame::FrameError),
    /// The scene gives a draw a value or resource that cannot be used.
    #[error("draw `{draw}`: {message}")]
    Scene { draw: String, message: String },
    /// The draws of a scene exceed a frame's ids or buffers.
    #[error("the draws of scene `{scene}`: {message}")]
    Draws { scene: String, message: String },
    /// An attachment of a plan is impossible.
    #[error("attachment `{name}`: {message}")]
    Attachment { name: String, message: String },
    /// The frame has no pixels, or more than the adapter supports.
    #[error("cannot draw a frame of {0}x{1} pixels")]
    Size(u32, u32),
}

impl Error {
    /// Whether nothing more can be drawn, because the device is lost or the lock of a shared
    /// adapter failed. Measurements that skip other errors must not skip this one.
    pub fn is_lost(&self) -> bool {
        matches!(self, Self::Lost(_) | Self::Slow { .. } | Self::Shared(_))
    }

    pub fn code(&self) -> &'static str {
        match self {
            Self::NoAdapter { .. } => codes::NO_ADAPTER.code,
            Self::Lost(_) | Self::Slow { .. } => codes::DEVICE_LOST.code,
            Self::Shared(_) => codes::SHARED_ADAPTER.code,
            Self::Unsupported { .. } => codes::NO_FEATURE.code,
            Self::Refused { .. } => codes::DRIVER_REFUSED.code,
            Self::OutOfMemory(_) => codes::OUT_OF_MEMORY.code,
            Self::Plan { .. } => preshade_plan::codes::BROKEN_PLAN.code,
            Self::Endless { .. } => codes::ENDLESS.code,
            Self::Frame(_) => codes::FRAME.code,
            Self::Scene { .. } => codes::DRAW.code,
            Self::Draws { .. } => codes::DRAWS.code,
            Self::Attachment { .. } => codes::ATTACHMENT.code,
            Self::Size(..) => codes::FRAME_SIZE.code,
        }
    }
}

fn no_adapter(wanted: &Option<String>, found: &[String]) -> String {
    match wanted {
        Some(wanted) if wanted.starts_with('#') && !found.is_empty() => format!(
            "there is no adapter {wanted}; there are: {}",
            found.join(", ")
        ),
        Some(wanted) if !found.is_empty() => format!(
            "no graphics adapter's name, driver or backend contains `{wanted}`; there are: {}",
            found.join(", ")
        ),
        _ => "no graphics adapter was found; on Debian and Ubuntu `apt-get install \
              mesa-vulkan-drivers libvulkan1` \
              installs one that needs no graphics card"
            .to_owned(),
    }
}
