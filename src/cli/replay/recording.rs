//! A file as a frontend's recording, and the items that a frontend would send of it.
//!
//! A BAL file holds one camera a keyframe, ids are the file's indices. A COLMAP folder gives its
//! own ids to cameras, images and points; its images come in the natural order of their names.
//! Neither holds times: keyframe k is taken to be captured at k seconds.
//!
//! Each camera comes just before its first keyframe; a keyframe brings its observations and the
//! start values of the landmarks that it sees first. Where that would pass the size of a message,
//! the rest follows as landmarks and observations items. The same recording and limit give the same
//! items, so that sequences can be counted from 1 and sent again.

use std::path::Path;

use covis_solvers::io::bal::BalFile;
use covis_solvers::io::colmap::ColmapModel;
use covis_solvers::problem::BundleProblem;
use prost::Message;

use crate::client::Item;
use crate::frontend::mapping::messages;
use crate::wire::v1;

/// A file that can be streamed.
#[derive(Debug, Default)]
pub(super) struct Recording {
    /// Start values and observations; one pose a keyframe, in order.
    pub(super) problem: BundleProblem,
    /// The id of each pose's keyframe.
    pub(super) keyframe_ids: Vec<i64>,
    /// The id of each camera.
    pub(super) camera_ids: Vec<i64>,
    /// Width and height of each camera's image in pixels, 0 where they are not known.
    pub(super) image_sizes: Vec<(i32, i32)>,
    /// The id of each landmark.
    pub(super) landmark_ids: Vec<i64>,
    /// The observations of each pose as indices into the problem's batch, in file order.
    pub(super) observations: Vec<Vec<usize>>,
    /// Observations left out because they stand twice: same keyframe, landmark and pixel.
    pub(super) repeated: usize,
}

impl Recording {
    /// Reads a BAL file or a COLMAP folder.
    pub(super) fn read(path: &Path) -> anyhow::Result<Self> {
        let recording = if path.is_dir() {
            let model = ColmapModel::read(path)?;
            let solved = model.to_problem()?;
            let size = |length: u64| i32::try_from(length).unwrap_or_default();
            let image_sizes =
                model.cameras.values().map(|c| (size(c.width), size(c.height))).collect();
            let mut landmark_ids = Vec::with_capacity(solved.point_ids.len());
            for &id in &solved.point_ids {
                landmark_ids.push(i64::try_from(id)?);
            }
            let ids = |ids: &[u32]| ids.iter().map(|&id| i64::from(id)).collect();
            let (keyframe_ids, camera_ids) = (ids(&solved.image_ids), ids(&solved.camera_ids));
            let problem = solved.problem;
            Self { problem, keyframe_ids, camera_ids, image_sizes, landmark_ids, ..Self::default() }
        } else {
            let problem = BalFile::read(path)?.to_problem();
            let ids = |count: usize| (0..).take(count).collect::<Vec<i64>>();
            Self {
                keyframe_ids: ids(problem.poses.len()),
                camera_ids: ids(problem.cameras.len()),
                image_sizes: vec![(0, 0); problem.cameras.len()],
                landmark_ids: ids(problem.landmarks.len()),
                problem,
                ..Self::default()
            }
        };
        Ok(recording.with_observations())
    }

    /// Sorts the problem's observations by pose, and leaves out those that stand twice.
    fn with_observations(self) -> Self {
        let mut observations = vec![Vec::new(); self.problem.poses.len()];
        let mut seen = std::collections::BTreeSet::new();
        let mut repeated = 0;
        let batch = &self.problem.reprojections;
        for (index, (&pose, &landmark)) in batch.poses.iter().zip(&batch.landmarks).enumerate() {
            let pixel = &batch.pixels[index];
            if seen.insert((pose, landmark, pixel.x.to_bits(), pixel.y.to_bits())) {
                observations[pose as usize].push(index);
            } else {
                repeated += 1;
            }
        }
        Self { observations, repeated, ..self }
    }
}

/// Room for what surrounds lists in a message: tags, lengths, sequence, references.
const ENVELOPE_BYTES: usize = 512;

/// Hands out a recording's items.
#[derive(Debug)]
pub(super) struct Items<'a> {
    recording: &'a Recording,
    max_message_bytes: usize,
    is_camera_sent: Vec<bool>,
    is_landmark_sent: Vec<bool>,
}

/// What fits one message.
#[derive(Debug, Default)]
struct Part {
    bytes: usize,
    observations: Vec<v1::Observation>,
    landmarks: Vec<v1::Landmark>,
}

impl<'a> Items<'a> {
    /// The items of `recording` in messages of at most `max_message_bytes`.
    pub(super) fn new(recording: &'a Recording, max_message_bytes: usize) -> Self {
        Self {
            recording,
            max_message_bytes,
            is_camera_sent: vec![false; recording.problem.cameras.len()],
            is_landmark_sent: vec![false; recording.problem.landmarks.len()],
        }
    }

    /// The items of keyframe `index`, the keyframe itself among them. Call in order.
    pub(super) fn of_keyframe(&mut self, index: usize) -> Vec<Item> {
        let Recording { problem, camera_ids, image_sizes, .. } = self.recording;
        let batch = &problem.reprojections;
        let observations = &self.recording.observations[index];
        let camera = observations.first().map(|&o| batch.cameras[o] as usize);
        let mut items = Vec::new();
        if let Some(camera) =
            camera.filter(|&c| !std::mem::replace(&mut self.is_camera_sent[c], true))
        {
            let model = &problem.cameras[camera];
            items.push(messages::camera(camera_ids[camera], model, image_sizes[camera]).into());
        }
        let keyframe_id = self.recording.keyframe_ids[index];
        let keyframe = v1::Keyframe {
            id: keyframe_id,
            capture_time: Some(messages::timestamp(index as f64)),
            world_from_camera: Some(messages::rigid(&problem.poses[index])),
            sensor: camera.map(|c| v1::keyframe::Sensor::CameraId(camera_ids[c])),
            ..v1::Keyframe::default()
        };
        let mut parts = self.parts(index, keyframe.encoded_len()).into_iter();
        let Part { observations, landmarks, .. } = parts.next().unwrap_or_default();
        items.push(v1::Keyframe { observations, landmarks, ..keyframe }.into());
        for Part { observations, landmarks, .. } in parts {
            if !landmarks.is_empty() {
                items.push(v1::LandmarkBatch { landmarks }.into());
            }
            let keyframe = Some(messages::keyframe_ref(keyframe_id));
            items.push(v1::ObservationBatch { keyframe, observations }.into());
        }
        items
    }

    /// Observations and new landmarks of a keyframe, split to messages; the first has room for the
    /// `keyframe_bytes` of the keyframe itself.
    fn parts(&mut self, index: usize, keyframe_bytes: usize) -> Vec<Part> {
        let Recording { problem, landmark_ids, .. } = self.recording;
        let batch = &problem.reprojections;
        let room = self.max_message_bytes.saturating_sub(ENVELOPE_BYTES);
        let mut parts = Vec::new();
        let mut part = Part { bytes: keyframe_bytes, ..Part::default() };
        for &o in &self.recording.observations[index] {
            let landmark = batch.landmarks[o] as usize;
            let id = landmark_ids[landmark];
            let observation = v1::Observation {
                landmark: Some(messages::landmark_ref(id)),
                pixel: Some(messages::vector2(&batch.pixels[o])),
                sigma_px: Some(batch.sigmas_px[o]),
                ..v1::Observation::default()
            };
            let is_new = !std::mem::replace(&mut self.is_landmark_sent[landmark], true);
            let landmark = is_new.then(|| v1::Landmark {
                id,
                point_in_world: Some(messages::vector3(&problem.landmarks[landmark])),
                ..v1::Landmark::default()
            });
            let bytes = in_list(&observation) + landmark.as_ref().map_or(0, in_list);
            if part.bytes + bytes > room && !part.observations.is_empty() {
                parts.push(std::mem::take(&mut part));
            }
            part.bytes += bytes;
            part.observations.push(observation);
            part.landmarks.extend(landmark);
        }
        parts.push(part);
        parts
    }
}

/// The bytes of a message in a list: itself, a tag and its length.
fn in_list(message: &impl Message) -> usize {
    let bytes = message.encoded_len();
    bytes + 1 + prost::length_delimiter_len(bytes)
}
