//! What `covis run --mcap` adds to the map: the image of each keyframe, colors of landmarks, figures of each frame, and the server's
//! solves.
//!
//! Images are compressed on a thread of their own. Tracking never waits for it: an image that comes while
//! several wait is left out and counted, but in lock-step, where runs repeat.

use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context, anyhow, ensure};
use covis_solvers::io::trajectory::nanoseconds_of_seconds;
use tokio::sync::oneshot;
use tokio::task;

use super::colors::Colors;
use super::recorder::Recorder;
use super::scene::{Frames, timestamp};
use super::schemas::figures::{FrameFigures, SolveFigures};
use super::schemas::foxglove::CompressedImage;
use super::sink::{self, Sink};
use super::surface::surface;
use crate::client::Client;
use crate::frontend::dense::surface::Mesh;
use crate::frontend::image::{Image, RgbdFrame};
use crate::frontend::input::encode;
use crate::frontend::mapping::run::RunReport;
use crate::frontend::pipeline::Outcome;

/// Images that wait to be compressed.
const MOST_WAITING: usize = 8;
/// How often states of the map are written.
const EVERY: Duration = Duration::from_secs(1);

/// The recording of a run.
#[derive(Debug)]
pub(in crate::cli) struct RunRecording {
    sink: Arc<Sink>,
    lock_step: bool,
    frame: String,
    colors: Colors,
    end: oneshot::Sender<()>,
    recorder: task::JoinHandle<anyhow::Result<u64>>,
}

impl RunRecording {
    /// Opens the recording of a map that a run of `client_id` is going to fill.
    pub(in crate::cli) async fn start(
        client: &Client,
        map: &str,
        client_id: &str,
        path: &Path,
        lock_step: bool,
    ) -> anyhow::Result<Self> {
        sink::available().with_context(|| format!("--mcap {}", path.display()))?;
        ensure!(path.as_os_str() != "-", "--mcap takes a file: standard output has the figures");
        let colors = Colors::new(client_id);
        let mut recorder = Recorder::open(client, map, EVERY, Some(colors.clone())).await?;
        let sink = Arc::new(Sink::create(path)?);
        let (end, ended) = oneshot::channel();
        let its_sink = Arc::clone(&sink);
        let recorder = tokio::spawn(async move {
            let end = async {
                // Also where the run failed and nobody tells it.
                let _told = ended.await;
            };
            recorder.record(&its_sink, true, end).await
        });
        Ok(Self { sink, lock_step, frame: Frames::of(client_id).camera, colors, end, recorder })
    }

    /// What the tracking thread writes with.
    pub(in crate::cli) fn frames(&self) -> FrameWriter {
        let (images, waiting) = sync_channel(MOST_WAITING);
        let (sink, frame) = (Arc::clone(&self.sink), self.frame.clone());
        let compressor = std::thread::spawn(move || compress(&waiting, &sink, &frame));
        FrameWriter {
            sink: Arc::clone(&self.sink),
            waits: self.lock_step,
            images,
            previous: None,
            colors: self.colors.clone(),
            compressor,
            left_out: 0,
            failure: None,
        }
    }

    /// Ends the recording, with the mesh where the run has fused one; `frames` come from the tracking thread, which has ended. Returns how many messages
    /// there are.
    pub(in crate::cli) async fn finish(
        self,
        frames: FrameWriter,
        report: &RunReport,
        mesh: Option<&Mesh>,
    ) -> anyhow::Result<u64> {
        let left_out = frames.finish()?;
        if left_out > 0 {
            tracing::warn!("the recording lacks {left_out} images: compressing them took too long");
        }
        for solve in &report.local_solves {
            let time_ns = nanoseconds(solve.newest_keyframe_s);
            let figures = SolveFigures {
                timestamp: Some(timestamp(time_ns)),
                initial_cost: solve.initial_cost,
                final_cost: solve.final_cost,
                solve_ms: solve.solve_s * 1e3,
            };
            self.sink.put("/covis/solve", time_ns, &figures)?;
        }
        if let Some((mesh, last)) = mesh.zip(report.live.last()) {
            let time_ns = nanoseconds(last.timestamp_s);
            self.sink.put("/covis/mesh", time_ns, &surface(mesh, time_ns))?;
        }
        // The recorder has ended before only where it failed, which its answer tells.
        let _ended = self.end.send(());
        self.recorder.await?
    }
}

/// Writes frames from the tracking thread.
#[derive(Debug)]
pub(in crate::cli) struct FrameWriter {
    sink: Arc<Sink>,
    waits: bool,
    images: SyncSender<(u64, Image<[u8; 3]>)>,
    /// The frame before this one, as long as no keyframe came: the first keyframe comes a frame late.
    previous: Option<(f64, Image<[u8; 3]>)>,
    colors: Colors,
    compressor: JoinHandle<anyhow::Result<()>>,
    left_out: usize,
    failure: Option<anyhow::Error>,
}

impl FrameWriter {
    /// Writes a frame that was tracked or lost; the image of one that became a keyframe.
    pub(in crate::cli) fn tracked(&mut self, frame: &RgbdFrame, outcome: &Outcome) {
        let time_ns = nanoseconds(frame.timestamp_s);
        let figures = FrameFigures {
            timestamp: Some(timestamp(time_ns)),
            tracked: outcome.tracked.is_some(),
            inlier_count: outcome.tracked.as_ref().map_or(0, |t| t.inliers as i64),
            track_ms: outcome.seconds.track * 1e3,
        };
        if let Err(error) = self.sink.put("/covis/frame", time_ns, &figures) {
            self.failure.get_or_insert(error);
        }
        let Some(keyframe) = &outcome.keyframe else {
            let has_begun = !self.colors.known().is_empty();
            self.previous = (!has_begun).then(|| (frame.timestamp_s, frame.color.clone()));
            return;
        };
        let is_late = |(time_s, _): &(f64, _)| *time_s == keyframe.timestamp_s;
        let previous = self.previous.take().filter(is_late);
        let color = previous.map_or_else(|| frame.color.clone(), |(_, color)| color);
        self.colors.learn(keyframe, &color);
        let images = &self.images;
        let image = (nanoseconds(keyframe.timestamp_s), color);
        let is_sent =
            if self.waits { images.send(image).is_ok() } else { images.try_send(image).is_ok() };
        self.left_out += usize::from(!is_sent);
    }

    /// Waits for the last image. Returns how many were left out.
    fn finish(self) -> anyhow::Result<usize> {
        drop(self.images);
        self.compressor.join().map_err(|_panic| anyhow!("the thread for images panicked"))??;
        self.failure.map_or(Ok(self.left_out), Err)
    }
}

/// Compresses images and writes them, until there are no more.
fn compress(
    waiting: &Receiver<(u64, Image<[u8; 3]>)>,
    sink: &Sink,
    frame: &str,
) -> anyhow::Result<()> {
    while let Ok((time_ns, image)) = waiting.recv() {
        let message = CompressedImage {
            timestamp: Some(timestamp(time_ns)),
            data: encode::rgb(&image)?,
            format: "png".to_owned(),
            frame_id: frame.to_owned(),
        };
        sink.put("/covis/image", time_ns, &message)?;
    }
    Ok(())
}

fn nanoseconds(seconds: f64) -> u64 {
    // Negative times and such that are no numbers become 0.
    nanoseconds_of_seconds(seconds).and_then(|ns| u64::try_from(ns).ok()).unwrap_or_default()
}
