//! `covis map edit`: changes or removes what a map of a running server holds.
//!
//! The edit is one item of an ingest stream, sent under its own client name; the command ends once
//! the server has answered it, on a server with a disk once it is durable. It reads and writes only
//! through [`crate::client`].

use std::str::FromStr;

use anyhow::{Context, bail};
use serde::Serialize;
use tokio::sync::mpsc;

use super::super::output::show;
use crate::client::{Client, IngestReport, Item, SessionOptions, WatchOptions, describe_violation};
use crate::wire::v1;

/// Changes or removes what a map holds.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The map.
    name: String,
    /// The client name under which the edit is sent. Do not use the name of a robot: opening a
    /// stream ends another one that is open under the same name.
    #[arg(long, global = true, default_value = "editor", value_name = "NAME")]
    client: String,
    /// Also wait until the solves that the edit starts have ended.
    #[arg(long, global = true)]
    optimized: bool,
    #[command(subcommand)]
    edit: Edit,
}

#[derive(Debug, clap::Subcommand)]
enum Edit {
    /// Remove a constraint or prior.
    RevokeConstraint {
        /// The client whose constraint it is.
        owner: String,
        /// Its id; negative if the server added the constraint itself.
        #[arg(allow_negative_numbers = true)]
        id: i64,
    },
    /// Remove a keyframe's observations of landmarks.
    RemoveObservations {
        /// The client whose keyframe it is.
        owner: String,
        /// The keyframe.
        keyframe: i64,
        /// The landmarks: ID of the same client, or CLIENT/ID.
        #[arg(required = true)]
        landmarks: Vec<Named>,
    },
    /// Fuse several landmarks into one.
    FuseLandmarks {
        /// The client whose landmarks they are.
        owner: String,
        /// The landmark to keep.
        kept: i64,
        /// The landmarks to fuse into it: ID of the same client, or CLIENT/ID.
        #[arg(required = true)]
        absorbed: Vec<Named>,
    },
    /// Remove landmarks with their observations.
    RemoveLandmarks {
        /// The client whose landmarks they are.
        owner: String,
        /// The landmarks: ID of the same client, or CLIENT/ID.
        #[arg(required = true)]
        landmarks: Vec<Named>,
    },
    /// Remove a keyframe with its observations, constraints and priors.
    RemoveKeyframe {
        /// The client whose keyframe it is.
        owner: String,
        /// Its id.
        id: i64,
    },
    /// Replace the model of a camera.
    SetCamera {
        /// The client whose camera it is.
        owner: String,
        /// Its id.
        id: i64,
        /// The model.
        model: Model,
        /// pinhole: fx fy cx cy [k1 k2 p1 p2 k3]; kannala-brandt: fx fy cx cy k1 k2 k3 k4;
        /// snavely: focal k1 k2. Lengths in pixels.
        #[arg(required = true, allow_negative_numbers = true)]
        numbers: Vec<f64>,
        /// Size of the image in pixels, for instance 640x480 [default: unchanged].
        #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
        size: Option<Size>,
    },
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Model {
    Pinhole,
    KannalaBrandt,
    Snavely,
}

/// An entity, with its client where that is named.
#[derive(Clone, Debug)]
struct Named {
    owner: Option<String>,
    id: i64,
}

impl FromStr for Named {
    type Err = std::num::ParseIntError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (owner, id) = match text.split_once('/') {
            Some((owner, id)) => (Some(owner.to_owned()), id),
            None => (None, text),
        };
        Ok(Self { owner, id: id.parse()? })
    }
}

impl Named {
    fn landmark(self, owner: &str) -> v1::LandmarkRef {
        v1::LandmarkRef { client_id: self.owner.unwrap_or_else(|| owner.to_owned()), id: self.id }
    }
}

/// Width and height of an image in pixels.
type Size = (i32, i32);

fn size(text: &str) -> Result<Size, String> {
    let numbers = text.split_once('x');
    let size =
        numbers.and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
    size.ok_or_else(|| format!("{text} is not WIDTHxHEIGHT, for instance 640x480"))
}

/// What was done, in `--json`.
#[derive(Debug, Serialize)]
struct Done {
    map: String,
    client: String,
    edit: String,
    sequence: i64,
    revision: i64,
    /// Whether the map was already as the edit asks.
    duplicate: bool,
    durable: bool,
    /// The solves that covered it, where the command waited for them.
    #[serde(skip_serializing_if = "Option::is_none")]
    solves: Option<u64>,
    before: Counts,
    after: Counts,
}

#[derive(Debug, Serialize)]
struct Counts {
    keyframes: i64,
    landmarks: i64,
    observations: i64,
    constraints: i64,
    size_bytes: i64,
}

impl From<v1::Map> for Counts {
    fn from(map: v1::Map) -> Self {
        let counts = map.counts.unwrap_or_default();
        Self {
            keyframes: counts.keyframe_count,
            landmarks: counts.landmark_count,
            observations: counts.observation_count,
            constraints: counts.constraint_count,
            size_bytes: counts.size_bytes,
        }
    }
}

/// Sends the edit, waits for its acks and prints what it changed.
/// Fails for an edit that the server refuses, naming the fields.
pub(super) async fn run(args: Args, client: &Client, json: bool) -> anyhow::Result<()> {
    let Args { name, client: editor, optimized, edit } = args;
    let (feature, what) = edit.described();
    let info = client.server_info().await?;
    if !info.features.iter().any(|served| served == feature) {
        bail!("the server, version {}, does not serve {feature}", info.version);
    }
    let before = client.get_map(&name).await?.into();
    let item = edit.item(client, &name).await?;
    let (sender, mut acks) = mpsc::unbounded_channel();
    let options = SessionOptions { omit_solve_summary: true, ..SessionOptions::default() };
    let options = options.on_ack(move |ack| {
        // Nobody receives once the command has what it waits for.
        let _gone = sender.send((ack.sequence, ack.status()));
    });
    let mut session = client.ingest(&name, &editor, options).await?;
    let is_durable = session.opened().durability() != v1::Durability::InMemory;
    let sequence = session.send(item).await?;
    session.flush().await?;
    refused(&session.report())?;
    if is_durable {
        durable(&mut acks, sequence).await?;
    }
    let mut report = session.report();
    let mut solves = None;
    if optimized {
        report = session.finish().await?;
        solves = Some(report.optimized);
    }
    let done = Done {
        edit: what,
        sequence,
        revision: report.revision,
        duplicate: report.duplicates > 0,
        durable: is_durable,
        solves,
        before,
        after: client.get_map(&name).await?.into(),
        map: name,
        client: editor,
    };
    show(json, &done, || text(&done))
}

/// Waits until the server has said that everything up to `sequence` is durable.
async fn durable(
    acks: &mut mpsc::UnboundedReceiver<(i64, v1::AckStatus)>,
    sequence: i64,
) -> anyhow::Result<()> {
    while let Some((through, status)) = acks.recv().await {
        if status == v1::AckStatus::Durable && through >= sequence {
            return Ok(());
        }
    }
    bail!("the stream ended before the edit was durable: send it again")
}

/// Fails with the fields, if the server has refused the edit.
fn refused(report: &IngestReport) -> anyhow::Result<()> {
    let Some(item) = report.rejections.first() else { return Ok(()) };
    let fields: Vec<String> = item.violations.iter().map(describe_violation).collect();
    bail!("the server refuses the edit: {}", fields.join("; "))
}

fn text(done: &Done) -> String {
    let durable = if done.durable { ", durable" } else { "" };
    let mut lines = vec![match done.duplicate {
        true => format!("map {} is unchanged, this was so already: {}", done.map, done.edit),
        false => format!("map {}, revision {}{durable}: {}", done.map, done.revision, done.edit),
    }];
    let (before, after) = (&done.before, &done.after);
    for (name, before, after) in [
        ("keyframes", before.keyframes, after.keyframes),
        ("landmarks", before.landmarks, after.landmarks),
        ("observations", before.observations, after.observations),
        ("constraints", before.constraints, after.constraints),
        ("bytes", before.size_bytes, after.size_bytes),
    ] {
        if before != after {
            lines.push(format!("{name:<13} {before} -> {after}"));
        }
    }
    lines.join("\n")
}

impl Edit {
    /// What a server must list to take it, and what it does.
    fn described(&self) -> (&'static str, String) {
        match self {
            Self::RevokeConstraint { owner, id } => {
                ("ingest.revoke-constraint", format!("constraint {id} of {owner} is revoked"))
            }
            Self::RemoveObservations { owner, keyframe, landmarks } => {
                let count = landmarks.len();
                let text = format!(
                    "{count} landmarks are no longer seen by keyframe {keyframe} of {owner}"
                );
                ("ingest.remove-observations", text)
            }
            Self::FuseLandmarks { owner, kept, absorbed } => {
                let count = absorbed.len() + 1;
                let text = format!("{count} landmarks are now landmark {kept} of {owner}");
                ("ingest.fuse-landmarks", text)
            }
            Self::RemoveLandmarks { landmarks, .. } => {
                ("ingest.remove-landmarks", format!("{} landmarks are removed", landmarks.len()))
            }
            Self::RemoveKeyframe { owner, id } => {
                ("ingest.remove-keyframe", format!("keyframe {id} of {owner} is removed"))
            }
            Self::SetCamera { owner, id, .. } => {
                ("ingest.set-camera", format!("camera {id} of {owner} is replaced"))
            }
        }
    }

    /// The item of the stream.
    async fn item(self, client: &Client, map: &str) -> anyhow::Result<Item> {
        Ok(match self {
            Self::RevokeConstraint { owner: client_id, id } => {
                let constraint = Some(v1::ConstraintRef { client_id, id });
                v1::RevokeConstraint { constraint }.into()
            }
            Self::RemoveObservations { owner, keyframe, landmarks } => {
                let keyframe = v1::KeyframeRef { client_id: owner.clone(), id: keyframe };
                let observation = |landmark: Named| v1::ObservationRef {
                    keyframe: Some(keyframe.clone()),
                    landmark: Some(landmark.landmark(&owner)),
                    camera_index: 0,
                };
                let observations = landmarks.into_iter().map(observation).collect();
                v1::RemoveObservations { observations }.into()
            }
            Self::FuseLandmarks { owner, kept, absorbed } => {
                let kept = Some(v1::LandmarkRef { client_id: owner.clone(), id: kept });
                let absorbed = absorbed.into_iter().map(|l| l.landmark(&owner)).collect();
                v1::FuseLandmarks { kept, absorbed }.into()
            }
            Self::RemoveLandmarks { owner, landmarks } => {
                let landmarks = landmarks.into_iter().map(|l| l.landmark(&owner)).collect();
                v1::RemoveLandmarks { landmarks }.into()
            }
            Self::RemoveKeyframe { owner: client_id, id } => {
                v1::RemoveKeyframe { keyframe: Some(v1::KeyframeRef { client_id, id }) }.into()
            }
            Self::SetCamera { owner, id, model, numbers, size } => {
                let model = Some(model.message(&numbers)?);
                let (width_px, height_px) = match size {
                    Some(size) => size,
                    None => present_size(client, map, &owner, id).await?,
                };
                Item::SetCamera(v1::Camera {
                    client_id: owner,
                    id,
                    width_px,
                    height_px,
                    model,
                    ..v1::Camera::default()
                })
            }
        })
    }
}

/// The image size of a camera of the map; unknown for one that the map does not hold, which the server
/// refuses.
async fn present_size(client: &Client, map: &str, owner: &str, id: i64) -> anyhow::Result<Size> {
    let options =
        WatchOptions { omit_landmarks: true, omit_constraints: true, ..WatchOptions::default() };
    let mut watch = client.watch(map, options).await?;
    let cameras = &watch.next().await?.cameras;
    let known = cameras.get(&(owner.to_owned(), id));
    Ok(known.map(|camera| (camera.width_px, camera.height_px)).unwrap_or_default())
}

impl Model {
    fn message(self, numbers: &[f64]) -> anyhow::Result<v1::camera::Model> {
        let wrong = || format!("this model does not take {} numbers; see --help", numbers.len());
        let model = match (self, numbers) {
            (Self::Pinhole, &[fx, fy, cx, cy]) => {
                let model = v1::PinholeRadialTangential { fx, fy, cx, cy, ..Default::default() };
                Some(v1::camera::Model::PinholeRadialTangential(model))
            }
            (Self::Pinhole, &[fx, fy, cx, cy, k1, k2, p1, p2, k3]) => {
                let model = v1::PinholeRadialTangential { fx, fy, cx, cy, k1, k2, p1, p2, k3 };
                Some(v1::camera::Model::PinholeRadialTangential(model))
            }
            (Self::KannalaBrandt, &[fx, fy, cx, cy, k1, k2, k3, k4]) => {
                let model = v1::KannalaBrandt { fx, fy, cx, cy, k1, k2, k3, k4 };
                Some(v1::camera::Model::KannalaBrandt(model))
            }
            (Self::Snavely, &[focal, k1, k2]) => {
                Some(v1::camera::Model::Snavely(v1::Snavely { focal, k1, k2 }))
            }
            (Self::Pinhole | Self::KannalaBrandt | Self::Snavely, _) => None,
        };
        model.with_context(wrong)
    }
}
