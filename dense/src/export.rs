//! Meshes as files that other programs read: PLY and GLB.
//!
//! Files are in the frame of the mesh, meters, except where a format wants its own. Bytes are a
//! function of the mesh alone.

use serde_json::json;

use super::surface::Mesh;

/// Bytes of a vertex in a PLY: six floats and three colors.
const VERTEX: usize = 27;
/// Bytes of a face in a PLY: the number of corners, and their indices.
const FACE: usize = 13;

/// The mesh as PLY, binary little endian: vertices with normals and colors, and faces.
#[must_use]
pub fn ply(mesh: &Mesh) -> Vec<u8> {
    let faces = mesh.triangles.len();
    let mut bytes = vertices(mesh, faces, FACE * faces);
    for triangle in &mesh.triangles {
        let mut face = [3; FACE];
        for (bytes, index) in face[1..].chunks_exact_mut(4).zip(triangle) {
            bytes.copy_from_slice(&index.to_le_bytes());
        }
        bytes.extend_from_slice(&face);
    }
    bytes
}

/// The header and the vertices of a PLY, with room for what follows.
fn vertices(mesh: &Mesh, faces: usize, room: usize) -> Vec<u8> {
    let count = mesh.positions.len();
    let mut header = format!(
        "ply\nformat binary_little_endian 1.0\ncomment covis, meters\nelement vertex {count}\n"
    );
    for name in ["float x", "float y", "float z", "float nx", "float ny", "float nz"] {
        header += &format!("property {name}\n");
    }
    header += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    header += &format!("element face {faces}\nproperty list uchar uint vertex_indices\n");
    header += "end_header\n";
    let mut bytes = Vec::with_capacity(header.len() + VERTEX * count + room);
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

/// The usage of a glTF buffer: indices of triangles, or attributes of vertices.
const ELEMENT_ARRAY_BUFFER: u32 = 34_963;
const ARRAY_BUFFER: u32 = 34_962;
const UNSIGNED_BYTE: u32 = 5_121;
const UNSIGNED_INT: u32 = 5_125;
const FLOAT: u32 = 5_126;
/// Chunks end on a multiple of this.
const ALIGNMENT: usize = 4;

/// The mesh as binary glTF 2.0 (GLB), which browsers and engines show; `None` where it needs more than
/// 4 GiB, which the format cannot store.
///
/// ```text
/// "glTF"  version 2 u32  length u32
/// length u32  "JSON"  the scene, padded with spaces
/// length u32  "BIN\0" indices u32, positions and normals 3 f32, colors 4 u8, in this order
/// ```
///
/// glTF's y axis points up, that of the volume's frame down, as in the first camera's image (x right, y
/// down, z ahead). The buffers keep the volume's frame; a half turn around x in the scene's only node
/// makes y point up. glTF requires linear colors; those of the camera are sRGB and are converted.
#[must_use]
pub fn glb(mesh: &Mesh) -> Option<Vec<u8>> {
    let (vertices, corners) = (mesh.positions.len(), 3 * mesh.triangles.len());
    let lengths = [4 * corners, 12 * vertices, 12 * vertices, 4 * vertices];
    // glTF has no empty buffers: without triangles there is no second chunk.
    let binary = if corners == 0 { 0 } else { lengths.iter().sum() };
    let mut json = scene(mesh, lengths).to_string().into_bytes();
    json.resize(json.len().next_multiple_of(ALIGNMENT), b' ');
    let chunks = [(json.len(), *b"JSON"), (binary, *b"BIN\0")];
    let chunks = if binary == 0 { &chunks[..1] } else { &chunks };
    let length = 12 + chunks.iter().map(|(length, _)| 8 + length).sum::<usize>();
    let mut bytes = Vec::with_capacity(length);
    bytes.extend_from_slice(b"glTF");
    bytes.extend_from_slice(&2_u32.to_le_bytes());
    bytes.extend_from_slice(&u32::try_from(length).ok()?.to_le_bytes());
    for (length, kind) in chunks {
        bytes.extend_from_slice(&(*length as u32).to_le_bytes());
        bytes.extend_from_slice(kind);
        match kind {
            b"JSON" => bytes.append(&mut json),
            _ => put_buffer(&mut bytes, mesh),
        }
    }
    Some(bytes)
}

fn put_buffer(bytes: &mut Vec<u8>, mesh: &Mesh) {
    for index in mesh.triangles.as_flattened() {
        bytes.extend_from_slice(&index.to_le_bytes());
    }
    for number in mesh.positions.as_flattened().iter().chain(mesh.normals.as_flattened()) {
        bytes.extend_from_slice(&number.to_le_bytes());
    }
    let linear: [u8; 256] = std::array::from_fn(|value| linear(value as u8));
    for color in &mesh.colors {
        let [r, g, b] = color.map(|value| linear[usize::from(value)]);
        bytes.extend_from_slice(&[r, g, b, u8::MAX]);
    }
}

/// A value of sRGB (IEC 61966-2-1) as linear light.
fn linear(value: u8) -> u8 {
    let v = f64::from(value) / 255.0;
    let light = if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
    (light * 255.0).round() as u8
}

/// The JSON part, with the lengths of indices, positions, normals and colors in bytes.
fn scene(mesh: &Mesh, lengths: [usize; 4]) -> serde_json::Value {
    let asset = json!({ "version": "2.0", "generator": "covis" });
    if mesh.triangles.is_empty() {
        return json!({ "asset": asset, "scene": 0, "scenes": [{}] });
    }
    let mut offset = 0;
    let views: Vec<_> = lengths
        .iter()
        .zip([ELEMENT_ARRAY_BUFFER, ARRAY_BUFFER, ARRAY_BUFFER, ARRAY_BUFFER])
        .map(|(&length, target)| {
            let view = json!({
                "buffer": 0, "byteOffset": offset, "byteLength": length, "target": target
            });
            offset += length;
            view
        })
        .collect();
    let (corners, vertices) = (3 * mesh.triangles.len(), mesh.positions.len());
    let (lowest, highest) = bounds(&mesh.positions);
    let accessors = json!([
        { "bufferView": 0, "componentType": UNSIGNED_INT, "count": corners, "type": "SCALAR" },
        { "bufferView": 1, "componentType": FLOAT, "count": vertices, "type": "VEC3",
          "min": lowest, "max": highest },
        { "bufferView": 2, "componentType": FLOAT, "count": vertices, "type": "VEC3" },
        { "bufferView": 3, "componentType": UNSIGNED_BYTE, "normalized": true,
          "count": vertices, "type": "VEC4" },
    ]);
    json!({
        "asset": asset,
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        // A quaternion x, y, z, w: half a turn around x.
        "nodes": [{ "name": "surface", "mesh": 0, "rotation": [1, 0, 0, 0] }],
        "meshes": [{ "primitives": [{
            "attributes": { "POSITION": 1, "NORMAL": 2, "COLOR_0": 3 },
            "indices": 0,
            "material": 0,
        }] }],
        "materials": [{
            "doubleSided": true,
            "pbrMetallicRoughness": { "metallicFactor": 0, "roughnessFactor": 1 },
        }],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{ "byteLength": offset }],
    })
}

/// The least and the greatest of each coordinate.
fn bounds(positions: &[[f32; 3]]) -> ([f32; 3], [f32; 3]) {
    let start = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    positions.iter().fold(start, |(low, high), p| {
        (std::array::from_fn(|i| low[i].min(p[i])), std::array::from_fn(|i| high[i].max(p[i])))
    })
}

#[cfg(test)]
mod tests {
    use super::super::testing::{CENTIMETER, sphere, volume};
    use super::super::tests::extract;
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
        let mesh = extract(&volume(CENTIMETER, [-1; 3], [0; 3], ball));
        assert!(mesh.triangles.len() > 100);
        assert_eq!(read(&ply(&mesh)), mesh);
        assert_eq!(read(&ply(&Mesh::default())), Mesh::default());
    }

    fn u32_at(bytes: &[u8], at: usize) -> usize {
        u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
    }

    fn ball() -> Mesh {
        let ball = |p| Some((sphere(p, [0.1, 0.0, 0.0], 0.05), 1.0, [255, 188, 0]));
        extract(&volume(CENTIMETER, [0, -1, -1], [2, 0, 0], ball))
    }

    #[test]
    fn chunks_views_and_accessors_fit_together() {
        let mesh = ball();
        let bytes = glb(&mesh).unwrap();
        assert_eq!(&bytes[..4], b"glTF");
        assert_eq!((u32_at(&bytes, 4), u32_at(&bytes, 8)), (2, bytes.len()));
        let json_length = u32_at(&bytes, 12);
        assert_eq!((json_length % 4, &bytes[16..20]), (0, &b"JSON"[..]));
        let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + json_length]).unwrap();
        let head = 20 + json_length;
        let binary = &bytes[head + 8..];
        assert_eq!(
            (u32_at(&bytes, head), &bytes[head + 4..head + 8]),
            (binary.len(), &b"BIN\0"[..])
        );
        assert_eq!(json["asset"]["version"], "2.0");
        assert_eq!(json["buffers"][0]["byteLength"], binary.len());
        let mut end = 0;
        for (i, size) in [4, 12, 12, 4].into_iter().enumerate() {
            let (accessor, view) = (&json["accessors"][i], &json["bufferViews"][i]);
            assert_eq!(accessor["bufferView"], i);
            assert_eq!((view["byteOffset"].as_u64(), end % 4), (Some(end), 0));
            let length = view["byteLength"].as_u64().unwrap();
            assert_eq!(length, size * accessor["count"].as_u64().unwrap());
            end += length;
        }
        assert_eq!(end, binary.len() as u64);
        let offset = |i: usize| json["bufferViews"][i]["byteOffset"].as_u64().unwrap() as usize;
        for (i, corner) in mesh.triangles.iter().flatten().enumerate() {
            assert_eq!(u32_at(binary, 4 * i), *corner as usize);
        }
        for (k, number) in mesh.positions.iter().flatten().enumerate() {
            let axis = k % 3;
            let read = f32::from_bits(u32_at(binary, offset(1) + 4 * k) as u32);
            assert_eq!(read, *number);
            let bound = |name: &str| json["accessors"][1][name][axis].as_f64().unwrap() as f32;
            assert!((bound("min")..=bound("max")).contains(number));
        }
        assert_eq!(binary[offset(3)..offset(3) + 4], [255, 128, 0, 255], "linear and opaque");
    }

    #[test]
    fn no_surface_is_a_scene_without_a_buffer() {
        let bytes = glb(&Mesh::default()).unwrap();
        assert_eq!((u32_at(&bytes, 8), u32_at(&bytes, 12) + 20), (bytes.len(), bytes.len()));
        let json: serde_json::Value = serde_json::from_slice(&bytes[20..]).unwrap();
        assert_eq!(json.get("buffers"), None);
    }
}
