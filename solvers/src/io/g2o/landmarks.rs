//! Measurements of landmarks and priors of g2o files, to factors and back.
//!
//! A sensor sits on its pose: z, measured by a sensor S = pose_from_sensor, is S · z in the frame of the
//! pose with the information R Ω Rᵀ, and a measured world_from_sensor Z is Z · S⁻¹ with Adᵀ Ω Ad,
//! Ad that of S⁻¹, because Log(Z⁻¹ X S) = Ad · Log((Z S⁻¹)⁻¹ X). So the objective is that of the file to
//! rounding, and solvers know no sensors. g2o's own error of a pose takes half-angles or translations in
//! place of the logarithm, as it does in edges.

use std::path::Path;

use nalgebra::{Matrix3, Vector3};

use super::super::symmetric::upper_triangle;
use super::super::{IoError, Location};
use super::convert::{G2oPose, Indices, element, id_at, information_of};
use super::{G2oFile, G2oMeasured, G2oOffset, G2oPosePrior, G2oPositionPrior, G2oSe2, G2oSighting};
use crate::factors::{LandmarkMeasurement, PosePrior, PositionPrior, Sighting};
use crate::geometry::LieGroup;
use crate::information::Information;
use crate::loss::Loss;
use crate::problem::PoseGraph;

/// Adds the measurements of landmarks and the priors of `file`.
pub(super) fn add_measurements<G, const N: usize, const P: usize, const U: usize>(
    file: &G2oFile<P, U>,
    indices: &Indices,
    graph: &mut PoseGraph<G, N>,
) -> Result<(), IoError>
where
    G: G2oPose<N, P>,
{
    let sensor = |offset: Option<i64>, kind: &str, k: usize| -> Result<Option<G>, IoError> {
        let Some(id) = offset else { return Ok(None) };
        let found = file.offsets.iter().find(|offset| offset.id == id);
        let location = || Location::record(Path::new(kind), k as u64);
        let unknown =
            || IoError::UnknownId { location: location(), field: "parameter", id: id.into() };
        let offset: G = element(&found.ok_or_else(unknown)?.pose_from_sensor, kind, k)?;
        Ok((offset != G::identity()).then_some(offset))
    };
    for (k, seen) in file.sightings.iter().enumerate() {
        let kind = "measurement of a landmark";
        let location = || Location::record(Path::new(kind), k as u64);
        let pose = Some(indices.pose(seen.pose, kind, k)?);
        let landmark = indices.landmarks.get(&seen.point).copied();
        let landmark = landmark.ok_or_else(|| IoError::UnknownId {
            location: location(),
            field: "landmark",
            id: seen.point.into(),
        })?;
        let mut information = information_of(&seen.information, kind, k, (seen.pose, seen.point))?;
        let sighting = match seen.measured {
            G2oMeasured::Position(z) => {
                let z = Vector3::from(z);
                Sighting::Position(match sensor(seen.offset, kind, k)? {
                    None => z,
                    Some(pose_from_sensor) => {
                        let turn = rotation(&pose_from_sensor);
                        let turned = turn * information.matrix() * turn.transpose();
                        information = symmetric_information(&turned, location())?;
                        pose_from_sensor.act(&z)
                    }
                })
            }
            G2oMeasured::Bearing(angle) => Sighting::Bearing(angle),
        };
        let measurement = LandmarkMeasurement { pose, landmark, sighting, information, loss: None };
        graph.landmarks.measurements.push(measurement);
    }
    for (k, prior) in file.pose_priors.iter().enumerate() {
        let kind = "prior on a pose";
        let pose = indices.pose(prior.id, kind, k)?;
        let measured: G = element(&prior.world_from_sensor, kind, k)?;
        let mut information = information_of(&prior.information, kind, k, (prior.id, prior.id))?;
        let world_from_camera = match sensor(prior.offset, kind, k)? {
            None => measured,
            Some(pose_from_sensor) => {
                let sensor_from_pose = pose_from_sensor.inverse();
                let adjoint = sensor_from_pose.adjoint();
                let moved = adjoint.tr_mul(&(information.matrix() * adjoint));
                let location = Location::record(Path::new(kind), k as u64);
                information = symmetric_information(&moved, location)?;
                measured.compose(&sensor_from_pose)
            }
        };
        let loss = Loss::Trivial;
        graph.pose_priors.push(PosePrior { pose, world_from_camera, information, loss });
    }
    for (k, prior) in file.position_priors.iter().enumerate() {
        let kind = "prior on a position";
        let information = information_of(&prior.information, kind, k, (prior.id, prior.id))?;
        let position = Vector3::from(prior.position);
        match indices.landmarks.get(&prior.id) {
            Some(&landmark) => graph.landmarks.measurements.push(LandmarkMeasurement {
                pose: None,
                landmark,
                sighting: Sighting::Position(position),
                information,
                loss: Some(Loss::Trivial),
            }),
            None => graph.position_priors.push(PositionPrior {
                pose: indices.pose(prior.id, kind, k)?,
                position_in_world: position,
                point_in_camera: Vector3::zeros(),
                information,
                loss: Loss::Trivial,
            }),
        }
    }
    Ok(())
}

/// R of a motion as it acts on points of space.
fn rotation<G: LieGroup<N>, const N: usize>(motion: &G) -> Matrix3<f64> {
    let origin = motion.act(&Vector3::zeros());
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    Matrix3::from_columns(&axes.map(|axis| motion.act(&axis) - origin))
}

/// The information of a matrix that is symmetric but for rounding.
fn symmetric_information<const N: usize>(
    matrix: &nalgebra::SMatrix<f64, N, N>,
    location: Location,
) -> Result<Information<N>, IoError> {
    // Halved first: a sum of the largest numbers is none.
    Information::nearest(&(matrix * 0.5 + matrix.transpose() * 0.5))
        .map_err(|_error| IoError::NotFinite { location, field: "information".to_owned() })
}

/// Appends the records of measurements of landmarks and of priors to `file`.
pub(super) fn put_measurements<G, const N: usize, const P: usize, const U: usize>(
    graph: &PoseGraph<G, N>,
    file: &mut G2oFile<P, U>,
) -> Result<(), IoError>
where
    G: G2oPose<N, P>,
{
    let is_plane = P == G2oSe2::POSE_NUMBERS;
    // Records in space name a sensor: that of the pose itself.
    let offset = (!is_plane).then_some(0);
    let landmarks = &graph.landmarks;
    let unwritable = |kind: &'static str, k: usize, reason: &'static str| {
        Err(IoError::UnwritableFactor { factor: kind, index: k, reason })
    };
    for (k, measurement) in landmarks.measurements.iter().enumerate() {
        let kind = "measurement of a landmark";
        let point = id_at(&landmarks.ids, measurement.landmark, "landmark", kind, k)?;
        let information = upper_triangle(measurement.information.matrix());
        let measured = match (measurement.sighting, measurement.pose) {
            (Sighting::Position(z), None) => {
                let (id, position) = (point, z.into());
                let prior = G2oPositionPrior { id, offset: None, position, information };
                file.position_priors.push(prior);
                continue;
            }
            (Sighting::Position(z), Some(_)) => G2oMeasured::Position(z.into()),
            (Sighting::Bearing(angle), Some(_)) if is_plane => G2oMeasured::Bearing(angle),
            (Sighting::Bearing(_), _) => {
                return unwritable(kind, k, "g2o has bearings in the plane only, from poses");
            }
        };
        let pose = id_at(&graph.ids, measurement.pose.unwrap_or_default(), "pose", kind, k)?;
        let offset = offset.filter(|_| matches!(measured, G2oMeasured::Position(_)));
        file.sightings.push(G2oSighting { pose, point, offset, measured, information });
    }
    if !graph.ranges.is_empty() {
        return unwritable("range", 0, "g2o has no ranges");
    }
    for (k, prior) in graph.pose_priors.iter().enumerate() {
        let id = id_at(&graph.ids, prior.pose, "pose", "prior on a pose", k)?;
        let world_from_sensor = prior.world_from_camera.to_numbers();
        let information = upper_triangle(prior.information.matrix());
        file.pose_priors.push(G2oPosePrior { id, offset, world_from_sensor, information });
    }
    for (k, prior) in graph.position_priors.iter().enumerate() {
        let kind = "prior on a position";
        let id = id_at(&graph.ids, prior.pose, "pose", kind, k)?;
        if prior.point_in_camera != Vector3::zeros() {
            return unwritable(kind, k, "g2o has no lever arms");
        }
        let position = prior.position_in_world.into();
        let information = upper_triangle(prior.information.matrix());
        file.position_priors.push(G2oPositionPrior { id, offset, position, information });
    }
    let names_sensor = file.sightings.iter().any(|seen| seen.offset.is_some())
        || !file.pose_priors.is_empty()
        || !file.position_priors.is_empty();
    if let Some(id) = offset.filter(|_| names_sensor) {
        file.offsets.push(G2oOffset { id, pose_from_sensor: G::identity().to_numbers() });
    }
    Ok(())
}
