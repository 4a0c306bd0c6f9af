//! The three files record by record, for a caller that does not hold all of a model.
//!
//! A file is its head, then its records by rising id. Nothing is checked across records.

use super::super::IoError;
use super::super::text::TextWriter;
use super::{ColmapCamera, ColmapEncoding, ColmapImage, ColmapPoint, binary, text};

impl ColmapEncoding {
    /// Appends what stands before `count` cameras.
    pub fn put_cameras_head(self, count: usize, out: &mut Vec<u8>) {
        self.put_head(text::CAMERAS_HEAD, count, out);
    }

    /// Appends what stands before `count` images.
    pub fn put_images_head(self, count: usize, out: &mut Vec<u8>) {
        self.put_head(text::IMAGES_HEAD, count, out);
    }

    /// Appends what stands before `count` points.
    pub fn put_points_head(self, count: usize, out: &mut Vec<u8>) {
        self.put_head(text::POINTS_HEAD, count, out);
    }

    /// Appends a camera.
    pub fn put_camera(self, id: u32, camera: &ColmapCamera, out: &mut Vec<u8>) {
        match self {
            Self::Text => TextWriter::append(out, |text| text::put_camera(text, id, camera)),
            Self::Binary => binary::put_camera(out, id, camera),
        }
    }

    /// Appends an image with its keypoints.
    ///
    /// # Errors
    /// [`IoError::UnwritableText`] where the name does not survive the format.
    pub fn put_image(self, id: u32, image: &ColmapImage, out: &mut Vec<u8>) -> Result<(), IoError> {
        match self {
            Self::Text => {
                text::check_name(id, &image.name)?;
                TextWriter::append(out, |text| text::put_image(text, id, image));
                Ok(())
            }
            Self::Binary => binary::put_image(out, id, image),
        }
    }

    /// Appends a point with its track.
    pub fn put_point(self, id: u64, point: &ColmapPoint, out: &mut Vec<u8>) {
        match self {
            Self::Text => TextWriter::append(out, |text| text::put_point(text, id, point)),
            Self::Binary => binary::put_point(out, id, point),
        }
    }

    fn put_head(self, comment: &[u8], count: usize, out: &mut Vec<u8>) {
        match self {
            Self::Text => out.extend(comment),
            Self::Binary => binary::put_count(out, count),
        }
    }
}
