//! COLMAP's camera models and which of them covis' models represent.
//!
//! SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, and FULL_OPENCV with k4 = k5 = k6 = 0
//! are pinholes with radial-tangential distortion; OPENCV_FISHEYE, SIMPLE_RADIAL_FISHEYE and
//! RADIAL_FISHEYE are Kannala-Brandt. The others are kept in a model and refused by the
//! conversion. Principal points shift by 0.5 px on the way. What a model lacks of covis' parameters
//! stays as it is in a solve, so that the model represents the result.

use self::ColmapCameraModel as Model;
use super::super::IoError;
use crate::geometry::{Camera, FreeParameters, KannalaBrandt, PinholeRadialTangential};

/// Distance from COLMAP's pixel origin (a corner) to covis' (the first pixel's center).
pub(super) const PIXEL_CENTER: f64 = 0.5;

/// A camera model of COLMAP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "the variants are COLMAP's names")]
pub enum ColmapCameraModel {
    SimplePinhole,
    Pinhole,
    SimpleRadial,
    Radial,
    OpenCv,
    OpenCvFisheye,
    FullOpenCv,
    Fov,
    SimpleRadialFisheye,
    RadialFisheye,
    ThinPrismFisheye,
    RadTanThinPrismFisheye,
}

/// Every model with its number in binary files (its place), name and parameter count.
const MODELS: [(Model, &str, usize); 12] = [
    (Model::SimplePinhole, "SIMPLE_PINHOLE", 3),
    (Model::Pinhole, "PINHOLE", 4),
    (Model::SimpleRadial, "SIMPLE_RADIAL", 4),
    (Model::Radial, "RADIAL", 5),
    (Model::OpenCv, "OPENCV", 8),
    (Model::OpenCvFisheye, "OPENCV_FISHEYE", 8),
    (Model::FullOpenCv, "FULL_OPENCV", 12),
    (Model::Fov, "FOV", 5),
    (Model::SimpleRadialFisheye, "SIMPLE_RADIAL_FISHEYE", 4),
    (Model::RadialFisheye, "RADIAL_FISHEYE", 5),
    (Model::ThinPrismFisheye, "THIN_PRISM_FISHEYE", 12),
    (Model::RadTanThinPrismFisheye, "RAD_TAN_THIN_PRISM_FISHEYE", 16),
];

impl ColmapCameraModel {
    /// The model's number in binary files.
    #[must_use]
    pub fn number(self) -> u32 {
        self as u32
    }

    /// The model's name in text files.
    #[must_use]
    pub fn name(self) -> &'static str {
        MODELS[self as usize].1
    }

    /// How many parameters it has.
    #[must_use]
    pub fn parameter_count(self) -> usize {
        MODELS[self as usize].2
    }

    /// Which parameters of covis' camera the model has: a single focal length is one unknown for fx and
    /// fy. k4, k5 and k6 of FULL_OPENCV stay zero. A model that covis does not represent has none.
    #[must_use]
    pub fn free_parameters(self) -> FreeParameters {
        // Focal lengths and principal point, then what is there of the distortion, in covis' order.
        let (has_one_focal_length, coefficients) = match self {
            Self::SimplePinhole => (true, 0),
            Self::Pinhole => (false, 0),
            Self::SimpleRadial | Self::SimpleRadialFisheye => (true, 1),
            Self::Radial | Self::RadialFisheye => (true, 2),
            Self::OpenCv | Self::OpenCvFisheye => (false, 4),
            Self::FullOpenCv => (false, 5),
            Self::Fov | Self::ThinPrismFisheye | Self::RadTanThinPrismFisheye => {
                return FreeParameters::NONE;
            }
        };
        FreeParameters::new(std::array::from_fn(|k| k < 4 + coefficients), has_one_focal_length)
    }

    /// The model of a number; `None` where covis does not know it.
    #[must_use]
    pub fn from_number(number: u32) -> Option<Self> {
        MODELS.get(number as usize).map(|entry| entry.0)
    }

    /// The model of a name; `None` where covis does not know it.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        MODELS.iter().find(|entry| entry.1 == name).map(|entry| entry.0)
    }
}

/// A camera with COLMAP's parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct ColmapCamera {
    /// The model.
    pub model: ColmapCameraModel,
    /// Image width in pixels.
    pub width: u64,
    /// Image height in pixels.
    pub height: u64,
    /// The model's parameters in COLMAP's order.
    pub parameters: Vec<f64>,
}

impl ColmapCamera {
    /// The narrowest of PINHOLE, OPENCV, FULL_OPENCV, OPENCV_FISHEYE and, for a Snavely camera,
    /// RADIAL that represents `camera` exactly. `width` and `height` are the image's, in pixels.
    #[must_use]
    pub fn from_camera(camera: &Camera, width: u64, height: u64) -> Self {
        let model = match camera {
            Camera::Snavely(_) => Model::Radial,
            Camera::Fisheye(_) => Model::OpenCvFisheye,
            Camera::Pinhole(c) if c.k3 != 0.0 => Model::FullOpenCv,
            Camera::Pinhole(c) if [c.k1, c.k2, c.p1, c.p2] != [0.0; 4] => Model::OpenCv,
            Camera::Pinhole(_) => Model::Pinhole,
        };
        let parameters = parameters(model, camera).unwrap_or_default();
        Self { model, width, height, parameters }
    }

    /// This camera with the parameters of `camera`, in the same model where that represents them
    /// exactly, else in the one of [`ColmapCamera::from_camera`].
    #[must_use]
    pub fn updated(&self, camera: &Camera) -> Self {
        let wide = Self::from_camera(camera, self.width, self.height);
        let same =
            parameters(self.model, camera).map(|parameters| Self { parameters, ..self.clone() });
        match same {
            Some(same) if same.to_camera(0).ok() == wide.to_camera(0).ok() => same,
            Some(_) | None => wide,
        }
    }

    /// Covis' camera.
    ///
    /// # Errors
    /// [`IoError::UnsupportedCamera`] with `id` where no model of covis represents it.
    pub fn to_camera(&self, id: u32) -> Result<Camera, IoError> {
        let refuse = |reason| IoError::UnsupportedCamera {
            camera: id.into(),
            model: self.model.name().to_owned(),
            reason,
        };
        let h = PIXEL_CENTER;
        let pinhole = |[fx, fy, cx, cy]: [f64; 4], [k1, k2, p1, p2, k3]: [f64; 5]| {
            let (cx, cy) = (cx - h, cy - h);
            Camera::Pinhole(PinholeRadialTangential { fx, fy, cx, cy, k1, k2, p1, p2, k3 })
        };
        let fisheye = |[fx, fy, cx, cy]: [f64; 4], [k1, k2, k3, k4]: [f64; 4]| {
            let (cx, cy) = (cx - h, cy - h);
            Camera::Fisheye(KannalaBrandt { fx, fy, cx, cy, k1, k2, k3, k4 })
        };
        let camera = match (self.model, self.parameters.as_slice()) {
            (Model::SimplePinhole, &[f, cx, cy]) => pinhole([f, f, cx, cy], [0.0; 5]),
            (Model::Pinhole, &[fx, fy, cx, cy]) => pinhole([fx, fy, cx, cy], [0.0; 5]),
            (Model::SimpleRadial, &[f, cx, cy, k]) => {
                pinhole([f, f, cx, cy], [k, 0.0, 0.0, 0.0, 0.0])
            }
            (Model::Radial, &[f, cx, cy, k1, k2]) => {
                pinhole([f, f, cx, cy], [k1, k2, 0.0, 0.0, 0.0])
            }
            (Model::OpenCv, &[fx, fy, cx, cy, k1, k2, p1, p2]) => {
                pinhole([fx, fy, cx, cy], [k1, k2, p1, p2, 0.0])
            }
            (Model::FullOpenCv, &[fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6]) => {
                if [k4, k5, k6] != [0.0; 3] {
                    return Err(refuse("k4, k5 and k6 must be zero"));
                }
                pinhole([fx, fy, cx, cy], [k1, k2, p1, p2, k3])
            }
            (Model::OpenCvFisheye, &[fx, fy, cx, cy, k1, k2, k3, k4]) => {
                fisheye([fx, fy, cx, cy], [k1, k2, k3, k4])
            }
            (Model::SimpleRadialFisheye, &[f, cx, cy, k]) => {
                fisheye([f, f, cx, cy], [k, 0.0, 0.0, 0.0])
            }
            (Model::RadialFisheye, &[f, cx, cy, k1, k2]) => {
                fisheye([f, f, cx, cy], [k1, k2, 0.0, 0.0])
            }
            (Model::Fov | Model::ThinPrismFisheye | Model::RadTanThinPrismFisheye, _) => {
                return Err(refuse("covis has no such model"));
            }
            (_, parameters) => {
                let (actual, expected) = (parameters.len(), self.model.parameter_count());
                return Err(IoError::SizeMismatch { what: "camera parameters", actual, expected });
            }
        };
        Ok(camera)
    }
}

/// The parameters of `camera` in COLMAP's `model`, dropping what the model lacks; `None` where the
/// two are of different kinds.
fn parameters(model: Model, camera: &Camera) -> Option<Vec<f64>> {
    let h = PIXEL_CENTER;
    let camera = match *camera {
        Camera::Snavely(s) => Camera::Pinhole(PinholeRadialTangential {
            k1: s.k1,
            k2: s.k2,
            ..PinholeRadialTangential::undistorted(s.focal, s.focal, 0.0, 0.0)
        }),
        Camera::Pinhole(_) | Camera::Fisheye(_) => *camera,
    };
    match camera {
        Camera::Pinhole(c) => {
            let (cx, cy) = (c.cx + h, c.cy + h);
            match model {
                Model::SimplePinhole => Some(vec![c.fx, cx, cy]),
                Model::Pinhole => Some(vec![c.fx, c.fy, cx, cy]),
                Model::SimpleRadial => Some(vec![c.fx, cx, cy, c.k1]),
                Model::Radial => Some(vec![c.fx, cx, cy, c.k1, c.k2]),
                Model::OpenCv => Some(vec![c.fx, c.fy, cx, cy, c.k1, c.k2, c.p1, c.p2]),
                Model::FullOpenCv => {
                    let radial = [c.k1, c.k2, c.p1, c.p2, c.k3, 0.0, 0.0, 0.0];
                    Some([[c.fx, c.fy, cx, cy].as_slice(), &radial].concat())
                }
                Model::OpenCvFisheye
                | Model::Fov
                | Model::SimpleRadialFisheye
                | Model::RadialFisheye
                | Model::ThinPrismFisheye
                | Model::RadTanThinPrismFisheye => None,
            }
        }
        Camera::Fisheye(c) => {
            let (cx, cy) = (c.cx + h, c.cy + h);
            match model {
                Model::OpenCvFisheye => Some(vec![c.fx, c.fy, cx, cy, c.k1, c.k2, c.k3, c.k4]),
                Model::SimpleRadialFisheye => Some(vec![c.fx, cx, cy, c.k1]),
                Model::RadialFisheye => Some(vec![c.fx, cx, cy, c.k1, c.k2]),
                Model::SimplePinhole
                | Model::Pinhole
                | Model::SimpleRadial
                | Model::Radial
                | Model::OpenCv
                | Model::FullOpenCv
                | Model::Fov
                | Model::ThinPrismFisheye
                | Model::RadTanThinPrismFisheye => None,
            }
        }
        Camera::Snavely(_) => None,
    }
}
