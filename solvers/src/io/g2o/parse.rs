//! g2o in: one pass over the lines, then the checks that need the whole file.
//!
//! Lines are remembered during the parse only, so that a refusal names them. Numbers stay those of the
//! file, except for quaternions far from norm 1 and for information matrices that are repaired on request.

use std::collections::BTreeSet;
use std::path::Path;

use super::super::changed_lines::{ChangedLines, UnknownTags};
use super::super::error::excerpt;
use super::super::rotation::normalized;
use super::super::symmetric::{PLANE, symmetric, upper_triangle};
use super::super::text::{Line, Text};
use super::super::{IoError, Location, files};
use super::convert::refused;
use super::tags::{Record, Space, read_tag};
use super::toro;
use super::{
    G2oChanges, G2oEdge, G2oFile, G2oGraph, G2oMeasured, G2oOffset, G2oPoint, G2oPosePrior,
    G2oPositionPrior, G2oReading, G2oSighting, G2oVertex, Indefinite, RepairedEdges,
};
use crate::information::{Information, InformationError};

/// A file that is being read, with the line of each record.
struct Builder<const P: usize, const U: usize> {
    file: G2oFile<P, U>,
    edge_lines: Vec<u64>,
    sighting_lines: Vec<u64>,
    pose_prior_lines: Vec<u64>,
    position_prior_lines: Vec<u64>,
    poses: BTreeSet<i64>,
    points: BTreeSet<i64>,
    changes: G2oChanges,
}

/// The file, and what was changed in it.
pub(super) fn parse(
    bytes: &[u8],
    path: &Path,
    reading: G2oReading,
) -> Result<(G2oGraph, G2oChanges), IoError> {
    files::check_lines(bytes, path)?;
    let mut se2 = Builder::<3, 6>::new();
    let mut se3 = Builder::<7, 21>::new();
    let mut fixed: Vec<(i64, u64)> = Vec::new();
    let mut unknown = UnknownTags::new(reading.skip_unknown);
    let mut text = Text::new(bytes, path);
    while let Some(mut line) = text.record() {
        let word = line.word().unwrap_or_default();
        let Some((record, space)) = read_tag(word) else {
            unknown.take(word, &line)?;
            continue;
        };
        match (record, space) {
            // Of parameters, only offsets of sensors in space are used.
            (Record::Parameter, _) => {}
            (Record::Offset, _) => se3.offset(line)?,
            (Record::Fix, _) => {
                fixed.push((line.integer("vertex id")?, line.line_number()));
                while !line.is_at_end() {
                    fixed.push((line.integer("vertex id")?, line.line_number()));
                }
            }
            (_, Space::Plane) if !se3.is_empty() => return Err(mixed(&line, word, "3D")),
            (_, Space::Solid) if !se2.is_empty() => return Err(mixed(&line, word, "2D")),
            (record, Space::Plane) => se2.record(record, line)?,
            (record, Space::Solid) => se3.record(record, line)?,
        }
    }
    let (graph, mut changes) = if !se2.is_empty() {
        let (file, changes) = se2.finish::<3>(fixed, path, reading.indefinite)?;
        (G2oGraph::Se2(file), changes)
    } else if !se3.is_empty() {
        let (file, changes) = se3.finish::<6>(fixed, path, reading.indefinite)?;
        (G2oGraph::Se3(file), changes)
    } else {
        return Err(IoError::Empty { path: path.to_owned(), what: "vertex or edge" });
    };
    changes.skipped = unknown.skipped();
    Ok((graph, changes))
}

fn mixed(line: &Line<'_>, tag: &[u8], kind: &'static str) -> IoError {
    IoError::MixedKinds { location: line.location(), kind, found: excerpt(tag) }
}

impl<const P: usize, const U: usize> Builder<P, U> {
    const SPACE: Space = if P == 3 { Space::Plane } else { Space::Solid };

    fn new() -> Self {
        Self {
            file: G2oFile::default(),
            edge_lines: Vec::new(),
            sighting_lines: Vec::new(),
            pose_prior_lines: Vec::new(),
            position_prior_lines: Vec::new(),
            poses: BTreeSet::new(),
            points: BTreeSet::new(),
            changes: G2oChanges::default(),
        }
    }

    /// Whether there is neither a pose nor anything that measures one.
    fn is_empty(&self) -> bool {
        let file = &self.file;
        file.vertices.is_empty()
            && file.edges.is_empty()
            && file.points.is_empty()
            && file.sightings.is_empty()
            && file.pose_priors.is_empty()
            && file.position_priors.is_empty()
    }

    fn record(&mut self, record: Record, line: Line<'_>) -> Result<(), IoError> {
        match record {
            Record::Pose => self.vertex(line, Self::pose),
            Record::ToroPose => self.vertex(line, toro::pose),
            Record::Point => self.point(line),
            Record::Edge => self.edge(line, Self::pose, Self::upper_triangle),
            Record::ToroEdge => self.edge(line, toro::pose, toro::information),
            Record::Position => self.position(line),
            Record::Bearing => self.bearing(line),
            Record::PosePrior => self.pose_prior(line),
            Record::PositionPrior => self.position_prior(line, false),
            Record::PositionPriorWithOffset => self.position_prior(line, true),
            // These belong to no group.
            Record::Offset | Record::Fix | Record::Parameter => Ok(()),
        }
    }

    fn new_id(&mut self, id: i64, is_point: bool, location: Location) -> Result<(), IoError> {
        let (own, other) = match is_point {
            true => (&mut self.points, &self.poses),
            false => (&mut self.poses, &self.points),
        };
        if other.contains(&id) || !own.insert(id) {
            return Err(IoError::DuplicateId { location, field: "vertex", id: id.into() });
        }
        Ok(())
    }

    /// A pose as g2o writes it.
    fn pose(line: &mut Line<'_>, field: &str) -> Result<[f64; P], IoError> {
        line.numbers(field)
    }

    /// An information matrix as g2o writes it.
    fn upper_triangle(line: &mut Line<'_>) -> Result<[f64; U], IoError> {
        line.numbers("information")
    }

    fn vertex(
        &mut self,
        mut line: Line<'_>,
        pose: impl Fn(&mut Line<'_>, &str) -> Result<[f64; P], IoError>,
    ) -> Result<(), IoError> {
        let id: i64 = line.integer("vertex id")?;
        let mut pose = pose(&mut line, "pose")?;
        self.normalize(&mut pose, &line)?;
        let location = line.location();
        line.end()?;
        self.new_id(id, false, location)?;
        self.file.vertices.push(G2oVertex { id, pose });
        Ok(())
    }

    fn point(&mut self, mut line: Line<'_>) -> Result<(), IoError> {
        let id: i64 = line.integer("vertex id")?;
        let position = position(&mut line, "position", Self::SPACE)?;
        let location = line.location();
        line.end()?;
        self.new_id(id, true, location)?;
        self.file.points.push(G2oPoint { id, position });
        Ok(())
    }

    fn offset(&mut self, mut line: Line<'_>) -> Result<(), IoError> {
        let id: i64 = line.integer("parameter id")?;
        let mut pose_from_sensor = line.numbers("offset")?;
        self.normalize(&mut pose_from_sensor, &line)?;
        let location = line.location();
        line.end()?;
        if self.file.offsets.iter().any(|offset| offset.id == id) {
            return Err(IoError::DuplicateId { location, field: "parameter", id: id.into() });
        }
        self.file.offsets.push(G2oOffset { id, pose_from_sensor });
        Ok(())
    }

    fn edge(
        &mut self,
        mut line: Line<'_>,
        pose: impl Fn(&mut Line<'_>, &str) -> Result<[f64; P], IoError>,
        information: impl Fn(&mut Line<'_>) -> Result<[f64; U], IoError>,
    ) -> Result<(), IoError> {
        let i: i64 = line.integer("vertex i")?;
        let j: i64 = line.integer("vertex j")?;
        let mut i_from_j = pose(&mut line, "measurement")?;
        let information = information(&mut line)?;
        if i == j {
            ChangedLines::note(&mut self.changes.self_edges, &line);
            return line.end();
        }
        self.normalize(&mut i_from_j, &line)?;
        self.edge_lines.push(line.line_number());
        line.end()?;
        self.file.edges.push(G2oEdge { i, j, i_from_j, information });
        Ok(())
    }

    fn position(&mut self, mut line: Line<'_>) -> Result<(), IoError> {
        let pose: i64 = line.integer("vertex i")?;
        let point: i64 = line.integer("vertex j")?;
        let offset = match Self::SPACE {
            Space::Plane => None,
            Space::Solid => Some(line.integer("parameter id")?),
        };
        let measured = position(&mut line, "measurement", Self::SPACE)?;
        let information = information(&mut line, Self::SPACE)?;
        self.sighting_lines.push(line.line_number());
        line.end()?;
        let measured = G2oMeasured::Position(measured);
        self.file.sightings.push(G2oSighting { pose, point, offset, measured, information });
        Ok(())
    }

    fn bearing(&mut self, mut line: Line<'_>) -> Result<(), IoError> {
        let pose: i64 = line.integer("vertex i")?;
        let point: i64 = line.integer("vertex j")?;
        let measured = G2oMeasured::Bearing(line.number("measurement[0]")?);
        let mut information = [0.0; 6];
        information[0] = line.number("information[0]")?;
        self.sighting_lines.push(line.line_number());
        line.end()?;
        self.file.sightings.push(G2oSighting { pose, point, offset: None, measured, information });
        Ok(())
    }

    fn pose_prior(&mut self, mut line: Line<'_>) -> Result<(), IoError> {
        let id: i64 = line.integer("vertex")?;
        let offset = match Self::SPACE {
            Space::Plane => None,
            Space::Solid => Some(line.integer("parameter id")?),
        };
        let mut world_from_sensor = line.numbers("measurement")?;
        let information = line.numbers("information")?;
        self.normalize(&mut world_from_sensor, &line)?;
        self.pose_prior_lines.push(line.line_number());
        line.end()?;
        self.file.pose_priors.push(G2oPosePrior { id, offset, world_from_sensor, information });
        Ok(())
    }

    fn position_prior(&mut self, mut line: Line<'_>, has_offset: bool) -> Result<(), IoError> {
        let id: i64 = line.integer("vertex")?;
        let offset = has_offset.then(|| line.integer("parameter id")).transpose()?;
        let position = position(&mut line, "measurement", Self::SPACE)?;
        let information = information(&mut line, Self::SPACE)?;
        self.position_prior_lines.push(line.line_number());
        line.end()?;
        self.file.position_priors.push(G2oPositionPrior { id, offset, position, information });
        Ok(())
    }

    /// Gives the quaternion of a 3D pose norm 1, unless rounding alone keeps it from that.
    fn normalize(&mut self, pose: &mut [f64; P], line: &Line<'_>) -> Result<(), IoError> {
        let quaternion = pose.get_mut(3..).and_then(|q| q.first_chunk_mut::<4>());
        if let Some(quaternion) = quaternion
            && let Some(new) = normalized(quaternion, || line.location())?
        {
            *quaternion = new;
            ChangedLines::note(&mut self.changes.normalized, line);
        }
        Ok(())
    }

    /// The checks that need the whole file; `N` is the tangent's dimension.
    fn finish<const N: usize>(
        mut self,
        fixed: Vec<(i64, u64)>,
        path: &Path,
        indefinite: Indefinite,
    ) -> Result<(G2oFile<P, U>, G2oChanges), IoError> {
        if !self.file.has_vertices() {
            self.take_ids_of_edges(path)?;
        }
        self.check_references(&fixed, path)?;
        self.changes.repaired = self.check_information::<N>(path, indefinite)?;
        self.file.fixed = fixed.into_iter().map(|(id, _)| id).collect();
        Ok((self.file, self.changes))
    }

    /// In a file without poses, these are what its edges name, and so are landmarks whose position was
    /// measured.
    fn take_ids_of_edges(&mut self, path: &Path) -> Result<(), IoError> {
        let file = &self.file;
        self.poses.extend(file.edges.iter().flat_map(|edge| [edge.i, edge.j]));
        self.poses.extend(file.sightings.iter().map(|sighting| sighting.pose));
        self.poses.extend(file.pose_priors.iter().map(|prior| prior.id));
        for (sighting, &line) in file.sightings.iter().zip(&self.sighting_lines) {
            if self.poses.contains(&sighting.point) {
                let (location, id) = (Location::line(path, line), sighting.point.into());
                return Err(IoError::DuplicateId { location, field: "vertex", id });
            }
            if matches!(sighting.measured, G2oMeasured::Position(_)) {
                self.points.insert(sighting.point);
            }
        }
        Ok(())
    }

    /// Refuses the first record, by its kind and then its line, that names what is not there.
    fn check_references(&self, fixed: &[(i64, u64)], path: &Path) -> Result<(), IoError> {
        let file = &self.file;
        let unknown = |field: &'static str, id: i64, line: u64| {
            let location = Location::line(path, line);
            Err(IoError::UnknownId { location, field, id: id.into() })
        };
        let pose = |id: i64, line: u64| match self.poses.contains(&id) {
            true => Ok(()),
            false if self.points.contains(&id) => unknown("pose", id, line),
            false => unknown("vertex", id, line),
        };
        let offset = |id: Option<i64>, line: u64| match id {
            Some(id) if !file.offsets.iter().any(|offset| offset.id == id) => {
                unknown("parameter", id, line)
            }
            Some(_) | None => Ok(()),
        };
        for (edge, &line) in file.edges.iter().zip(&self.edge_lines) {
            pose(edge.i, line)?;
            pose(edge.j, line)?;
        }
        for (sighting, &line) in file.sightings.iter().zip(&self.sighting_lines) {
            pose(sighting.pose, line)?;
            if !self.points.contains(&sighting.point) {
                return unknown("landmark", sighting.point, line);
            }
            offset(sighting.offset, line)?;
        }
        for (prior, &line) in file.pose_priors.iter().zip(&self.pose_prior_lines) {
            pose(prior.id, line)?;
            offset(prior.offset, line)?;
        }
        let positions = file.position_priors.iter().zip(&self.position_prior_lines);
        let on_position = positions.map(|(prior, &line)| (prior.id, line));
        for (id, line) in on_position.chain(fixed.iter().copied()) {
            if !self.poses.contains(&id) && !self.points.contains(&id) {
                return unknown("vertex", id, line);
            }
        }
        Ok(())
    }

    /// Refuses or repairs information matrices with negative eigenvalues.
    fn check_information<const N: usize>(
        &mut self,
        path: &Path,
        indefinite: Indefinite,
    ) -> Result<Option<RepairedEdges>, IoError> {
        let mut check = Check { path, indefinite, count: 0, first: None };
        for (edge, &line) in self.file.edges.iter_mut().zip(&self.edge_lines) {
            check.matrix::<N, U>(&mut edge.information, line, (edge.i, edge.j))?;
        }
        for (seen, &line) in self.file.sightings.iter_mut().zip(&self.sighting_lines) {
            check.matrix::<3, 6>(&mut seen.information, line, (seen.pose, seen.point))?;
        }
        for (prior, &line) in self.file.pose_priors.iter_mut().zip(&self.pose_prior_lines) {
            check.matrix::<N, U>(&mut prior.information, line, (prior.id, prior.id))?;
        }
        for (prior, &line) in self.file.position_priors.iter_mut().zip(&self.position_prior_lines) {
            check.matrix::<3, 6>(&mut prior.information, line, (prior.id, prior.id))?;
        }
        check.finish()
    }
}

/// The check of all information matrices.
struct Check<'a> {
    path: &'a Path,
    indefinite: Indefinite,
    count: usize,
    first: Option<(InformationError, u64, (i64, i64))>,
}

impl Check<'_> {
    fn matrix<const N: usize, const U: usize>(
        &mut self,
        upper: &mut [f64; U],
        line: u64,
        ends: (i64, i64),
    ) -> Result<(), IoError> {
        let matrix = symmetric::<N, U>(upper);
        let Err(error) = Information::semidefinite(&matrix) else { return Ok(()) };
        self.count += 1;
        self.first.get_or_insert((error, line, ends));
        if self.indefinite == Indefinite::Repair {
            let refuse = |error| refused(error, Location::line(self.path, line), ends, 1);
            *upper = upper_triangle(Information::nearest(&matrix).map_err(refuse)?.matrix());
        }
        Ok(())
    }

    fn finish(self) -> Result<Option<RepairedEdges>, IoError> {
        let Self { path, indefinite, count, first } = self;
        match (first, indefinite) {
            (None, _) => Ok(None),
            (
                Some((InformationError::Indefinite { smallest_eigenvalue }, first_line, (i, j))),
                Indefinite::Repair,
            ) => Ok(Some(RepairedEdges { count, first_line, i, j, smallest_eigenvalue })),
            (Some((error, line, ends)), _) => {
                Err(refused(error, Location::line(path, line), ends, count))
            }
        }
    }
}

/// A position in the plane or in space.
fn position(line: &mut Line<'_>, field: &str, space: Space) -> Result<[f64; 3], IoError> {
    match space {
        Space::Plane => line.numbers::<2>(field).map(|[x, y]| [x, y, 0.0]),
        Space::Solid => line.numbers(field),
    }
}

/// The upper triangle of the information matrix of a position.
fn information(line: &mut Line<'_>, space: Space) -> Result<[f64; 6], IoError> {
    match space {
        Space::Plane => {
            let mut upper = [0.0; 6];
            let entries = line.numbers::<3>("information")?;
            PLANE.into_iter().zip(entries).for_each(|(at, entry)| upper[at] = entry);
            Ok(upper)
        }
        Space::Solid => line.numbers("information"),
    }
}
