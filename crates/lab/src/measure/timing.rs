//! Times frames: N identical frames a submission, variants interleaved A B B A in one process,
//! medians with bootstrap intervals.

use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::Error;
use preshade_draw::render::{self, Gpu, Prepared};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Clock {
    /// The GPU's own, between two timestamps around all frames of a submission.
    GpuTimestamps,
    /// The CPU's, from submission until the GPU is done.
    WallClock,
}

/// With fewer samples there is no interval. From 6 on, the least and the greatest enclose the
/// median in 97 of 100 cases.
pub const FEWEST_SAMPLES: usize = 6;

/// How long and how often to measure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimingSettings {
    /// Time for all variants of one view together. It ends after [`TimingSettings::min_samples`] at
    /// the earliest.
    pub budget: Duration,
    /// Least number of samples a variant; a sample is one submission.
    pub min_samples: usize,
    /// Most samples a variant.
    pub max_samples: usize,
    /// Target time of one submission on a hardware adapter. Software adapters draw one frame a
    /// submission.
    pub submission: Duration,
    /// Ends at this time with fewer samples, but at least one pair of rounds. `None`: no deadline.
    pub deadline: Option<Instant>,
    pub seed: u64,
}

impl Default for TimingSettings {
    fn default() -> Self {
        Self {
            budget: Duration::from_secs(4),
            min_samples: 8,
            max_samples: 200,
            submission: Duration::from_millis(15),
            deadline: None,
            seed: 0x7072_6573_6861_6465,
        }
    }
}

/// A median and its 95% confidence interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    pub median: f64,
    /// 2.5th percentile of the bootstrap's medians.
    pub low: f64,
    /// 97.5th percentile of the bootstrap's medians.
    pub high: f64,
}

/// A time in milliseconds a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameTime {
    #[serde(flatten)]
    pub estimate: Estimate,
    /// Every sample, in the order they were taken.
    pub samples: Vec<f64>,
}

/// The time of one variant, and its ratio to the first.
#[derive(Clone, Debug, PartialEq)]
pub struct Timing {
    pub time: FrameTime,
    /// The first variant's time over this one's, from samples of the same round. 1 for the first.
    pub speedup: Estimate,
    /// The ratios behind the speedup, round by round.
    pub ratios: Vec<f64>,
    /// Frames a submission.
    pub frames: u32,
    /// Samples thrown away because the clock gave zero or ran backwards.
    pub rejected: u32,
    /// Median milliseconds the CPU took to encode one frame.
    pub encode_ms: f64,
}

/// Times `variants` against each other. All are compared with the first, and all must be aimed at
/// the same view.
pub fn time(
    gpu: &Gpu,
    variants: &[&Prepared<'_>],
    settings: &TimingSettings,
    tick: impl FnMut(f64),
) -> Result<(Clock, Vec<Timing>), Error> {
    gpu.alone(|| time_alone(gpu, variants, settings, tick))?
}

fn time_alone(
    gpu: &Gpu,
    variants: &[&Prepared<'_>],
    settings: &TimingSettings,
    mut tick: impl FnMut(f64),
) -> Result<(Clock, Vec<Timing>), Error> {
    let start = Instant::now();
    let stopwatch = Stopwatch::new(gpu)?;
    // Warm-up: the first frames compile, upload and raise clocks. The second gives the number of
    // frames a submission.
    let mut frames = Vec::new();
    for variant in variants {
        stopwatch.sample(variant, 1)?;
        let once = stopwatch.sample(variant, 1)?;
        let mut n = match gpu.adapter().kind.as_str() {
            "software" => 1,
            _ => frames_in(settings.submission, once.ms),
        };
        if n > 1 {
            // One frame is a poor guess: clocks still rise, and a submission has its own cost.
            let several = stopwatch.sample(variant, n)?;
            n = frames_in(settings.submission, several.ms);
        }
        frames.push(n);
    }
    let mut samples: Vec<Vec<Option<f64>>> = vec![Vec::new(); variants.len()];
    let mut encodes: Vec<Vec<f64>> = vec![Vec::new(); variants.len()];
    let mut round = 0;
    loop {
        let forward = round % 2 == 0;
        let order: Vec<usize> = match forward {
            true => (0..variants.len()).collect(),
            false => (0..variants.len()).rev().collect(),
        };
        for v in order {
            let sample = stopwatch.sample(variants[v], frames[v])?;
            samples[v].push(sample.ms.filter(|ms| *ms > 0.0));
            encodes[v].push(sample.encode_ms);
        }
        round += 1;
        let spent = start.elapsed();
        tick((spent.as_secs_f64() / settings.budget.as_secs_f64().max(1e-9)).min(1.0));
        // Rounds come in pairs, A B then B A, so that a drift of the clock falls on both alike.
        let enough = round >= settings.min_samples && spent >= settings.budget;
        let late = settings.deadline.is_some_and(|d| Instant::now() >= d);
        let late = late && round >= FEWEST_SAMPLES.min(settings.min_samples);
        if round % 2 == 0 && (enough || late || round >= settings.max_samples) {
            break;
        }
    }
    let timings = (0..variants.len())
        .map(|v| {
            let good: Vec<f64> = samples[v].iter().flatten().copied().collect();
            if good.is_empty() {
                return Err(Error::Clock);
            }
            let ratios: Vec<f64> = samples[0]
                .iter()
                .zip(&samples[v])
                .filter_map(|(a, b)| Some((*a)? / (*b)?))
                .collect();
            let seed = settings.seed ^ v as u64;
            Ok(Timing {
                rejected: (samples[v].len() - good.len()) as u32,
                speedup: match v {
                    0 => Estimate {
                        median: 1.0,
                        low: 1.0,
                        high: 1.0,
                    },
                    _ => estimate(&ratios, seed),
                },
                ratios,
                time: FrameTime {
                    estimate: estimate(&good, seed),
                    samples: good,
                },
                frames: frames[v],
                encode_ms: estimate(&encodes[v], seed).median,
            })
        })
        .collect::<Result<_, _>>()?;
    Ok((stopwatch.clock(), timings))
}

fn frames_in(submission: Duration, frame_ms: Option<f64>) -> u32 {
    let frame_ms = frame_ms.filter(|ms| *ms > 0.0).unwrap_or(1.0);
    (submission.as_secs_f64() * 1e3 / frame_ms)
        .round()
        .clamp(1.0, 64.0) as u32
}

struct Stopwatch<'g> {
    gpu: &'g Gpu,
    /// Two timestamps, a buffer to resolve them into, and one to read.
    queries: Option<(wgpu::QuerySet, wgpu::Buffer, wgpu::Buffer)>,
}

struct Sample {
    /// Milliseconds a frame; `None` where the timestamps run backwards.
    ms: Option<f64>,
    encode_ms: f64,
}

impl<'g> Stopwatch<'g> {
    fn new(gpu: &'g Gpu) -> Result<Self, Error> {
        let queries = gpu
            .has_timestamps()
            .then(|| {
                gpu.checked("timestamp queries", || {
                    let buffer = |usage| {
                        gpu.device.create_buffer(&wgpu::BufferDescriptor {
                            label: Some("timestamps"),
                            size: 16,
                            usage,
                            mapped_at_creation: false,
                        })
                    };
                    let set = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                        label: Some("timestamps"),
                        ty: wgpu::QueryType::Timestamp,
                        count: 2,
                    });
                    (
                        set,
                        buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC),
                        buffer(wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ),
                    )
                })
            })
            .transpose()?;
        // A software adapter's timestamps are taken while it records work, not while it draws.
        let queries = queries.filter(|_| gpu.adapter().kind != "software");
        Ok(Self { gpu, queries })
    }

    fn clock(&self) -> Clock {
        match self.queries {
            Some(_) => Clock::GpuTimestamps,
            None => Clock::WallClock,
        }
    }

    fn sample(&self, variant: &Prepared<'_>, frames: u32) -> Result<Sample, render::Error> {
        variant.check_end()?;
        let gpu = self.gpu;
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let start = Instant::now();
        gpu.checked("timed frames", || {
            if let Some((set, ..)) = &self.queries {
                encoder.write_timestamp(set, 0);
            }
            for _ in 0..frames {
                variant.encode(&mut encoder);
            }
            if let Some((set, resolved, read)) = &self.queries {
                encoder.write_timestamp(set, 1);
                encoder.resolve_query_set(set, 0..2, resolved, 0);
                encoder.copy_buffer_to_buffer(resolved, 0, read, 0, 16);
            }
        })?;
        let encode_ms = start.elapsed().as_secs_f64() * 1e3 / f64::from(frames);
        let start = Instant::now();
        gpu.submit("timed frames", encoder)?;
        let wall = start.elapsed().as_secs_f64() * 1e3;
        let ms = match &self.queries {
            None => Some(wall),
            Some((.., read)) => {
                let bytes = gpu.read_buffer(read)?;
                let stamps: Vec<u64> = bytes
                    .as_chunks::<8>()
                    .0
                    .iter()
                    .map(|b| u64::from_le_bytes(*b))
                    .collect();
                let ticks = match stamps.as_slice() {
                    [a, b] => b.checked_sub(*a),
                    _ => None,
                };
                ticks.map(|t| t as f64 * f64::from(gpu.queue.get_timestamp_period()) * 1e-6)
            }
        };
        Ok(Sample {
            ms: ms.map(|ms| ms / f64::from(frames)),
            encode_ms,
        })
    }
}

/// Resamples of the bootstrap (Efron 1979).
const RESAMPLES: usize = 1000;

/// The median of `values` and its 95 % interval by the percentile bootstrap, seeded by `seed`. NaN
/// for no values.
pub fn estimate(values: &[f64], seed: u64) -> Estimate {
    let mut state = seed;
    let mut medians: Vec<f64> = (0..RESAMPLES)
        .map(|_| {
            let resample: Vec<f64> = (0..values.len())
                .map(|_| values[(next(&mut state) % values.len() as u64) as usize])
                .collect();
            median(resample)
        })
        .collect();
    medians.sort_by(f64::total_cmp);
    Estimate {
        median: median(values.to_vec()),
        low: medians[RESAMPLES * 25 / 1000],
        high: medians[RESAMPLES * 975 / 1000 - 1],
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => values[n / 2],
        n => (values[n / 2 - 1] + values[n / 2]) / 2.0,
    }
}

/// SplitMix64 (Steele, Lea, Flood 2014).
fn next(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
