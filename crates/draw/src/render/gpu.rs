//! Adapters and devices.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use preshade_plan::safety::Checks;
use serde::{Deserialize, Serialize};
use wgpu::{Backends, DeviceType, ErrorFilter, Features};

use super::turns::Turns;
use super::{Error, limits, trusted};
use shader_text::limits::Trust;
use shader_text::panics;

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum AdapterChoice {
    /// The fastest kind available: discrete, integrated, virtual, then software.
    #[default]
    Best,
    /// The first adapter whose name, driver or backend contains this text, ignoring case. `#2`
    /// selects the second of [`adapters`].
    Matching(String),
}

impl AdapterChoice {
    /// The index in [`adapters`] that `#N` selects.
    fn place(&self) -> Option<usize> {
        match self {
            Self::Best => None,
            Self::Matching(text) => text
                .strip_prefix('#')?
                .parse::<usize>()
                .ok()?
                .checked_sub(1),
        }
    }
}

/// An adapter's properties and measurement features.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AdapterReport {
    /// Name from the driver.
    pub name: String,
    /// Driver and its version.
    pub driver: String,
    /// `vulkan`, `metal`, `dx12` or `gl`.
    pub backend: String,
    /// `discrete`, `integrated`, `virtual`, `software` or `other`.
    pub kind: String,
    /// Whether the GPU's own clock can measure time.
    pub timestamps: bool,
    /// Whether the adapter can count vertex and fragment invocations.
    pub pipeline_statistics: bool,
    /// WebGPU features beyond the core, in WebGPU's spelling.
    pub features: Vec<String>,
    /// Whether shaders are compiled with wgpu's run-time checks ([`Trust::Strangers`]), which
    /// change times. Serialised only if true.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub checked_shaders: bool,
}

impl AdapterReport {
    /// The name, marked if shaders are checked. Times with different titles are not comparable.
    pub fn title(&self) -> String {
        match self.checked_shaders {
            true => format!("{} with checked shaders", self.name),
            false => self.name.clone(),
        }
    }

    /// Whether name, driver or backend contain this text, ignoring case.
    pub fn matches(&self, text: &str) -> bool {
        let text = text.to_lowercase();
        [&self.name, &self.driver, &self.backend]
            .iter()
            .any(|has| has.to_lowercase().contains(&text))
    }
}

/// Features that plans often need, by WebGPU's name, or wgpu's if WebGPU has none. The adapter
/// report lists them.
const PLAN_FEATURES: [(&str, Features); 18] = [
    ("bgra8unorm-storage", Features::BGRA8UNORM_STORAGE),
    ("clip-distances", Features::CLIP_DISTANCES),
    ("depth-clip-control", Features::DEPTH_CLIP_CONTROL),
    ("depth32float-stencil8", Features::DEPTH32FLOAT_STENCIL8),
    ("dual-source-blending", Features::DUAL_SOURCE_BLENDING),
    ("float32-blendable", Features::FLOAT32_BLENDABLE),
    ("float32-filterable", Features::FLOAT32_FILTERABLE),
    ("immediates", Features::IMMEDIATES),
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

/// The features to enable if the adapter has them: for plans and for measurements.
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
        | Features::TEXTURE_COMPRESSION_BC
        | Features::TEXTURE_COMPRESSION_BC_SLICED_3D
        | Features::TEXTURE_COMPRESSION_ETC2
        | Features::TEXTURE_COMPRESSION_ASTC
        | Features::TEXTURE_COMPRESSION_ASTC_SLICED_3D
}

fn instance(backends: Backends) -> wgpu::Instance {
    // No validation layer: wgpu-core validates everything, and a layer would distort timings.
    // WGPU_VALIDATION=1 and WGPU_DEBUG=1 enable one.
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

/// The adapters of Vulkan, Metal or Direct3D 12, best first. OpenGL adapters are listed only if no
/// other adapter `suits`, because enumerating them makes some drivers write to stderr.
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

/// Held while instances are created or dropped, because a driver deadlocked when several threads
/// did this.
static OPENING: Mutex<()> = Mutex::new(());

/// The adapters of this machine, best first. OpenGL adapters are listed only if there are no
/// others.
pub fn adapters() -> Vec<AdapterReport> {
    cards().into_iter().map(|card| card.report).collect()
}

/// An adapter of this machine. Several may have equal reports.
#[derive(Clone, Debug)]
pub struct Card {
    pub report: AdapterReport,
    /// The text of [`AdapterChoice::Matching`] that selects it.
    pub choice: String,
    /// Distinguishes cards of this machine: the PCI address, `cpu` for software, or name and index.
    /// Two drivers of one card have the same address.
    pub address: String,
}

/// As [`adapters`], with the means to select each.
pub fn cards() -> Vec<Card> {
    let _opening = OPENING.lock().unwrap_or_else(PoisonError::into_inner);
    let all = enumerate(|_| true);
    let mut places: BTreeMap<(String, String, String), usize> = BTreeMap::new();
    let card = |(i, adapter): (usize, &wgpu::Adapter)| {
        let report = report(adapter);
        let model = (
            report.name.clone(),
            report.driver.clone(),
            report.backend.clone(),
        );
        let place = places.entry(model).or_default();
        *place += 1;
        let bus = adapter.get_info().device_pci_bus_id;
        let address = match report.kind.as_str() {
            "software" => "cpu".to_owned(),
            _ if bus.is_empty() => format!("{} {place}", report.name),
            _ => bus,
        };
        Card {
            report,
            choice: format!("#{}", i + 1),
            address,
        }
    };
    all.iter().enumerate().map(card).collect()
}

impl std::fmt::Display for AdapterReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let has = |yes: bool| if yes { "yes" } else { "no" };
        let clock = match self.kind == "software" {
            true => "unused, the wall clock times a software adapter",
            false => has(self.timestamps),
        };
        write!(
            f,
            "{} ({}, {}, {})\n  GPU timestamps: {}\n  pipeline statistics: {}\n  features: {}",
            self.name,
            self.backend,
            self.kind,
            self.driver,
            clock,
            has(self.pipeline_statistics),
            self.features.join(", ")
        )
    }
}

#[derive(Debug)]
pub struct Gpu {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    report: AdapterReport,
    trust: Trust,
    trouble: Arc<Mutex<Trouble>>,
    turns: Option<Turns>,
}

/// Errors that the device reported asynchronously.
#[derive(Debug, Default)]
struct Trouble {
    lost: Option<String>,
    uncaptured: Option<String>,
}

/// Longest time for one submission. After it, the device counts as hung.
const SUBMISSION_TIMEOUT: Duration = Duration::from_secs(120);

/// As [`SUBMISSION_TIMEOUT`], for software adapters. They need minutes for a large frame on a busy
/// machine.
const SOFTWARE_TIMEOUT: Duration = Duration::from_secs(1200);

impl Gpu {
    /// Opens an adapter for the user's own shaders, with its full limits and every feature that
    /// plans and measurements use.
    ///
    /// # Errors
    /// [`Error::NoAdapter`], or [`Error::Lost`] if the driver cannot open it.
    pub fn new(choice: &AdapterChoice) -> Result<Self, Error> {
        Self::with_trust(choice, Trust::Own)
    }

    /// [`Gpu::new`] with a level of trust in the shaders.
    ///
    /// # Errors
    /// As [`Gpu::new`].
    pub fn with_trust(choice: &AdapterChoice, trust: Trust) -> Result<Self, Error> {
        let mut gpu = Self::open(choice, |adapter| {
            let copies = wgpu::DownlevelFlags::DEPTH_TEXTURE_AND_BUFFER_COPIES;
            if !adapter.get_downlevel_capabilities().flags.contains(copies) {
                let report = report(adapter);
                return Err(Error::Unsupported {
                    what: "comparing pictures".to_owned(),
                    feature: "copies of depth textures, a part of WebGPU".to_owned(),
                    adapter: format!("{} ({})", report.name, report.backend),
                });
            }
            Ok((adapter.features() & wanted_features(), adapter.limits()))
        })?;
        gpu.trust = trust;
        gpu.report.checked_shaders = trust == Trust::Strangers;
        Ok(gpu)
    }

    /// Opens an adapter with WebGPU's default limits, raised to `limits`, and only `features`: the
    /// device of a host that follows the plan. It cannot time or count.
    ///
    /// # Errors
    /// [`Error::NoAdapter`], [`Error::Unsupported`] for an unknown feature or limit, or
    /// [`Error::Lost`] if the adapter has less.
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

    /// Opens an adapter with the features and limits of `needs`.
    fn open(
        choice: &AdapterChoice,
        needs: impl Fn(&wgpu::Adapter) -> Result<(Features, wgpu::Limits), Error>,
    ) -> Result<Self, Error> {
        let _opening = OPENING.lock().unwrap_or_else(PoisonError::into_inner);
        let wanted = match choice {
            AdapterChoice::Best => None,
            AdapterChoice::Matching(text) => Some(text.clone()),
        };
        let place = choice.place();
        let matches = |adapter: &wgpu::Adapter| {
            let wanted = wanted.as_ref().filter(|_| place.is_none());
            wanted.is_none_or(|text| report(adapter).matches(text))
        };
        let found = enumerate(matches);
        let adapter = found
            .iter()
            .filter(|a| matches(a))
            .nth(place.unwrap_or_default())
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
            // Dropping a device does not count as a loss.
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
            turns: None,
        })
    }

    /// Shares the adapter with other processes.
    ///
    /// # Errors
    /// [`Error::Shared`].
    pub fn in_turns(mut self, turns: Turns) -> Result<Self, Error> {
        let is_cpu = self.report.kind == "software";
        self.turns = Some(turns.begin(is_cpu).map_err(Error::Shared)?);
        Ok(self)
    }

    /// Stops taking turns, for a device that draws no more.
    pub fn end_turns(&mut self) {
        self.turns = None;
    }

    /// Runs `time` while no other process draws on a shared adapter.
    pub fn alone<T>(&self, time: impl FnOnce() -> T) -> Result<T, Error> {
        match &self.turns {
            None => Ok(time()),
            Some(turns) => turns.alone(time).map_err(Error::Shared),
        }
    }

    pub fn adapter(&self) -> &AdapterReport {
        &self.report
    }

    pub fn trust(&self) -> Trust {
        self.trust
    }

    /// Whether timestamps can be written between passes.
    pub fn has_timestamps(&self) -> bool {
        self.device.features().contains(TIMESTAMPS)
    }

    /// Whether the adapter can count invocations.
    pub fn has_pipeline_statistics(&self) -> bool {
        self.device
            .features()
            .contains(Features::PIPELINE_STATISTICS_QUERY)
    }

    /// Compiles a shader with the run-time checks that it needs, or with all if [`Trust`] requires
    /// them.
    pub fn shader(
        &self,
        needed: Checks,
        descriptor: wgpu::ShaderModuleDescriptor<'_>,
    ) -> wgpu::ShaderModule {
        trusted::compile(&self.device, self.trust, needed, descriptor)
    }

    /// Fails unless the device has the feature with this WebGPU name.
    pub fn require(&self, what: &str, feature: &str) -> Result<(), Error> {
        match feature.parse() {
            Ok(known) if self.device.features().contains(known) => Ok(()),
            _ => Err(self.unsupported(what, feature)),
        }
    }

    /// Fails unless the device meets every limit in `needed`, by WebGPU's name. Unknown limits fail.
    pub(super) fn require_limits(
        &self,
        what: &str,
        needed: &BTreeMap<String, u64>,
    ) -> Result<(), Error> {
        let limits = self.device.limits();
        for (name, value) in needed {
            if limits::limit(&limits, name).is_none_or(|has| has < *value) {
                return Err(self.unsupported(what, &format!("{name} of {value}")));
            }
        }
        Ok(())
    }

    pub(crate) fn unsupported(&self, what: &str, feature: &str) -> Error {
        Error::Unsupported {
            what: what.to_owned(),
            feature: feature.to_owned(),
            adapter: self.report.name.clone(),
        }
    }

    /// Runs `make` and converts wgpu's validation errors to an error about `what`.
    pub fn checked<T>(&self, what: &str, make: impl FnOnce() -> T) -> Result<T, Error> {
        let memory = self.device.push_error_scope(ErrorFilter::OutOfMemory);
        let internal = self.device.push_error_scope(ErrorFilter::Internal);
        let validation = self.device.push_error_scope(ErrorFilter::Validation);
        // naga's writers, which wgpu calls, panic on some modules that pass wgpu's validation.
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
    pub fn submit(&self, what: &str, encoder: wgpu::CommandEncoder) -> Result<(), Error> {
        match &self.turns {
            None => self.submit_now(what, encoder),
            Some(turns) => turns
                .beside(|| self.submit_now(what, encoder))
                .map_err(Error::Shared)?,
        }
    }

    fn submit_now(&self, what: &str, encoder: wgpu::CommandEncoder) -> Result<(), Error> {
        let index = self.checked(what, || self.queue.submit([encoder.finish()]))?;
        let time = match self.report.kind == "software" {
            true => SOFTWARE_TIMEOUT,
            false => SUBMISSION_TIMEOUT,
        };
        let waited = self.device.poll(wgpu::PollType::Wait {
            submission_index: Some(index),
            timeout: Some(time),
        });
        match waited {
            Ok(_) => {}
            Err(wgpu::PollError::Timeout) => {
                let what = what.to_owned();
                let slow = Error::Slow { what, time };
                self.lose(slow.to_string());
                return Err(slow);
            }
            Err(other) => return Err(self.lose(format!("{what}: {other}"))),
        }
        self.check_trouble()
    }

    /// The bytes of a buffer with `MAP_READ`.
    pub fn read_buffer(&self, buffer: &wgpu::Buffer) -> Result<Vec<u8>, Error> {
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

    /// Why the device was lost, if it was. A lost device cannot draw any more.
    pub fn lost(&self) -> Option<String> {
        lock(&self.trouble).lost.clone()
    }

    /// Marks the device as lost. A device that does not answer counts as lost.
    fn lose(&self, why: String) -> Error {
        lock(&self.trouble).lost.get_or_insert(why.clone());
        Error::Lost(why)
    }

    /// Makes every later call report a lost device. Tests need this because they cannot cause a
    /// real loss.
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
    // The data is plain, so a panicking holder cannot leave it half-written.
    trouble.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The messages of an error and its causes.
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
