//! Priors of a map: what of them reaches a problem, and what holds a piece that has none.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use covis::map::{
    AppliedSolve, Change, ConstraintKind, EntityRef, Gauge, GlobalOptions, Item, MapPolicy,
    MeasuredPosition, Prior, Reason, SolveKind, SwitchedOff, global_problem, local_problem,
};
use covis_solvers::geometry::{Geodetic, LocalFrame};
use covis_solvers::information::Information;
use covis_solvers::loss::Loss;
use nalgebra::Vector3;

use crate::map_support::{
    Journal, ROBOT, fix, graph_problem, id, loop_problem, pose_at, relative_pose, solve_of, street,
    window_around,
};

/// A solve that changes nothing but verdicts.
fn judged(switched_off: Vec<(covis::map::EntityId, SwitchedOff)>) -> Change {
    Change::SolveApplied { solve: AppliedSolve { switched_off, ..solve_of(SolveKind::PoseGraph) } }
}

fn held(journal: &Journal, gauge: Gauge) -> (Vec<bool>, Vec<bool>) {
    let options = GlobalOptions { gauge, ..GlobalOptions::default() };
    let bundle = global_problem(&journal.map, &options).problem.constant_poses;
    (bundle, graph_problem(&journal.map, gauge, |_, _| None).graph.constant)
}

#[test]
fn priors_win_over_holding_the_first_keyframe() {
    let mut journal = street(4, MapPolicy::default());
    let (first, none) = (vec![true, false, false, false], vec![false; 4]);
    let gauges = [Gauge::FirstKeyframeFixed, Gauge::Free, Gauge::Priors, Gauge::FixedPoses];
    for gauge in gauges {
        let bundle = if matches!(gauge, Gauge::Free | Gauge::Priors) { &none } else { &first };
        // A pose graph without priors has no other frame.
        assert_eq!(held(&journal, gauge), (bundle.clone(), first.clone()), "{gauge:?}");
    }
    journal.send(ROBOT, &fix(1, 2, Vector3::zeros())).unwrap();
    for gauge in gauges {
        let all = if gauge == Gauge::FixedPoses { &first } else { &none };
        assert_eq!(held(&journal, gauge), (all.clone(), all.clone()), "{gauge:?}");
    }
    // The policy's is the default.
    let policy = MapPolicy { gauge: Gauge::FixedPoses, ..MapPolicy::default() };
    let mut fixed = street(4, policy);
    fixed.send(ROBOT, &fix(1, 2, Vector3::zeros())).unwrap();
    assert_eq!(loop_problem(&fixed.map, |_, _| None).graph.constant, first);
    assert_eq!(loop_problem(&journal.map, |_, _| None).graph.constant, none);
}

#[test]
fn lever_arms_and_losses_reach_both_problems() {
    let mut journal = street(3, MapPolicy::default());
    let arm = Vector3::new(0.1, 0.2, 0.3);
    let mut item = fix(1, 2, Vector3::x());
    let Item::PositionPrior { point_in_camera, loss, .. } = &mut item else { panic!() };
    (*point_in_camera, *loss) = (arm, Loss::Cauchy(2.0));
    journal.send(ROBOT, &item).unwrap();
    journal
        .send(
            ROBOT,
            &Item::PosePrior {
                id: 2,
                keyframe: EntityRef::own(1),
                world_from_camera: pose_at(1.0),
                information: Information::identity(),
                loss: Loss::Huber(3.0),
            },
        )
        .unwrap();
    let mut odometry = relative_pose(3, ConstraintKind::Odometry, 0, 1, pose_at(1.0));
    let Item::RelativePose { loss, .. } = &mut odometry else { panic!() };
    *loss = Some(Loss::Tukey(4.0));
    journal.send(ROBOT, &odometry).unwrap();
    let bundle = global_problem(&journal.map, &GlobalOptions::default()).problem;
    let graph = loop_problem(&journal.map, |_, _| None).graph;
    assert_eq!(bundle.position_priors, graph.position_priors);
    assert_eq!(bundle.pose_priors, graph.pose_priors);
    let prior = graph.position_priors[0];
    assert_eq!((prior.pose, prior.point_in_camera, prior.loss), (2, arm, Loss::Cauchy(2.0)));
    assert_eq!(graph.pose_priors[0].loss, Loss::Huber(3.0));
    assert_eq!(bundle.relative_poses[0].loss, Some(Loss::Tukey(4.0)));
    assert_eq!(graph.edges.last().unwrap().loss, Some(Loss::Tukey(4.0)));
    assert!(graph.edges[..graph.edges.len() - 1].iter().all(|edge| edge.loss.is_none()));
    // The same item again is a duplicate; with another arm it is not.
    assert!(journal.map.holds(ROBOT, &item));
    let Item::PositionPrior { point_in_camera, .. } = &mut item else { panic!() };
    point_in_camera.z = 0.0;
    assert!(!journal.map.holds(ROBOT, &item));
}

#[test]
fn a_fix_that_is_switched_off_is_left_out_but_judged_again() {
    let mut journal = street(4, MapPolicy::default());
    journal.send(ROBOT, &fix(1, 2, Vector3::zeros())).unwrap();
    let before = journal.map.state_hash();
    let off = SwitchedOff { chi2: 99.0, weight: 0.0, is_provisional: false };
    journal.push(judged(vec![(id(1), off)]));
    assert_ne!(journal.map.state_hash(), before);
    assert_eq!(journal.map.switched_off().get(&id(1)), Some(&off));
    assert!(journal.map.active_prior(id(1)).is_none());
    let bundle = global_problem(&journal.map, &GlobalOptions::default()).problem;
    assert!(bundle.position_priors.is_empty());
    assert_eq!(bundle.constant_poses, [true, false, false, false]);
    let problem = loop_problem(&journal.map, |_, _| None);
    assert_eq!(problem.graph.position_priors.len(), 1);
    assert_eq!(problem.positions[0].prior, id(1));
    assert_eq!(problem.positions[0].switched_off, Some(off));
    assert_eq!(problem.graph.constant, [false; 4]);
    journal.push(Change::ConstraintRevoked { id: id(1) });
    assert!(journal.map.switched_off().is_empty());
}

#[test]
fn a_geodetic_fix_needs_an_anchor_and_is_kept_in_the_world() {
    let point = Geodetic { latitude_deg: 48.001, longitude_deg: 11.002, height_m: 512.0 };
    let mut item = fix(1, 2, Vector3::zeros());
    let Item::PositionPrior { position: sent, .. } = &mut item else { panic!() };
    *sent = MeasuredPosition::OnEarth(point);
    let plain = street(3, MapPolicy::default());
    let rejection = plain.map.check(ROBOT, &item).unwrap_err();
    let found: Vec<_> = rejection.violations.iter().map(|v| (v.field.as_str(), v.reason)).collect();
    assert_eq!(found, [("position_prior.geodetic_point", Reason::Inconsistent)]);
    let anchor = Geodetic { latitude_deg: 48.0, longitude_deg: 11.0, height_m: 500.0 };
    let policy = MapPolicy { geodetic_anchor: Some(anchor), ..MapPolicy::default() };
    let mut journal = street(3, policy);
    journal.send(ROBOT, &item).unwrap();
    let Some(&Prior::Position { position_in_world, .. }) = journal.map.priors().get(&id(1)) else {
        panic!()
    };
    assert_eq!(position_in_world, LocalFrame::new(&anchor).point_in_local(&point));
    assert!((position_in_world - Vector3::new(149.2, 111.2, 12.0)).norm() < 0.5);
}

#[test]
fn a_window_leaves_a_strained_fix_to_the_pose_graph() {
    let window = |policy: MapPolicy, off: f64| {
        let mut journal = street(4, policy);
        let at = pose_at(2.0).translation + Vector3::x() * off;
        journal.send(ROBOT, &fix(1, 2, at)).unwrap();
        let window = window_around(&journal.map, &[id(3)]);
        local_problem(&journal.map, &window).problem.position_priors.len()
    };
    // σ is 0.01 m.
    assert_eq!(window(MapPolicy::default(), 0.02), 1);
    assert_eq!(window(MapPolicy::default(), 0.5), 0);
    let policy = MapPolicy { loop_closure: false, ..MapPolicy::default() };
    assert_eq!(window(policy, 0.5), 1, "no pose graph would come");
}
