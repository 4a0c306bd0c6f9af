//! The bridge to the server: keyframes are sent as items, `WatchMap` returns corrections.
//!
//! The only asynchronous part of the frontend, and the only one that uses messages; it decides nothing
//! about tracking. Ids are those of [`crate::local_map`], the client is the frontend's own.

mod encode;
pub mod messages;
pub mod run;

use covis_solvers::geometry::Se3;
use nalgebra::Vector3;

use covis_client::wire::v1;
use covis_client::{
    Client, ClientError, IngestReport, IngestSession, MapMirror, MapWatch, SessionOptions,
    WatchOptions,
};

use crate::camera::FrameCamera;
use crate::local_map::Corrections;
use crate::tracking::keyframe::NewKeyframe;

/// The id of the only camera.
const CAMERA: i64 = 0;

/// A session with the server and a watch on its map.
#[derive(Debug)]
pub struct Mapper {
    client: Client,
    map_id: String,
    client_id: String,
    session: IngestSession,
    watch: MapWatch,
}

impl Mapper {
    /// Opens a session of `client_id` on a map, which must exist, and sends the camera. Lock-step:
    /// the server finishes the solve of a keyframe before it takes the next.
    ///
    /// # Errors
    /// As [`Client::ingest`] and [`Client::watch`].
    pub async fn open(
        client: &Client,
        map_id: &str,
        client_id: &str,
        camera: &FrameCamera,
    ) -> Result<Self, ClientError> {
        let options = SessionOptions { lock_step: true, ..SessionOptions::default() };
        let mut session = client.ingest(map_id, client_id, options).await?;
        let options = WatchOptions { omit_constraints: true, ..WatchOptions::default() };
        let watch = client.watch(map_id, options).await?;
        session.send(encode::camera(CAMERA, camera)).await?;
        let (map_id, client_id) = (map_id.to_owned(), client_id.to_owned());
        Ok(Self { client: client.clone(), map_id, client_id, session, watch })
    }

    /// Sends a keyframe, waits until a solve has included it, and returns the corrected map.
    ///
    /// # Errors
    /// [`ClientError::Rejected`] where the server refused it; the error that ended the session.
    pub async fn map_keyframe(
        &mut self,
        keyframe: &NewKeyframe,
    ) -> Result<Corrections, ClientError> {
        let sequence = self.session.send(encode::keyframe(CAMERA, keyframe)).await?;
        self.session.optimized(sequence).await?;
        let mirror = self.watch.reach(self.session.report().revision).await?;
        Ok(corrections(mirror, &self.client_id))
    }

    /// Optimizes the whole map and returns the result.
    ///
    /// # Errors
    /// Any code of `OptimizeMap`; the error that ended the watch.
    pub async fn optimize(&mut self) -> Result<Corrections, ClientError> {
        let request = v1::OptimizeMapRequest { map_id: self.map_id.clone(), ..Default::default() };
        self.client.optimize_map(request, |_row| {}).await?;
        let revision = self.client.get_map(&self.map_id).await?.revision;
        let mirror = self.watch.reach(revision).await?;
        Ok(corrections(mirror, &self.client_id))
    }

    /// Ends the session.
    ///
    /// # Errors
    /// The error that ended it before everything was answered.
    pub async fn finish(self) -> Result<IngestReport, ClientError> {
        self.session.finish().await
    }
}

/// The keyframes and landmarks of a client as a mirror has them.
fn corrections(mirror: &MapMirror, client_id: &str) -> Corrections {
    let own = |key: &(String, i64)| (key.0 == client_id).then(|| usize::try_from(key.1).ok())?;
    let pose = |keyframe: &v1::KeyframePose| -> Option<Se3> {
        messages::se3(keyframe.world_from_camera.as_ref()?)
    };
    let point = |landmark: &v1::Landmark| {
        let p = landmark.point_in_world?;
        Some(Vector3::new(p.x, p.y, p.z))
    };
    let keyframes = mirror.keyframes.iter().filter_map(|(k, v)| Some((own(k)?, pose(v)?)));
    let landmarks = mirror.landmarks.iter().filter_map(|(k, v)| Some((own(k)?, point(v)?)));
    Corrections { keyframes: keyframes.collect(), landmarks: landmarks.collect() }
}
