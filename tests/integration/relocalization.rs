//! A camera that was covered for three seconds asks the server where it is: the reference frontend, the real
//! server, recorded and rendered frames. Each attempt is compared with the pose of the same frame in a run
//! that nothing interrupts. `--nocapture` prints the time of an attempt.

use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use covis::client::Client;
use covis::frontend::camera::FrameCamera;
use covis::frontend::image::{Image, RgbdFrame};
use covis::frontend::input::{FolderOptions, FrameError, FrameSource, SensorTiming, open_folder};
use covis::frontend::mapping::run::{Companion, MOST_HELD, RunReport, Target, run as track};
use covis::frontend::pipeline::{Outcome, Pipeline, PipelineOptions};
use covis::frontend::synthetic::{SceneName, Sequence, SequenceOptions, SyntheticSource};
use covis::wire::v1;
use covis_solvers::geometry::{LieGroup, PinholeRadialTangential, Se3};
use covis_solvers::testing::data;
use nalgebra::Vector3;

use crate::common::{TestServer, run};
use crate::frontend_beside::{
    AfterFrame, CLIENT, Frames, camera, connected, frames, pipeline, relayed, sequence,
};

/// How long the camera is covered before each attempt, seconds, and how often it delivers then.
const COVERED_S: f64 = 3.0;
const COVERED_FRAMES: u32 = 30;
/// Frames that an attempt may take to find the camera.
const SHOWN: usize = 6;
/// A place is known where a mapped frame looks nearly there, degrees.
const KNOWN_DEG: f64 = 12.0;

/// Frames 0 to `mapped`, and then attempts: the camera is covered, and some frames are shown.
struct Covered {
    frames: Box<dyn FrameSource>,
    mapped: usize,
    /// The first frame of each attempt, in the order in which they are made.
    attempts: Vec<usize>,
    /// The next of `frames`.
    index: usize,
    last_s: f64,
    ready: VecDeque<RgbdFrame>,
}

impl Covered {
    /// Attempts at each fifth frame of the range. Those that follow each other are a second apart, so that
    /// none is helped by the frames of the one before.
    fn new(frames: Box<dyn FrameSource>, mapped: usize, range: Range<usize>) -> Self {
        let offsets = [0, 10, 20, 5, 15, 25].into_iter();
        let attempts = offsets.flat_map(|offset| (range.start + offset..range.end).step_by(30));
        let (index, last_s, ready) = (0, 0.0, VecDeque::new());
        Self { frames, mapped, attempts: attempts.collect(), index, last_s, ready }
    }

    /// All attempts with the darkness before each.
    fn show(&mut self) -> Result<(), FrameError> {
        let first = self.index;
        let last = self.attempts.iter().max().map_or(first, |last| last + SHOWN);
        let mut held = Vec::new();
        for _ in first..last {
            held.push(self.frames.next_frame().unwrap()?);
        }
        let mut time_s = self.last_s;
        for &attempt in &self.attempts {
            let shown = &held[attempt - first..attempt - first + SHOWN];
            for _ in 0..COVERED_FRAMES {
                time_s += COVERED_S / f64::from(COVERED_FRAMES);
                self.ready.push_back(black(&shown[0], time_s));
            }
            let late_s = time_s + 0.033 - shown[0].timestamp_s;
            let late = |frame: &RgbdFrame| {
                let timestamp_s = frame.timestamp_s + late_s;
                RgbdFrame { timestamp_s, ..frame.clone() }
            };
            self.ready.extend(shown.iter().map(late));
            time_s = shown[SHOWN - 1].timestamp_s + late_s;
        }
        Ok(())
    }
}

impl FrameSource for Covered {
    fn camera(&self) -> &PinholeRadialTangential {
        self.frames.camera()
    }

    fn timing(&self) -> SensorTiming {
        self.frames.timing()
    }

    fn len(&self) -> usize {
        self.mapped + self.attempts.len() * (COVERED_FRAMES as usize + SHOWN)
    }

    fn next_frame(&mut self) -> Option<Result<RgbdFrame, FrameError>> {
        if self.index < self.mapped {
            let frame = self.frames.next_frame()?;
            self.index += 1;
            if let Ok(frame) = &frame {
                self.last_s = frame.timestamp_s;
            }
            if self.index == self.mapped
                && let Err(error) = self.show()
            {
                return Some(Err(error));
            }
            return Some(frame);
        }
        self.ready.pop_front().map(Ok)
    }
}

fn black(like: &RgbdFrame, timestamp_s: f64) -> RgbdFrame {
    let (width, height) = like.color.size();
    let color = Image::filled(width, height, [0; 3]);
    let depth_m = Image::filled(width, height, 0.0);
    RgbdFrame { timestamp_s, depth_delay_s: 0.0, color, depth_m, given_pose: None }
}

/// A frame as it was delivered.
struct Delivered {
    timestamp_s: f64,
    is_black: bool,
}

/// Keeps what was delivered.
#[derive(Default)]
struct Log(Vec<Delivered>);

impl Companion for Log {
    fn mask(&mut self, _timestamp_s: f64) -> Option<Image<u8>> {
        None
    }

    fn tracked(&mut self, frame: &RgbdFrame, _outcome: &Outcome) {
        let is_black = frame.depth_m.pixels().iter().all(|depth| *depth == 0.0);
        self.0.push(Delivered { timestamp_s: frame.timestamp_s, is_black });
    }

    fn skipped(&mut self, error: &FrameError) {
        panic!("{error}");
    }
}

async fn tracked(client: &Client, map_id: &str, source: Box<dyn FrameSource>) -> (RunReport, Log) {
    client.create_map(map_id, None).await.unwrap();
    let size = if source.camera().cx < 200.0 { (320, 240) } else { (640, 480) };
    let camera = FrameCamera::new(*source.camera(), size.0, size.1).unwrap();
    let options = PipelineOptions { timing: source.timing(), ..PipelineOptions::default() };
    let target =
        Target { client, map_id, client_id: "robot", lock_step: true, most_held: MOST_HELD };
    let pipeline = Pipeline::new(camera, options);
    track(source, pipeline, target, true, Log::default(), None).await.unwrap()
}

/// How attempts ended.
#[derive(Debug, Default)]
struct Attempts {
    /// Of places that are known.
    all: usize,
    /// Within 3 cm and 1.5° of the pose of uninterrupted tracking.
    right: usize,
    /// The first pose is another one.
    wrong: usize,
    /// Of each frame without a pose, its question and the answer included, ms.
    took_ms: Vec<f64>,
}

/// Maps the frames of a source up to some place, and attempts to find the camera in frames that were taken
/// three seconds later and more.
#[allow(clippy::print_stdout, reason = "docs/benchmarking.md has these figures")]
async fn attempt(
    source: impl Fn() -> Box<dyn FrameSource>,
    maps: &[(usize, Range<usize>)],
) -> Attempts {
    let server = TestServer::start().await;
    let client = connected(&server).await;
    let (uninterrupted, log) = tracked(&client, "uninterrupted", source()).await;
    let times: Vec<f64> = log.0.iter().map(|frame| frame.timestamp_s).collect();
    let micros = |seconds: f64| (seconds * 1e6).round() as i64;
    let poses = |run: &RunReport| -> BTreeMap<i64, Se3> {
        run.live.iter().map(|t| (micros(t.timestamp_s), t.world_from_camera)).collect()
    };
    let truth = poses(&uninterrupted);
    let truth = |frame: usize| truth[&micros(times[frame])];
    let mut attempts = Attempts::default();
    for (mapped, range) in maps {
        let covered = Covered::new(source(), *mapped, range.clone());
        let firsts = covered.attempts.clone();
        let (report, log) = tracked(&client, &format!("until-{mapped}"), Box::new(covered)).await;
        let live = poses(&report);
        // The frames that are shown after each time that the camera was covered.
        let begins = (1..log.0.len()).filter(|&k| !log.0[k].is_black && log.0[k - 1].is_black);
        for (first, begin) in firsts.into_iter().zip(begins) {
            let angle_deg = |mapped: usize| {
                let turn = truth(first).inverse().compose(&truth(mapped)).rotation;
                turn.rotate(&Vector3::z()).z.clamp(-1.0, 1.0).acos().to_degrees()
            };
            let nearest_deg = (0..*mapped).map(angle_deg).fold(180.0, f64::min);
            let pose = |k: usize| live.get(&micros(log.0[begin + k].timestamp_s));
            let found = (0..SHOWN).find_map(|k| Some((k, pose(k)?)));
            let error = found.map(|(k, pose)| {
                let error = truth(first + k).inverse().compose(pose);
                (error.translation.norm(), error.rotation.log().norm().to_degrees())
            });
            let place = format!("map of {mapped} frames, frame {first} ({nearest_deg:.1} deg off)");
            match (found, error) {
                (Some((k, _)), Some((m, deg))) => println!("{place} + {k}: {m:.4} m, {deg:.3} deg"),
                _ => println!("{place}: not found"),
            }
            let is_right = error.is_some_and(|(m, deg)| m < 0.03 && deg < 1.5);
            attempts.wrong += usize::from(error.is_some() && !is_right);
            if nearest_deg < KNOWN_DEG {
                attempts.all += 1;
                attempts.right += usize::from(is_right);
                let lost = begin..begin + found.map_or(SHOWN, |(k, _)| k);
                attempts.took_ms.extend(lost.map(|k| 1e3 * report.durations.frame[k]));
            }
        }
        println!("map of {mapped} frames: the server told {} poses", report.relocalizations);
    }
    attempts.took_ms.sort_by(f64::total_cmp);
    let Attempts { all, right, wrong, took_ms } = &attempts;
    let (median, most) = (took_ms[took_ms.len() / 2], took_ms[took_ms.len() - 1]);
    println!(
        "{all} attempts at known places, {right} right; {wrong} wrong anywhere; a frame took \
         {median:.1} ms at the median, {most:.1} ms at most"
    );
    attempts
}

#[test]
fn a_recorded_camera_that_was_covered_is_told_where_it_is() {
    let Some(folder) = data("rgbd/tum_fr1_rpy") else { return };
    run(async {
        let source = || open_folder(&folder, FolderOptions::default()).unwrap().source;
        let attempts = attempt(source, &[(180, 270..354)]).await;
        assert!(attempts.all >= 15 && attempts.wrong == 0, "{attempts:?}");
        assert!(100 * attempts.right >= 95 * attempts.all, "{attempts:?}");
    });
}

#[test]
fn a_rendered_camera_that_was_covered_is_told_where_it_is() {
    run(async {
        // Twice around in a room with people.
        let (width, height) = (320, 240);
        let options = SequenceOptions { width, height, frames: 360, seed: 11, noise: true };
        let source = || -> Box<dyn FrameSource> {
            Box::new(SyntheticSource::new(Sequence::new(SceneName::Rounds, &options)))
        };
        let attempts = attempt(source, &[(200, 290..354)]).await;
        assert!(attempts.all >= 10 && attempts.wrong == 0, "{attempts:?}");
        // People hide much of a small image: some need more frames than are shown.
        assert!(3 * attempts.right >= 2 * attempts.all, "{attempts:?}");
    });
}

/// Half a turn, darkness, and then a place that was seen at first and that the local map has forgotten: the
/// camera stands there until it is tracked again.
struct UntilFound {
    next: usize,
    last_s: f64,
    is_found: Arc<AtomicBool>,
}

/// Frames of the half turn, and of the darkness.
const TURN: usize = 30;
const DARK: usize = 3;
/// What is shown then.
const PLACE: usize = 3;
/// A camera that nobody finds within so many frames is lost.
const MOST_FRAMES: usize = 4000;

impl FrameSource for UntilFound {
    fn camera(&self) -> &PinholeRadialTangential {
        camera()
    }

    fn timing(&self) -> SensorTiming {
        SensorTiming::default()
    }

    fn len(&self) -> usize {
        MOST_FRAMES
    }

    fn next_frame(&mut self) -> Option<Result<RgbdFrame, FrameError>> {
        let index = self.next;
        self.next += 1;
        self.last_s += 1.0 / 30.0;
        let timestamp_s = self.last_s;
        let is_over = self.is_found.load(Ordering::Acquire) || index >= MOST_FRAMES;
        Some(Ok(match index {
            _ if index < TURN => RgbdFrame { timestamp_s, ..sequence().frame(index) },
            _ if index < TURN + DARK => black(&frames()[PLACE], timestamp_s),
            _ if is_over => return None,
            _ => RgbdFrame { timestamp_s, ..frames()[PLACE].clone() },
        }))
    }
}

/// Runs [`UntilFound`] into the map "m", with a local map of five keyframes. `lost` is called after each
/// frame that is shown after the darkness and has no pose.
async fn run_until_found(
    client: &Client,
    lock_step: bool,
    mut lost: impl FnMut(usize) + Send + 'static,
) -> RunReport {
    let is_found = Arc::new(AtomicBool::new(false));
    let source = Box::new(UntilFound { next: 0, last_s: 1.0, is_found: Arc::clone(&is_found) });
    let options = PipelineOptions { most_keyframes: 5, ..PipelineOptions::default() };
    let pipeline = Pipeline::new(FrameCamera::new(*camera(), 320, 240).unwrap(), options);
    let target = Target { client, map_id: "m", client_id: CLIENT, lock_step, most_held: MOST_HELD };
    let call = move |frames: usize, is_tracked: bool| {
        if frames > TURN + DARK && is_tracked {
            is_found.store(true, Ordering::Release);
        } else if frames > TURN + DARK {
            lost(frames - TURN - DARK);
        }
    };
    let companion = AfterFrame { frames: 0, call };
    track(source, pipeline, target, false, companion, None).await.unwrap().0
}

#[test]
fn a_lost_camera_is_told_where_it_is_and_tracking_does_not_wait_for_that() {
    run(async {
        let (server, proxy, client) = relayed().await;
        client.create_map("m", None).await.unwrap();
        let link = Arc::clone(&proxy);
        let report = run_until_found(&client, false, move |lost| match lost {
            // The question goes out with this frame: nothing passes.
            1 => link.hold(true),
            // Tracking has come here without an answer.
            20 => link.hold(false),
            _ => {}
        });
        let report = report.await;
        assert!(report.failure.is_none(), "{:?}", report.failure);
        assert!(report.relocalizations >= 1 && report.frames < MOST_FRAMES, "{report:?}");
        found_where_it_was(&report);
        drop(server);
    });
}

#[test]
fn a_lost_camera_is_told_where_it_is_in_lock_step_too_and_repeats_to_the_bit() {
    run(async {
        let mut lives = Vec::new();
        for _ in 0..2 {
            let server = TestServer::start().await;
            let client = connected(&server).await;
            client.create_map("m", None).await.unwrap();
            let report = run_until_found(&client, true, |_| {}).await;
            // One frame is asked for, the next one is tracked.
            assert_eq!((report.relocalizations, report.lost()), (1, DARK + 1));
            found_where_it_was(&report);
            lives.push(report.live);
        }
        assert_eq!(lives[0], lives[1]);
    });
}

/// The last frame shows what frame [`PLACE`] showed.
fn found_where_it_was(report: &RunReport) {
    let (first, last) = (report.live[PLACE], report.live.last().unwrap());
    let error = first.world_from_camera.inverse().compose(&last.world_from_camera);
    let (m, rad) = (error.translation.norm(), error.rotation.log().norm());
    assert!(m < 0.03 && rad < 0.02, "{m} m, {rad} rad");
}

#[test]
fn without_place_recognition_a_run_goes_on_and_tracks_what_comes_into_view_again() {
    run(async {
        let server = TestServer::start().await;
        let client = connected(&server).await;
        let off = v1::PlaceRecognition { enabled: Some(false) };
        let policy = v1::MapPolicy { place_recognition: Some(off), ..Default::default() };
        client.create_map("m", Some(policy)).await.unwrap();
        // Dark after frame 11, and another place shown for a while: then back.
        let all = (0..30).map(|index| match index {
            0..12 => frames()[index].clone(),
            12..15 => black(&frames()[11], 0.0),
            15..25 => sequence().frame(index + 20),
            _ => frames()[11].clone(),
        });
        let all = all.enumerate().map(|(index, frame)| RgbdFrame {
            timestamp_s: sequence().timestamp_s(index),
            ..frame
        });
        let source = Box::new(Frames { frames: Arc::new(all.collect()), next: 0 });
        let target = Target {
            client: &client,
            map_id: "m",
            client_id: CLIENT,
            lock_step: true,
            most_held: MOST_HELD,
        };
        let companion = AfterFrame { frames: 0, call: |_, _| {} };
        let (report, _) = track(source, pipeline(), target, false, companion, None).await.unwrap();
        // The first frame that shows it again is not published.
        assert_eq!((report.relocalizations, report.lost()), (0, 14));
    });
}
