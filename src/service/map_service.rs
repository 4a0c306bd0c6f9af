//! `MapService`: creating, reading, watching and exporting maps.
//!
//! Each handler reads its request, asks the engine and converts the answer. A stream reads one
//! snapshot, however long it takes. No mathematics, and no state of maps: both are the engine's.

use std::sync::Arc;

use prost::Message;
use tonic::{Request, Response, Status, Streaming};

use super::access::{Caller, change};
use super::connections::Peer;
use super::context::{Answers, Context, Messages, Rpcs};
use super::convert::map::{display_name, policy, to_hints};
use super::convert::{Path, convert, copy, ids, merge, update};
use super::deadline::{CancelOnDrop, call_time, solve_deadline};
use super::engine::{EngineError, Estimate, MapHandle, PoolError, Resource};
use super::error::ServiceError;
use super::names::shown;
use super::watch::{Resolution, WatcherOptions};
use super::{export, import, listing, watch};
use crate::map::{Map, Reason};
use crate::store::StoreError;
use crate::wire::v1;
use v1::export_map_response::Content;
use v1::map_service_server::MapService;

impl Rpcs {
    async fn create(
        &self,
        request: Request<v1::CreateMapRequest>,
    ) -> Result<v1::CreateMapResponse, ServiceError> {
        let (caller, request) = (Caller::of(&request)?, request.into_inner());
        let limits = self.context.limits();
        let (map_id, display_name, policy) = convert(|out| {
            let map_id = ids::map_id(&request.map_id, out);
            let display_name = display_name(&request.display_name, out);
            let policy = policy(request.policy.as_ref(), &limits, out);
            Some((map_id?, display_name?, policy?))
        })?;
        let name = caller.engine_name(&map_id);
        let info = self.context.maps.create(&name, &display_name, policy).await?;
        Ok(v1::CreateMapResponse { map: Some(self.context.map_message(info).await?) })
    }

    async fn update(
        &self,
        request: Request<v1::UpdateMapRequest>,
    ) -> Result<v1::UpdateMapResponse, ServiceError> {
        let (caller, request) = (Caller::of(&request)?, request.into_inner());
        let limits = self.context.limits();
        let map = self.map(&caller, &request.map_id).await?;
        let update = convert(|out| update::update(&request, &limits, out))?;
        let info = map.update(update).await?;
        Ok(v1::UpdateMapResponse { map: Some(self.context.map_message(info).await?) })
    }

    async fn copy(
        &self,
        request: Request<v1::CopyMapRequest>,
    ) -> Result<v1::CopyMapResponse, ServiceError> {
        let (caller, request) = (Caller::of(&request)?, request.into_inner());
        let copy = convert(|out| copy::copy(&request, out))?;
        let source = self.map(&caller, &copy.source).await?;
        let name = caller.engine_name(&copy.name);
        let copied = self.context.maps.copy(&source, copy.moment, &name, copy.frozen).await?;
        let map = self.context.map_message(copied.map.clone()).await?;
        Ok(copy::to_response(&copied, map))
    }

    async fn list(
        &self,
        request: Request<v1::ListMapsRequest>,
    ) -> Result<v1::ListMapsResponse, ServiceError> {
        let caller = Caller::of(&request)?;
        let list = listing::PagedList::new("ListMaps", caller.tenant());
        let v1::ListMapsRequest { page_size, page_token } = request.get_ref();
        let (size, after) = listing::page(*page_size, page_token, &list)?;
        let mut handles = self.context.maps.list();
        handles.retain(|map| caller.owns(map.name()) && shown(map.name()) > after.as_str());
        let (mut maps, mut bytes) = (Vec::new(), 0);
        // A page ends at its number of maps, and where a map with many clients makes it too long.
        let (mut last, mut more) = (None, handles.len() > size);
        handles.truncate(size);
        for handle in handles {
            let name = shown(handle.name()).to_owned();
            match handle.listed().await {
                Ok(info) => {
                    let map = self.context.map_message(info).await?;
                    let length = map.encoded_len() + listing::ENTRY_OVERHEAD;
                    if !maps.is_empty() && bytes + length > listing::MESSAGE_BYTES {
                        more = true;
                        break;
                    }
                    bytes += length;
                    maps.push(map);
                }
                // The map was deleted after the list was made, or another server may have it.
                Err(
                    EngineError::MapNotFound { .. }
                    | EngineError::Store(StoreError::OwnedElsewhere { .. }),
                ) => {}
                Err(error) => return Err(error.into()),
            }
            last = Some(name);
        }
        let last = last.filter(|_| more);
        let next_page_token = last.map(|last| list.token(&last)).unwrap_or_default();
        Ok(v1::ListMapsResponse { maps, next_page_token })
    }

    /// The edges of a map's pose graph. Pairs of keyframes that no solve has measured are measured on
    /// the solver pool, until the caller leaves.
    pub(super) async fn graph_lines(
        &self,
        map: &MapHandle,
        snapshot: Arc<Map>,
    ) -> Result<export::GraphLines, ServiceError> {
        let (maps, cancel) = (&self.context.maps, CancelOnDrop::default());
        let (interrupt, handle) = (cancel.interrupt(None), map.clone());
        let ceiling = self.context.config.engine.ceiling();
        let estimate = Estimate::of_graph(snapshot.usage(), &ceiling);
        let work = move || Some(export::GraphLines::of(handle.pose_graph(&snapshot, &interrupt)?));
        let lines = maps.pool().run(map.account(), estimate, work).await;
        if let Err(PoolError::Panicked(_)) = lines {
            maps.meters().solve_panics.increment();
        }
        lines?.ok_or(ServiceError::Gone)
    }

    async fn merge(
        &self,
        request: Request<v1::MergeMapsRequest>,
    ) -> Result<v1::MergeMapsResponse, ServiceError> {
        let (caller, deadline) = (Caller::of(&request)?, solve_deadline(&request, 0));
        let peer = request.extensions().get().map(Peer::address);
        let request = request.into_inner();
        let map_id = request.source_map_id.clone();
        let merge = convert(|out| merge::merge(request, &caller, out))?;
        // A merge that has begun is finished also when the caller is gone.
        let cancel = CancelOnDrop::default();
        let merged = self.context.maps.merge(merge, cancel.interrupt(deadline)).await;
        let merged = merged.map_err(ServiceError::from);
        change("MergeMaps", &caller, peer, &map_id, &merged);
        let merged = merged?;
        let map = self.context.map_message(merged.map.clone()).await?;
        Ok(merge::to_response(&merged, map))
    }

    async fn undo(
        &self,
        request: Request<v1::UndoMergeRequest>,
    ) -> Result<v1::UndoMergeResponse, ServiceError> {
        let caller = Caller::of(&request)?;
        let peer = request.extensions().get().map(Peer::address);
        let request = request.into_inner();
        let map = self.map(&caller, &request.map_id).await?;
        let source =
            convert(|out| ids::name(Path::root("source_map_id"), &request.source_map_id, out))?;
        let from = caller.engine_name(&source);
        let undone = self.context.maps.undo_merge(map.name(), &from).await;
        let undone = undone.map_err(ServiceError::from);
        change("UndoMerge", &caller, peer, &source, &undone);
        let (map, source) = undone?;
        let (map, source) =
            (self.context.map_message(map).await?, self.context.map_message(source).await?);
        Ok(v1::UndoMergeResponse { map: Some(map), source: Some(source) })
    }

    async fn map(&self, caller: &Caller, map_id: &str) -> Result<MapHandle, ServiceError> {
        let map_id = convert(|out| ids::map_id(map_id, out))?;
        Ok(self.context.maps.find(&caller.engine_name(&map_id)).await?)
    }
}

/// Streams a list of a map's entities: `pages` reads the options of the request, `send` sends.
macro_rules! list {
    ($rpcs:ident, $request:ident, $rpc:literal, $pages:path, $send:path) => {{
        let (rpcs, time) = ($rpcs.clone(), call_time($request.metadata()));
        let (caller, request) = (Caller::of(&$request), $request.into_inner());
        $rpcs.context.stream($rpc, time, Messages::Large, |sink| async move {
            let pages = convert(|out| {
                let map_id = ids::map_id(&request.map_id, out);
                let pages = $pages(&request, out);
                map_id?;
                pages
            })?;
            let map = rpcs.map(&caller?, &request.map_id).await?;
            let _reservation = map.account().reserve(Resource::Lists, 1)?;
            $send(&*map.snapshot().await?, &pages, &sink).await
        })
    }};
}

#[async_trait::async_trait]
impl MapService for Rpcs {
    async fn create_map(
        &self,
        request: Request<v1::CreateMapRequest>,
    ) -> Result<Response<v1::CreateMapResponse>, Status> {
        self.context.answer("CreateMap", self.create(request)).await
    }

    async fn get_map(
        &self,
        request: Request<v1::GetMapRequest>,
    ) -> Result<Response<v1::GetMapResponse>, Status> {
        let handler = async {
            let caller = Caller::of(&request)?;
            let info = self.map(&caller, &request.get_ref().map_id).await?.info().await?;
            let snapshot = Arc::clone(&info.snapshot);
            let of_hints = Arc::clone(&snapshot);
            let hints = Context::blocking(move || Ok(to_hints(&of_hints))).await?;
            let map = Some(v1::Map { hints, ..self.context.map_message(info).await? });
            let mut answer = v1::GetMapResponse { map, ..v1::GetMapResponse::default() };
            if request.get_ref().include_digests {
                let digests = move || Ok((snapshot.content_hash(), snapshot.keyframe_ids_digest()));
                let (state, ids) = Context::blocking(digests).await?;
                answer.state_hash = state.to_vec();
                answer.keyframe_ids_digest = ids.to_vec();
            }
            Ok(answer)
        };
        self.context.answer("GetMap", handler).await
    }

    async fn update_map(
        &self,
        request: Request<v1::UpdateMapRequest>,
    ) -> Result<Response<v1::UpdateMapResponse>, Status> {
        self.context.answer("UpdateMap", self.update(request)).await
    }

    async fn copy_map(
        &self,
        request: Request<v1::CopyMapRequest>,
    ) -> Result<Response<v1::CopyMapResponse>, Status> {
        self.context.answer("CopyMap", self.copy(request)).await
    }

    async fn list_maps(
        &self,
        request: Request<v1::ListMapsRequest>,
    ) -> Result<Response<v1::ListMapsResponse>, Status> {
        self.context.answer("ListMaps", self.list(request)).await
    }

    async fn delete_map(
        &self,
        request: Request<v1::DeleteMapRequest>,
    ) -> Result<Response<v1::DeleteMapResponse>, Status> {
        let handler = async {
            let caller = Caller::of(&request)?;
            let map_id = convert(|out| ids::map_id(&request.get_ref().map_id, out))?;
            let deleted = self.context.maps.delete(&caller.engine_name(&map_id)).await;
            let deleted = deleted.map_err(ServiceError::from);
            let peer = request.extensions().get().map(Peer::address);
            change("DeleteMap", &caller, peer, &map_id, &deleted);
            deleted.map(|()| v1::DeleteMapResponse {})
        };
        self.context.answer("DeleteMap", handler).await
    }

    async fn merge_maps(
        &self,
        request: Request<v1::MergeMapsRequest>,
    ) -> Result<Response<v1::MergeMapsResponse>, Status> {
        self.context.answer("MergeMaps", self.merge(request)).await
    }

    async fn undo_merge(
        &self,
        request: Request<v1::UndoMergeRequest>,
    ) -> Result<Response<v1::UndoMergeResponse>, Status> {
        self.context.answer("UndoMerge", self.undo(request)).await
    }

    type ExportMapStream = Answers<v1::ExportMapResponse>;

    async fn export_map(
        &self,
        request: Request<v1::ExportMapRequest>,
    ) -> Result<Response<Self::ExportMapStream>, Status> {
        let (rpcs, time) = (self.clone(), call_time(request.metadata()));
        let (caller, request) = (Caller::of(&request), request.into_inner());
        self.context.stream("ExportMap", time, Messages::Large, |sink| async move {
            let map = rpcs.map(&caller?, &request.map_id).await?;
            let choice = export::choice(&request)?;
            let _reservation = map.account().reserve(Resource::Exports, 1)?;
            let snapshot = map.snapshot().await?;
            let map_id = request.map_id.clone();
            let exported = Arc::clone(&snapshot);
            let started = move || export::Export::new(map_id, exported, choice);
            let mut export = Context::blocking(started).await?;
            if choice.format == export::Format::G2o {
                export = export.with_graph(rpcs.graph_lines(&map, snapshot).await?);
            }
            let header = v1::ExportMapHeader {
                map_id: request.map_id,
                revision: export.revision(),
                format: request.format,
                paths: export.paths(),
            };
            let content = Some(Content::Header(header));
            sink.send(v1::ExportMapResponse { content }).await?;
            loop {
                // A chunk is made when there is room for it.
                let room = sink.room().await?;
                let made = move || export.next_chunk().map(|chunk| (chunk, export));
                let (chunk, rest) = Context::blocking(made).await?;
                let Some(chunk) = chunk else { break };
                room.send(v1::ExportMapResponse { content: Some(Content::Chunk(chunk)) });
                export = rest;
            }
            Ok(())
        })
    }

    async fn import_map(
        &self,
        request: Request<Streaming<v1::ImportMapRequest>>,
    ) -> Result<Response<v1::ImportMapResponse>, Status> {
        let handler = async {
            let caller = Caller::of(&request)?;
            import::import(&self.context, &caller, request.into_inner()).await
        };
        self.context.answer("ImportMap", handler).await
    }

    type GetTrajectoryStream = Answers<v1::GetTrajectoryResponse>;

    async fn get_trajectory(
        &self,
        request: Request<v1::GetTrajectoryRequest>,
    ) -> Result<Response<Self::GetTrajectoryStream>, Status> {
        let (rpcs, time) = (self.clone(), call_time(request.metadata()));
        let (caller, request) = (Caller::of(&request), request.into_inner());
        self.context.stream("GetTrajectory", time, Messages::Large, |sink| async move {
            let wanted = match request.client_id.as_str() {
                "" => None,
                id => Some(convert(|out| ids::name(Path::root("client_id"), id, out))?),
            };
            let map = rpcs.map(&caller?, &request.map_id).await?;
            let _reservation = map.account().reserve(Resource::Lists, 1)?;
            let map = map.snapshot().await?;
            let client = match wanted {
                None => None,
                Some(client) => {
                    let map_id = request.map_id;
                    let found = map.client_named(&client);
                    Some(found.ok_or(ServiceError::ClientNotFound { map: map_id, client })?)
                }
            };
            listing::trajectory(&map, client, &sink).await
        })
    }

    type ListKeyframesStream = Answers<v1::ListKeyframesResponse>;

    async fn list_keyframes(
        &self,
        request: Request<v1::ListKeyframesRequest>,
    ) -> Result<Response<Self::ListKeyframesStream>, Status> {
        list!(self, request, "ListKeyframes", listing::keyframe_pages, listing::keyframes)
    }

    type ListLandmarksStream = Answers<v1::ListLandmarksResponse>;

    async fn list_landmarks(
        &self,
        request: Request<v1::ListLandmarksRequest>,
    ) -> Result<Response<Self::ListLandmarksStream>, Status> {
        list!(self, request, "ListLandmarks", listing::landmark_pages, listing::landmarks)
    }

    type ListConstraintsStream = Answers<v1::ListConstraintsResponse>;

    async fn list_constraints(
        &self,
        request: Request<v1::ListConstraintsRequest>,
    ) -> Result<Response<Self::ListConstraintsStream>, Status> {
        list!(self, request, "ListConstraints", listing::constraint_pages, listing::constraints)
    }

    type ListPlaceSearchesStream = Answers<v1::ListPlaceSearchesResponse>;

    async fn list_place_searches(
        &self,
        request: Request<v1::ListPlaceSearchesRequest>,
    ) -> Result<Response<Self::ListPlaceSearchesStream>, Status> {
        list!(
            self,
            request,
            "ListPlaceSearches",
            listing::place_search_pages,
            listing::place_searches
        )
    }

    type WatchMapStream = Answers<v1::WatchMapResponse>;

    async fn watch_map(
        &self,
        request: Request<v1::WatchMapRequest>,
    ) -> Result<Response<Self::WatchMapStream>, Status> {
        let (rpcs, time) = (self.clone(), call_time(request.metadata()));
        let (caller, request) = (Caller::of(&request), request.into_inner());
        self.context.stream("WatchMap", time, Messages::Large, |sink| async move {
            let caller = caller?;
            let map = rpcs.map(&caller, &request.map_id).await?;
            if let Some(revision) = request.from_revision.filter(|&revision| revision < 0) {
                let text = format!("{revision} is below 0");
                return Err(ServiceError::field("from_revision", Reason::OutOfRange, text));
            }
            let is_other = !request.map_uid.is_empty() && request.map_uid != map.uid();
            let wanted = WatcherOptions {
                from_revision: request.from_revision.filter(|_| !is_other),
                landmarks: !request.omit_landmarks,
                constraints: !request.omit_constraints,
                resolution: resolution(&request)?,
            };
            tokio::select! {
                biased;
                ended = watch::watch(&rpcs.context, &map, &wanted, &sink) => ended,
                reason = rpcs.context.access.withdrawn(&caller) => Err(reason),
            }
        })
    }
}

/// How far a watcher's values may be off.
fn resolution(request: &v1::WatchMapRequest) -> Result<Resolution, ServiceError> {
    Ok(convert(|out| {
        let mut read = |field, value| out.not_negative(Path::root(field), value);
        let position_m = read("position_resolution_m", request.position_resolution_m);
        let rotation_rad = read("rotation_resolution_rad", request.rotation_resolution_rad);
        Some(Resolution { position_m: position_m?, rotation_rad: rotation_rad? })
    })?)
}
