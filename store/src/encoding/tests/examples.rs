//! An event of every kind that leads to the next one, with values that an encoding could lose.

use std::collections::BTreeMap;
use std::sync::Arc;

use covis_solvers::geometry::{
    Camera, Geodetic, KannalaBrandt, LieGroup, PinholeRadialTangential, Se3, Sim3, Snavely,
};
use covis_solvers::information::Information;
use covis_solvers::loss::Loss;
use covis_solvers::robust::Kernel;
use nalgebra::{Matrix3, Matrix6, Vector2, Vector3, Vector6};

use covis_map::{
    AppliedSolve, CameraEntity, Cause, Change, ClientIndex, ClosureRobustness, Comparison,
    Constraint, ConstraintKind, Depth, Descriptor, DescriptorKind, EntityId, Event, Gauge, Link,
    Map, MapLimits, MapPolicy, NewLandmark, Noise, Observation, OdometryNoise, PlaceCandidate,
    PlaceRefusal, PlaceSearch, Prior, Retired, SolveKind, SwitchedOff, ViewNoise, WhenFull,
};

pub(super) fn id(id: i64) -> EntityId {
    EntityId::new(ClientIndex(0), id)
}

fn pose(k: f64) -> Se3 {
    Se3::exp(&(Vector6::new(0.1, -0.2, 0.3, 0.03, 0.02, -0.05) * k))
}

fn similarity(k: f64, scale: f64) -> Sim3 {
    Sim3 { scale, ..pose(k).into() }
}

fn seen(landmark: i64, u: f64) -> Observation {
    Observation {
        landmark: id(landmark),
        pixel: Vector2::new(u, 1.0 / 3.0),
        sigma_px: 0.7,
        depth: None,
        descriptor: None,
    }
}

fn keyframe(k: i64, observations: Vec<Observation>, landmarks: Vec<NewLandmark>) -> Change {
    Change::KeyframeAdded {
        id: id(k),
        capture_time_ns: -k,
        camera: Some(id(k % 3)),
        world_from_camera: pose(k as f64),
        odom_from_camera: pose(0.5 * k as f64),
        observations,
        landmarks,
        motion: Some(similarity(0.0625, if k % 2 == 1 { 0.37 } else { 1.0 })),
        global_descriptor: (k % 2 == 1).then(|| {
            let (name, data) = ("vlad".to_owned(), vec![k as u8, 0, 0x80, 0x3f]);
            Arc::new(Descriptor { kind: DescriptorKind::Float32, name, data })
        }),
    }
}

fn new(landmark: i64, x: f64) -> NewLandmark {
    NewLandmark { id: id(landmark), position: Some(Vector3::new(x, -0.0, 5e-324)) }
}

fn refusal(reason: &str) -> PlaceRefusal {
    PlaceRefusal { reason: reason.to_owned(), text: format!("{reason}: 3 of 7") }
}

fn search(closure: Option<EntityId>, of_search: Option<PlaceRefusal>) -> PlaceSearch {
    let candidate = |keyframe, refusal| PlaceCandidate {
        keyframe: id(keyframe),
        score: 1.0 / 3.0,
        matches: 80,
        refusal,
    };
    let candidates = vec![candidate(12, Some(refusal("ambiguous"))), candidate(10, None)];
    PlaceSearch { candidates, closure, refusal: of_search }
}

/// A journal with every kind of change, every model and every option.
pub(crate) fn every_change() -> Vec<Event> {
    let policy = MapPolicy {
        local_bundle: false,
        loop_closure: false,
        closure_adjustment: false,
        odometry: false,
        metric_odometry: false,
        place_recognition: true,
        window_keyframes: 7,
        min_shared_landmarks: 3,
        observation_loss: Loss::Cauchy(1.5),
        constraint_loss: Loss::Tukey(4.25),
        max_local_iterations: 3,
        loop_closure_robustness: ClosureRobustness {
            kernel: Some(Kernel::GemanMcClure),
            threshold: Some(-0.0),
        },
        limits: MapLimits {
            keyframes: Some(0),
            landmarks: None,
            observations: Some(9),
            bytes: Some(1 << 40),
            ..MapLimits::default()
        },
        when_full: WhenFull::Sparsify,
        max_queued_items: Some(3),
        gauge: Gauge::Priors,
        geodetic_anchor: Some(Geodetic { latitude_deg: -0.0, longitude_deg: 9.5, height_m: 1e3 }),
    };
    let other = MapPolicy {
        loop_closure_robustness: ClosureRobustness::NONE,
        observation_loss: Loss::GemanMcClure(0.1),
        constraint_loss: Loss::Trivial,
        when_full: WhenFull::Marginalize,
        max_queued_items: None,
        gauge: Gauge::FixedPoses,
        geodetic_anchor: None,
        limits: MapLimits {
            clients: Some(1),
            cameras: Some(2),
            constraints: Some(3),
            priors: Some(u64::MAX),
            ..policy.limits
        },
        ..policy
    };
    let pinhole = PinholeRadialTangential {
        k1: 0.1,
        k2: -0.2,
        p1: 1e-3,
        p2: -0.0,
        k3: 1e-300,
        ..PinholeRadialTangential::undistorted(500.0, 501.0, 320.5, 240.25)
    };
    let fisheye =
        KannalaBrandt { fx: 1.0, fy: 2.0, cx: 3.0, cy: 4.0, k1: 5.0, k2: 6.0, k3: 7.0, k4: 8.0 };
    let cameras = [
        Camera::Pinhole(pinhole),
        Camera::Fisheye(fisheye),
        Camera::Snavely(Snavely { focal: 400.0, k1: 0.01, k2: -0.0 }),
    ];
    let camera = |k: usize| Change::CameraSet {
        id: id(k as i64),
        camera: CameraEntity { camera: cameras[k], width_px: 640, height_px: k as u32 },
    };
    let descriptor =
        |kind| Some(Arc::new(Descriptor { kind, name: "orb".into(), data: vec![0, 1] }));
    let mut rich = seen(1, -0.0);
    rich.depth = Some(Depth { depth_m: 2.5, sigma_m: 0.01 });
    rich.descriptor = descriptor(DescriptorKind::Binary);
    let mut float = seen(2, 2.0);
    float.descriptor = descriptor(DescriptorKind::Float32);
    let mut bytes = seen(3, 3.0);
    bytes.descriptor = descriptor(DescriptorKind::Uint8);
    let twice = seen(3, 4.0);
    let mut information = Matrix6::identity() * 100.0;
    (information[(0, 4)], information[(4, 0)]) = (0.1, 0.1);
    let information = Information::new(&information).unwrap();
    let relative = Constraint {
        kind: ConstraintKind::LoopClosure,
        keyframe_i: id(10),
        keyframe_j: id(11),
        keyframe_i_from_keyframe_j: pose(0.01),
        information,
        loss: None,
    };
    let constraint = |k: i64, kind| {
        let loss = (k == 2).then_some(Loss::Cauchy(0.25));
        Change::ConstraintAdded { id: id(k), constraint: Constraint { kind, loss, ..relative } }
    };
    let solve = |kind| Change::SolveApplied {
        solve: AppliedSolve {
            kind,
            poses: vec![(id(10), pose(0.123))],
            landmarks: vec![(id(1), Vector3::new(-0.0, 1e300, 0.1))],
            cameras: vec![(id(1), cameras[1])],
            switched_off: vec![(
                id(1),
                SwitchedOff { chi2: 1e9, weight: -0.0, is_provisional: true },
            )],
            switched_on: vec![id(2)],
            left_frames: vec![(ClientIndex(0), pose(0.125))],
            closure_variances: vec![(ClientIndex(0), 270.5)],
            noise: vec![(
                ClientIndex(0),
                Noise {
                    odometry: OdometryNoise {
                        translation_share: 0.25,
                        rotation_rad: 0.125,
                        pairs: 33.0,
                    },
                    views: ViewNoise {
                        pixel_factor: 0.5,
                        depth_factor: 2.0,
                        outlier_share: 0.125,
                        windows: 9.0,
                    },
                },
            )],
            covered: vec![(ClientIndex(0), 3)],
            initial_cost: 1e9,
            final_cost: -0.0,
            request: Some([7; 16]),
        },
    };
    let position = Information::new(&Matrix3::identity()).unwrap();
    let unplaced = NewLandmark { id: id(4), position: None };
    let changes = vec![
        Change::Created { policy, create_time_ns: -5, display_name: "Haus".to_owned() },
        Change::ClientOpened { name: "röbot".to_owned(), epoch: 3 },
        camera(0),
        camera(1),
        camera(2),
        keyframe(10, vec![rich, float], vec![new(1, 1.0), new(2, -0.0)]),
        Change::LandmarksAdded { landmarks: vec![new(3, 3.0), unplaced], scale: 0.37 },
        keyframe(11, vec![bytes, twice, seen(4, 9.0)], Vec::new()),
        Change::ObservationsAdded { keyframe: id(10), observations: vec![seen(3, 7.0)] },
        constraint(0, ConstraintKind::Odometry),
        constraint(1, ConstraintKind::LoopClosure),
        constraint(2, ConstraintKind::Other),
        Change::PriorAdded {
            id: id(3),
            prior: Prior::Pose {
                keyframe: id(10),
                world_from_camera: pose(1.0),
                information,
                loss: Loss::Trivial,
            },
        },
        Change::PriorAdded {
            id: id(4),
            prior: Prior::Position {
                keyframe: id(11),
                position_in_world: Vector3::new(0.0, -0.0, 1.0),
                point_in_camera: Vector3::new(-0.0, 0.0, 0.0),
                information: position,
                loss: Loss::Tukey(2.5),
            },
        },
        Change::PriorAdded {
            id: id(5),
            prior: Prior::Position {
                keyframe: id(11),
                position_in_world: Vector3::x(),
                point_in_camera: Vector3::zeros(),
                information: position,
                loss: Loss::Trivial,
            },
        },
        Change::LandmarksTriangulated { positions: vec![(id(4), Vector3::new(4.0, 5.0, 6.0))] },
        Change::DuplicatesFound {
            comparisons: vec![Comparison {
                closure: id(1),
                pairs: vec![(id(3), id(1)), (id(3), id(4))],
            }],
        },
        Change::PlacesSearched {
            searches: vec![
                (id(10), search(None, Some(refusal("no_room")))),
                (id(11), search(Some(EntityId::own(ClientIndex(0), 30, 1)), None)),
            ],
            closures: vec![(EntityId::own(ClientIndex(0), 30, 1), relative)],
        },
        solve(SolveKind::LocalBundle),
        solve(SolveKind::PoseGraph),
        solve(SolveKind::Global),
        keyframe(13, vec![seen(1, 1.0), seen(2, 1.0)], vec![new(20, 1.0), new(21, 2.0)]),
        Change::ObservationsRemoved { observations: vec![(id(10), id(2))] },
        Change::LandmarksFused { kept: id(1), absorbed: vec![id(2)] },
        Change::LandmarksRemoved { landmarks: vec![id(20)] },
        Change::ConstraintRevoked { id: id(1) },
        Change::DuplicatesSplit { closures: vec![id(1)], landmarks: vec![id(1), id(3), id(4)] },
        keyframe(12, Vec::new(), Vec::new()),
        Change::KeyframeRemoved { keyframe: id(12) },
        keyframe(14, Vec::new(), Vec::new()),
        keyframe(15, Vec::new(), Vec::new()),
        Change::KeyframeRetired {
            retired: Retired {
                keyframe: id(14),
                landmarks: vec![id(21)],
                revoked: vec![id(2)],
                constraints: vec![(
                    id(-4096),
                    Constraint {
                        kind: ConstraintKind::Marginal,
                        keyframe_i: id(10),
                        keyframe_j: id(15),
                        keyframe_i_from_keyframe_j: pose(0.5),
                        information,
                        loss: None,
                    },
                )],
                priors: vec![(
                    id(-4095),
                    Prior::Pose {
                        keyframe: id(15),
                        world_from_camera: pose(2.0),
                        information,
                        loss: Loss::Huber(1.5),
                    },
                )],
            },
        },
        Change::MapUpdated { display_name: None, policy: Some(other), frozen: None },
        Change::ItemRepeated,
        Change::MapUpdated {
            display_name: Some(String::new()),
            policy: Some(policy),
            frozen: Some(true),
        },
        Change::MapUpdated { display_name: None, policy: None, frozen: Some(false) },
        Change::MapUpdated { display_name: Some("Hof".into()), policy: None, frozen: None },
    ];
    let merges = merges(&changes);
    let changes = changes.into_iter().chain(merges);
    let cause = |revision: i64, change: &Change| {
        let from_client = matches!(
            change,
            Change::CameraSet { .. } | Change::KeyframeAdded { .. } | Change::ItemRepeated
        );
        let digest = [revision as u8; 32];
        from_client.then_some(Cause {
            client: ClientIndex(0),
            epoch: 3,
            sequence: revision,
            digest,
        })
    };
    (1..)
        .zip(changes)
        .map(|(revision, change)| {
            let cause = cause(revision, &change);
            Event { revision, time_ns: 7 * revision, cause, change }
        })
        .collect()
}

/// Another map comes, goes and comes again.
fn merges(changes: &[Change]) -> Vec<Change> {
    let event = |(revision, change): (i64, &Change)| {
        let change = change.clone();
        Event { revision, time_ns: 7 * revision, cause: None, change }
    };
    let target: Vec<Event> = (1..).zip(changes).map(event).collect();
    let mut target = Map::replay(target.iter()).unwrap();
    let created = Change::Created {
        policy: MapPolicy::default(),
        create_time_ns: 11,
        display_name: "Garten".to_owned(),
    };
    let opened = Change::ClientOpened { name: "mower".to_owned(), epoch: 2 };
    let alone = Change::KeyframeAdded {
        id: id(5),
        capture_time_ns: -3,
        camera: None,
        world_from_camera: pose(0.25),
        odom_from_camera: pose(-0.0),
        observations: Vec::new(),
        landmarks: vec![NewLandmark { id: id(6), position: Some(Vector3::new(1.0, 2.0, 3.0)) }],
        motion: None,
        global_descriptor: None,
    };
    let source: Vec<Event> = (1..).zip(&[created, opened, alone]).map(event).collect();
    let source = Map::replay(source.iter()).unwrap();
    let link = Link {
        target: id(10),
        source: id(5),
        target_from_source: pose(0.75),
        information: Information::identity(),
    };
    let names = BTreeMap::from([("mower".to_owned(), "mower-2".to_owned())]);
    let mut changes = Vec::new();
    for (links, scale) in [(vec![link], 1.0), (Vec::new(), 0.37)] {
        let at = similarity(1.5, scale);
        let merge = target.merge_of(("garden", &source), at, &names, &links).unwrap();
        let out = Change::MapTakenOut { name: "garden".to_owned(), clients_leave: true };
        for change in [Change::MapMerged { merge: Box::new(merge) }, out] {
            target.apply(&event((target.revision() + 1, &change))).unwrap();
            changes.push(change);
        }
    }
    // The last one stays.
    changes.truncate(3);
    changes
}
