//! Maps that become one, and apart again.
//!
//! The order makes every step safe to be cut off. Merging: the source takes nothing more, the target
//! journals the whole content as one event, and once no crash can undo that the source is deleted.
//! Undoing: the source is made anew, the target journals that it left, the source is opened. A server that
//! stops in between finds at its start a map that is also part of another one. It is deleted if the other
//! one has every item of it, and stays otherwise. That it takes nothing is not journaled: a source whose
//! merge was cut off before the target's event is a map as before.
//!
//! The name of a merged map leads to the map that it became part of ([`MergedName`]), so that the robots
//! that write to it continue after they have connected again. Where the maps lie in each other is found by
//! [`align`], unless the caller knows.

use std::collections::BTreeMap;
use std::future::ready;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use covis_solvers::geometry::{LieGroup, Se3, Sim3};
use covis_solvers::information::Information;
use covis_solvers::interrupt::Interrupt;
use covis_solvers::problem::SolveError;
use futures_util::FutureExt;

use crate::loop_closing::{QueryView, align};
use crate::map::{EntityId, Link, Map, MergeError, MergedMap};
use crate::service::engine::actor::merging::{SeparatedMap, check_room};
use crate::service::engine::error::report_bug;
use crate::service::engine::maps::opening::Start;
use crate::service::engine::maps::{Claim, run_to_end};
use crate::service::engine::merged_name::MergedName;
use crate::service::engine::pool::{Estimate, PoolError};
use crate::service::engine::{EngineError, MapHandle, MapInfo, Maps, Resource};

/// A request to merge one map into another.
#[derive(Clone, Debug)]
pub struct MergeRequest {
    /// The map that takes the content.
    pub target: String,
    /// The map that becomes part of it.
    pub source: String,
    /// The pose of the source's world frame in the target's; `None` follows from the constraints, or
    /// without these from places that both maps show.
    pub target_from_source: Option<Se3>,
    /// Length in the target of the source's unit of length, where `target_from_source` or constraints
    /// say where it lies.
    pub scale: f64,
    /// Relative poses between keyframes of both, in the target's unit.
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
    /// The measurement, in the target's unit.
    pub keyframe_i_from_keyframe_j: Se3,
    /// Information of its error, translation first.
    pub information: Information<6>,
}

/// What became of a merge.
#[derive(Clone, Debug)]
pub struct MergeOutcome {
    /// The target after the merge.
    pub map: MapInfo,
    /// The pose of the source's world frame in the target's, and the length there of its unit.
    pub target_from_source: Sim3,
    /// Loop closures that tie both.
    pub closures: usize,
}

impl Default for MergeRequest {
    fn default() -> Self {
        Self {
            target: String::new(),
            source: String::new(),
            target_from_source: None,
            scale: 1.0,
            constraints: Vec::new(),
            renamed: BTreeMap::new(),
        }
    }
}

impl Maps {
    /// Merges one map into another. Calling it again after it was cut off finishes it, or tells what it
    /// did. Dropping the future does not stop a merge that has begun.
    ///
    /// # Errors
    /// [`EngineError::MapNotFound`], [`EngineError::NotAligned`], [`EngineError::CannotMerge`],
    /// [`EngineError::NoSuchKeyframe`], [`EngineError::Frozen`], [`EngineError::Poisoned`],
    /// [`EngineError::MapLimit`], [`EngineError::ShuttingDown`]; both maps are then as they were.
    /// [`EngineError::Store`]; where the target has the content already, the source takes nothing until a
    /// further call or a restart has deleted it.
    pub async fn merge(
        &self,
        request: MergeRequest,
        interrupt: Interrupt,
    ) -> Result<MergeOutcome, EngineError> {
        let source = self.find(&request.source).await?;
        let target = self.find(&request.target).await?;
        if source.is_same_map(&target) {
            return self.merged_already(&request, &source).await;
        }
        let is_part = target.snapshot().await?.merged_as(&request.source).is_some();
        let aligned = match is_part {
            true => None,
            false => Some(self.aligned(&request, &source, &target, interrupt).await?),
        };
        // The other one may have been found by the name of a map that became part of it.
        let request = MergeRequest { target: target.name().to_owned(), ..request };
        let maps = self.clone();
        run_to_end(async move { maps.merge_aligned(request, aligned).await }).await
    }

    /// What an earlier call did: the names of the request lead to one map, `handle`.
    async fn merged_already(
        &self,
        request: &MergeRequest,
        handle: &MapHandle,
    ) -> Result<MergeOutcome, EngineError> {
        let map = handle.info().await?;
        let merged = map.snapshot.merged_as(&request.source);
        let Some(target_from_source) = merged.map(|merged| merged.target_from_source) else {
            // It was merged the other way.
            let (map, into) = (request.target.clone(), handle.name().to_owned());
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
    ) -> Result<(Sim3, Vec<Link>), EngineError> {
        let (of_source, of_target) = (source.snapshot().await?, target.snapshot().await?);
        let cannot = |error| EngineError::CannotMerge { map: request.source.clone(), error };
        let link = |request: &LinkRequest| request.link(&of_target, &of_source, cannot);
        let links: Vec<Link> = request.constraints.iter().map(link).collect::<Result<_, _>>()?;
        // The engine asks all of this again: here no stream has ended yet.
        if of_target.is_frozen() {
            return Err(EngineError::Frozen { map: target.name().to_owned() });
        }
        of_target.joining(&of_source, &request.renamed).map_err(cannot)?;
        check_room(&target.shared.account, &of_target, of_source.usage())?;
        let by_link = links.first().and_then(|link| {
            let at = of_target.keyframes().get(&link.target)?.world_from_camera;
            let seen = of_source.keyframes().get(&link.source)?.world_from_camera;
            let seen = Se3::new(seen.rotation, seen.translation * request.scale);
            Some(at.compose(&link.target_from_source).compose(&seen.inverse()))
        });
        if let Some(pose) = request.target_from_source.or(by_link) {
            return Ok((Sim3 { scale: request.scale, ..pose.into() }, links));
        }
        if !of_target.policy().place_recognition {
            return Err(EngineError::NoPlaceRecognition { map: target.name().to_owned() });
        }
        let (name, places) = (request.source.clone(), Arc::clone(&target.shared.places));
        let asked = Arc::new((name, places, of_source, of_target, interrupt));
        loop {
            let asked = Arc::clone(&asked);
            let work = move || {
                let (map, places, of_source, of_target, interrupt) = &*asked;
                // An index that lacks much, as after a restart, is made in several turns of the pool.
                if !places.advance(of_target, interrupt) {
                    return None;
                }
                // What was measured is looked for here: without depth every observation is gone through.
                if of_source.has_metric_scale() && !of_target.has_metric_scale() {
                    let (map, error) = (map.clone(), MergeError::OnlySourceIsMetric);
                    return Some(Err(EngineError::CannotMerge { map, error }));
                }
                let candidates = |view: &QueryView<'_>| {
                    places.candidates(of_target, view, interrupt, &|_| false)
                };
                let aligned = align(of_target, of_source, candidates, interrupt);
                Some(match aligned {
                    _ if interrupt.is_due() => Err(EngineError::Solve(SolveError::Interrupted)),
                    Ok(alignment) => Ok((alignment.target_from_source, alignment.links)),
                    Err(error) => Err(EngineError::NotAligned { map: map.clone(), error }),
                })
            };
            return match self.inner.pool.run(&target.shared.account, Estimate::LONG, work).await {
                Ok(None) => continue,
                Ok(Some(aligned)) => aligned,
                Err(PoolError::Full(error)) => Err(error),
                Err(PoolError::Panicked(panicked)) => Err(report_bug(&panicked.message)),
            };
        }
    }

    /// Merges under claims of both names. `aligned` says where the source lies, and what ties it; it is
    /// `None` where the target had the source already.
    async fn merge_aligned(
        &self,
        request: MergeRequest,
        aligned: Option<(Sim3, Vec<Link>)>,
    ) -> Result<MergeOutcome, EngineError> {
        let (name, into) = (request.source.clone(), request.target.clone());
        let (mut source, target) = self.claim_both(&name, &into).await?;
        let (from, to) = (found(&source, &name)?, found(&target, &into)?);
        if from.is_same_map(&to) {
            return self.merged_already(&request, &from).await;
        }
        if from.merged.is_some() {
            let (map, into) = (name, from.name().to_owned());
            return Err(EngineError::MergedAway { map, into });
        }
        if to.merged.is_some() {
            return Err(EngineError::Moving { map: into });
        }
        let was_held = from.is_held();
        let (map, closures) = match joined(&from, &to, request, aligned).await {
            Ok(joined) => joined,
            Err(error) => {
                // What an earlier call has begun is not for this one to take back.
                if !was_held {
                    from.release().await;
                }
                return Err(error);
            }
        };
        // From here on the source is a copy: it takes nothing more, whatever fails.
        to.durable(map.snapshot.revision()).await?;
        // Its files go once those of the target were read back with what it brought.
        let kept = Arc::clone(&map.snapshot);
        to.call(move |actor| ready(actor.journal.snapshot_of(kept)).boxed()).await?.await?;
        from.call(|actor| actor.delete().boxed()).await??;
        let Some(merged) = map.snapshot.merged_as(&name) else {
            return Err(report_bug("a map that was merged is not in the target"));
        };
        source.set(Some(to.called(merged)));
        // Names that led to the source lead to the target.
        self.inner.table.redirect(&from, &to);
        tracing::info!(map = name, into, "map merged");
        let target_from_source = merged.target_from_source;
        Ok(MergeOutcome { map, target_from_source, closures })
    }

    /// Claims two names, always in the same order, so that two changes never wait for each other.
    async fn claim_both(&self, a: &str, b: &str) -> Result<(Claim, Claim), EngineError> {
        if a == b {
            return Err(EngineError::Moving { map: a.to_owned() });
        }
        if a < b {
            let first = self.claim(a).await?;
            return Ok((first, self.claim(b).await?));
        }
        let first = self.claim(b).await?;
        Ok((self.claim(a).await?, first))
    }

    /// Takes a map out of the one that it was merged into. Answers both, the latter first. Dropping the
    /// future does not stop it.
    ///
    /// # Errors
    /// [`EngineError::MapNotFound`], [`EngineError::NotMerged`], [`EngineError::Frozen`],
    /// [`EngineError::Poisoned`], [`EngineError::Store`], [`EngineError::TenantLimit`],
    /// [`EngineError::ServerLimit`], [`EngineError::ShuttingDown`].
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
        // It may have been found by the name of a map that became part of it.
        let target = self.find(&into).await?.name().to_owned();
        if target == name {
            return Err(not_merged());
        }
        let (mut source, claim) = self.claim_both(&name, &target).await?;
        let to = found(&claim, &target)?;
        let is_part = |found: &MapHandle| found.merged.is_some() && found.is_same_map(&to);
        if to.merged.is_some() {
            return Err(EngineError::Moving { map: into });
        }
        if !source.map().is_some_and(is_part) {
            return Err(not_merged());
        }
        let reservation = self.tenant(&name).reserve(Resource::Maps, 1)?;
        let taken = name.clone();
        let left = to.call(|actor| actor.take_out(taken).boxed()).await??;
        let SeparatedMap { map, content, epoch, flushed } = left;
        // A full disk delays it only: the content has no other map any more.
        let durable = to.durable_at_last(map.snapshot.revision()).await;
        let (revision, content) = (content.revision(), Arc::unwrap_or_clone(content));
        let start = Start::open(name.clone(), epoch, content, revision, flushed);
        let from = self.spawn(start, reservation);
        source.set(Some(from.clone()));
        drop((source, claim));
        self.lead_merged(&from).await;
        durable?;
        tracing::info!(map = name, from = into, "a merge was undone");
        Ok((map, from.info().await?))
    }

    /// Makes the names of the maps that became part of this one lead to it. What a merge that was cut off
    /// has left of them is deleted.
    pub(crate) async fn lead_merged(&self, handle: &MapHandle) {
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
        if let Some(rest) = claim.map().filter(|other| other.merged.is_none()).cloned() {
            // A damaged map is no reason to delete another one.
            handle.shared.check_open()?;
            let (left, kept) = (rest.hold().await?, handle.snapshot().await?);
            if !left.is_within(&kept, merged) {
                rest.release().await;
                return Err(EngineError::MapExists { map: merged.name.clone() });
            }
            handle.durable(kept.revision()).await?;
            tracing::warn!(map = merged.name, "the remains of a merged map are deleted");
            rest.call(|actor| actor.delete().boxed()).await??;
        }
        claim.set(Some(handle.called(merged)));
        Ok(())
    }

    /// Releases the maps that were to be deleted because `deleted` had their content.
    pub(crate) async fn release_merged(&self, deleted: &Map) {
        for merged in deleted.merged() {
            let Ok(claim) = self.claim(&merged.name).await else { return };
            if let Some(rest) = claim.map().filter(|rest| rest.merged.is_none()) {
                rest.release().await;
            }
        }
    }
}

/// Lets the target take what the source holds, unless an earlier call did. Answers the target, and how
/// many closures tie both. The source takes nothing more from here on.
async fn joined(
    from: &MapHandle,
    to: &MapHandle,
    request: MergeRequest,
    aligned: Option<(Sim3, Vec<Link>)>,
) -> Result<(MapInfo, usize), EngineError> {
    let MergeRequest { source: name, renamed, .. } = request;
    let source = from.hold().await?;
    let there = to.info().await?;
    if let Some(merged) = there.snapshot.merged_as(&name) {
        return match source.is_within(&there.snapshot, merged) {
            true => Ok((there, 0)),
            false => Err(EngineError::MapExists { map: name }),
        };
    }
    let Some((target_from_source, links)) = aligned else {
        // It was taken out meanwhile.
        return Err(EngineError::Moving { map: name });
    };
    from.durable(source.revision()).await?;
    let count = links.len();
    let join =
        to.call(move |actor| actor.join(name, source, target_from_source, renamed, links).boxed());
    Ok((join.await??, count))
}

/// The map of a claim.
fn found(claim: &Claim, name: &str) -> Result<MapHandle, EngineError> {
    let found = claim.map().cloned();
    found.ok_or_else(|| EngineError::MapNotFound { map: name.to_owned() })
}

impl MapHandle {
    /// Whether both are handles of one map, by whatever name.
    pub(crate) fn is_same_map(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.shared, &other.shared)
    }

    /// A handle of the map under the name of one that became part of it.
    fn called(&self, merged: &MergedMap) -> Self {
        Self { merged: Some(MergedName::new(merged)), ..self.clone() }
    }

    /// The map as it is, which from now on takes nothing until [`MapHandle::release`].
    async fn hold(&self) -> Result<Arc<Map>, EngineError> {
        Ok(self.call(|actor| ready(actor.hold()).boxed()).await??.snapshot)
    }

    /// Whether the map takes nothing because another one is to take its content, or has.
    fn is_held(&self) -> bool {
        self.shared.moving.load(Ordering::Relaxed)
    }

    /// The map takes changes again.
    async fn release(&self) {
        self.shared.moving.store(false, Ordering::Relaxed);
        // The engine wakes and starts the solves that have waited.
        let _ended = self.info().await;
    }

    /// The same name for another map.
    pub(crate) fn redirected(&self, to: &Self) -> Self {
        Self { merged: self.merged.clone(), ..to.clone() }
    }
}

impl LinkRequest {
    /// # Errors
    /// [`EngineError::NoSuchKeyframe`]; what `cannot` makes of numbers that overflow.
    fn link(
        &self,
        target: &Map,
        source: &Map,
        cannot: impl Fn(MergeError) -> EngineError,
    ) -> Result<Link, EngineError> {
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
        Link::from_source(j, i, &i_from_j, &self.information).map_err(cannot)
    }
}
