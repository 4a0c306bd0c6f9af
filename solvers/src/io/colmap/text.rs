//! COLMAP's text files: one line a camera or point, two lines an image (pose, then keypoints).
//!
//! The second line of an image is blank where the image has no keypoints, so blank lines count
//! there and nowhere else. Point id −1 means none. Numbers stay those of the file; `convert` applies
//! the conventions.

use std::path::Path;

use super::super::IoError;
use super::super::error::excerpt;
use super::super::rotation::check_norm;
use super::super::text::{Line, Text, TextWriter};
use super::{
    ColmapCamera, ColmapCameraModel, ColmapImage, ColmapKeypoint, ColmapModel, ColmapPoint, insert,
    point_id,
};

pub(super) fn parse_cameras(
    model: &mut ColmapModel,
    bytes: &[u8],
    path: &Path,
) -> Result<(), IoError> {
    let mut text = Text::new(bytes, path);
    while let Some(mut line) = text.record() {
        let location = line.location();
        let id: u32 = line.integer("camera id")?;
        let name = line.word().unwrap_or_default();
        let kind = std::str::from_utf8(name).ok().and_then(ColmapCameraModel::from_name);
        let Some(kind) = kind else {
            let (field, found) = ("camera model".to_owned(), excerpt(name));
            return Err(IoError::Malformed { location, field, found });
        };
        let (width, height) = (line.integer("width")?, line.integer("height")?);
        let mut parameters = vec![0.0; kind.parameter_count()];
        for (k, parameter) in parameters.iter_mut().enumerate() {
            *parameter = line.number(format_args!("parameter[{k}]"))?;
        }
        line.end()?;
        let camera = ColmapCamera { model: kind, width, height, parameters };
        insert(&mut model.cameras, "camera", id, camera, location)?;
    }
    Ok(())
}

pub(super) fn parse_points(
    model: &mut ColmapModel,
    bytes: &[u8],
    path: &Path,
) -> Result<(), IoError> {
    let mut text = Text::new(bytes, path);
    while let Some(mut line) = text.record() {
        let location = line.location();
        let id = point_id(line.integer("point id")?, &location)?;
        let position = line.numbers("position")?;
        let color = [line.integer("red")?, line.integer("green")?, line.integer("blue")?];
        let error = line.number("error")?;
        let mut track = Vec::new();
        while !line.is_at_end() {
            track.push((line.integer("track image id")?, line.integer("track keypoint")?));
        }
        let point = ColmapPoint { position, color, error, track };
        insert(&mut model.points, "point", id, point, location)?;
    }
    Ok(())
}

pub(super) fn parse_images(
    model: &mut ColmapModel,
    bytes: &[u8],
    path: &Path,
) -> Result<(), IoError> {
    let mut text = Text::new(bytes, path);
    while let Some(mut line) = text.record() {
        let location = line.location();
        let id: u32 = line.integer("image id")?;
        let quaternion_wxyz = line.numbers("quaternion")?;
        check_norm(&quaternion_wxyz, || location.clone())?;
        let translation = line.numbers("translation")?;
        let camera: u32 = line.integer("camera id")?;
        model.check_camera(camera, || location.clone())?;
        let name = image_name(&mut line)?;
        let mut keypoints = Vec::new();
        if let Some(mut line) = text.line() {
            while !line.is_at_end() {
                let (x, y) = (line.number("keypoint x")?, line.number("keypoint y")?);
                let point = keypoint_point(&mut line)?;
                model.check_point(point, || line.location())?;
                keypoints.push(ColmapKeypoint { x, y, point });
            }
        }
        let image = ColmapImage { quaternion_wxyz, translation, camera, name, keypoints };
        insert(&mut model.images, "image", id, image, location)?;
    }
    Ok(())
}

/// The rest of the line, which may hold spaces.
fn image_name(line: &mut Line<'_>) -> Result<String, IoError> {
    let field = || "image name".to_owned();
    let tail = line.tail();
    match std::str::from_utf8(tail) {
        Ok("") => Err(IoError::Truncated { location: line.location(), field: field() }),
        Ok(name) => Ok(name.to_owned()),
        Err(_) => {
            let (location, found) = (line.location(), excerpt(tail));
            Err(IoError::Malformed { location, field: field(), found })
        }
    }
}

/// A point id or −1.
fn keypoint_point(line: &mut Line<'_>) -> Result<Option<u64>, IoError> {
    let id: i128 = line.integer("keypoint point id")?;
    match u64::try_from(id) {
        Ok(id) => Ok(Some(id)),
        Err(_) if id == -1 => Ok(None),
        Err(_) => {
            let (location, field) = (line.location(), "keypoint point id".to_owned());
            Err(IoError::Malformed { location, field, found: id.to_string() })
        }
    }
}

pub(super) const CAMERAS_HEAD: &[u8] = b"# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n";
pub(super) const IMAGES_HEAD: &[u8] =
    b"# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME\n# POINTS2D[] as X Y POINT3D_ID\n";
pub(super) const POINTS_HEAD: &[u8] =
    b"# POINT3D_ID X Y Z R G B ERROR TRACK[] as IMAGE_ID POINT2D_IDX\n";

pub(super) fn put_camera(text: &mut TextWriter, id: u32, camera: &ColmapCamera) {
    let ColmapCamera { width, height, .. } = camera;
    text.put(format_args!("{id} {} {width} {height}", camera.model.name()));
    put_all(text, &camera.parameters);
    text.end_line();
}

/// Refuses a name that a line does not hold.
pub(super) fn check_name(id: u32, name: &str) -> Result<(), IoError> {
    if name.is_empty() || name.trim_ascii() != name || name.contains('\n') {
        return Err(IoError::UnwritableText {
            field: "image",
            id: id.into(),
            reason: "a text file needs a name without a line break or outer white space",
        });
    }
    Ok(())
}

pub(super) fn put_image(text: &mut TextWriter, id: u32, image: &ColmapImage) {
    text.put(id);
    put_all(text, &image.quaternion_wxyz);
    put_all(text, &image.translation);
    text.put(format_args!(" {} {}\n", image.camera, image.name));
    for (k, ColmapKeypoint { x, y, point }) in image.keypoints.iter().enumerate() {
        let separator = if k == 0 { "" } else { " " };
        match point {
            Some(point) => text.put(format_args!("{separator}{x:?} {y:?} {point}")),
            None => text.put(format_args!("{separator}{x:?} {y:?} -1")),
        }
    }
    text.end_line();
}

pub(super) fn put_point(text: &mut TextWriter, id: u64, point: &ColmapPoint) {
    let ([r, g, b], error) = (point.color, point.error);
    text.put(id);
    put_all(text, &point.position);
    text.put(format_args!(" {r} {g} {b} {error:?}"));
    for (image, keypoint) in &point.track {
        text.put(format_args!(" {image} {keypoint}"));
    }
    text.end_line();
}

/// Appends numbers with the fewest digits that read back exactly.
fn put_all(text: &mut TextWriter, numbers: &[f64]) {
    for number in numbers {
        text.put(format_args!(" {number:?}"));
    }
}
