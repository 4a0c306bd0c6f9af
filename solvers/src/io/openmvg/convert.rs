//! From the numbers of an `sfm_data.json` to a model.
//!
//! Images are in the natural order of their names, as those of a COLMAP model, and each has a pose of
//! its own. Only intrinsics that an image with a pose uses become cameras: the others may have a model
//! that covis lacks. Of a camera those parameters are free that OpenMVG's model has, with one focal
//! length.

use std::collections::BTreeMap;
use std::path::Path;

use super::super::error::excerpt;
use super::super::sparse_model::{GRAY, SparseModel};
use super::super::{IoError, Location, natural_cmp, pose_matrix};
use super::{OpenMvgFile, OpenMvgIntrinsic, OpenMvgPose, OpenMvgView, UNDEFINED};
use crate::geometry::{Camera, FreeParameters, KannalaBrandt, PinholeRadialTangential, Se3};

/// What a model does not have of the file, and what it has otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OpenMvgLeftOut {
    /// Views without a pose or an intrinsic.
    pub views: usize,
    /// Observations in these views.
    pub observations: usize,
    /// Control points.
    pub control_points: usize,
    /// Views whose pose is that of another view too; each gets a pose of its own.
    pub shared_poses: usize,
}

impl SparseModel {
    /// The model of an OpenMVG file, and what it leaves out; `path` names the file in errors. Points that
    /// no image shows, and cameras whose points are left out, are constant.
    ///
    /// # Errors
    /// With the key: [`IoError::UnknownId`] for a view's intrinsic or an observation's view that the file
    /// does not have, [`IoError::NotRigid`], [`IoError::Truncated`] for a member that a camera's model
    /// needs, [`IoError::UnsupportedCamera`] for a model that covis lacks.
    pub fn from_openmvg(
        file: &OpenMvgFile,
        path: &Path,
    ) -> Result<(Self, OpenMvgLeftOut), IoError> {
        let mut left_out =
            OpenMvgLeftOut { control_points: file.control_points, ..OpenMvgLeftOut::default() };
        let mut placed = placed(file, path)?;
        left_out.views = file.views.len() - placed.len();
        placed.sort_by(|a, b| natural_cmp(&a.name, &b.name).then(a.key.cmp(&b.key)));

        let mut model = Self::default();
        let mut camera_of: BTreeMap<u32, u32> =
            placed.iter().map(|placed| (placed.view.id_intrinsic, 0)).collect();
        for (&key, index) in &mut camera_of {
            let intrinsic = &file.intrinsics[&key];
            let (camera, free) = intrinsic.camera(key, path)?;
            let camera = model.problem.push_camera(camera, true);
            model.problem.set_free_parameters(camera, free);
            model.image_sizes_px.push(intrinsic.size_px.unwrap_or_default().map(u64::from));
            *index = camera as u32;
        }
        let mut pose_of = BTreeMap::new();
        let mut users_of_pose: BTreeMap<u32, usize> = BTreeMap::new();
        for Placed { key, view, pose, name } in placed {
            let location = || Location::key(path, "pose", view.id_pose);
            let pose = model.problem.push_pose(pose.world_from_camera(location)?);
            let camera = camera_of[&view.id_intrinsic];
            model.camera_of_pose.push(camera);
            model.image_names.push(name);
            pose_of.insert(key, (pose as u32, camera));
            *users_of_pose.entry(view.id_pose).or_default() += 1;
        }
        left_out.shared_poses = users_of_pose.values().filter(|&&users| users > 1).sum();
        for (&key, point) in &file.points {
            let landmark = model.problem.push_landmark(point.position.into());
            model.problem.constant_landmarks[landmark] = true;
            model.colors.push(GRAY);
            for &(view, pixel) in &point.observations {
                let Some(&(pose, camera)) = pose_of.get(&view) else {
                    if file.views.contains_key(&view) {
                        left_out.observations += 1;
                        continue;
                    }
                    let location = Location::key(path, "point", key);
                    return Err(IoError::UnknownId { location, field: "view", id: view.into() });
                };
                model.problem.constant_landmarks[landmark] = false;
                model.problem.constant_cameras[camera as usize] = false;
                let seen = &mut model.problem.reprojections;
                seen.push(pose, camera, landmark as u32, pixel.into(), 1.0);
            }
        }
        Ok((model, left_out))
    }
}

/// A view that has a pose and an intrinsic.
struct Placed<'a> {
    key: u32,
    view: &'a OpenMvgView,
    pose: &'a OpenMvgPose,
    name: String,
}

fn placed<'a>(file: &'a OpenMvgFile, path: &Path) -> Result<Vec<Placed<'a>>, IoError> {
    let mut placed = Vec::new();
    for (&key, view) in &file.views {
        let Some(pose) = file.poses.get(&view.id_pose) else { continue };
        if view.id_intrinsic == UNDEFINED {
            continue;
        }
        if !file.intrinsics.contains_key(&view.id_intrinsic) {
            let (location, id) = (Location::key(path, "view", key), view.id_intrinsic.into());
            return Err(IoError::UnknownId { location, field: "intrinsic", id });
        }
        placed.push(Placed { key, view, pose, name: view.name() });
    }
    Ok(placed)
}

impl OpenMvgView {
    /// The image's path below the root.
    fn name(&self) -> String {
        let folder = self.local_path.trim_end_matches(['/', '\\']);
        match folder {
            "" | "." => self.filename.clone(),
            folder => format!("{folder}/{}", self.filename),
        }
    }
}

impl OpenMvgPose {
    /// The pose: the rotation's transpose, and the center.
    fn world_from_camera(&self, location: impl FnOnce() -> Location) -> Result<Se3, IoError> {
        let [r0, r1, r2] = self.rotation;
        let [x, y, z] = self.center;
        let columns = |i: usize, t: f64| [r0[i], r1[i], r2[i], t];
        pose_matrix::rigid([columns(0, x), columns(1, y), columns(2, z)], location)
    }
}

impl OpenMvgIntrinsic {
    /// The camera, and which of its parameters OpenMVG's model has.
    fn camera(&self, key: u32, path: &Path) -> Result<(Camera, FreeParameters), IoError> {
        let missing = |field: &str| IoError::Truncated {
            location: Location::key(path, "intrinsic", key),
            field: field.to_owned(),
        };
        let linear = || {
            let focal = self.focal_length.ok_or_else(|| missing("focal_length"))?;
            let [cx, cy] = self.principal_point.ok_or_else(|| missing("principal_point"))?;
            Ok([focal, focal, cx, cy])
        };
        // k1, k2, p1, p2, k3, and which of them the model has.
        let (coefficients, has) = match self.model.as_str() {
            "pinhole" => ([0.0; 5], [false; 5]),
            "pinhole_radial_k1" => {
                let [k1] = self.disto_k1.ok_or_else(|| missing("disto_k1"))?;
                ([k1, 0.0, 0.0, 0.0, 0.0], [true, false, false, false, false])
            }
            "pinhole_radial_k3" => {
                let [k1, k2, k3] = self.disto_k3.ok_or_else(|| missing("disto_k3"))?;
                ([k1, k2, 0.0, 0.0, k3], [true, true, false, false, true])
            }
            "pinhole_brown_t2" => {
                let [k1, k2, k3, p1, p2] = self.disto_t2.ok_or_else(|| missing("disto_t2"))?;
                ([k1, k2, p1, p2, k3], [true; 5])
            }
            "fisheye" => {
                let [k1, k2, k3, k4] = self.fisheye.ok_or_else(|| missing("fisheye"))?;
                let [fx, fy, cx, cy] = linear()?;
                let camera = Camera::Fisheye(KannalaBrandt { fx, fy, cx, cy, k1, k2, k3, k4 });
                return Ok((camera, FreeParameters::new([true; 9], true)));
            }
            model => {
                let (camera, model) = (key.into(), excerpt(model.as_bytes()));
                let reason = "covis has no such model";
                return Err(IoError::UnsupportedCamera { camera, model, reason });
            }
        };
        let ([fx, fy, cx, cy], [k1, k2, p1, p2, k3]) = (linear()?, coefficients);
        let camera =
            Camera::Pinhole(PinholeRadialTangential { fx, fy, cx, cy, k1, k2, p1, p2, k3 });
        let is_free = std::array::from_fn(|k| k < 4 || has[k - 4]);
        Ok((camera, FreeParameters::new(is_free, true)))
    }
}
