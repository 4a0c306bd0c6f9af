//! pyfg in: one pass over the lines, then the check that every name has a vertex.
//!
//! Lines are remembered during the parse only, so that a refusal names them. Numbers stay those of the file.

use std::collections::BTreeSet;
use std::path::Path;

use super::super::changed_lines::UnknownTags;
use super::super::error::excerpt;
use super::super::rotation::check_norm;
use super::super::symmetric::PLANE;
use super::super::text::{Line, Text};
use super::super::{IoError, Location, files};
use super::convert::{information, position_information, precision};
use super::{
    PyfgEdge, PyfgFile, PyfgGraph, PyfgLandmark, PyfgLandmarkPrior, PyfgName, PyfgPose,
    PyfgPosePrior, PyfgRange, PyfgRead, PyfgSighting, PyfgTime,
};

// Tags in the plane and in space.
pub(super) const POSE: [&str; 2] = ["VERTEX_SE2", "VERTEX_SE3:QUAT"];
pub(super) const LANDMARK: [&str; 2] = ["VERTEX_XY", "VERTEX_XYZ"];
pub(super) const POSE_PRIOR: [&str; 2] = ["VERTEX_SE2:PRIOR", "VERTEX_SE3:QUAT:PRIOR"];
pub(super) const LANDMARK_PRIOR: [&str; 2] = ["VERTEX_XY:PRIOR", "VERTEX_XYZ:PRIOR"];
pub(super) const EDGE: [&str; 2] = ["EDGE_SE2", "EDGE_SE3:QUAT"];
pub(super) const SIGHTING: [&str; 2] = ["EDGE_SE2_XY", "EDGE_SE3_XYZ"];
/// The tag of a range, which is the same in both.
pub(super) const RANGE: &str = "EDGE_RANGE";

/// What a line holds.
#[derive(Clone, Copy, Debug)]
enum Record {
    Pose,
    Landmark,
    PosePrior,
    LandmarkPrior,
    Edge,
    Sighting,
}

const RECORDS: [([&str; 2], Record); 6] = [
    (POSE, Record::Pose),
    (LANDMARK, Record::Landmark),
    (POSE_PRIOR, Record::PosePrior),
    (LANDMARK_PRIOR, Record::LandmarkPrior),
    (EDGE, Record::Edge),
    (SIGHTING, Record::Sighting),
];

/// The record that a tag begins, and whether it is one of space.
fn read_tag(tag: &[u8]) -> Option<(Record, bool)> {
    RECORDS.iter().find_map(|(tags, record)| {
        let kind = tags.iter().position(|name| name.as_bytes() == tag)?;
        Some((*record, kind == 1))
    })
}

/// What a name must be the name of.
#[derive(Clone, Copy, Debug)]
enum Wanted {
    Pose,
    Landmark,
    Either,
}

/// A name in a record that is no vertex.
struct Named {
    name: PyfgName,
    wanted: Wanted,
    line: u64,
}

/// A file that is being read; `N` is the dimension of the tangent.
struct Builder<const N: usize, const P: usize, const U: usize> {
    file: PyfgFile<P, U>,
    poses: BTreeSet<PyfgName>,
    landmarks: BTreeSet<PyfgName>,
    named: Vec<Named>,
    is_empty: bool,
}

/// The file, and what was skipped.
pub(super) fn parse(bytes: &[u8], path: &Path, skip_unknown: bool) -> Result<PyfgRead, IoError> {
    files::check_lines(bytes, path)?;
    let mut plane = Builder::<3, 3, 6>::new();
    let mut space = Builder::<6, 7, 21>::new();
    // Their tag does not say in which space they are.
    let (mut ranges, mut ends) = (Vec::new(), Vec::new());
    let mut unknown = UnknownTags::new(skip_unknown);
    let mut text = Text::new(bytes, path);
    while let Some(mut line) = text.record() {
        let tag = line.word().unwrap_or_default();
        if tag == RANGE.as_bytes() {
            ranges.push(range(line, &mut ends)?);
            continue;
        }
        let mixed = |kind| {
            Err(IoError::MixedKinds { location: line.location(), kind, found: excerpt(tag) })
        };
        match read_tag(tag) {
            None => unknown.take(tag, &line)?,
            Some((_, true)) if !plane.is_empty => return mixed("2D"),
            Some((_, false)) if !space.is_empty => return mixed("3D"),
            Some((record, true)) => space.record(record, line)?,
            Some((record, false)) => plane.record(record, line)?,
        }
    }
    let graph = if !plane.is_empty {
        plane.named.append(&mut ends);
        plane.file.ranges = ranges;
        PyfgGraph::Se2(plane.finish(path)?)
    } else if !space.is_empty {
        space.named.append(&mut ends);
        space.file.ranges = ranges;
        PyfgGraph::Se3(space.finish(path)?)
    } else {
        return Err(IoError::Empty { path: path.to_owned(), what: "vertex" });
    };
    Ok((graph, unknown.skipped()))
}

/// The next word as a time.
fn time(line: &mut Line<'_>) -> Result<PyfgTime, IoError> {
    line.parsed("time")
}

/// The next word as the name of a variable.
fn name(line: &mut Line<'_>, field: &str) -> Result<PyfgName, IoError> {
    line.parsed(field)
}

/// Refuses a record between a variable and itself.
fn check_ends(a: PyfgName, b: PyfgName, line: &Line<'_>) -> Result<(), IoError> {
    if a != b {
        return Ok(());
    }
    let (location, field, name) = (line.location(), "name", a.to_string());
    Err(IoError::Name { location, field, name, reason: "is at both ends" })
}

/// A range; its ends are checked later.
fn range(mut line: Line<'_>, named: &mut Vec<Named>) -> Result<PyfgRange, IoError> {
    let time = time(&mut line)?;
    let ends = [name(&mut line, "name a")?, name(&mut line, "name b")?];
    check_ends(ends[0], ends[1], &line)?;
    let distance_m = line.number("range")?;
    let variance = line.number("variance")?;
    if precision(variance).is_none() {
        return Err(IoError::Covariance { location: line.location(), field: "variance" });
    }
    let number = line.line_number();
    line.end()?;
    named.extend(ends.map(|name| Named { name, wanted: Wanted::Either, line: number }));
    Ok(PyfgRange { time, ends, distance_m, variance })
}

impl<const N: usize, const P: usize, const U: usize> Builder<N, P, U> {
    fn new() -> Self {
        Self {
            file: PyfgFile::default(),
            poses: BTreeSet::new(),
            landmarks: BTreeSet::new(),
            named: Vec::new(),
            is_empty: true,
        }
    }

    fn record(&mut self, record: Record, line: Line<'_>) -> Result<(), IoError> {
        self.is_empty = false;
        match record {
            Record::Pose => self.pose(line),
            Record::Landmark => self.landmark(line),
            Record::PosePrior => self.pose_prior(line),
            Record::LandmarkPrior => self.landmark_prior(line),
            Record::Edge => self.edge(line),
            Record::Sighting => self.sighting(line),
        }
    }

    fn pose(&mut self, mut line: Line<'_>) -> Result<(), IoError> {
        let (time, name) = (time(&mut line)?, name(&mut line, "name")?);
        let pose = Self::pose_numbers(&mut line, "pose")?;
        let location = line.location();
        line.end()?;
        if self.landmarks.contains(&name) || !self.poses.insert(name) {
            return Err(twice(name, location));
        }
        self.file.poses.push(PyfgPose { time, name, pose });
        Ok(())
    }

    fn landmark(&mut self, mut line: Line<'_>) -> Result<(), IoError> {
        let name = name(&mut line, "name")?;
        let position = Self::position(&mut line, "position")?;
        let location = line.location();
        line.end()?;
        if self.poses.contains(&name) || !self.landmarks.insert(name) {
            return Err(twice(name, location));
        }
        self.file.landmarks.push(PyfgLandmark { name, position });
        Ok(())
    }

    fn pose_prior(&mut self, mut line: Line<'_>) -> Result<(), IoError> {
        let (time, name) = (time(&mut line)?, name(&mut line, "name")?);
        let world_from_pose = Self::pose_numbers(&mut line, "measurement")?;
        let covariance = Self::covariance(&mut line)?;
        self.end(line, [(name, Wanted::Pose)])?;
        self.file.pose_priors.push(PyfgPosePrior { time, name, world_from_pose, covariance });
        Ok(())
    }

    fn landmark_prior(&mut self, mut line: Line<'_>) -> Result<(), IoError> {
        let (time, name) = (time(&mut line)?, name(&mut line, "name")?);
        let position = Self::position(&mut line, "measurement")?;
        let covariance = Self::position_covariance(&mut line)?;
        self.end(line, [(name, Wanted::Landmark)])?;
        self.file.landmark_priors.push(PyfgLandmarkPrior { time, name, position, covariance });
        Ok(())
    }

    fn edge(&mut self, mut line: Line<'_>) -> Result<(), IoError> {
        let time = time(&mut line)?;
        let (i, j) = (name(&mut line, "name i")?, name(&mut line, "name j")?);
        check_ends(i, j, &line)?;
        let i_from_j = Self::pose_numbers(&mut line, "measurement")?;
        let covariance = Self::covariance(&mut line)?;
        self.end(line, [(i, Wanted::Pose), (j, Wanted::Pose)])?;
        self.file.edges.push(PyfgEdge { time, i, j, i_from_j, covariance });
        Ok(())
    }

    fn sighting(&mut self, mut line: Line<'_>) -> Result<(), IoError> {
        let time = time(&mut line)?;
        let (pose, landmark) = (name(&mut line, "pose")?, name(&mut line, "landmark")?);
        let position = Self::position(&mut line, "measurement")?;
        let covariance = Self::position_covariance(&mut line)?;
        self.end(line, [(pose, Wanted::Pose), (landmark, Wanted::Landmark)])?;
        self.file.sightings.push(PyfgSighting { time, pose, landmark, position, covariance });
        Ok(())
    }

    /// Ends a line and remembers what it names.
    fn end<const K: usize>(
        &mut self,
        line: Line<'_>,
        names: [(PyfgName, Wanted); K],
    ) -> Result<(), IoError> {
        let number = line.line_number();
        line.end()?;
        let named = names.map(|(name, wanted)| Named { name, wanted, line: number });
        self.named.extend(named);
        Ok(())
    }

    /// A pose, whose quaternion has norm 1.
    fn pose_numbers(line: &mut Line<'_>, field: &str) -> Result<[f64; P], IoError> {
        let pose: [f64; P] = line.numbers(field)?;
        if let Some(quaternion) = pose.get(3..).and_then(|q| q.first_chunk::<4>()) {
            check_norm(quaternion, || line.location())?;
        }
        Ok(pose)
    }

    /// A position in the plane or in space.
    fn position(line: &mut Line<'_>, field: &str) -> Result<[f64; 3], IoError> {
        match PyfgFile::<P, U>::SPACE {
            2 => line.numbers::<2>(field).map(|[x, y]| [x, y, 0.0]),
            _ => line.numbers(field),
        }
    }

    fn covariance(line: &mut Line<'_>) -> Result<[f64; U], IoError> {
        let upper = line.numbers("covariance")?;
        match information::<N, U>(&upper) {
            Some(_) => Ok(upper),
            None => Err(IoError::Covariance { location: line.location(), field: "covariance" }),
        }
    }

    fn position_covariance(line: &mut Line<'_>) -> Result<[f64; 6], IoError> {
        let space = PyfgFile::<P, U>::SPACE;
        let mut upper = [0.0; 6];
        match space {
            2 => {
                let entries = line.numbers::<3>("covariance")?;
                PLANE.into_iter().zip(entries).for_each(|(at, entry)| upper[at] = entry);
            }
            _ => upper = line.numbers("covariance")?,
        }
        match position_information(&upper, space) {
            Some(_) => Ok(upper),
            None => Err(IoError::Covariance { location: line.location(), field: "covariance" }),
        }
    }

    /// Refuses the first record, by its line, that names what is not there.
    fn finish(mut self, path: &Path) -> Result<PyfgFile<P, U>, IoError> {
        self.named.sort_by_key(|named| named.line);
        for Named { name, wanted, line } in self.named {
            let (is_pose, is_landmark) =
                (self.poses.contains(&name), self.landmarks.contains(&name));
            let (field, is_there) = match wanted {
                Wanted::Pose => ("pose", is_pose),
                Wanted::Landmark => ("landmark", is_landmark),
                Wanted::Either => ("pose or landmark", is_pose || is_landmark),
            };
            if !is_there {
                let (location, name) = (Location::line(path, line), name.to_string());
                return Err(IoError::Name { location, field, name, reason: "does not exist" });
            }
        }
        Ok(self.file)
    }
}

fn twice(name: PyfgName, location: Location) -> IoError {
    IoError::Name { location, field: "vertex", name: name.to_string(), reason: "occurs twice" }
}
