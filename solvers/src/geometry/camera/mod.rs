//! Camera models: from a point in camera coordinates to a pixel and back, with Jacobians.
//!
//! Camera axes are x right, y down, z forward; a pixel is (u, v) = (column, row), with integers at
//! pixel centers. Points behind a pinhole project too, since BAL counts them: a caller that cares
//! about cheirality checks z. [`CameraModel`] is the static interface for hot loops, [`Camera`] the
//! closed set of models for storage and mixed problems.
//!
//! | file | role |
//! |---|---|
//! | `pinhole`, `kannala_brandt`, `snavely` | the models |
//! | `radial` | the inverse of a radial distortion |
//! | `free` | which parameters are free, and which share one unknown |

mod free;
mod kannala_brandt;
mod pinhole;
mod radial;
mod snavely;

use std::fmt::Debug;
use std::ops::Deref;

use nalgebra::{Matrix2x3, SMatrix, SVector, Vector2, Vector3};

pub use free::{FreeParameters, ParameterKind};
pub use kannala_brandt::KannalaBrandt;
pub use pinhole::PinholeRadialTangential;
pub use snavely::Snavely;

/// Parameters of the model that has most of them.
const MAX_PARAMETERS: usize = 9;

/// A projected pixel with its derivatives; `P` is the number of camera parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection<const P: usize> {
    /// The pixel (u, v).
    pub pixel: Vector2<f64>,
    /// ∂pixel/∂(point in camera), 2 × 3.
    pub d_point: Matrix2x3<f64>,
    /// ∂pixel/∂parameters, 2 × P, columns in the model's parameter order.
    pub d_parameters: SMatrix<f64, 2, P>,
}

impl<const P: usize> Projection<P> {
    /// The projection itself where all its numbers are finite.
    #[inline]
    fn finite(self) -> Option<Self> {
        // A sum is finite only if no term is NaN or infinite.
        let sum = self.pixel.sum() + self.d_point.sum() + self.d_parameters.sum();
        sum.is_finite().then_some(self)
    }

    /// The same projection with zero columns up to the widest model.
    #[inline]
    fn padded(&self) -> Projection<MAX_PARAMETERS> {
        let mut d_parameters = SMatrix::<f64, 2, MAX_PARAMETERS>::zeros();
        d_parameters.fixed_view_mut::<2, P>(0, 0).copy_from(&self.d_parameters);
        Projection { pixel: self.pixel, d_point: self.d_point, d_parameters }
    }
}

/// A camera model with `P` parameters.
pub trait CameraModel<const P: usize>: Copy + Debug + PartialEq + Send + Sync + 'static {
    /// The parameters, in the order of the struct's fields.
    fn parameters(&self) -> SVector<f64, P>;

    /// The camera with these parameters.
    fn from_parameters(parameters: &SVector<f64, P>) -> Self;

    /// The pixel of a point, or `None` where it is not finite.
    fn project(&self, point_in_camera: &Vector3<f64>) -> Option<Vector2<f64>>;

    /// The pixel and its derivatives, or `None` where any of them is not finite.
    fn project_with_jacobians(&self, point_in_camera: &Vector3<f64>) -> Option<Projection<P>>;

    /// A point on the ray of a pixel: at depth z = 1 for pinhole models, of unit length for the
    /// fisheye. `None` where no ray meets the pixel or the iteration fails.
    fn unproject(&self, pixel: &Vector2<f64>) -> Option<Vector3<f64>>;
}

/// The parameters of a [`Camera`]: as many as its model has; dereferences to their slice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParameterVec {
    /// The parameters, then zeros.
    pub values: SVector<f64, MAX_PARAMETERS>,
    /// How many of `values` are parameters.
    pub count: usize,
}

impl ParameterVec {
    /// Pads the parameters of a model with zeros.
    fn new<const P: usize>(parameters: &SVector<f64, P>) -> Self {
        let mut values = SVector::<f64, MAX_PARAMETERS>::zeros();
        values.fixed_rows_mut::<P>(0).copy_from(parameters);
        Self { values, count: P }
    }

    /// The parameters without the padding.
    pub fn as_slice(&self) -> &[f64] {
        &self.values.as_slice()[..self.count.min(MAX_PARAMETERS)]
    }
}

impl Deref for ParameterVec {
    type Target = [f64];

    fn deref(&self) -> &[f64] {
        self.as_slice()
    }
}

/// A camera of any supported model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Camera {
    /// Pinhole with radial and tangential distortion.
    Pinhole(PinholeRadialTangential),
    /// Kannala-Brandt fisheye.
    Fisheye(KannalaBrandt),
    /// The camera of Bundler and BAL files.
    Snavely(Snavely),
}

impl Camera {
    /// The pixel of a point, or `None` where it is not finite.
    #[inline]
    pub fn project(&self, point_in_camera: &Vector3<f64>) -> Option<Vector2<f64>> {
        match self {
            Self::Pinhole(camera) => camera.project(point_in_camera),
            Self::Fisheye(camera) => camera.project(point_in_camera),
            Self::Snavely(camera) => camera.project(point_in_camera),
        }
    }

    /// The pixel and its derivatives, or `None` where any of them is not finite.
    ///
    /// Columns of `d_parameters` from [`Camera::parameter_count`] on are zero.
    #[inline]
    pub fn project_with_jacobians(
        &self,
        point_in_camera: &Vector3<f64>,
    ) -> Option<Projection<MAX_PARAMETERS>> {
        match self {
            Self::Pinhole(camera) => camera.project_with_jacobians(point_in_camera),
            Self::Fisheye(camera) => {
                camera.project_with_jacobians(point_in_camera).map(|p| p.padded())
            }
            Self::Snavely(camera) => {
                camera.project_with_jacobians(point_in_camera).map(|p| p.padded())
            }
        }
    }

    /// A point on the ray of a pixel; see [`CameraModel::unproject`].
    pub fn unproject(&self, pixel: &Vector2<f64>) -> Option<Vector3<f64>> {
        match self {
            Self::Pinhole(camera) => camera.unproject(pixel),
            Self::Fisheye(camera) => camera.unproject(pixel),
            Self::Snavely(camera) => camera.unproject(pixel),
        }
    }

    /// The number of parameters of the model.
    #[inline]
    pub fn parameter_count(&self) -> usize {
        match self {
            Self::Pinhole(_) => 9,
            Self::Fisheye(_) => 8,
            Self::Snavely(_) => 3,
        }
    }

    /// What the parameter of this index describes.
    pub fn parameter_kind(&self, parameter: usize) -> ParameterKind {
        match (self, parameter) {
            (Self::Snavely(_), 0) | (Self::Pinhole(_) | Self::Fisheye(_), 0 | 1) => {
                ParameterKind::FocalLength
            }
            (Self::Pinhole(_) | Self::Fisheye(_), 2 | 3) => ParameterKind::PrincipalPoint,
            (Self::Pinhole(_) | Self::Fisheye(_) | Self::Snavely(_), _) => {
                ParameterKind::Distortion
            }
        }
    }

    /// The parameters, in the order of the model's fields.
    pub fn parameters(&self) -> ParameterVec {
        match self {
            Self::Pinhole(camera) => ParameterVec::new(&camera.parameters()),
            Self::Fisheye(camera) => ParameterVec::new(&camera.parameters()),
            Self::Snavely(camera) => ParameterVec::new(&camera.parameters()),
        }
    }

    /// Adds `delta` to the parameters; entries that are missing count as zero, and entries past
    /// the parameter count are ignored.
    pub fn plus_parameters(&mut self, delta: &[f64]) {
        match self {
            Self::Pinhole(camera) => add(camera, delta),
            Self::Fisheye(camera) => add(camera, delta),
            Self::Snavely(camera) => add(camera, delta),
        }
    }

    /// Whether every parameter is finite.
    pub fn is_finite(&self) -> bool {
        self.parameters().iter().all(|p| p.is_finite())
    }

    /// The focal length in pixels, averaged over both axes where they differ.
    pub fn mean_focal_px(&self) -> f64 {
        match self {
            Self::Pinhole(camera) => 0.5 * (camera.fx + camera.fy),
            Self::Fisheye(camera) => 0.5 * (camera.fx + camera.fy),
            Self::Snavely(camera) => camera.focal,
        }
    }
}

/// Moves a camera's parameters by `delta`.
fn add<const P: usize, C: CameraModel<P>>(camera: &mut C, delta: &[f64]) {
    let mut parameters = camera.parameters();
    for (parameter, change) in parameters.iter_mut().zip(delta) {
        *parameter += change;
    }
    *camera = C::from_parameters(&parameters);
}

impl From<PinholeRadialTangential> for Camera {
    fn from(camera: PinholeRadialTangential) -> Self {
        Self::Pinhole(camera)
    }
}

impl From<KannalaBrandt> for Camera {
    fn from(camera: KannalaBrandt) -> Self {
        Self::Fisheye(camera)
    }
}

impl From<Snavely> for Camera {
    fn from(camera: Snavely) -> Self {
        Self::Snavely(camera)
    }
}

/// A pixel where both its coordinates are finite.
#[inline]
fn finite_pixel(u: f64, v: f64) -> Option<Vector2<f64>> {
    (u.is_finite() && v.is_finite()).then(|| Vector2::new(u, v))
}
