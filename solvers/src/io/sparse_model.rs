//! A bundle adjustment problem with what files hold beside it, between BAL, Bundler, COLMAP and OpenMVG.
//!
//! Poses, points and residuals stay what they are, whatever the format. What a format cannot hold
//! is refused with the camera's number where it changes residuals (distortion, two focal lengths), and
//! left out where it does not (names, colors, keypoints without a point, cameras without a pose).

use nalgebra::Vector2;

use super::IoError;
use super::bal::{BalFile, BalObservation};
use super::bundler::{BundlerCamera, BundlerFile, BundlerPoint, BundlerView};
use super::colmap::{
    ColmapCamera, ColmapCameraModel, ColmapImage, ColmapModel, ColmapPoint, mean_errors_px,
};
use super::down_z;
use super::trajectory::Trajectory;
use crate::geometry::{Camera, Snavely};
use crate::problem::BundleProblem;

/// Color of points whose file has none.
pub(super) const GRAY: [u8; 3] = [128; 3];

/// A problem of observations (u, v) with names, sizes and colors.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SparseModel {
    /// The problem; sigma is 1 px, and every pose has one camera.
    pub problem: BundleProblem,
    /// Index of each pose's camera.
    pub camera_of_pose: Vec<u32>,
    /// Name of each pose's image; empty where the file has none.
    pub image_names: Vec<String>,
    /// Width and height of each camera's images, px; 0 where the file does not tell.
    pub image_sizes_px: Vec<[u64; 2]>,
    /// Color of each landmark.
    pub colors: Vec<[u8; 3]>,
}

impl SparseModel {
    /// The model of a BAL file.
    #[must_use]
    pub fn from_bal(file: &BalFile) -> Self {
        let problem = file.to_problem();
        Self {
            camera_of_pose: (0..problem.poses.len() as u32).collect(),
            image_names: Vec::new(),
            image_sizes_px: vec![[0; 2]; problem.cameras.len()],
            colors: vec![GRAY; problem.landmarks.len()],
            problem,
        }
    }

    /// The model of a Bundler file: the cameras that were reconstructed, in their order.
    ///
    /// # Errors
    /// For a file that was not parsed but filled by hand: [`IoError::NotRigid`], and
    /// [`IoError::OutOfRange`] where a view names a camera that is not there.
    pub fn from_bundler(file: &BundlerFile) -> Result<Self, IoError> {
        let mut model = Self::default();
        let mut pose_of = vec![None; file.cameras.len()];
        for (k, camera) in file.cameras.iter().enumerate().filter(|(_, c)| c.is_placed()) {
            let pose = model.problem.push_pose(camera.world_from_camera(k)?);
            let index = model.problem.push_camera(Camera::Snavely(camera.snavely()), false);
            model.camera_of_pose.push(index as u32);
            model.image_sizes_px.push([0; 2]);
            model.image_names.extend(file.image_names.get(k).cloned());
            pose_of[k] = Some(pose as u32);
        }
        for (k, point) in file.points.iter().enumerate() {
            let landmark = model.problem.push_landmark(point.position.into()) as u32;
            model.colors.push(point.color);
            for view in &point.views {
                let Some(&Some(pose)) = pose_of.get(view.camera as usize) else {
                    return Err(IoError::OutOfRange {
                        location: super::Location::record("point".as_ref(), k as u64),
                        field: "camera of a view".to_owned(),
                        value: view.camera.into(),
                        count: file.cameras.len() as u64,
                    });
                };
                let pixel = down_z::flip_pixel(Vector2::new(view.x, view.y));
                model.problem.reprojections.push(pose, pose, landmark, pixel, 1.0);
            }
        }
        Ok(model)
    }

    /// The model of COLMAP's: images in the natural order of their names.
    ///
    /// # Errors
    /// As [`ColmapModel::to_problem`].
    pub fn from_colmap(file: &ColmapModel) -> Result<Self, IoError> {
        let solved = file.to_problem()?;
        let mut model = Self { problem: solved.problem, ..Self::default() };
        for id in &solved.image_ids {
            let image = &file.images[id];
            let camera = solved.camera_ids.binary_search(&image.camera).unwrap_or_default();
            model.camera_of_pose.push(camera as u32);
            model.image_names.push(image.name.clone());
        }
        let sizes = file.cameras.values().map(|camera| [camera.width, camera.height]);
        model.image_sizes_px = sizes.collect();
        model.colors = file.points.values().map(|point| point.color).collect();
        Ok(model)
    }

    /// The same as a BAL file, in which each image has a camera of its own.
    ///
    /// # Errors
    /// [`IoError::UnsupportedCamera`] where a camera is no Snavely camera.
    pub fn to_bal(&self) -> Result<BalFile, IoError> {
        let cameras = self.snavely_cameras("a BAL file holds one focal length, k1 and k2 only")?;
        let mut file = BalFile::default();
        for (pose, &camera) in self.problem.poses.iter().zip(&self.camera_of_pose) {
            file.cameras.push(super::bal::camera_numbers(pose, &cameras[camera as usize].0));
        }
        file.points = self.problem.landmarks.iter().map(|p| (*p).into()).collect();
        for (camera, point, pixel) in self.observations(&cameras) {
            file.observations.push(BalObservation { camera, point, u: pixel.x, v: pixel.y });
        }
        Ok(file)
    }

    /// The same as a Bundler file, in which each image has a camera of its own.
    ///
    /// # Errors
    /// [`IoError::UnsupportedCamera`] where a camera is no Snavely camera.
    pub fn to_bundler(&self) -> Result<BundlerFile, IoError> {
        let cameras =
            self.snavely_cameras("a Bundler file holds one focal length, k1 and k2 only")?;
        let mut file =
            BundlerFile { image_names: self.image_names.clone(), ..BundlerFile::default() };
        for (pose, &camera) in self.problem.poses.iter().zip(&self.camera_of_pose) {
            file.cameras.push(BundlerCamera::new(pose, &cameras[camera as usize].0));
        }
        let points = self.problem.landmarks.iter().zip(&self.colors);
        file.points = points.map(|(point, &color)| BundlerPoint::new(point, color)).collect();
        let mut keys = vec![0; file.cameras.len()];
        for (camera, point, pixel) in self.observations(&cameras) {
            let key = keys[camera as usize];
            keys[camera as usize] += 1;
            let view = BundlerView { camera, key, x: pixel.x, y: pixel.y };
            file.points[point as usize].views.push(view);
        }
        Ok(file)
    }

    /// The same as COLMAP's model: ids count from 1, and a camera whose principal point is the image's
    /// center becomes RADIAL. Images without a name are called `image000001` and so on. A size that is
    /// not known is the least even one that holds all observations.
    ///
    /// # Errors
    /// [`IoError::UnknownId`] where an observation names a pose or landmark that is not there.
    pub fn to_colmap(&self) -> Result<ColmapModel, IoError> {
        let mut model = ColmapModel::default();
        let sizes = self.sizes_px();
        for (k, (camera, &[width, height])) in self.problem.cameras.iter().zip(&sizes).enumerate() {
            let mut written = ColmapCamera::from_camera(camera, width, height);
            if let Camera::Snavely(Snavely { focal, k1, k2 }) = *camera {
                let center = self.center_px(k, &sizes);
                written.model = ColmapCameraModel::Radial;
                written.parameters = vec![focal, center.x + 0.5, center.y + 0.5, k1, k2];
            }
            model.cameras.insert(k as u32 + 1, written);
        }
        for (k, (pose, &camera)) in self.problem.poses.iter().zip(&self.camera_of_pose).enumerate()
        {
            let made = || format!("image{:06}", k + 1);
            let name = self.image_names.get(k).cloned().unwrap_or_else(made);
            model.images.insert(k as u32 + 1, ColmapImage::new(name, camera + 1, pose));
        }
        let points = self.problem.landmarks.iter().zip(&self.colors);
        for ((k, (point, &color)), error) in points.enumerate().zip(mean_errors_px(&self.problem)) {
            let point = ColmapPoint { error, ..ColmapPoint::new(point, color) };
            model.points.insert(k as u64 + 1, point);
        }
        let seen = &self.problem.reprojections;
        for k in 0..seen.len() {
            let pixel = seen.pixels[k] + self.center_px(seen.cameras[k] as usize, &sizes);
            let point = u64::from(seen.landmarks[k]) + 1;
            model.push_observation(seen.poses[k] + 1, &pixel, point)?;
        }
        Ok(model)
    }

    /// The poses: at the numbers that the images are named by (`1305031102.17.png`), in seconds, where
    /// all are and no two differ by digits that the times do not hold, else at their numbers from 0.
    #[must_use]
    pub fn trajectory(&self) -> Trajectory {
        let times = self.name_times();
        let mut trajectory = Trajectory::default();
        for (k, pose) in self.problem.poses.iter().enumerate() {
            let time = times.as_ref().map_or(k as f64, |times| times[k]);
            trajectory.push(time, *pose);
        }
        trajectory
    }

    /// The number that each image is named by.
    fn name_times(&self) -> Option<Vec<f64>> {
        if self.image_names.len() != self.problem.poses.len() {
            return None;
        }
        let names = self.image_names.iter().map(|name| stem(name));
        let mut named = names
            .map(|stem| name_number(stem).map(|time| (time, stem)))
            .collect::<Option<Vec<(f64, &str)>>>()?;
        let times = named.iter().map(|&(time, _)| time).collect();
        named.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let are_distinct =
            named.windows(2).all(|pair| pair[0].0 != pair[1].0 || pair[0].1 == pair[1].1);
        are_distinct.then_some(times)
    }

    /// The Snavely camera of each camera, and the pixel of its principal point in covis' problem.
    fn snavely_cameras(
        &self,
        reason: &'static str,
    ) -> Result<Vec<(Snavely, Vector2<f64>)>, IoError> {
        let all = self.problem.cameras.iter().enumerate();
        all.map(|(k, camera)| match *camera {
            Camera::Snavely(camera) => Ok((camera, Vector2::zeros())),
            Camera::Pinhole(c) if c.fx == c.fy && [c.p1, c.p2, c.k3] == [0.0; 3] => {
                Ok((Snavely { focal: c.fx, k1: c.k1, k2: c.k2 }, Vector2::new(c.cx, c.cy)))
            }
            Camera::Pinhole(_) | Camera::Fisheye(_) => Err(IoError::UnsupportedCamera {
                camera: k as u64,
                model: format!("{camera:?}"),
                reason,
            }),
        })
        .collect()
    }

    /// Each observation as BAL and Bundler have it: number of the image, number of the point, pixel from
    /// the image's center with y up.
    fn observations<'a>(
        &'a self,
        cameras: &'a [(Snavely, Vector2<f64>)],
    ) -> impl Iterator<Item = (u32, u32, Vector2<f64>)> + 'a {
        let seen = &self.problem.reprojections;
        (0..seen.len()).map(move |k| {
            let center = cameras[seen.cameras[k] as usize].1;
            (seen.poses[k], seen.landmarks[k], down_z::flip_pixel(seen.pixels[k] - center))
        })
    }

    /// Sizes of images, those that are not known from the observations.
    fn sizes_px(&self) -> Vec<[u64; 2]> {
        let mut half = vec![Vector2::<f64>::repeat(1.0); self.problem.cameras.len()];
        let seen = &self.problem.reprojections;
        for (&camera, pixel) in seen.cameras.iter().zip(&seen.pixels) {
            let most = &mut half[camera as usize];
            *most = most.sup(&pixel.abs());
        }
        let known = self.image_sizes_px.iter().zip(half);
        known
            .map(|(&size, half)| match size {
                [0, _] | [_, 0] => [2 * half.x.ceil() as u64, 2 * half.y.ceil() as u64],
                size => size,
            })
            .collect()
    }

    /// What a pixel of the problem becomes longer by in an image whose first pixel's center is (0, 0): of
    /// a Snavely camera, whose pixels are counted from the center.
    fn center_px(&self, camera: usize, sizes: &[[u64; 2]]) -> Vector2<f64> {
        match self.problem.cameras[camera] {
            Camera::Snavely(_) => sizes[camera].map(|size| 0.5 * size as f64 - 0.5).into(),
            Camera::Pinhole(_) | Camera::Fisheye(_) => Vector2::zeros(),
        }
    }
}

/// A file's name without its folders and its extension.
fn stem(name: &str) -> &str {
    let name = name.rsplit(['/', '\\']).next().unwrap_or(name);
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}

/// The number that a name without extension is.
fn name_number(stem: &str) -> Option<f64> {
    let is_number = stem.starts_with(|c: char| c.is_ascii_digit());
    stem.parse().ok().filter(|time: &f64| is_number && time.is_finite())
}
