//! What a run left: trajectories as files, figures as a table or as JSON. Counts and quantiles
//! only; errors against a truth are `covis eval`'s.

use std::collections::BTreeMap;
use std::path::Path;

use covis_solvers::io::trajectory::{Trajectory, TrajectoryFormat};
use serde::Serialize;

use super::super::formats::{extension, joined};
use super::super::volume::{MeshFigures, Paging};
use super::page::FinalMap;
use super::refined::Refined;
use crate::frontend::dense::thread::DenseReport;
use crate::frontend::mapping::run::RunReport;
use crate::frontend::pipeline::StageSeconds;
use crate::report::number;

/// Loops that the table lists.
const SHOWN_LOOPS: usize = 5;

/// The object of `--json`.
#[derive(Debug, Serialize)]
pub(super) struct Document {
    frames: usize,
    /// Length of the camera's way on the final map, m.
    length_m: f64,
    /// Of the sequence, from the first tracked frame to the last, s.
    duration_s: f64,
    /// How long tracking took over how long the sequence is: below 1 it keeps up with the camera.
    real_time_factor: Option<f64>,
    skipped: usize,
    tracked: usize,
    lost: usize,
    keyframes: usize,
    landmarks: usize,
    /// Frames that took tracking longer than 33 ms, mapping included.
    late: usize,
    /// How often tracking took corrections.
    corrections: usize,
    /// Loop closures of the map that count.
    loops: usize,
    /// Those that were found false.
    loops_switched_off: usize,
    /// When the camera came back, and when it had been there; seconds, as in the trajectories.
    loop_times_s: Vec<(f64, f64)>,
    /// How often the server told where the lost camera was.
    relocalizations: usize,
    /// The most keyframes that waited for the server's answer.
    most_held: usize,
    /// Keyframes that were not sent.
    left_out: usize,
    reconnects: u64,
    /// The signal that ended the run before the last frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    interrupted_by: Option<&'static str>,
    /// Durations by stage.
    pub(super) stages: BTreeMap<&'static str, Quantiles>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mesh: Option<MeshFigures>,
    #[serde(skip_serializing_if = "Option::is_none")]
    paging: Option<Paging>,
    /// Frames of the capture's `transforms.json` with new poses.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) refined: Option<Refined>,
}

/// Of the durations of a stage.
#[derive(Clone, Copy, Debug, Serialize)]
pub(in crate::cli) struct Quantiles {
    pub(in crate::cli) p50_ms: f64,
    pub(in crate::cli) p99_ms: f64,
}

impl Quantiles {
    pub(in crate::cli) fn of(seconds: impl Iterator<Item = f64>) -> Self {
        let mut all: Vec<f64> = seconds.collect();
        all.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| {
            let index = (share * all.len() as f64) as usize;
            all.get(index.min(all.len().saturating_sub(1))).map_or(0.0, |s| s * 1e3)
        };
        Self { p50_ms: at(0.5), p99_ms: at(0.99) }
    }
}

impl Document {
    /// What came out, in a sentence.
    pub(super) fn verdict(&self, map: Option<&FinalMap>) -> String {
        let mut text = match self.lost {
            0 => format!("All {} frames were tracked", self.frames),
            lost => format!("{lost} of {} frames were lost", self.frames),
        };
        if let Some(factor) = self.real_time_factor {
            text.push_str(&format!(", in {} times the sequence's duration", number(factor)));
        }
        if let Some(rms_px) = map.and_then(FinalMap::rms_px) {
            text.push_str(&format!("; the map's pixels are {} px off (rms)", number(rms_px)));
        }
        match (self.loops, self.loops_switched_off) {
            (0, 0) => {}
            (loops, 0) => text.push_str(&format!("; {loops} loops were closed")),
            (loops, off) => {
                text.push_str(&format!("; {loops} loops were closed, {off} found false"))
            }
        }
        text.push('.');
        text
    }

    /// The counts as lines `name value`.
    pub(super) fn facts(&self) -> Vec<(&'static str, String)> {
        let mut facts = vec![
            (
                "frames",
                format!(
                    "{}: {} tracked, {} lost, {} skipped, {} later than 33 ms",
                    self.frames, self.tracked, self.lost, self.skipped, self.late
                ),
            ),
            (
                "camera's way",
                format!("{} m in {} s", number(self.length_m), number(self.duration_s)),
            ),
            ("map", format!("{} keyframes, {} landmarks", self.keyframes, self.landmarks)),
            ("loops", format!("{} closed, {} found false", self.loops, self.loops_switched_off)),
            (
                "server",
                format!(
                    "{} corrections, {} reconnects, {} relocalizations; {} keyframes waited at most, \
                     {} were left out",
                    self.corrections,
                    self.reconnects,
                    self.relocalizations,
                    self.most_held,
                    self.left_out
                ),
            ),
        ];
        if let Some(signal) = self.interrupted_by {
            facts.push(("ended early", format!("by {signal}")));
        }
        if let Some(MeshFigures { vertices, triangles, .. }) = self.mesh {
            facts.push(("mesh", format!("{vertices} vertices, {triangles} triangles")));
        }
        facts
    }
}

/// Tracking a frame, mask included and decoding not.
pub(in crate::cli) fn track(report: &RunReport) -> Quantiles {
    Quantiles::of(report.durations.stages.iter().map(|s| s.track))
}

/// Every tracked frame on the final map.
pub(in crate::cli) fn trajectory(report: &RunReport) -> Trajectory {
    joined(report.trajectory.iter().copied())
}

/// The figures of a run.
pub(super) fn document(
    report: &RunReport,
    dense: Option<(&DenseReport, MeshFigures)>,
    interrupted_by: Option<&'static str>,
) -> Document {
    let durations = &report.durations;
    let stage = |of: fn(&StageSeconds) -> f64| Quantiles::of(durations.stages.iter().map(of));
    let mut stages = BTreeMap::from([
        ("decode", Quantiles::of(durations.decode.iter().copied())),
        ("frame", Quantiles::of(durations.frame.iter().copied())),
        ("track", track(report)),
        ("align", stage(|s| s.align)),
        ("mask", stage(|s| s.mask)),
        ("refine", stage(|s| s.refine)),
        ("map", Quantiles::of(durations.map.iter().copied())),
    ]);
    if let Some((dense, _)) = dense {
        stages.insert("integrate", Quantiles::of(dense.integrate_s.iter().copied()));
        stages.insert("follow", Quantiles::of(dense.follow_s.iter().copied()));
    }
    let way = trajectory(report);
    let duration_s = way.duration_s();
    let busy_s: f64 = durations.frame.iter().sum();
    Document {
        length_m: way.length_m(),
        duration_s,
        real_time_factor: (duration_s > 0.0).then(|| busy_s / duration_s),
        mesh: dense.map(|(_, mesh)| mesh),
        paging: dense.and_then(|(dense, _)| Paging::of(&dense.volume)),
        refined: None,
        frames: report.frames,
        skipped: report.skipped,
        tracked: report.live.len(),
        lost: report.lost(),
        keyframes: report.keyframes.len(),
        landmarks: report.landmarks,
        late: report.late(),
        corrections: report.corrections,
        loops: report.loops.counting,
        loops_switched_off: report.loops.switched_off,
        loop_times_s: report.loops.times_s.clone(),
        relocalizations: report.relocalizations,
        most_held: report.most_held,
        left_out: report.left_out,
        reconnects: report.reconnects,
        interrupted_by,
        stages,
    }
}

/// Writes `trajectory`, `trajectory_live` and `keyframes`, with the extension that the format has.
pub(in crate::cli) fn write(
    report: &RunReport,
    out: &Path,
    format: TrajectoryFormat,
) -> anyhow::Result<()> {
    let live = report.live.iter().map(|t| (t.timestamp_s, t.world_from_camera));
    let path = |name: &str| out.join(name).with_extension(extension(format));
    trajectory(report).write_as(&path("trajectory"), format)?;
    joined(live).write_as(&path("trajectory_live"), format)?;
    joined(report.keyframes.iter().copied()).write_as(&path("keyframes"), format)?;
    Ok(())
}

/// The figures as text.
pub(super) fn table(document: &Document, out: &Path) -> String {
    let mut text = format!(
        "{} frames: {} tracked, {} lost, {} skipped, {} later than 33 ms\n\
         {} keyframes, {} landmarks; {} waited for the server at most, {} were left out\n\
         {} corrections, {} reconnects; a lost camera was found {} times\n\
         {}\n\n\
         {:>8}  {:>9}  {:>9}",
        document.frames,
        document.tracked,
        document.lost,
        document.skipped,
        document.late,
        document.keyframes,
        document.landmarks,
        document.most_held,
        document.left_out,
        document.corrections,
        document.reconnects,
        document.relocalizations,
        loops(document),
        "stage",
        "p50",
        "p99"
    );
    for (name, quantiles) in &document.stages {
        let Quantiles { p50_ms, p99_ms } = quantiles;
        text.push_str(&format!("\n{name:>8}  {p50_ms:>6.1} ms  {p99_ms:>6.1} ms"));
    }
    if let Some(MeshFigures { vertices, triangles, .. }) = document.mesh {
        text.push_str(&format!("\n\n{vertices} vertices, {triangles} triangles in mesh.ply"));
    }
    if let Some(signal) = document.interrupted_by {
        text.push_str(&format!("\n\nEnded early, by {signal}: these are the frames until then"));
    }
    if let Some(refined) = document.refined {
        text.push_str(&format!("\n\n{}", refined.text()));
    }
    text.push_str(&format!("\n\nTrajectories are in {}", out.display()));
    text
}

/// The loops of a map, and the first of them by their times.
fn loops(document: &Document) -> String {
    let Document { loops, loops_switched_off, loop_times_s, .. } = document;
    let mut text = format!("{loops} loops closed, {loops_switched_off} found false");
    for (back_s, before_s) in loop_times_s.iter().take(SHOWN_LOOPS) {
        let after_s = back_s - before_s;
        text.push_str(&format!(
            "\n  at {back_s:.3} s the camera was back where it had been {after_s:.1} s before"
        ));
    }
    let more = loop_times_s.len().saturating_sub(SHOWN_LOOPS);
    if more > 0 {
        text.push_str(&format!("\n  and {more} more; --json has all"));
    }
    text
}
