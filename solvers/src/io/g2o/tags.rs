//! Tags of g2o's lines, and of TORO's, which g2o reads too.
//!
//! One table says which record a tag begins; `parse` and `write` know what is in a record.

/// What a line holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Record {
    Pose,
    /// As TORO writes it: roll, pitch and yaw in place of a quaternion.
    ToroPose,
    Point,
    Edge,
    /// As TORO writes it: angles, and in the plane another order of the information.
    ToroEdge,
    /// A point seen from a pose.
    Position,
    Bearing,
    PosePrior,
    PositionPrior,
    /// With the id of an offset that g2o reads and does not use.
    PositionPriorWithOffset,
    /// Where a sensor is on a pose in space.
    Offset,
    Fix,
    /// Another parameter, which no record that is read uses.
    Parameter,
}

/// Dimensions of the space that a record is about; those that have none count as solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Space {
    Plane,
    Solid,
}

pub(super) const POINT: [&str; 2] = ["VERTEX_XY", "VERTEX_TRACKXYZ"];
pub(super) const POSITION: [&str; 2] = ["EDGE_SE2_XY", "EDGE_SE3_TRACKXYZ"];
pub(super) const BEARING: &str = "EDGE_BEARING_SE2_XY";
pub(super) const POSE_PRIOR: [&str; 2] = ["EDGE_PRIOR_SE2", "EDGE_SE3_PRIOR"];
pub(super) const POSITION_PRIOR: [&str; 2] = ["EDGE_PRIOR_SE2_XY", "EDGE_POINTXYZ_PRIOR"];
pub(super) const POSITION_PRIOR_WITH_OFFSET: &str = "EDGE_SE3_XYZ_PRIOR";
pub(super) const OFFSET: &str = "PARAMS_SE3OFFSET";

/// The tags that are read, each with the record and the space.
const TAGS: [(&str, Record, Space); 21] = [
    ("VERTEX_SE2", Record::Pose, Space::Plane),
    ("EDGE_SE2", Record::Edge, Space::Plane),
    ("VERTEX_SE3:QUAT", Record::Pose, Space::Solid),
    ("EDGE_SE3:QUAT", Record::Edge, Space::Solid),
    ("VERTEX2", Record::ToroPose, Space::Plane),
    ("EDGE2", Record::ToroEdge, Space::Plane),
    ("VERTEX3", Record::ToroPose, Space::Solid),
    ("EDGE3", Record::ToroEdge, Space::Solid),
    (POINT[0], Record::Point, Space::Plane),
    (POINT[1], Record::Point, Space::Solid),
    (POSITION[0], Record::Position, Space::Plane),
    (POSITION[1], Record::Position, Space::Solid),
    (BEARING, Record::Bearing, Space::Plane),
    (POSE_PRIOR[0], Record::PosePrior, Space::Plane),
    // As some programs call it.
    ("EDGE_SE2_PRIOR", Record::PosePrior, Space::Plane),
    (POSE_PRIOR[1], Record::PosePrior, Space::Solid),
    (POSITION_PRIOR[0], Record::PositionPrior, Space::Plane),
    (POSITION_PRIOR[1], Record::PositionPrior, Space::Solid),
    (POSITION_PRIOR_WITH_OFFSET, Record::PositionPriorWithOffset, Space::Solid),
    (OFFSET, Record::Offset, Space::Solid),
    ("FIX", Record::Fix, Space::Solid),
];

/// The record that a tag begins, and its space.
pub(super) fn read_tag(tag: &[u8]) -> Option<(Record, Space)> {
    let found = TAGS.iter().find(|(name, ..)| name.as_bytes() == tag);
    let parameter = (Record::Parameter, Space::Solid);
    let is_parameter = tag.starts_with(b"PARAMS_");
    found.map(|&(_, record, space)| (record, space)).or(is_parameter.then_some(parameter))
}
