//! The calls of a client, one method each: maps, trajectories, landmarks, solves.
//!
//! Streamed and paged answers are collected here. Calls with one answer that solve nothing have a
//! deadline ([`super::LinkOptions::deadline`]). A call that the server did not begin, or that changes
//! nothing, is made again ([`super::LinkOptions::retry`]).

use tokio_stream::{Stream, StreamExt as _};
use tonic::{Response, Status, Streaming};

use super::{Client, ClientError, MapExport, export};
use crate::wire::v1;
use v1::import_map_request::Content;
use v1::optimize_map_response::Event;

/// Digests of one revision of a map; what goes into them is in `map_service.proto`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MapDigests {
    /// SHA-256 over all that the map holds.
    pub state_hash: Vec<u8>,
    /// SHA-256 over the ids of its keyframes.
    pub keyframe_ids_digest: Vec<u8>,
}

/// Makes a call, again at the server that owns the map where another one was asked, and again after a
/// pause where [`ClientError::may_repeat`] allows it.
macro_rules! repeated {
    ($client:expr, $call:expr) => {{
        let mut attempts = $crate::repeats::Attempts::of(&$client);
        loop {
            let answered: Result<_, ClientError> = $call;
            let Err(error) = answered else { break answered };
            if let Err(error) = attempts.after(error).await {
                break Err(error);
            }
        }
    }};
}
pub(super) use repeated;

/// All that a streamed answer lists, of one revision, as one message without a page token.
macro_rules! all {
    ($client:ident, $rpc:literal, $call:ident($request:ident), $list:ident) => {
        repeated!(
            $client,
            match answer($rpc, $client.map_service().$call($request.clone()).await) {
                Ok(stream) =>
                    joined($rpc, stream, |all, part| {
                        all.revision = part.revision;
                        all.$list.extend(part.$list);
                    })
                    .await,
                Err(error) => Err(error),
            }
        )
    };
}

impl Client {
    /// Version, limits, durability and features of the server.
    ///
    /// # Errors
    /// The codes of `GetServerInfo`.
    pub async fn server_info(&self) -> Result<v1::GetServerInfoResponse, ClientError> {
        let call = || self.timed(v1::GetServerInfoRequest {});
        repeated!(
            self,
            answer("GetServerInfo", self.server_service().get_server_info(call()).await)
        )
    }

    /// Creates an empty map; an absent policy is the server's.
    ///
    /// # Errors
    /// The codes of `CreateMap`, ALREADY_EXISTS for a `map_id` that is taken.
    pub async fn create_map(
        &self,
        map_id: &str,
        policy: Option<v1::MapPolicy>,
    ) -> Result<v1::Map, ClientError> {
        let map_id = map_id.to_owned();
        let request = v1::CreateMapRequest { map_id, policy, ..v1::CreateMapRequest::default() };
        self.create_map_with(request).await
    }

    /// As [`Client::create_map`], with everything that a request can choose.
    ///
    /// # Errors
    /// The codes of `CreateMap`.
    pub async fn create_map_with(
        &self,
        request: v1::CreateMapRequest,
    ) -> Result<v1::Map, ClientError> {
        const RPC: &str = "CreateMap";
        let answer = repeated!(
            self,
            answer(RPC, self.map_service().create_map(self.timed(request.clone())).await)
        )?;
        one(RPC, answer.map)
    }

    /// One map with its counts.
    ///
    /// # Errors
    /// The codes of `GetMap`.
    pub async fn get_map(&self, map_id: &str) -> Result<v1::Map, ClientError> {
        Ok(self.get_map_answer(map_id, false).await?.0)
    }

    /// As [`Client::get_map`], with digests by which maps of servers of one version are compared.
    ///
    /// # Errors
    /// The codes of `GetMap`.
    pub async fn get_map_digests(
        &self,
        map_id: &str,
    ) -> Result<(v1::Map, MapDigests), ClientError> {
        self.get_map_answer(map_id, true).await
    }

    async fn get_map_answer(
        &self,
        map_id: &str,
        include_digests: bool,
    ) -> Result<(v1::Map, MapDigests), ClientError> {
        const RPC: &str = "GetMap";
        let request = v1::GetMapRequest { map_id: map_id.to_owned(), include_digests };
        let answer = repeated!(
            self,
            answer(RPC, self.map_service().get_map(self.timed(request.clone())).await)
        )?;
        let v1::GetMapResponse { map, state_hash, keyframe_ids_digest } = answer;
        Ok((one(RPC, map)?, MapDigests { state_hash, keyframe_ids_digest }))
    }

    /// As [`Client::get_map`], `None` where there is no such map.
    ///
    /// # Errors
    /// The other codes of `GetMap`.
    pub async fn find_map(&self, map_id: &str) -> Result<Option<v1::Map>, ClientError> {
        match self.get_map(map_id).await {
            Ok(map) => Ok(Some(map)),
            Err(error) if error.code() == Some(tonic::Code::NotFound) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// All maps by `map_id`.
    ///
    /// # Errors
    /// The codes of `ListMaps`.
    pub async fn list_maps(&self) -> Result<Vec<v1::Map>, ClientError> {
        let mut maps = Vec::new();
        let mut request = v1::ListMapsRequest::default();
        loop {
            let call = || self.timed(request.clone());
            let page =
                repeated!(self, answer("ListMaps", self.map_service().list_maps(call()).await))?;
            maps.extend(page.maps);
            if page.next_page_token.is_empty() {
                return Ok(maps);
            }
            request = v1::ListMapsRequest { page_size: 0, page_token: page.next_page_token };
        }
    }

    /// Deletes a map with its journal.
    ///
    /// # Errors
    /// The codes of `DeleteMap`.
    pub async fn delete_map(&self, map_id: &str) -> Result<(), ClientError> {
        let request = v1::DeleteMapRequest { map_id: map_id.to_owned() };
        let call = || self.timed(request.clone());
        repeated!(self, answer("DeleteMap", self.map_service().delete_map(call()).await)).map(drop)
    }

    /// Makes a map part of another one.
    ///
    /// # Errors
    /// The codes of `MergeMaps`.
    pub async fn merge_maps(
        &self,
        request: v1::MergeMapsRequest,
    ) -> Result<v1::MergeMapsResponse, ClientError> {
        repeated!(self, answer("MergeMaps", self.map_service().merge_maps(request.clone()).await))
    }

    /// Takes a map out of the one that it was merged into.
    ///
    /// # Errors
    /// The codes of `UndoMerge`.
    pub async fn undo_merge(
        &self,
        request: v1::UndoMergeRequest,
    ) -> Result<v1::UndoMergeResponse, ClientError> {
        repeated!(self, answer("UndoMerge", self.map_service().undo_merge(request.clone()).await))
    }

    /// The poses of a map's keyframes, of one client or (`None`) of all: by client, then capture time,
    /// then id.
    ///
    /// # Errors
    /// The codes of `GetTrajectory`.
    pub async fn trajectory(
        &self,
        map_id: &str,
        client_id: Option<&str>,
    ) -> Result<v1::GetTrajectoryResponse, ClientError> {
        let client_id = client_id.unwrap_or_default().to_owned();
        let request = v1::GetTrajectoryRequest { map_id: map_id.to_owned(), client_id };
        all!(self, "GetTrajectory", get_trajectory(request), poses)
    }

    /// A map's landmarks by client, then id, without descriptors.
    ///
    /// # Errors
    /// The codes of `ListLandmarks`.
    pub async fn landmarks(&self, map_id: &str) -> Result<v1::ListLandmarksResponse, ClientError> {
        let request = v1::ListLandmarksRequest { map_id: map_id.to_owned(), ..Default::default() };
        all!(self, "ListLandmarks", list_landmarks(request), landmarks)
    }

    /// A map's constraints by client, then id: relative poses, those that are switched off too, and
    /// priors.
    ///
    /// # Errors
    /// The codes of `ListConstraints`.
    pub async fn constraints(
        &self,
        map_id: &str,
    ) -> Result<v1::ListConstraintsResponse, ClientError> {
        let request =
            v1::ListConstraintsRequest { map_id: map_id.to_owned(), ..Default::default() };
        all!(self, "ListConstraints", list_constraints(request), constraints)
    }

    /// What the searches for known places found, by client, then keyframe.
    ///
    /// # Errors
    /// The codes of `ListPlaceSearches`.
    pub async fn place_searches(
        &self,
        map_id: &str,
    ) -> Result<v1::ListPlaceSearchesResponse, ClientError> {
        let request =
            v1::ListPlaceSearchesRequest { map_id: map_id.to_owned(), ..Default::default() };
        all!(self, "ListPlaceSearches", list_place_searches(request), searches)
    }

    /// A map's keyframes by client, then id, each once, with the fields that the mask names; `None` for
    /// all but observations.
    ///
    /// # Errors
    /// The codes of `ListKeyframes`.
    pub async fn keyframes(
        &self,
        map_id: &str,
        read_mask: Option<prost_types::FieldMask>,
    ) -> Result<v1::ListKeyframesResponse, ClientError> {
        let map_id = map_id.to_owned();
        let request = v1::ListKeyframesRequest { map_id, read_mask, ..Default::default() };
        let mut all = all!(self, "ListKeyframes", list_keyframes(request), keyframes)?;
        // A keyframe with more observations than fit one entry has several.
        all.keyframes.dedup_by(|entry, last| {
            let is_same = (&last.client_id, last.id) == (&entry.client_id, entry.id);
            if is_same {
                last.observations.append(&mut entry.observations);
            }
            is_same
        });
        Ok(all)
    }

    /// Changes name, policy or state of a map, as the request's mask says; the map after it.
    ///
    /// # Errors
    /// The codes of `UpdateMap`.
    pub async fn update_map(&self, request: v1::UpdateMapRequest) -> Result<v1::Map, ClientError> {
        const RPC: &str = "UpdateMap";
        let answer = repeated!(
            self,
            answer(RPC, self.map_service().update_map(self.timed(request.clone())).await)
        )?;
        one(RPC, answer.map)
    }

    /// Creates a map that holds what another one holds, now or at the revision or time of the request.
    ///
    /// # Errors
    /// The codes of `CopyMap`.
    pub async fn copy_map(
        &self,
        request: v1::CopyMapRequest,
    ) -> Result<v1::CopyMapResponse, ClientError> {
        repeated!(self, answer("CopyMap", self.map_service().copy_map(request.clone()).await))
    }

    /// Creates a map from files, whose chunks come in order; the map, and what it does not hold as the files
    /// have it. Dropping the future before the answer
    /// leaves no map, unless the server had everything already.
    ///
    /// # Errors
    /// The codes of `ImportMap`.
    pub async fn import_map(
        &self,
        header: v1::ImportMapHeader,
        chunks: impl Stream<Item = v1::FileChunk> + Send + 'static,
    ) -> Result<(v1::Map, Vec<v1::ImportWarning>), ClientError> {
        const RPC: &str = "ImportMap";
        let message = |content| v1::ImportMapRequest { content: Some(content) };
        let header = tokio_stream::once(Content::Header(header));
        let content = header.chain(chunks.map(Content::Chunk)).map(message);
        let answer = answer(RPC, self.map_service().import_map(content).await)?;
        Ok((one(RPC, answer.map)?, answer.warnings))
    }

    /// Starts an export; its files come chunk by chunk.
    ///
    /// # Errors
    /// The codes of `ExportMap`.
    pub async fn export_map(
        &self,
        map_id: &str,
        format: v1::MapFormat,
    ) -> Result<MapExport, ClientError> {
        let request = v1::ExportMapRequest {
            map_id: map_id.to_owned(),
            format: format.into(),
            ..v1::ExportMapRequest::default()
        };
        self.export_map_with(request).await
    }

    /// As [`Client::export_map`], with everything that a request can choose.
    ///
    /// # Errors
    /// The codes of `ExportMap`.
    pub async fn export_map_with(
        &self,
        request: v1::ExportMapRequest,
    ) -> Result<MapExport, ClientError> {
        repeated!(
            self,
            match answer(export::RPC, self.map_service().export_map(request.clone()).await) {
                Ok(stream) => MapExport::begin(stream).await,
                Err(error) => Err(error),
            }
        )
    }

    /// Optimizes a whole map; `on_iteration` sees each iteration as it comes. Dropping the future
    /// cancels the solve and leaves the map as it was.
    ///
    /// # Errors
    /// The codes of `OptimizeMap`.
    pub async fn optimize_map(
        &self,
        request: v1::OptimizeMapRequest,
        mut on_iteration: impl FnMut(&v1::IterationSummary),
    ) -> Result<v1::OptimizeMapResult, ClientError> {
        const RPC: &str = "OptimizeMap";
        repeated!(
            self,
            async {
                let request = request.clone();
                let answered = self.optimization_service().optimize_map(request).await;
                let mut stream = answer(RPC, answered)?;
                while let Some(part) = next(RPC, &mut stream).await? {
                    match part.event {
                        Some(Event::Iteration(row)) => on_iteration(&row),
                        Some(Event::Result(result)) => return Ok(result),
                        None => {}
                    }
                }
                let what = "the stream ended without a result";
                Err(ClientError::Protocol { rpc: RPC, what })
            }
            .await
        )
    }

    /// Refines the pose of one camera over known points.
    ///
    /// # Errors
    /// The codes of `RefinePose`.
    pub async fn refine_pose(
        &self,
        request: v1::RefinePoseRequest,
    ) -> Result<v1::RefinePoseResponse, ClientError> {
        repeated!(
            self,
            answer("RefinePose", self.optimization_service().refine_pose(request.clone()).await)
        )
    }

    /// Finds where a camera is in a map.
    ///
    /// # Errors
    /// The codes of `Localize`.
    pub async fn localize(
        &self,
        request: v1::LocalizeRequest,
    ) -> Result<v1::LocalizeResponse, ClientError> {
        repeated!(
            self,
            answer("Localize", self.optimization_service().localize(request.clone()).await)
        )
    }

    /// Solves a bundle adjustment problem that comes with the call.
    ///
    /// # Errors
    /// The codes of `SolveBundle`.
    pub async fn solve_bundle(
        &self,
        request: v1::SolveBundleRequest,
    ) -> Result<v1::SolveBundleResponse, ClientError> {
        repeated!(
            self,
            answer("SolveBundle", self.optimization_service().solve_bundle(request.clone()).await)
        )
    }

    /// Solves a pose graph that comes with the call.
    ///
    /// # Errors
    /// The codes of `SolvePoseGraph`.
    pub async fn solve_pose_graph(
        &self,
        request: v1::SolvePoseGraphRequest,
    ) -> Result<v1::SolvePoseGraphResponse, ClientError> {
        repeated!(
            self,
            answer(
                "SolvePoseGraph",
                self.optimization_service().solve_pose_graph(request.clone()).await
            )
        )
    }
}

fn one(rpc: &'static str, map: Option<v1::Map>) -> Result<v1::Map, ClientError> {
    map.ok_or(ClientError::Protocol { rpc, what: "no map" })
}

/// What a call was answered with.
pub(super) fn answer<T>(
    rpc: &'static str,
    answer: Result<Response<T>, Status>,
) -> Result<T, ClientError> {
    answer.map(Response::into_inner).map_err(ClientError::rpc(rpc))
}

/// The messages of a streamed answer as one, to which `add` adds each.
async fn joined<T: Default>(
    rpc: &'static str,
    mut stream: Streaming<T>,
    add: impl Fn(&mut T, T),
) -> Result<T, ClientError> {
    let mut all = T::default();
    while let Some(part) = next(rpc, &mut stream).await? {
        add(&mut all, part);
    }
    Ok(all)
}

/// The next message of a streamed answer.
pub(super) async fn next<T>(
    rpc: &'static str,
    stream: &mut Streaming<T>,
) -> Result<Option<T>, ClientError> {
    stream.message().await.map_err(ClientError::rpc(rpc))
}
