//! COLMAP's binary files: little-endian, a 64-bit count, then the records.
//!
//! camera: id u32, model u32, width u64, height u64, parameters f64…;
//! image: id u32, quaternion 4 f64, translation 3 f64, camera u32, name ending with a zero byte,
//! keypoints as a u64 count of (x f64, y f64, point u64, all ones meaning none);
//! point: id u64, position 3 f64, color 3 u8, error f64, track as a u64 count of two u32. Numbers stay
//! those of the file; `convert` applies the conventions.

use std::path::Path;

use super::super::IoError;
use super::super::binary::Binary;
use super::super::rotation::check_norm;
use super::{
    ColmapCamera, ColmapCameraModel, ColmapImage, ColmapKeypoint, ColmapModel, ColmapPoint,
    NO_POINT, insert, point_id,
};

/// Least bytes of a camera, an image, a keypoint, a point and a track entry.
const CAMERA_BYTES: usize = 24 + 3 * 8;
const IMAGE_BYTES: usize = 4 + 7 * 8 + 4 + 1 + 8;
const KEYPOINT_BYTES: usize = 24;
const POINT_BYTES: usize = 8 + 3 * 8 + 3 + 8 + 8;
const TRACK_BYTES: usize = 8;

pub(super) fn parse_cameras(
    model: &mut ColmapModel,
    bytes: &[u8],
    path: &Path,
) -> Result<(), IoError> {
    let mut file = Binary::new(bytes, path);
    for _ in 0..file.count("camera count", CAMERA_BYTES)? {
        let location = file.location();
        let id = file.u32("camera id")?;
        let number = file.u32("camera model")?;
        let Some(kind) = ColmapCameraModel::from_number(number) else {
            let (field, found) = ("camera model".to_owned(), number.to_string());
            return Err(IoError::Malformed { location, field, found });
        };
        let (width, height) = (file.u64("width")?, file.u64("height")?);
        let mut parameters = vec![0.0; kind.parameter_count()];
        for (k, parameter) in parameters.iter_mut().enumerate() {
            *parameter = file.f64(format_args!("parameter[{k}]"))?;
        }
        let camera = ColmapCamera { model: kind, width, height, parameters };
        insert(&mut model.cameras, "camera", id, camera, location)?;
    }
    file.end()
}

pub(super) fn parse_points(
    model: &mut ColmapModel,
    bytes: &[u8],
    path: &Path,
) -> Result<(), IoError> {
    let mut file = Binary::new(bytes, path);
    for _ in 0..file.count("point count", POINT_BYTES)? {
        let location = file.location();
        let id = point_id(file.u64("point id")?, &location)?;
        let position = file.f64s("position")?;
        let color = file.color("color")?;
        let error = file.f64("error")?;
        let length = file.count("track length", TRACK_BYTES)?;
        let mut track = Vec::with_capacity(length);
        for _ in 0..length {
            track.push((file.u32("track image id")?, file.u32("track keypoint")?));
        }
        let point = ColmapPoint { position, color, error, track };
        insert(&mut model.points, "point", id, point, location)?;
    }
    file.end()
}

pub(super) fn parse_images(
    model: &mut ColmapModel,
    bytes: &[u8],
    path: &Path,
) -> Result<(), IoError> {
    let mut file = Binary::new(bytes, path);
    for _ in 0..file.count("image count", IMAGE_BYTES)? {
        let location = file.location();
        let id = file.u32("image id")?;
        let quaternion_wxyz = file.f64s("quaternion")?;
        check_norm(&quaternion_wxyz, || location.clone())?;
        let translation = file.f64s("translation")?;
        let camera = file.u32("camera id")?;
        model.check_camera(camera, || location.clone())?;
        let name = file.c_string("image name")?.to_owned();
        let count = file.count("keypoint count", KEYPOINT_BYTES)?;
        let mut keypoints = Vec::with_capacity(count);
        for _ in 0..count {
            let (x, y) = (file.f64("keypoint x")?, file.f64("keypoint y")?);
            let id = file.u64("keypoint point id")?;
            let point = (id != NO_POINT).then_some(id);
            model.check_point(point, || file.location())?;
            keypoints.push(ColmapKeypoint { x, y, point });
        }
        let image = ColmapImage { quaternion_wxyz, translation, camera, name, keypoints };
        insert(&mut model.images, "image", id, image, location)?;
    }
    file.end()
}

pub(super) fn put_camera(bytes: &mut Vec<u8>, id: u32, camera: &ColmapCamera) {
    bytes.extend(id.to_le_bytes());
    bytes.extend(camera.model.number().to_le_bytes());
    bytes.extend(camera.width.to_le_bytes());
    bytes.extend(camera.height.to_le_bytes());
    put_all(bytes, &camera.parameters);
}

pub(super) fn put_image(bytes: &mut Vec<u8>, id: u32, image: &ColmapImage) -> Result<(), IoError> {
    if image.name.contains('\0') {
        let (id, reason) = (id.into(), "a binary file needs a name without a zero byte");
        return Err(IoError::UnwritableText { field: "image", id, reason });
    }
    bytes.extend(id.to_le_bytes());
    put_all(bytes, &image.quaternion_wxyz);
    put_all(bytes, &image.translation);
    bytes.extend(image.camera.to_le_bytes());
    bytes.extend(image.name.as_bytes());
    bytes.push(0);
    put_count(bytes, image.keypoints.len());
    for keypoint in &image.keypoints {
        put_all(bytes, &[keypoint.x, keypoint.y]);
        bytes.extend(keypoint.point.unwrap_or(NO_POINT).to_le_bytes());
    }
    Ok(())
}

pub(super) fn put_point(bytes: &mut Vec<u8>, id: u64, point: &ColmapPoint) {
    bytes.extend(id.to_le_bytes());
    put_all(bytes, &point.position);
    bytes.extend(point.color);
    put_all(bytes, &[point.error]);
    put_count(bytes, point.track.len());
    for (image, keypoint) in &point.track {
        bytes.extend(image.to_le_bytes());
        bytes.extend(keypoint.to_le_bytes());
    }
}

pub(super) fn put_count(bytes: &mut Vec<u8>, count: usize) {
    bytes.extend((count as u64).to_le_bytes());
}

fn put_all(bytes: &mut Vec<u8>, numbers: &[f64]) {
    for number in numbers {
        bytes.extend(number.to_le_bytes());
    }
}
