//! Which intrinsics a folder's images have: given, from `camera.txt`, by the folder's name, assumed.
//!
//! A camera is 4 numbers, fx fy cx cy in pixels, or 9, with k1 k2 p1 p2 k3 after them; between numbers
//! stand white space or commas, and `#` begins a comment. Color and depth share the camera. It
//! calibrates nothing and opens no image.

use std::path::{Path, PathBuf};

use covis_solvers::geometry::PinholeRadialTangential;

use super::error::InputError;

/// The file in a sequence's folder.
pub const CAMERA_FILE: &str = "camera.txt";

/// The parameters' names, in the order of a file.
const FIELDS: [&str; 9] = ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"];

/// What the TUM RGB-D benchmark publishes for the color cameras of its three sets; the images of the
/// third are undistorted already.
const FREIBURG: [(&str, &str, [f64; 9]); 3] = [
    (
        "freiburg1",
        "fr1",
        [
            517.306408, 516.469215, 318.643040, 255.313989, 0.262383, -0.953104, -0.005358,
            0.002628, 1.163314,
        ],
    ),
    (
        "freiburg2",
        "fr2",
        [
            520.908620, 521.007327, 325.141442, 249.701764, 0.231222, -0.784899, -0.003257,
            -0.000105, 0.917205,
        ],
    ),
    ("freiburg3", "fr3", [535.4, 539.2, 320.1, 247.6, 0.0, 0.0, 0.0, 0.0, 0.0]),
];

/// Where a camera came from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CameraOrigin {
    /// The caller gave it.
    Given,
    /// This file in the folder.
    File(PathBuf),
    /// The folder's name names this set of the TUM RGB-D benchmark.
    FolderName(&'static str),
    /// All folders of this layout have it.
    Layout,
    /// Nothing tells: TUM's fr1 is assumed, which deserves a warning.
    Assumed,
}

/// A camera, and why this one.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct CameraChoice {
    /// Intrinsics, px.
    pub(super) camera: PinholeRadialTangential,
    /// Where they came from.
    pub(super) origin: CameraOrigin,
}

/// The camera that is assumed where no file gives one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Fallback {
    /// A TUM set by the folder's name, else its fr1.
    FolderName,
    /// The camera of the layout.
    Layout(PinholeRadialTangential),
}

/// Chooses the camera of a folder. `given` is a list of numbers separated by commas, or else a file.
pub(super) fn choose(
    given: Option<&str>,
    folder: &Path,
    fallback: Fallback,
) -> Result<CameraChoice, InputError> {
    if let Some(given) = given {
        return Ok(CameraChoice { camera: parse_argument(given)?, origin: CameraOrigin::Given });
    }
    let file = folder.join(CAMERA_FILE);
    if file.exists() {
        return Ok(CameraChoice { camera: read(&file)?, origin: CameraOrigin::File(file) });
    }
    Ok(match fallback {
        Fallback::Layout(camera) => CameraChoice { camera, origin: CameraOrigin::Layout },
        Fallback::FolderName => by_name(folder),
    })
}

/// A camera from the text of an argument: `fx,fy,cx,cy[,k1,k2,p1,p2,k3]`, or the path of a file.
///
/// # Errors
/// [`InputError`] naming the field, the count, or why the file cannot be read.
pub fn parse_argument(text: &str) -> Result<PinholeRadialTangential, InputError> {
    let file = Path::new(text);
    if text.contains(',') && !file.exists() { parse(text, text) } else { read(file) }
}

fn read(path: &Path) -> Result<PinholeRadialTangential, InputError> {
    let bytes =
        std::fs::read(path).map_err(|source| InputError::Read { path: path.to_owned(), source })?;
    parse(&String::from_utf8_lossy(&bytes), &path.display().to_string())
}

/// Parses the numbers; `from` names them in errors.
pub(super) fn parse(text: &str, from: &str) -> Result<PinholeRadialTangential, InputError> {
    let code = text.lines().filter_map(|line| line.split('#').next());
    let words: Vec<&str> = code
        .flat_map(|line| line.split(|c: char| c.is_whitespace() || c == ','))
        .filter(|word| !word.is_empty())
        .collect();
    let mut numbers = [0.0; 9];
    for ((number, word), field) in numbers.iter_mut().zip(&words).zip(FIELDS) {
        let parsed = word.parse().ok().filter(|value: &f64| value.is_finite());
        *number = parsed.ok_or_else(|| InputError::CameraNumber {
            from: from.to_owned(),
            field,
            found: word.chars().take(40).collect(),
        })?;
    }
    if ![4, FIELDS.len()].contains(&words.len()) {
        return Err(InputError::CameraCount { from: from.to_owned(), found: words.len() });
    }
    for (&value, field) in numbers.iter().zip(FIELDS).take(2) {
        if value <= 0.0 {
            return Err(InputError::Focal { from: from.to_owned(), field, value });
        }
    }
    Ok(camera(numbers))
}

fn by_name(folder: &Path) -> CameraChoice {
    // `.` and a trailing `..` have names too.
    let full = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let name =
        full.file_name().map_or_else(String::new, |name| name.to_string_lossy().to_lowercase());
    let named =
        FREIBURG.iter().find(|(long, short, _)| name.contains(long) || name.contains(short));
    let (origin, numbers) = match named {
        Some((_, short, numbers)) => (CameraOrigin::FolderName(short), *numbers),
        None => (CameraOrigin::Assumed, FREIBURG[0].2),
    };
    CameraChoice { camera: camera(numbers), origin }
}

fn camera([fx, fy, cx, cy, k1, k2, p1, p2, k3]: [f64; 9]) -> PinholeRadialTangential {
    PinholeRadialTangential { fx, fy, cx, cy, k1, k2, p1, p2, k3 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_or_nine_numbers_are_a_camera() {
        let short = parse_argument("500, 501,320,240").unwrap();
        assert_eq!(short, PinholeRadialTangential::undistorted(500.0, 501.0, 320.0, 240.0));
        let text =
            "# fx fy\n517.3 516.5 318.6 255.3 # center\n0.2624 -0.9531,-0.0054 0.0026 1.1633";
        let long = parse(text, "camera.txt").unwrap();
        assert_eq!((long.k1, long.k2, long.p1), (0.2624, -0.9531, -0.0054));
        assert_eq!((long.p2, long.k3), (0.0026, 1.1633));
    }

    #[test]
    fn what_is_wrong_with_a_camera_is_named() {
        let error = |text| parse_argument(text).unwrap_err().to_string();
        assert_eq!(error("1,2,x,4"), "camera 1,2,x,4: cx is `x`, not a finite number");
        assert!(error("1,2,3,4,inf,0,0,0,0").contains("k1 is `inf`"));
        assert!(error("1,2,3,4,5").contains("5 numbers"));
        assert!(error("1,2,3,4,5,6,7,8,9,10").contains("10 numbers"));
        assert!(error("1,-2,3,4").contains("fy is -2 px"));
        assert!(error("0,2,3,4").contains("fx is 0 px"));
        assert!(error("no-such-file").contains("no-such-file: cannot be read"));
    }

    #[test]
    fn given_goes_before_file_before_name_before_assumption() {
        let root = tempfile::tempdir().unwrap();
        let choice = |name: &str, given| {
            let folder = root.path().join(name);
            fs_err::create_dir_all(&folder).unwrap();
            choose(given, &folder, Fallback::FolderName).unwrap()
        };
        let third = choice("rgbd_dataset_freiburg3_walking_xyz", None);
        assert_eq!((third.origin, third.camera.fx), (CameraOrigin::FolderName("fr3"), 535.4));
        let second = choice("my_FR2_desk", None);
        assert_eq!((second.origin, second.camera.fx), (CameraOrigin::FolderName("fr2"), 520.90862));
        let first = choice("office", None);
        assert_eq!((first.origin, first.camera.fx), (CameraOrigin::Assumed, 517.306408));

        let file = root.path().join("office/camera.txt");
        fs_err::write(&file, "400 400 1 2").unwrap();
        let from_file = choice("office", None);
        assert_eq!(from_file.camera.fx, 400.0);
        assert_eq!(from_file.origin, CameraOrigin::File(file.clone()));
        let given = choice("office", Some("300,300,1,2"));
        assert_eq!((given.origin, given.camera.fx), (CameraOrigin::Given, 300.0));
        let other = choice("my_FR2_desk", file.to_str());
        assert_eq!((other.origin, other.camera.fx), (CameraOrigin::Given, 400.0));
    }
}
