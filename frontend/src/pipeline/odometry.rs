//! The odometry that keyframes are sent with, where the source measures one.
//!
//! The motion between two consecutive keyframes is the measured one; where a measurement of either is missing,
//! it is the tracked one. So the frame of odometry never jumps.

use covis_solvers::geometry::{LieGroup, Se3};

/// Follows the odometry from keyframe to keyframe.
#[derive(Debug, Default)]
pub(super) struct Odometry {
    last: Option<Step>,
}

/// odom_from_camera of a keyframe.
#[derive(Debug)]
struct Step {
    measured: Option<Se3>,
    tracked: Se3,
    sent: Se3,
}

impl Odometry {
    /// odom_from_camera of the next keyframe, as it is sent.
    pub(super) fn next(&mut self, measured: Option<&Se3>, tracked: &Se3) -> Se3 {
        let sent = match &self.last {
            None => *measured.unwrap_or(tracked),
            Some(last) => {
                let motion = match last.measured.zip(measured) {
                    Some((before, now)) => before.inverse().compose(now),
                    None => last.tracked.inverse().compose(tracked),
                };
                last.sent.compose(&motion)
            }
        };
        self.last = Some(Step { measured: measured.copied(), tracked: *tracked, sent });
        sent
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::*;

    #[test]
    fn the_measured_motion_is_sent_and_the_tracked_one_where_it_is_missing() {
        let moved = |twist: f64| Se3::exp(&(Vector6::new(1.0, 0.2, 0.0, 0.1, 0.3, -0.2) * twist));
        let (measured_step, tracked_step) = (moved(0.5), moved(0.4));
        let mut odometry = Odometry::default();
        let mut last: Option<Se3> = None;
        for k in 0..6 {
            let measured = moved(7.0 + 0.5 * f64::from(k));
            let tracked = moved(0.4 * f64::from(k));
            let is_measured = k != 3;
            let sent = odometry.next(is_measured.then_some(&measured), &tracked);
            if let Some(last) = last.replace(sent) {
                let expected = if [3, 4].contains(&k) { tracked_step } else { measured_step };
                let motion = last.inverse().compose(&sent);
                assert!(expected.inverse().compose(&motion).log().norm() < 1e-12, "keyframe {k}");
            }
        }
    }
}
