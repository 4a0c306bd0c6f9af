//! Maps that become one, and apart again.
//!
//! The order makes every step safe to be cut off. Merging: the source is frozen, the target journals the
//! whole content as one event, the source is deleted. Undoing: the source is made anew, frozen, the target
//! journals that it left, the source is opened. A server that stops in between finds at its start a frozen
//! map that is also part of another one, and deletes it: nothing was added to it since.
//!
//! The name of a merged map leads to the map that it became part of ([`MergedName`]), so that the robots
//! that write to it go on after they have connected again. Where the maps lie in each other is found by
//! [`align`], unless the caller knows.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::information::Information;
use covis_solvers::interrupt::Interrupt;
use covis_solvers::problem::SolveError;

use super::actor::Actor;
use super::error::report_bug;
use super::handle::{Condition, Control, Shared};
use super::maps::{Claim, run_to_end};
use super::opening::{Start, uid};
use super::pool::{Estimate, PoolError};
use super::{EngineError, MapHandle, MapInfo, MapUpdate, Maps, Resource, tenant_of};
use crate::loop_closing::{View, align};
use crate::map::{Change, ClientIndex, EntityId, Link, Map, MergedMap, ToSolve, Unsolved};
use crate::store::{Epoch, StoreError};

/// A request to merge one map into another.
#[derive(Clone, Debug, Default)]
pub struct MergeRequest {
    /// The map that takes the content.
    pub target: String,
    /// The map that becomes part of it.
    pub source: String,
    /// The pose of the source's world frame in the target's; `None` follows from the constraints, or
    /// without these from places that both maps show.
    pub target_from_source: Option<Se3>,
    /// Relative poses between keyframes of both.
    pub constraints: Vec<LinkRequest>,
    /// New names of the source's clients.
    pub renamed: BTreeMap<String, String>,
}

/// A relative pose between keyframes of two maps, each named by client and id.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkRequest {
    /// The keyframe in whose frame the pose was measured, of one of the maps.
    pub keyframe_i: (String, i64),
    /// The keyframe whose pose was measured, of the other one.
    pub keyframe_j: (String, i64),
    /// The measurement.
    pub keyframe_i_from_keyframe_j: Se3,
    /// Information of its error, translation first.
    pub information: Information<6>,
}

/// What became of a merge.
#[derive(Clone, Debug)]
pub struct MergeOutcome {
    /// The target after the merge.
    pub map: MapInfo,
    /// The pose of the source's world frame in the target's.
    pub target_from_source: Se3,
    /// Loop closures that tie both.
    pub closures: usize,
}

/// The name of a map that became part of another one, as a handle of the latter has it.
#[derive(Debug)]
pub(super) struct MergedName {
    /// The name.
    pub(super) name: String,
    /// The uid of the map that had it: its clients' items are all in the other map.
    pub(super) uid: String,
    /// Whether the map left the other one again.
    pub(super) is_over: AtomicBool,
}

impl MergedName {
    fn new(merged: &MergedMap) -> Arc<Self> {
        let uid = uid(&merged.name, merged.create_time_ns);
        Arc::new(Self { name: merged.name.clone(), uid, is_over: AtomicBool::new(false) })
    }
}

/// What an engine is to take into its map.
pub(super) struct Joining {
    name: String,
    source: Arc<Map>,
    target_from_source: Se3,
    renamed: BTreeMap<String, String>,
    links: Vec<Link>,
}

/// A map that has left another one: its content, and the epoch under which the store made it.
pub(super) struct Left {
    content: Arc<Map>,
    epoch: Epoch,
}

impl Maps {
    /// Merges one map into another. Calling it again after it was cut off finishes it, or tells what it
    /// did. Dropping the future does not stop a merge that has begun.
    ///
    /// # Errors
    /// [`EngineError::MapNotFound`], [`EngineError::NotAligned`], [`EngineError::CannotMerge`],
    /// [`EngineError::NoSuchKeyframe`], [`EngineError::Frozen`], [`EngineError::Poisoned`],
    /// [`EngineError::Ceiling`], [`EngineError::Store`], [`EngineError::ShuttingDown`]; both maps are then
    /// as they were.
    pub async fn merge(
        &self,
        request: MergeRequest,
        interrupt: Interrupt,
    ) -> Result<MergeOutcome, EngineError> {
        let (source, target) = (self.get(&request.source)?, self.get(&request.target)?);
        if source.is_same_map(&target) {
            return self.merged_already(&request.source, &source).await;
        }
        let (pose, links) = self.aligned(&request, &source, &target, interrupt).await?;
        let maps = self.clone();
        run_to_end(async move { maps.merge_aligned(request, pose, links).await }).await
    }

    /// What an earlier call did.
    async fn merged_already(
        &self,
        name: &str,
        handle: &MapHandle,
    ) -> Result<MergeOutcome, EngineError> {
        let map = handle.info().await?;
        let merged = map.snapshot.merged().iter().find(|merged| merged.name == name);
        let Some(target_from_source) = merged.map(|merged| merged.target_from_source) else {
            let (map, into) = (name.to_owned(), handle.name().to_owned());
            return Err(EngineError::MergedAway { map, into });
        };
        handle.durable(map.snapshot.revision()).await?;
        Ok(MergeOutcome { map, target_from_source, closures: 0 })
    }

    /// Where the source lies in the target, and what ties them.
    async fn aligned(
        &self,
        request: &MergeRequest,
        source: &MapHandle,
        target: &MapHandle,
        interrupt: Interrupt,
    ) -> Result<(Se3, Vec<Link>), EngineError> {
        let (of_source, of_target) = (source.snapshot().await?, target.snapshot().await?);
        let link = |request: &LinkRequest| request.link(&of_target, &of_source);
        let links: Vec<Link> = request.constraints.iter().map(link).collect::<Result<_, _>>()?;
        let by_link = links.first().and_then(|link| {
            let at = of_target.keyframes().get(&link.target)?.world_from_camera;
            let seen = of_source.keyframes().get(&link.source)?.world_from_camera;
            Some(at.compose(&link.target_from_source).compose(&seen.inverse()))
        });
        if let Some(pose) = request.target_from_source.or(by_link) {
            return Ok((pose, links));
        }
        if !of_target.policy().place_recognition {
            return Err(EngineError::NoPlaceRecognition { map: target.name().to_owned() });
        }
        let asked = Arc::new((Arc::clone(&target.shared.places), of_source, of_target, interrupt));
        loop {
            let asked = Arc::clone(&asked);
            let work = move || {
                let (places, of_source, of_target, interrupt) = &*asked;
                // An index that lacks much, as after a restart, is made in several turns of the pool.
                if !places.advance(of_target, interrupt) {
                    return None;
                }
                let candidates =
                    |view: &View<'_>| places.candidates(of_target, view, interrupt, |_| false);
                let aligned = align(of_target, of_source, candidates, interrupt);
                Some((!interrupt.is_due()).then_some(aligned))
            };
            return match self.inner.pool.run(&target.shared.account, Estimate::LONG, work).await {
                Ok(None) => continue,
                Ok(Some(None)) => Err(EngineError::Solve(SolveError::Interrupted)),
                Ok(Some(Some(Ok(alignment)))) => {
                    Ok((alignment.target_from_source, alignment.links))
                }
                Ok(Some(Some(Err(error)))) => {
                    Err(EngineError::NotAligned { map: source.name().to_owned(), error })
                }
                Err(PoolError::Full(error)) => Err(error),
                Err(PoolError::Panicked(panicked)) => Err(report_bug(&panicked.message)),
            };
        }
    }

    async fn merge_aligned(
        &self,
        request: MergeRequest,
        target_from_source: Se3,
        links: Vec<Link>,
    ) -> Result<MergeOutcome, EngineError> {
        let MergeRequest { source: name, target: into, renamed, .. } = request;
        // In the order of the names, so that two merges never wait for each other.
        let (mut source, target) = if name < into {
            let source = self.claim(&name).await?;
            (source, self.claim(&into).await?)
        } else {
            let target = self.claim(&into).await?;
            (self.claim(&name).await?, target)
        };
        let from = found(&source, &name)?;
        let to = found(&target, &into)?;
        if from.is_same_map(&to) {
            return self.merged_already(&name, &from).await;
        }
        if let Some(merged) = &from.merged {
            let (map, into) = (merged.name.clone(), from.name().to_owned());
            return Err(EngineError::MergedAway { map, into });
        }
        let was_frozen = from.snapshot().await?.is_frozen();
        let left = from.call(|reply| Control::Leave { reply }).await??;
        from.durable(left.snapshot.revision()).await?;
        let count = links.len();
        let joining = Joining {
            name: name.clone(),
            source: left.snapshot,
            target_from_source,
            renamed,
            links,
        };
        let joined = to.call(|reply| Control::Join { joining: Box::new(joining), reply }).await;
        let map = match joined.and_then(|joined| joined) {
            Ok(map) => map,
            Err(error) => {
                let update = MapUpdate { frozen: Some(was_frozen), ..MapUpdate::default() };
                if let Err(reopening) = from.update(update).await {
                    tracing::error!(map = name, %reopening, "a map that was to be merged stays frozen");
                }
                return Err(error);
            }
        };
        to.durable(map.snapshot.revision()).await?;
        from.shared.ended.get_or_init(|| EngineError::Moving { map: name.clone() });
        from.call(|reply| Control::Delete { reply }).await??;
        source.set(map.snapshot.merged().last().map(|merged| to.called(merged)));
        // Names that led to the source lead to the target.
        self.inner.table.redirect(&from, &to);
        tracing::info!(map = name, into, "map merged");
        Ok(MergeOutcome { map, target_from_source, closures: count })
    }

    /// Takes a map out of the one that it was merged into. Answers both, the latter first. Dropping the
    /// future does not stop it.
    ///
    /// # Errors
    /// [`EngineError::MapNotFound`], [`EngineError::NotMerged`], [`EngineError::Frozen`],
    /// [`EngineError::Poisoned`], [`EngineError::Store`], [`EngineError::TenantCeiling`],
    /// [`EngineError::ServerCeiling`], [`EngineError::ShuttingDown`].
    pub async fn undo_merge(
        &self,
        target: &str,
        source: &str,
    ) -> Result<(MapInfo, MapInfo), EngineError> {
        let (maps, target, source) = (self.clone(), target.to_owned(), source.to_owned());
        run_to_end(async move { maps.take_out(target, source).await }).await
    }

    async fn take_out(
        &self,
        into: String,
        name: String,
    ) -> Result<(MapInfo, MapInfo), EngineError> {
        let not_merged = || EngineError::NotMerged { map: into.clone(), source_map: name.clone() };
        let source = self.claim(&name).await?;
        let to = self.get(&into)?;
        let merged = match source.map().cloned() {
            Some(handle) if handle.is_same_map(&to) => handle.merged,
            Some(_) | None => None,
        };
        let Some(merged) = merged else { return Err(not_merged()) };
        let tenant = self.inner.pool.accounts().tenant(tenant_of(&name));
        let place = tenant.reserve(Resource::Maps, 1)?;
        // Its watchers connect again, to the map of its own.
        merged.is_over.store(true, Ordering::Release);
        let left = to.call(|reply| Control::TakeOut { name: name.clone(), reply }).await;
        let Left { content, epoch } = match left.and_then(|left| left) {
            Ok(left) => left,
            Err(error) => {
                merged.is_over.store(false, Ordering::Release);
                return Err(error);
            }
        };
        let map = to.info().await?;
        to.durable(map.snapshot.revision()).await?;
        let inner: Vec<MergedMap> = content.merged().to_vec();
        let start = Start {
            flushed: self.inner.store.follow(&name).await?,
            name: name.clone(),
            epoch,
            snapshot: content.revision(),
            map: Arc::unwrap_or_clone(content),
            condition: Condition::Open,
            unopened: None,
        };
        self.start_created(source, start, place).await?;
        let from = self.get(&name)?;
        let update = MapUpdate { frozen: Some(false), ..MapUpdate::default() };
        let opened = from.update(update).await?;
        for merged in &inner {
            self.lead(&from, merged).await?;
        }
        tracing::info!(map = name, from = into, "a merge was undone");
        Ok((map, opened))
    }

    /// Makes the names of the maps that became part of this one lead to it. What a merge that was cut off
    /// has left of them is deleted.
    pub(super) async fn lead_merged(&self, handle: &MapHandle) {
        let Ok(info) = handle.info().await else { return };
        for merged in info.snapshot.merged() {
            if let Err(error) = self.lead(handle, merged).await {
                let map = &merged.name;
                tracing::error!(%error, map, into = handle.name(), "a merged map is not found by its name");
            }
        }
    }

    async fn lead(&self, handle: &MapHandle, merged: &MergedMap) -> Result<(), EngineError> {
        let mut claim = self.claim(&merged.name).await?;
        if let Some(other) = claim.map().cloned() {
            let info = other.info().await?;
            let is_rest = other.merged.is_none()
                && info.snapshot.is_frozen()
                && info.snapshot.create_time_ns() == merged.create_time_ns;
            if !is_rest && other.merged.is_none() {
                return Err(EngineError::MapExists { map: merged.name.clone() });
            }
            if is_rest {
                tracing::warn!(map = merged.name, "what is left of a merged map is deleted");
                other.call(|reply| Control::Delete { reply }).await??;
            }
        }
        claim.set(Some(handle.called(merged)));
        Ok(())
    }
}

/// The map of a claim.
fn found(claim: &Claim, name: &str) -> Result<MapHandle, EngineError> {
    let found = claim.map().cloned();
    found.ok_or_else(|| EngineError::MapNotFound { map: name.to_owned() })
}

impl MapHandle {
    /// Whether both are handles of one map, by whatever name.
    pub(super) fn is_same_map(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.shared, &other.shared)
    }

    /// A handle of the map under the name of one that became part of it.
    fn called(&self, merged: &MergedMap) -> Self {
        Self { merged: Some(MergedName::new(merged)), ..self.clone() }
    }

    /// Refuses a handle by a name that leads to another map by now.
    pub(super) fn check_name(&self) -> Result<(), EngineError> {
        match &self.merged {
            Some(merged) if merged.is_over.load(Ordering::Acquire) => {
                Err(EngineError::Moving { map: merged.name.clone() })
            }
            Some(_) | None => Ok(()),
        }
    }

    /// The same name for another map.
    pub(super) fn redirected(&self, to: &Self) -> Self {
        Self { merged: self.merged.clone(), ..to.clone() }
    }
}

impl LinkRequest {
    /// # Errors
    /// [`EngineError::NoSuchKeyframe`].
    fn link(&self, target: &Map, source: &Map) -> Result<Link, EngineError> {
        let in_map = |map: &Map, (client, id): &(String, i64)| {
            let id = EntityId::new(map.client_named(client)?, *id);
            map.keyframes().contains_key(&id).then_some(id)
        };
        let i_from_j = self.keyframe_i_from_keyframe_j;
        let pair =
            |i: &Map, j: &Map| Some((in_map(i, &self.keyframe_i)?, in_map(j, &self.keyframe_j)?));
        if let Some((i, j)) = pair(target, source) {
            let information = self.information;
            return Ok(Link { target: i, source: j, target_from_source: i_from_j, information });
        }
        let Some((i, j)) = pair(source, target) else {
            let (keyframe_i, keyframe_j) = (self.keyframe_i.clone(), self.keyframe_j.clone());
            return Err(EngineError::NoSuchKeyframe { keyframe_i, keyframe_j });
        };
        // The error of the inverse is the same one seen from the other end: r' = -Ad(Z) r.
        let adjoint = i_from_j.inverse().adjoint();
        let product = adjoint.transpose() * self.information.matrix() * adjoint;
        let symmetric = (product + product.transpose()) / 2.0;
        let information = Information::semidefinite(&symmetric).unwrap_or(self.information);
        Ok(Link { target: j, source: i, target_from_source: i_from_j.inverse(), information })
    }
}

impl Shared {
    /// Why a map takes nothing that was frozen to be moved, or by request.
    pub(super) fn frozen_error(&self) -> EngineError {
        let map = self.name.clone();
        match self.moving.load(Ordering::Relaxed) {
            true => EngineError::Moving { map },
            false => EngineError::Frozen { map },
        }
    }
}

impl Actor {
    /// The name in this map of a client that found it by the name of a map that became part of it.
    pub(super) fn named_here(&self, client: String, merged: Option<&MergedName>) -> String {
        let merged = merged.and_then(|name| self.map.merged().iter().find(|m| m.name == name.name));
        let known = merged.and_then(|merged| merged.clients.iter().find(|c| c.name == client));
        let known = known.and_then(|known| self.map.client(known.index));
        known.map_or(client, |known| known.name.clone())
    }

    /// Freezes the map and ends its streams: what it holds now is what the other map takes.
    pub(super) async fn leave(&mut self) -> Result<MapInfo, EngineError> {
        self.check_changeable()?;
        self.shared.moving.store(true, Ordering::Relaxed);
        let update = MapUpdate { frozen: Some(true), ..MapUpdate::default() };
        let frozen = self.update(update).await;
        if frozen.is_err() {
            self.shared.moving.store(false, Ordering::Relaxed);
        }
        frozen
    }

    /// Takes the content of another map.
    pub(super) async fn join(&mut self, joining: Joining) -> Result<MapInfo, EngineError> {
        self.check_open()?;
        let Joining { name, source, target_from_source, renamed, mut links } = joining;
        let map = name.clone();
        let merge = self.compute(move |map| {
            links.retain(|link| {
                let held = |map: &Map, id| map.keyframes().contains_key(&id);
                held(map, link.target) && held(&source, link.source)
            });
            map.merge_of((&name, &source), target_from_source, &renamed, &links)
        });
        let merge = merge.await.map_err(|error| EngineError::CannotMerge { map, error })?;
        let account = &self.shared.account;
        let ceilings = self.map.policy().ceilings.lower(&account.limits().held);
        if let Some(exceeded) = ceilings.exceeded(self.map.usage(), merge.content.usage()) {
            return Err(account.exceeded(exceeded));
        }
        let clients: Vec<ClientIndex> = merge.clients.iter().map(|client| client.index).collect();
        self.commit(None, Change::MapMerged { merge: Box::new(merge) }).await?;
        for (client, unsolved) in self.map.unsolved() {
            if client == ClientIndex::SERVER || clients.contains(&client) {
                self.trigger(client, unsolved).await;
            }
        }
        Ok(self.info())
    }

    /// Makes a map of what came with a merge, and lets go of it.
    pub(super) async fn take_out(&mut self, name: String) -> Result<Left, EngineError> {
        self.check_open()?;
        let wanted = name.clone();
        let content = self.compute(move |map| map.taken_out(&wanted)).await;
        let content = content.map_err(|error| report_bug(&error.to_string()))?;
        let Some(content) = content.map(Arc::new) else {
            let map = self.shared.name.clone();
            return Err(EngineError::NotMerged { map, source_map: name });
        };
        let merged = self.map.merged().iter().find(|merged| merged.name == name);
        let clients: Vec<ClientIndex> =
            merged.into_iter().flat_map(|merged| &merged.clients).map(|c| c.index).collect();
        let store = Arc::clone(&self.shared.store);
        let epoch = match store.create_map_of(&name, Arc::clone(&content)).await {
            // No engine owns it: a failed creation left it and could not be undone.
            Err(StoreError::MapExists { .. }) => {
                store.delete_map(&name).await?;
                store.create_map_of(&name, Arc::clone(&content)).await?
            }
            epoch => epoch?,
        };
        let moving = EngineError::Moving { map: name.clone() };
        clients.into_iter().for_each(|client| self.ingest.end(client, moving.clone()));
        if let Err(error) = self.commit(None, Change::MapTakenOut { name: name.clone() }).await {
            if let Err(left) = store.delete_map(&name).await {
                tracing::error!(map = name, %left, "a map that was not taken out is left in the store");
            }
            return Err(error);
        }
        let unsolved = Unsolved { sequence: self.map.revision(), to_solve: ToSolve::Loop };
        self.trigger(ClientIndex::SERVER, unsolved).await;
        Ok(Left { content, epoch })
    }
}
