//! PLY export: the header announces exactly what follows.

use covis_solvers::io::ply::{PlyEncoding, PlyFile};
use nalgebra::Vector3;

fn cloud() -> PlyFile {
    let mut file = PlyFile::default();
    file.push_points(&[Vector3::new(1.0, 2.5, -3.0)], [255, 0, 7]);
    file.push_polyline(&[Vector3::zeros(), Vector3::x(), Vector3::y()], [0, 255, 0]);
    file.push_polyline(&[], [0; 3]);
    file
}

#[test]
fn ascii_lists_points_and_segments() {
    let text = String::from_utf8(cloud().to_bytes(PlyEncoding::Ascii)).unwrap();
    let (header, body) = text.split_once("end_header\n").unwrap();
    assert!(header.starts_with("ply\nformat ascii 1.0\n"));
    assert!(header.contains("element vertex 4\n") && header.contains("element edge 2\n"));
    let lines: Vec<&str> = body.lines().collect();
    assert_eq!(lines[0], "1.0 2.5 -3.0 255 0 7");
    assert_eq!(lines[4..], ["1 2", "2 3"]);
}

#[test]
fn binary_has_the_announced_length() {
    let bytes = cloud().to_bytes(PlyEncoding::Binary);
    let marker = b"end_header\n";
    let start = bytes.windows(marker.len()).position(|w| w == marker).unwrap() + marker.len();
    assert_eq!(bytes.len() - start, 4 * 27 + 2 * 8);
    assert_eq!(bytes[start + 8..start + 16], 2.5f64.to_le_bytes());
    assert_eq!(bytes[start + 24..start + 27], [255, 0, 7]);
    let mut points = PlyFile::default();
    points.push_points(&[Vector3::zeros()], [1, 2, 3]);
    let header = String::from_utf8_lossy(&points.to_bytes(PlyEncoding::Binary)).into_owned();
    assert!(!header.contains("element edge"));
}
