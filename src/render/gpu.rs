//! Adapters, and the device that everything is drawn on.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use wgpu::{Backends, DeviceType, ErrorFilter, Features};

use super::trusted::{self, Trust};
use super::{Error, limits};
use crate::panics;

/// Which adapter to draw on.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum AdapterChoice {
    /// The fastest kind there is: discrete, integrated, virtual, then software.
    #[default]
    Best,
    /// The first whose name, driver or backend contains this, in any case.
    Matching(String),
}

/// What an adapter is and what can be measured on it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AdapterReport {
    /// Name, as the driver gives it.
    pub name: String,
    /// Driver and its version.
    pub driver: String,
    /// `vulkan`, `metal`, `dx12` or `gl`.
    pub backend: String,
    /// `discrete`, `integrated`, `virtual`, `software` or `other`.
    pub kind: String,
    /// Time can be measured on the GPU's own clock.
    pub timestamps: bool,
    /// Vertex and fragment invocations can be counted by the adapter.
    pub pipeline_statistics: bool,
    /// WebGPU features it has beyond the core, in WebGPU's spelling.
    pub features: Vec<String>,
    /// Shaders are compiled with wgpu's run-time checks ([`Trust::Strangers`]), which shifts times. Not written where they are not.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub checked_shaders: bool,
}

impl AdapterReport {
    /// The name, and whether shaders are checked: times under one are not comparable with times under another.
    pub fn title(&self) -> String {
        match self.checked_shaders {
            true => format!("{} with checked shaders", self.name),
            false => self.name.clone(),
        }
    }
}

/// WebGPU's names of the features that plans often ask for, or wgpu's where only that has one: what an adapter is reported to have.
const PLAN_FEATURES: [(&str, Features); 17] = [
    ("bgra8unorm-storage", Features::BGRA8UNORM_STORAGE),
    ("clip-distances", Features::CLIP_DISTANCES),
    ("depth-clip-control", Features::DEPTH_CLIP_CONTROL),
    ("depth32float-stencil8", Features::DEPTH32FLOAT_STENCIL8),
    ("dual-source-blending", Features::DUAL_SOURCE_BLENDING),
    ("float32-blendable", Features::FLOAT32_BLENDABLE),
    ("float32-filterable", Features::FLOAT32_FILTERABLE),
    ("indirect-first-instance", Features::INDIRECT_FIRST_INSTANCE),
    ("primitive-index", Features::PRIMITIVE_INDEX),
    (
        "rg11b10ufloat-renderable",
        Features::RG11B10UFLOAT_RENDERABLE,
    ),
    ("shader-f16", Features::SHADER_F16),
    ("subgroups", Features::SUBGROUP),
    ("timestamp-query", Features::TIMESTAMP_QUERY),
    ("wgpu-subgroup-vertex", Features::SUBGROUP_VERTEX),
    (
        "wgpu-texture-adapter-specific-format-features",
        Features::TEXTURE_ADAPTER_SPECIFIC_FORMAT_FEATURES,
    ),
    (
        "wgpu-texture-format-16-bit-norm",
        Features::TEXTURE_FORMAT_16BIT_NORM,
    ),
    (
        "wgpu-vertex-writable-storage",
        Features::VERTEX_WRITABLE_STORAGE,
    ),
];

/// What is switched on where the adapter has it: what plans may ask for, and what measuring needs.
fn wanted_features() -> Features {
    PLAN_FEATURES
        .iter()
        .fold(Features::empty(), |all, (_, f)| all | *f)
        | Features::TIMESTAMP_QUERY_INSIDE_ENCODERS
        | Features::PIPELINE_STATISTICS_QUERY
        | Features::SHADER_EARLY_DEPTH_TEST
        | Features::SUBGROUP_VERTEX
        | Features::VERTEX_WRITABLE_STORAGE
        | Features::TEXTURE_ADAPTER_SPECIFIC_FORMAT_FEATURES
}

fn instance(backends: Backends) -> wgpu::Instance {
    // No validation layer: wgpu-core validates everything already, and a layer would be in the timings. WGPU_VALIDATION=1 and
    // WGPU_DEBUG=1 switch it on.
    wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends,
        flags: wgpu::InstanceFlags::empty().with_env(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    })
}

fn report(adapter: &wgpu::Adapter) -> AdapterReport {
    let info = adapter.get_info();
    let features = adapter.features();
    AdapterReport {
        name: info.name,
        driver: [info.driver, info.driver_info]
            .iter()
            .filter(|s| !s.is_empty())
            .cloned()
            .collect::<Vec<_>>()
            .join(" "),
        backend: info.backend.to_str().to_owned(),
        kind: match info.device_type {
            DeviceType::DiscreteGpu => "discrete",
            DeviceType::IntegratedGpu => "integrated",
            DeviceType::VirtualGpu => "virtual",
            DeviceType::Cpu => "software",
            DeviceType::Other => "other",
        }
        .to_owned(),
        timestamps: features.contains(TIMESTAMPS),
        pipeline_statistics: features.contains(Features::PIPELINE_STATISTICS_QUERY),
        features: PLAN_FEATURES
            .iter()
            .filter(|(_, f)| features.contains(*f))
            .map(|(name, _)| (*name).to_owned())
            .collect(),
        checked_shaders: false,
    }
}

const TIMESTAMPS: Features =
    Features::TIMESTAMP_QUERY.union(Features::TIMESTAMP_QUERY_INSIDE_ENCODERS);

fn kind_rank(kind: DeviceType) -> u32 {
    match kind {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    }
}

/// The adapters behind Vulkan, Metal or Direct3D 12, best first; those behind OpenGL only where there are no others, or none that
/// `suits`. Asking OpenGL for its adapters makes some drivers write to stderr.
fn enumerate(suits: impl Fn(&wgpu::Adapter) -> bool) -> Vec<wgpu::Adapter> {
    let of = |backends| {
        let mut adapters = pollster::block_on(instance(backends).enumerate_adapters(backends));
        adapters.sort_by_key(|a| kind_rank(a.get_info().device_type));
        adapters
    };
    let mut adapters = of(Backends::PRIMARY);
    if !adapters.iter().any(suits) {
        adapters.extend(of(Backends::SECONDARY));
    }
    adapters
}

/// Held while instances come and go: with several threads at it, a driver has been seen to deadlock.
static OPENING: Mutex<()> = Mutex::new(());

/// The adapters of this machine, best first. OpenGL's are listed only where there are no others.
pub fn adapters() -> Vec<AdapterReport> {
    let _opening = OPENING.lock().unwrap_or_else(PoisonError::into_inner);
    enumerate(|_| true).iter().map(report).collect()
}

impl std::fmt::Display for AdapterReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let has = |yes: bool| if yes { "yes" } else { "no" };
        write!(
            f,
            "{} ({}, {}, {})\n  GPU timestamps: {}\n  pipeline statistics: {}\n  features: {}",
            self.name,
            self.backend,
            self.kind,
            self.driver,
            has(self.timestamps),
            has(self.pipeline_statistics),
            self.features.join(", ")
        )
    }
}

/// An open adapter.
#[derive(Debug)]
pub struct Gpu {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    report: AdapterReport,
    trust: Trust,
    trouble: Arc<Mutex<Trouble>>,
}

/// What the device reported outside of any call of ours.
#[derive(Debug, Default)]
struct Trouble {
    lost: Option<String>,
    uncaptured: Option<String>,
}

/// The longest a single submission may take before the device counts as hung. Software adapters draw full scenes in seconds.
const SUBMISSION_TIMEOUT: Duration = Duration::from_secs(120);

impl Gpu {
    /// Opens an adapter for the user's own shaders, with its own limits and with all features of it that plans and measurements use.
    ///
    /// # Errors
    /// [`Error::NoAdapter`], or [`Error::Lost`] when the driver refuses to open it.
    pub fn new(choice: &AdapterChoice) -> Result<Self, Error> {
        Self::with_trust(choice, Trust::Own)
    }

    /// [`Gpu::new`], for the shaders of whom `trust` says.
    ///
    /// # Errors
    /// As [`Gpu::new`].
    pub fn with_trust(choice: &AdapterChoice, trust: Trust) -> Result<Self, Error> {
        let mut gpu = Self::open(choice, |adapter| {
            Ok((adapter.features() & wanted_features(), adapter.limits()))
        })?;
        gpu.trust = trust;
        gpu.report.checked_shaders = trust == Trust::Strangers;
        Ok(gpu)
    }

    /// Opens an adapter with WebGPU's default limits, raised to `limits`, and with `features` alone: the device that a host has who knows of a plan what it says.
    /// Nothing can be timed or counted on it.
    ///
    /// # Errors
    /// [`Error::NoAdapter`], [`Error::Unsupported`] for a feature or a limit that plans do not tell of, or [`Error::Lost`] when the adapter has less.
    pub fn with_needs(
        choice: &AdapterChoice,
        features: &BTreeSet<String>,
        limits: &BTreeMap<String, u64>,
    ) -> Result<Self, Error> {
        Self::open(choice, |adapter| {
            let unknown = |what: &str| Error::Unsupported {
                what: "a plan".to_owned(),
                feature: what.to_owned(),
                adapter: adapter.get_info().name,
            };
            let mut required = Features::empty();
            for name in features {
                required |= name.parse::<Features>().map_err(|_| unknown(name))?;
            }
            let mut raised = wgpu::Limits::default();
            for (name, value) in limits {
                limits::raise(&mut raised, name, *value).ok_or_else(|| unknown(name))?;
            }
            Ok((required, raised))
        })
    }

    /// Opens an adapter with what `needs` says of it.
    fn open(
        choice: &AdapterChoice,
        needs: impl Fn(&wgpu::Adapter) -> Result<(Features, wgpu::Limits), Error>,
    ) -> Result<Self, Error> {
        let _opening = OPENING.lock().unwrap_or_else(PoisonError::into_inner);
        let wanted = match choice {
            AdapterChoice::Best => None,
            AdapterChoice::Matching(text) => Some(text.clone()),
        };
        let matches = |adapter: &wgpu::Adapter| {
            wanted.as_ref().is_none_or(|text| {
                let r = report(adapter);
                let text = text.to_lowercase();
                [r.name, r.driver, r.backend]
                    .iter()
                    .any(|s| s.to_lowercase().contains(&text))
            })
        };
        let found = enumerate(matches);
        let adapter = found
            .iter()
            .find(|a| matches(a))
            .ok_or_else(|| Error::NoAdapter {
                wanted: wanted.clone(),
                found: found
                    .iter()
                    .map(|a| {
                        let r = report(a);
                        format!("{} ({})", r.name, r.backend)
                    })
                    .collect(),
            })?;
        let (required_features, required_limits) = needs(adapter)?;
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("preshade"),
            required_features,
            required_limits,
            ..Default::default()
        }))
        .map_err(|e| Error::Lost(e.to_string()))?;
        let trouble = Arc::new(Mutex::new(Trouble::default()));
        let shared = Arc::clone(&trouble);
        device.set_device_lost_callback(move |reason, message| {
            // Dropping a device is not losing it.
            if reason != wgpu::DeviceLostReason::Destroyed {
                lock(&shared).lost = Some(message);
            }
        });
        let shared = Arc::clone(&trouble);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            lock(&shared)
                .uncaptured
                .get_or_insert_with(|| error.to_string());
        }));
        Ok(Self {
            device,
            queue,
            report: report(adapter),
            trust: Trust::Own,
            trouble,
        })
    }

    /// What the adapter is.
    pub fn adapter(&self) -> &AdapterReport {
        &self.report
    }

    /// Whose shaders it was opened for.
    pub fn trust(&self) -> Trust {
        self.trust
    }

    /// Whether GPU timestamps can be written between passes.
    pub fn has_timestamps(&self) -> bool {
        self.device.features().contains(TIMESTAMPS)
    }

    /// Whether invocations can be counted by the adapter.
    pub fn has_pipeline_statistics(&self) -> bool {
        self.device
            .features()
            .contains(Features::PIPELINE_STATISTICS_QUERY)
    }

    /// Compiles a shader, with the checks that its author is trusted without or not.
    pub(crate) fn shader(
        &self,
        descriptor: wgpu::ShaderModuleDescriptor<'_>,
    ) -> wgpu::ShaderModule {
        trusted::compile(&self.device, self.trust, descriptor)
    }

    /// Fails unless the device has a feature of WebGPU's name `feature`.
    pub(crate) fn require(&self, what: &str, feature: &str) -> Result<(), Error> {
        match feature.parse() {
            Ok(known) if self.device.features().contains(known) => Ok(()),
            _ => Err(self.unsupported(what, feature)),
        }
    }

    pub(crate) fn unsupported(&self, what: &str, feature: &str) -> Error {
        Error::Unsupported {
            what: what.to_owned(),
            feature: feature.to_owned(),
            adapter: self.report.name.clone(),
        }
    }

    /// Runs `make` and turns what wgpu says about it into an error that names `what`.
    pub(crate) fn checked<T>(&self, what: &str, make: impl FnOnce() -> T) -> Result<T, Error> {
        let memory = self.device.push_error_scope(ErrorFilter::OutOfMemory);
        let internal = self.device.push_error_scope(ErrorFilter::Internal);
        let validation = self.device.push_error_scope(ErrorFilter::Validation);
        // naga's writers, which wgpu calls, panic at some of what its own check takes.
        let made = panics::caught(make);
        let errors = [
            pollster::block_on(validation.pop()),
            pollster::block_on(internal.pop()),
            pollster::block_on(memory.pop()),
        ];
        self.check_trouble()?;
        match errors.into_iter().flatten().next() {
            None => made.map_err(|panicked| Error::Refused {
                what: what.to_owned(),
                message: format!("wgpu panicked: {panicked}"),
            }),
            Some(wgpu::Error::OutOfMemory { .. }) => Err(Error::OutOfMemory(what.to_owned())),
            Some(error) => Err(Error::Refused {
                what: what.to_owned(),
                message: chain(&error),
            }),
        }
    }

    /// Submits and waits until the GPU is done.
    pub(crate) fn submit(&self, what: &str, encoder: wgpu::CommandEncoder) -> Result<(), Error> {
        let index = self.checked(what, || self.queue.submit([encoder.finish()]))?;
        self.device
            .poll(wgpu::PollType::Wait {
                submission_index: Some(index),
                timeout: Some(SUBMISSION_TIMEOUT),
            })
            .map_err(|e| self.lose(format!("{what}: {e}")))?;
        self.check_trouble()
    }

    /// The bytes of a buffer with `MAP_READ`.
    pub(crate) fn read_buffer(&self, buffer: &wgpu::Buffer) -> Result<Vec<u8>, Error> {
        let (send, receive) = std::sync::mpsc::channel();
        buffer.map_async(wgpu::MapMode::Read, .., move |result| {
            // The receiver lives until the poll below returns.
            let _ = send.send(result);
        });
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .map_err(|e| self.lose(e.to_string()))?;
        let failed = |message: String| Error::Refused {
            what: "reading a buffer back".to_owned(),
            message,
        };
        receive
            .recv()
            .map_err(|e| failed(e.to_string()))?
            .map_err(|e| failed(e.to_string()))?;
        let bytes = buffer
            .get_mapped_range(..)
            .map_err(|e| failed(e.to_string()))?
            .to_vec();
        buffer.unmap();
        self.check_trouble()?;
        Ok(bytes)
    }

    /// Why the device was lost, if it was: nothing is drawn on it any more, and a new one is to be opened.
    pub fn lost(&self) -> Option<String> {
        lock(&self.trouble).lost.clone()
    }

    /// A device that does not answer counts as lost.
    fn lose(&self, why: String) -> Error {
        lock(&self.trouble).lost.get_or_insert(why.clone());
        Error::Lost(why)
    }

    /// From now on every call says that the device was lost: for tests of what is kept then. No device is lost at a test's will.
    #[doc(hidden)]
    pub fn pretend_lost(&self, why: &str) {
        lock(&self.trouble).lost = Some(why.to_owned());
    }

    fn check_trouble(&self) -> Result<(), Error> {
        let mut trouble = lock(&self.trouble);
        if let Some(message) = &trouble.lost {
            return Err(Error::Lost(message.clone()));
        }
        match trouble.uncaptured.take() {
            Some(message) => Err(Error::Refused {
                what: "a command".to_owned(),
                message,
            }),
            None => Ok(()),
        }
    }
}

fn lock(trouble: &Mutex<Trouble>) -> std::sync::MutexGuard<'_, Trouble> {
    // Plain data: nothing can be half-written by a panicking holder.
    trouble.lock().unwrap_or_else(PoisonError::into_inner)
}

/// An error's message and those of its causes, as one line each.
fn chain(error: &dyn std::error::Error) -> String {
    let mut message = error.to_string();
    let mut source = error.source();
    while let Some(e) = source {
        let text = e.to_string();
        if !message.contains(&text) {
            message.push_str(": ");
            message.push_str(&text);
        }
        source = e.source();
    }
    message
}
