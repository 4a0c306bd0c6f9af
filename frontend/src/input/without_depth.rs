//! Folders of data sets whose cameras measure no depth: EuRoC (ASL) and KITTI odometry.
//!
//! They are recognized by their files, so that a source says what is there and what is missing, and so
//! that those who compare with the truth find it. It reads no file.

use std::fmt;
use std::path::{Path, PathBuf};

use super::error::InputError;

/// Whose layout a folder has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataSet {
    /// EuRoC, and others in the layout of the ASL.
    Euroc,
    /// KITTI odometry.
    Kitti,
}

impl fmt::Display for DataSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Euroc => "EuRoC",
            Self::Kitti => "KITTI",
        })
    }
}

/// A folder of such a data set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WithoutDepth {
    /// The data set.
    pub layout: DataSet,
    /// The sensors in the folder, by their folders' names.
    pub sensors: Vec<&'static str>,
    /// The trajectory, where there is one: a table of EuRoC, or poses of KITTI.
    pub truth: Option<PathBuf>,
    /// The times of the poses of KITTI.
    pub times: Option<PathBuf>,
}

/// The sensors that EuRoC and KITTI have.
const EUROC_SENSORS: [&str; 4] = ["cam0", "cam1", "imu0", "leica0"];
const KITTI_SENSORS: [&str; 5] = ["image_0", "image_1", "image_2", "image_3", "velodyne"];

impl WithoutDepth {
    /// What a folder is, where it is one of these: of EuRoC the folder `mav0` or the one that has it, of
    /// KITTI the folder of a sequence.
    #[must_use]
    pub fn of(folder: &Path) -> Option<Self> {
        Self::euroc(&folder.join("mav0"))
            .or_else(|| Self::euroc(folder))
            .or_else(|| Self::kitti(folder))
    }

    fn euroc(folder: &Path) -> Option<Self> {
        let truth = folder.join("state_groundtruth_estimate0/data.csv");
        folder.join("cam0/data.csv").is_file().then(|| Self {
            layout: DataSet::Euroc,
            sensors: present(folder, &EUROC_SENSORS),
            truth: truth.is_file().then_some(truth),
            times: None,
        })
    }

    fn kitti(folder: &Path) -> Option<Self> {
        let sensors = present(folder, &KITTI_SENSORS);
        if sensors.is_empty() || !folder.join("calib.txt").is_file() {
            return None;
        }
        // `.` has a name and parents, too.
        let full = folder.canonicalize().ok()?;
        let truth = full
            .file_name()
            .zip(full.parent()?.parent())
            .map(|(name, root)| root.join("poses").join(name).with_extension("txt"));
        let times = folder.join("times.txt");
        Some(Self {
            layout: DataSet::Kitti,
            sensors,
            truth: truth.filter(|truth| truth.is_file()),
            times: times.is_file().then_some(times),
        })
    }

    /// Why it is no source of frames.
    pub(super) fn error(self, path: &Path) -> InputError {
        let Self { layout, sensors, truth, .. } = self;
        let (path, sensors) = (path.to_owned(), sensors.join(", "));
        InputError::WithoutDepth { path, layout, sensors, has_truth: truth.is_some() }
    }
}

fn present(folder: &Path, names: &[&'static str]) -> Vec<&'static str> {
    names.iter().copied().filter(|name| folder.join(name).is_dir()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::{FolderOptions, open_folder};

    #[test]
    fn folders_of_euroc_and_kitti_are_refused_by_name_with_what_they_have() {
        let root = tempfile::tempdir().unwrap();
        let put = |name: &str| {
            let path = root.path().join(name);
            fs_err::create_dir_all(path.parent().unwrap()).unwrap();
            fs_err::write(path, "").unwrap();
        };
        for name in ["cam0/data.csv", "cam1/data.csv", "imu0/data.csv"] {
            put(&format!("MH_01/mav0/{name}"));
        }
        for name in ["image_2/0.png", "calib.txt", "times.txt"] {
            put(&format!("sequences/07/{name}"));
        }
        let refused = |name: &str| {
            let folder = root.path().join(name);
            open_folder(&folder, FolderOptions::default()).err().unwrap().to_string()
        };
        for name in ["MH_01", "MH_01/mav0"] {
            let error = refused(name);
            assert!(
                error.contains(&format!("{name}: a folder of EuRoC with cam0, cam1, imu0")),
                "{error}"
            );
        }
        let kitti = root.path().join("sequences/07");
        assert!(
            refused("sequences/07")
                .contains("a folder of KITTI with image_2: it has no depth images")
        );
        let found = WithoutDepth::of(&kitti).unwrap();
        assert_eq!((found.truth, found.times), (None, Some(kitti.join("times.txt"))));
        put("poses/07.txt");
        let truth = WithoutDepth::of(&kitti).unwrap().truth.unwrap();
        assert!(truth.ends_with("poses/07.txt"), "{truth:?}");
        assert_eq!(WithoutDepth::of(root.path()), None);
    }
}
