//! The parts of the edge that the fuzz targets run: items of a stream, requests with problems, the
//! files of tokens and certificates.
//!
//! Built for tests and with the feature `fuzzing` only. Each function accepts any bytes and panics
//! if a guarantee is broken: what passes a check fits the map, an event keeps its bits on disk, and
//! its replay leads to the same state. A refusal is not a finding.

use std::collections::BTreeSet;
use std::path::Path;

use covis_solvers::interrupt::Interrupt;
use prost::Message as _;

use super::access::ParsedTokens;
pub use super::access::fuzzing::jwt;
use super::convert::item::{digest, item};
use super::convert::map::{ServerLimits, display_name, policy};
use super::convert::{convert, copy, ids};
use super::engine::EngineConfig;
use super::optimization_service::SolveBudget;
use super::{bundle_solve, graph_solve, listing, optimization_service, refine, tls};
use crate::map::{
    Cause, Change, ClientIndex, EntityId, Event, Map, MapLimits, Recall, choose_window,
    local_problem, triangulate,
};
use crate::store::fuzzing::{MOST_EVENTS, journey, map_journey};
use crate::wire::{check, densest, v1};
use v1::solve_pose_graph_request::Graph;

/// The client whose stream it is; another one is in the map.
const SENDER: &str = "robot";
/// Threads of the pool that the requests are for.
const THREADS: usize = 2;
/// Iterations, and the largest problem, that one input is worth.
const MOST_ITERATIONS: i32 = 3;
const MOST_POSES: usize = 16;
const MOST_FACTORS: usize = 96;

/// A map and the events that led to it, as the engine makes them.
struct Engine {
    map: Map,
    journal: Vec<Event>,
}

impl Engine {
    fn new() -> Self {
        let mut engine = Self { map: Map::new(), journal: Vec::new() };
        let policy = crate::map::MapPolicy::default();
        let display_name = "fuzzed".to_owned();
        engine.commit(None, Change::Created { policy, create_time_ns: 1, display_name });
        for name in [SENDER, "other"] {
            engine.commit(None, Change::ClientOpened { name: name.to_owned(), epoch: 1 });
        }
        engine
    }

    /// A checked change must apply, and must be read back from the journal unchanged.
    fn commit(&mut self, cause: Option<Cause>, change: Change) {
        let revision = self.map.revision() + 1;
        let event = journey(&Event { revision, time_ns: revision, cause, change });
        if let Err(error) = self.map.apply(&event) {
            panic!("a checked change does not fit: {error}: {event:?}");
        }
        self.journal.push(event);
    }

    /// Handles one item as the engine does; its events are in the journal.
    fn take(&mut self, sequence: i64, sent: v1::ingest_request::Item) {
        let client = ClientIndex(0);
        let (digest, item) = (digest(&sent), item(sent, SENDER));
        let Ok(item) = item else { return };
        if self.map.recall(client, sequence, &digest) != Recall::New
            || self.map.holds(client, &item)
        {
            return;
        }
        let Ok(change) = self.map.check(client, &item) else { return };
        drop(item);
        let views = if let Change::KeyframeAdded { id, .. } = &change {
            Some(*id)
        } else if let Change::ObservationsAdded { keyframe, .. } = &change {
            Some(*keyframe)
        } else {
            None
        };
        self.commit(Some(Cause { client, epoch: 1, sequence, digest }), change);
        if let Some(keyframe) = views {
            self.look(keyframe);
        }
    }

    /// What follows the views of a keyframe: triangulation and the problem of a local solve.
    fn look(&mut self, keyframe: EntityId) {
        let positions = triangulate(&self.map, keyframe);
        if !positions.is_empty() {
            self.commit(None, Change::LandmarksTriangulated { positions });
        }
        let problem =
            local_problem(&self.map, &choose_window(&self.map, &[keyframe], &BTreeSet::new()));
        if problem.is_solvable() {
            // A solver's refusal leaves the map as it is.
            let _refused = problem.problem.validate();
        }
    }
}

/// A stream: messages of `IngestRequest`, each after its length. The event of each accepted item is
/// encoded and read back; at the end the replay and a snapshot lead to the same state.
pub fn wire_item(mut input: &[u8]) {
    let mut engine = Engine::new();
    let mut sequence = 0;
    while !input.is_empty() && engine.journal.len() < MOST_EVENTS {
        let Ok(length) = prost::decode_length_delimiter(&mut input) else { break };
        let Some((message, rest)) = input.split_at_checked(length) else { break };
        input = rest;
        let Some(request) = decoded::<v1::IngestRequest>(message) else { continue };
        let next = request.sequence.max(sequence + 1);
        if let Some(item) = request.item {
            engine.take(next, item);
        }
        if next == i64::MAX {
            break;
        }
        sequence = next;
    }
    match Map::replay(engine.journal.iter()) {
        Ok(map) => assert_eq!(map.state_hash(), engine.map.state_hash()),
        Err(error) => panic!("the journal does not replay: {error}"),
    }
    map_journey(&engine.map);
}

/// A request after one byte that selects its type: the messages with problems, policies or names.
/// Small problems are solved for a few iterations.
pub fn wire_requests(input: &[u8]) {
    let Some((&kind, bytes)) = input.split_first() else { return };
    match kind % 7 {
        0 => decoded(bytes).map_or((), solve_bundle),
        1 => decoded(bytes).map_or((), solve_pose_graph),
        2 => decoded(bytes).map_or((), refine_pose),
        3 => decoded(bytes).map_or((), create_map),
        4 => decoded(bytes).map_or((), |request| {
            expect_status(optimization_service::map_options(&request, THREADS, None));
        }),
        5 => decoded(bytes).map_or((), |request: v1::ListMapsRequest| {
            expect_status(listing::page(
                request.page_size,
                &request.page_token,
                &listing::PagedList::new("ListMaps", ""),
            ));
        }),
        _ => decoded(bytes).map_or((), |request| {
            expect_status(convert(|out| copy::copy(&request, out)).map_err(Into::into));
        }),
    }
}

fn solve_bundle(mut request: v1::SolveBundleRequest) {
    bound(&mut request.options);
    let problem = request.problem.as_ref();
    let size = problem.map_or((0, 0), |p| (p.poses.len(), p.observations.len()));
    let is_small = is_small(size) && problem.is_some_and(|p| p.points.len() <= MOST_FACTORS);
    let Ok(read) = bundle_solve::input(request, &budget()) else { return };
    if is_small {
        expect_status(bundle_solve::run(read, &Interrupt::NEVER));
    }
}

fn solve_pose_graph(mut request: v1::SolvePoseGraphRequest) {
    bound(&mut request.options);
    let size = match &request.graph {
        Some(Graph::Se3(graph)) => (graph.vertices.len(), graph.edges.len()),
        Some(Graph::Se2(graph)) => (graph.vertices.len(), graph.edges.len()),
        None => (0, 0),
    };
    let Ok(read) = graph_solve::input(request, &budget()) else { return };
    if is_small(size) {
        expect_status(graph_solve::run(read, &Interrupt::NEVER));
    }
}

fn refine_pose(mut request: v1::RefinePoseRequest) {
    bound(&mut request.options);
    let is_small = request.observations.len() <= MOST_FACTORS;
    let Ok(read) = refine::input(request, &budget()) else { return };
    if is_small {
        expect_status(refine::run(read, &Interrupt::NEVER));
    }
}

fn budget() -> SolveBudget {
    SolveBudget { threads: THREADS, ceiling: EngineConfig::default().ceiling(), deadline: None }
}

/// Inputs of `wire_item` and of `wire_requests` that take as much memory as `length` bytes can.
#[must_use]
pub fn largest(length: usize) -> [Vec<Vec<u8>>; 2] {
    let length = length.saturating_sub(16);
    let framed = |message: &Vec<u8>| {
        let mut bytes = Vec::new();
        prost::encoding::encode_varint(message.len() as u64, &mut bytes);
        [&bytes[..], message].concat()
    };
    let mut items: Vec<_> = densest::<v1::IngestRequest>(length).iter().map(framed).collect();
    let landmark = |id| v1::Landmark { id, ..v1::Landmark::default() };
    let batch = v1::LandmarkBatch { landmarks: (0..65_536).map(landmark).collect() };
    let item = Some(v1::ingest_request::Item::Landmarks(batch));
    items.push(framed(&v1::IngestRequest { sequence: 1, item }.encode_to_vec()));
    let all = [
        densest::<v1::SolveBundleRequest>(length),
        densest::<v1::SolvePoseGraphRequest>(length),
        densest::<v1::RefinePoseRequest>(length),
        densest::<v1::CreateMapRequest>(length),
        densest::<v1::OptimizeMapRequest>(length),
        densest::<v1::ListMapsRequest>(length),
        densest::<v1::CopyMapRequest>(length),
    ];
    let request = |(kind, message): (u8, Vec<u8>)| [&[kind][..], &message].concat();
    let requests =
        (0_u8..).zip(all).flat_map(|(kind, all)| all.into_iter().map(move |m| (kind, m)));
    [items, requests.map(request).collect()]
}

/// A new map's policy goes to disk and back.
fn create_map(request: v1::CreateMapRequest) {
    let map = MapLimits { keyframes: Some(1000), ..MapLimits::default() };
    let server = ServerLimits { map, queued_items: 64 };
    let converted = convert(|out| {
        let map_id = ids::map_id(&request.map_id, out);
        let display_name = display_name(&request.display_name, out);
        let policy = policy(request.policy.as_ref(), &server, out);
        map_id?;
        Some(Change::Created { policy: policy?, create_time_ns: 1, display_name: display_name? })
    });
    if let Ok(change) = converted {
        let event = journey(&Event { revision: 1, time_ns: 1, cause: None, change });
        let mut map = Map::new();
        if let Err(error) = map.apply(&event) {
            panic!("a new map is refused: {error}: {event:?}");
        }
        map_journey(&map);
    }
}

/// A message as the codec decodes it.
fn decoded<M: prost::Name + Default>(bytes: &[u8]) -> Option<M> {
    check::<M>(bytes).ok()?;
    M::decode(bytes).ok()
}

fn bound(options: &mut Option<v1::SolverOptions>) {
    let options = options.get_or_insert_default();
    let most = options.max_iteration_count.unwrap_or(MOST_ITERATIONS).min(MOST_ITERATIONS);
    options.max_iteration_count = Some(most);
    options.thread_count = 1;
}

fn is_small((poses, factors): (usize, usize)) -> bool {
    poses <= MOST_POSES && factors <= MOST_FACTORS
}

/// Every error must have a status.
fn expect_status<T>(outcome: Result<T, super::error::ServiceError>) {
    if let Err(error) = outcome {
        let _status = tonic::Status::from(error);
    }
}

/// A file of tokens. Its error must not show what may be a token: nothing longer than a key.
pub fn tokens(input: &[u8]) {
    if let Err(error) = ParsedTokens::parse(&String::from_utf8_lossy(input), Path::new("tokens")) {
        let _told = error.to_string();
    }
}

/// A file of certificates, keys and authorities, as far as it is read before a handshake.
pub fn pem(input: &[u8]) {
    let mut authorities = tokio_rustls::rustls::RootCertStore::empty();
    for certificate in tls::certificates_in(input).unwrap_or_default() {
        let _refused = authorities.add(certificate);
    }
    if let Some(key) = tls::key_in(input) {
        let _refused = tokio_rustls::rustls::crypto::ring::sign::any_supported_type(&key);
    }
}
