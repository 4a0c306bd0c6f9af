//! PLY export: colored points and polylines (trajectories, camera centers) for viewers.
//!
//! Positions are written as doubles in the world frame, meters; colors as 8-bit RGB; polylines as
//! the `edge` element. Covis writes PLY, it does not read it.

use std::path::Path;

use nalgebra::Vector3;

use super::text::TextWriter;
use super::{IoError, files};

/// How the numbers are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PlyEncoding {
    /// Text that a person can read.
    Ascii,
    /// Little-endian binary.
    #[default]
    Binary,
}

/// A point with its color.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlyVertex {
    /// Position in the world frame, in meters.
    pub position: Vector3<f64>,
    /// Red, green, blue.
    pub color: [u8; 3],
}

/// Points and line segments between them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlyFile {
    /// The points.
    pub vertices: Vec<PlyVertex>,
    /// Segments as pairs of indices into `vertices`.
    pub edges: Vec<[u32; 2]>,
}

impl PlyFile {
    /// Appends points of one color.
    pub fn push_points<'a>(
        &mut self,
        points: impl IntoIterator<Item = &'a Vector3<f64>>,
        color: [u8; 3],
    ) {
        self.vertices.extend(points.into_iter().map(|&position| PlyVertex { position, color }));
    }

    /// Appends a polyline of one color: its points and the segments between neighbors.
    pub fn push_polyline<'a>(
        &mut self,
        points: impl IntoIterator<Item = &'a Vector3<f64>>,
        color: [u8; 3],
    ) {
        let first = self.vertices.len();
        self.push_points(points, color);
        let last = self.vertices.len().saturating_sub(1);
        self.edges.extend((first..last).map(|k| [k as u32, k as u32 + 1]));
    }

    /// Writes the file.
    ///
    /// # Errors
    /// [`IoError::Write`].
    pub fn write(&self, path: &Path, encoding: PlyEncoding) -> Result<(), IoError> {
        files::write(path, &self.to_bytes(encoding))
    }

    /// The file's bytes.
    #[must_use]
    pub fn to_bytes(&self, encoding: PlyEncoding) -> Vec<u8> {
        let mut bytes = Vec::new();
        encoding.put_head(self.vertices.len(), self.edges.len(), &mut bytes);
        self.vertices.iter().for_each(|vertex| encoding.put_vertex(vertex, &mut bytes));
        self.edges.iter().for_each(|&edge| encoding.put_edge(edge, &mut bytes));
        bytes
    }
}

/// The parts of a file in their order, for a caller that does not hold all of it.
impl PlyEncoding {
    /// Appends what stands before `vertices` points and `edges` segments.
    pub fn put_head(self, vertices: usize, edges: usize, out: &mut Vec<u8>) {
        let format = match self {
            Self::Ascii => "ascii",
            Self::Binary => "binary_little_endian",
        };
        TextWriter::append(out, |text| {
            text.put(format_args!("ply\nformat {format} 1.0\ncomment covis\n"));
            text.put(format_args!("element vertex {vertices}\n"));
            text.put("property double x\nproperty double y\nproperty double z\n");
            text.put("property uchar red\nproperty uchar green\nproperty uchar blue\n");
            if edges > 0 {
                text.put(format_args!("element edge {edges}\n"));
                text.put("property int vertex1\nproperty int vertex2\n");
            }
            text.put("end_header\n");
        });
    }

    /// Appends a point.
    pub fn put_vertex(self, vertex: &PlyVertex, out: &mut Vec<u8>) {
        let PlyVertex { position: p, color } = vertex;
        match self {
            Self::Ascii => TextWriter::append(out, |text| {
                let [r, g, b] = color;
                text.put(format_args!("{:?} {:?} {:?} {r} {g} {b}\n", p.x, p.y, p.z));
            }),
            Self::Binary => {
                p.iter().for_each(|number| out.extend(number.to_le_bytes()));
                out.extend(color);
            }
        }
    }

    /// Appends a segment between two points, by their numbers from 0.
    pub fn put_edge(self, [a, b]: [u32; 2], out: &mut Vec<u8>) {
        match self {
            Self::Ascii => {
                TextWriter::append(out, |text| text.put(format_args!("{a} {b}\n")));
            }
            Self::Binary => [a, b].iter().for_each(|index| out.extend(index.to_le_bytes())),
        }
    }
}
