//! Time along a camera path: the frame that stutters, not the one that is typical.

use serde::{Deserialize, Serialize};

use super::ViewReport;
use preshade_draw::scene::DrawOrder;

/// Times of the frames of one camera path in one order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PathTime {
    pub camera: String,
    pub order: DrawOrder,
    /// Frames timed, evenly spaced along the path; two at least.
    pub frames: usize,
    /// Median of the frames' times, in milliseconds.
    pub median_ms: f64,
    /// 95th percentile of the frames' times by the nearest rank, in milliseconds. With fewer than
    /// 20 frames it is the slowest.
    pub p95_ms: f64,
}

/// The paths with several timed frames. A frame counts by the median of its samples.
pub(crate) fn times(views: &[ViewReport]) -> Vec<PathTime> {
    let mut paths: Vec<(&str, DrawOrder, Vec<f64>)> = Vec::new();
    for view in views {
        let Some(time) = &view.time_ms else {
            continue;
        };
        let at = paths
            .iter()
            .position(|(camera, order, _)| *camera == view.camera && *order == view.order);
        match at {
            Some(at) => paths[at].2.push(time.estimate.median),
            None => paths.push((&view.camera, view.order, vec![time.estimate.median])),
        }
    }
    paths
        .into_iter()
        .filter(|(.., times)| times.len() > 1)
        .map(|(camera, order, mut times)| {
            times.sort_by(f64::total_cmp);
            PathTime {
                camera: camera.to_owned(),
                order,
                frames: times.len(),
                median_ms: percentile(&times, 50),
                p95_ms: percentile(&times, 95),
            }
        })
        .collect()
}

/// Percentile of sorted values by nearest rank.
fn percentile(sorted: &[f64], percent: usize) -> f64 {
    let rank = (sorted.len() * percent).div_ceil(100).max(1);
    sorted.get(rank - 1).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::{ErrorLadder, Estimate, FrameTime};

    fn view(frame: usize, order: DrawOrder, ms: Option<f64>) -> ViewReport {
        ViewReport {
            camera: "walk".to_owned(),
            frame,
            order,
            error: ErrorLadder::default(),
            time_ms: ms.map(|median| FrameTime {
                estimate: Estimate {
                    median,
                    low: median,
                    high: median,
                },
                samples: vec![median],
            }),
            speedup: None,
            shaded_per_pixel: None,
        }
    }

    #[test]
    fn the_95th_percentile_is_the_nearest_rank() {
        let mut views: Vec<ViewReport> = (1..=40)
            .map(|i| view(i, DrawOrder::FrontToBack, Some(((i * 17) % 41) as f64)))
            .collect();
        views.push(view(0, DrawOrder::Shuffled, Some(9.0)));
        views.push(view(41, DrawOrder::FrontToBack, None));
        let found: Vec<_> = times(&views)
            .iter()
            .map(|p| (p.order, p.frames, p.median_ms, p.p95_ms))
            .collect();
        // One frame is no path.
        assert_eq!(found, [(DrawOrder::FrontToBack, 40, 20.0, 38.0)]);
    }
}
