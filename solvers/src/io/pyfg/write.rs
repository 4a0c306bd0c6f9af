//! pyfg out: vertices, priors, edges, ranges, in the order in which PyFactorGraph writes them.
//!
//! Numbers have 17 significant digits, times those of the file. It checks nothing.

use std::path::Path;

use super::super::symmetric::PLANE;
use super::super::text::TextWriter;
use super::super::{IoError, files};
use super::PyfgFile;
use super::parse::{EDGE, LANDMARK, LANDMARK_PRIOR, POSE, POSE_PRIOR, RANGE, SIGHTING};

impl<const P: usize, const U: usize> PyfgFile<P, U> {
    /// Dimension of space.
    pub(super) const SPACE: usize = if P == 3 { 2 } else { 3 };

    /// Index of the tags.
    const KIND: usize = Self::SPACE - 2;

    /// Writes the file with 17 significant digits: reading it gives the same numbers, names and times.
    ///
    /// # Errors
    /// [`IoError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), IoError> {
        files::write(path, &self.to_bytes())
    }

    /// The file's bytes.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut text = TextWriter::default();
        let mut put = |head: std::fmt::Arguments<'_>, numbers: &[&[f64]]| {
            text.put(head);
            numbers.iter().for_each(|numbers| text.put_numbers(numbers));
            text.end_line();
        };
        let kind = Self::KIND;
        for pose in &self.poses {
            put(format_args!("{} {} {}", POSE[kind], pose.time, pose.name), &[&pose.pose]);
        }
        for landmark in &self.landmarks {
            let numbers = &landmark.position[..Self::SPACE];
            put(format_args!("{} {}", LANDMARK[kind], landmark.name), &[numbers]);
        }
        for prior in &self.pose_priors {
            let head = format_args!("{} {} {}", POSE_PRIOR[kind], prior.time, prior.name);
            put(head, &[&prior.world_from_pose, &prior.covariance]);
        }
        for prior in &self.landmark_priors {
            let head = format_args!("{} {} {}", LANDMARK_PRIOR[kind], prior.time, prior.name);
            let covariance = Self::of_position(&prior.covariance);
            put(head, &[&prior.position[..Self::SPACE], &covariance]);
        }
        for edge in &self.edges {
            let head = format_args!("{} {} {} {}", EDGE[kind], edge.time, edge.i, edge.j);
            put(head, &[&edge.i_from_j, &edge.covariance]);
        }
        for seen in &self.sightings {
            let tag = SIGHTING[kind];
            let head = format_args!("{tag} {} {} {}", seen.time, seen.pose, seen.landmark);
            let covariance = Self::of_position(&seen.covariance);
            put(head, &[&seen.position[..Self::SPACE], &covariance]);
        }
        for range in &self.ranges {
            let [a, b] = range.ends;
            put(
                format_args!("{RANGE} {} {a} {b}", range.time),
                &[&[range.distance_m, range.variance]],
            );
        }
        text.into_bytes()
    }

    /// The entries that the space has of the covariance of a position.
    fn of_position(upper: &[f64; 6]) -> Vec<f64> {
        match Self::SPACE {
            2 => PLANE.iter().map(|&at| upper[at]).collect(),
            _ => upper.to_vec(),
        }
    }
}
