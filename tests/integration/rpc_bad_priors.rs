//! Bad losses and bad measured places on an ingest stream: each is refused by name.

use covis::wire::v1;
use v1::ViolationReason as Reason;

use crate::common::vector3;
use crate::rpc_bad_input::{bad_constraint, check, pose_prior, position_prior};

#[test]
fn what_is_wrong_with_a_loss_or_a_measured_place_is_reported() {
    let huber = || Some(v1::Loss { kind: v1::LossKind::Huber.into(), width: Some(-1.0) });
    let place = |latitude_deg| Some(v1::GeodeticPosition { latitude_deg, ..Default::default() });
    check(vec![
        (bad_constraint(|c| c.loss = huber()), "relative_pose.loss.width", Reason::OutOfRange),
        (position_prior(|p| p.loss = huber()), "position_prior.loss.width", Reason::OutOfRange),
        (pose_prior(|p| p.loss = huber()), "pose_prior.loss.width", Reason::OutOfRange),
        (
            position_prior(|p| p.point_in_camera = Some(vector3([0.1, f64::NAN, 0.0]))),
            "position_prior.point_in_camera.y",
            Reason::NotFinite,
        ),
        (
            position_prior(|p| p.geodetic_point = place(1.0)),
            "position_prior.geodetic_point",
            Reason::Inconsistent,
        ),
        (
            position_prior(|p| (p.point_in_world, p.geodetic_point) = (None, place(-91.0))),
            "position_prior.geodetic_point.latitude_deg",
            Reason::OutOfRange,
        ),
        (
            position_prior(|p| (p.point_in_world, p.geodetic_point) = (None, place(1.0))),
            "position_prior.geodetic_point",
            Reason::Inconsistent,
        ),
    ]);
}
