//! g2o out: offsets, vertices, landmarks, `FIX` lines, edges, measurements, priors, 17 significant digits.
//!
//! It checks nothing.

use std::path::Path;

use super::super::symmetric::PLANE;
use super::super::text::TextWriter;
use super::super::{IoError, files};
use super::tags::{
    BEARING, OFFSET, POINT, POSE_PRIOR, POSITION, POSITION_PRIOR, POSITION_PRIOR_WITH_OFFSET,
};
use super::{
    G2oEdge, G2oFile, G2oMeasured, G2oPoint, G2oPosePrior, G2oPositionPrior, G2oSe2, G2oSighting,
    G2oVertex,
};

impl<const P: usize, const U: usize> G2oFile<P, U> {
    /// Writes the file with 17 significant digits: reading it gives the same numbers.
    ///
    /// # Errors
    /// [`IoError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), IoError> {
        files::write(path, &self.to_bytes())
    }

    /// The file's bytes.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        for offset in &self.offsets {
            let numbers = &offset.pose_from_sensor;
            put_line(&mut bytes, format_args!("{OFFSET} {}", offset.id), &[numbers]);
        }
        self.vertices.iter().for_each(|vertex| Self::put_vertex(vertex, &mut bytes));
        self.points.iter().for_each(|point| Self::put_point(point, &mut bytes));
        self.fixed.iter().for_each(|&id| Self::put_fixed(id, &mut bytes));
        self.edges.iter().for_each(|edge| Self::put_edge(edge, &mut bytes));
        self.sightings.iter().for_each(|sighting| Self::put_sighting(sighting, &mut bytes));
        self.pose_priors.iter().for_each(|prior| Self::put_pose_prior(prior, &mut bytes));
        self.position_priors.iter().for_each(|prior| Self::put_position_prior(prior, &mut bytes));
        bytes
    }

    /// Appends the line of a vertex, for a caller that does not hold all of a file.
    pub fn put_vertex(vertex: &G2oVertex<P>, out: &mut Vec<u8>) {
        let head = format_args!("VERTEX_{} {}", Self::SUFFIX, vertex.id);
        put_line(out, head, &[&vertex.pose]);
    }

    /// Appends the line that holds a vertex.
    pub fn put_fixed(id: i64, out: &mut Vec<u8>) {
        TextWriter::append(out, |text| text.put(format_args!("FIX {id}\n")));
    }

    /// Appends the line of an edge.
    pub fn put_edge(edge: &G2oEdge<P, U>, out: &mut Vec<u8>) {
        let head = format_args!("EDGE_{} {} {}", Self::SUFFIX, edge.i, edge.j);
        put_line(out, head, &[&edge.i_from_j, &edge.information]);
    }

    fn put_point(point: &G2oPoint, out: &mut Vec<u8>) {
        let head = format_args!("{} {}", POINT[Self::KIND], point.id);
        put_line(out, head, &[&point.position[..Self::SPACE]]);
    }

    fn put_sighting(sighting: &G2oSighting, out: &mut Vec<u8>) {
        let G2oSighting { pose, point, offset, .. } = sighting;
        let offset = offset.map(|id| format!(" {id}")).unwrap_or_default();
        match sighting.measured {
            G2oMeasured::Position(z) => {
                let tag = POSITION[Self::KIND];
                let information = Self::of_position(&sighting.information);
                let numbers = [&z[..Self::SPACE], &information];
                put_line(out, format_args!("{tag} {pose} {point}{offset}"), &numbers);
            }
            G2oMeasured::Bearing(z) => {
                let numbers: [&[f64]; 2] = [&[z], &sighting.information[..1]];
                put_line(out, format_args!("{BEARING} {pose} {point}"), &numbers);
            }
        }
    }

    fn put_pose_prior(prior: &G2oPosePrior<P, U>, out: &mut Vec<u8>) {
        let offset = prior.offset.map(|id| format!(" {id}")).unwrap_or_default();
        let head = format_args!("{} {}{offset}", POSE_PRIOR[Self::KIND], prior.id);
        put_line(out, head, &[&prior.world_from_sensor, &prior.information]);
    }

    fn put_position_prior(prior: &G2oPositionPrior, out: &mut Vec<u8>) {
        let information = Self::of_position(&prior.information);
        let numbers = [&prior.position[..Self::SPACE], &information];
        match prior.offset {
            Some(offset) => {
                let tag = POSITION_PRIOR_WITH_OFFSET;
                put_line(out, format_args!("{tag} {} {offset}", prior.id), &numbers);
            }
            None => {
                let tag = POSITION_PRIOR[Self::KIND];
                put_line(out, format_args!("{tag} {}", prior.id), &numbers);
            }
        }
    }

    /// The entries that the space has of the information of a position.
    fn of_position(upper: &[f64; 6]) -> Vec<f64> {
        match Self::SPACE {
            2 => PLANE.iter().map(|&at| upper[at]).collect(),
            _ => upper.to_vec(),
        }
    }

    /// Numbers that a pose takes.
    pub(super) const POSE_NUMBERS: usize = P;

    /// Dimension of space.
    pub(super) const SPACE: usize = if P == G2oSe2::POSE_NUMBERS { 2 } else { 3 };

    /// Index of the tags.
    const KIND: usize = Self::SPACE - 2;

    /// What the tags of lines end with.
    const SUFFIX: &str = if P == G2oSe2::POSE_NUMBERS { "SE2" } else { "SE3:QUAT" };
}

/// A line: its head, then numbers.
fn put_line(out: &mut Vec<u8>, head: std::fmt::Arguments<'_>, numbers: &[&[f64]]) {
    TextWriter::append(out, |text| {
        text.put(head);
        numbers.iter().for_each(|numbers| text.put_numbers(numbers));
        text.end_line();
    });
}
