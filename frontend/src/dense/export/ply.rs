//! PLY, binary little endian: vertices with normals and colors, with or without faces.
//!
//! Positions are in the mesh's frame, meters.

use std::fmt::Write as _;

use super::super::surface::Mesh;

/// Bytes of a vertex: six floats and three colors.
const VERTEX: usize = 27;
/// Bytes of a face: the number of corners, and their indices.
const FACE: usize = 13;

/// The bytes of a mesh.
#[must_use]
pub fn ply(mesh: &Mesh) -> Vec<u8> {
    let faces = mesh.triangles.len();
    let mut bytes = vertices(mesh, Some(faces), FACE * faces);
    for triangle in &mesh.triangles {
        let mut face = [3; FACE];
        for (bytes, index) in face[1..].chunks_exact_mut(4).zip(triangle) {
            bytes.copy_from_slice(&index.to_le_bytes());
        }
        bytes.extend_from_slice(&face);
    }
    bytes
}

/// The bytes of a mesh's vertices alone: a point cloud.
#[must_use]
pub fn point_cloud_ply(mesh: &Mesh) -> Vec<u8> {
    vertices(mesh, None, 0)
}

/// The header and the vertices, with room for what follows.
fn vertices(mesh: &Mesh, faces: Option<usize>, room: usize) -> Vec<u8> {
    let mut header = String::from("ply\nformat binary_little_endian 1.0\ncomment covis, meters\n");
    // Writing to a string does not fail.
    let _ = writeln!(header, "element vertex {}", mesh.positions.len());
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        let _ = writeln!(header, "property float {name}");
    }
    header += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    if let Some(faces) = faces {
        let _ = writeln!(header, "element face {faces}\nproperty list uchar uint vertex_indices");
    }
    header += "end_header\n";
    let mut bytes = Vec::with_capacity(header.len() + VERTEX * mesh.positions.len() + room);
    bytes.extend_from_slice(header.as_bytes());
    for ((position, normal), color) in mesh.positions.iter().zip(&mesh.normals).zip(&mesh.colors) {
        let mut vertex = [0; VERTEX];
        for (bytes, number) in vertex.chunks_exact_mut(4).zip(position.iter().chain(normal)) {
            bytes.copy_from_slice(&number.to_le_bytes());
        }
        vertex[24..].copy_from_slice(color);
        bytes.extend_from_slice(&vertex);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::super::super::surface::{SurfaceOptions, extract};
    use super::super::super::testing::{CENTIMETER, sphere, volume};
    use super::*;

    /// Reads a PLY of floats, uchars and lists of three as its header tells, and nothing else.
    fn read(bytes: &[u8]) -> Mesh {
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&bytes[..end]).unwrap();
        let mut lines = header.lines();
        assert_eq!(lines.next(), Some("ply"));
        assert_eq!(lines.next(), Some("format binary_little_endian 1.0"));
        let mut at = end;
        let mut mesh = Mesh::default();
        let elements: Vec<Vec<&str>> = lines.map(|line| line.split(' ').collect()).collect();
        for (i, element) in elements.iter().enumerate().filter(|(_, e)| e[0] == "element") {
            let properties: Vec<_> =
                elements[i + 1..].iter().take_while(|e| e[0] == "property").collect();
            for _ in 0..element[2].parse().unwrap() {
                let (mut floats, mut uchars) = (vec![], vec![]);
                for property in &properties {
                    let mut take = |n: usize| {
                        at += n;
                        &bytes[at - n..at]
                    };
                    match property[1] {
                        "float" => floats.push(f32::from_le_bytes(take(4).try_into().unwrap())),
                        "uchar" => uchars.push(take(1)[0]),
                        "list" => {
                            assert_eq!(property[2..], ["uchar", "uint", "vertex_indices"]);
                            assert_eq!(take(1), [3]);
                            let mut index = || u32::from_le_bytes(take(4).try_into().unwrap());
                            mesh.triangles.push([index(), index(), index()]);
                        }
                        other => panic!("a property of type {other}"),
                    }
                }
                if element[1] == "vertex" {
                    mesh.positions.push(floats[..3].try_into().unwrap());
                    mesh.normals.push(floats[3..].try_into().unwrap());
                    mesh.colors.push(uchars[..].try_into().unwrap());
                }
            }
        }
        assert_eq!(at, bytes.len());
        mesh
    }

    #[test]
    fn what_is_read_back_is_what_was_written() {
        let ball = |p| Some((sphere(p, [0.0; 3], 0.05), 1.0, [1, 2, 250]));
        let mesh = extract(&volume(CENTIMETER, [-1; 3], [0; 3], ball), SurfaceOptions::default());
        assert!(mesh.triangles.len() > 100);
        assert_eq!(read(&ply(&mesh)), mesh);
        let points = Mesh { triangles: vec![], ..mesh };
        assert_eq!(read(&point_cloud_ply(&points)), points);
        assert_eq!(read(&ply(&Mesh::default())), Mesh::default());
    }
}
