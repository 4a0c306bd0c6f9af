//! A first guess of the motion: the rotation between two small blurred images.
//!
//! Uses all pixels of the coarsest level that showed nothing moving, so that the guess is good where
//! the camera turns by much more than the patches of an alignment reach (like the first step of the
//! tracker of Klein and Murray, ECCV 2008). Inverse compositional Gauss-Newton over SO(3). It is a
//! first guess for `alignment`, never the pose of a frame.

use covis_solvers::geometry::{LieGroup, So3};
use nalgebra::{Matrix3, Vector2, Vector3};

use crate::camera::FrameCamera;
use crate::image::Image;
use crate::pyramid::{Pyramid, scale};

/// Most steps.
const MAX_STEPS: usize = 15;
/// A step that turns by less than this, pixels of the level, is the last.
const SHORT_PX: f64 = 0.02;
/// Passes of the blur, each with weights 1 2 1 along rows and columns.
const BLURS: usize = 3;
/// Scale of the robust weights, gray levels.
const SCALE: f32 = 12.0;

/// The small image of a frame, ready to be compared.
#[derive(Clone, Debug)]
pub struct SmallImage {
    gray: Image<f32>,
    level: usize,
}

/// A pixel that is compared.
struct Sample {
    ray: Vector3<f64>,
    gray: f32,
    /// ∂gray/∂ω.
    slope: Vector3<f64>,
}

impl SmallImage {
    /// The small image of a pyramid's coarsest level.
    #[must_use]
    pub fn new(pyramid: &Pyramid) -> Self {
        let level = pyramid.level_count() - 1;
        let mut gray = pyramid.level(level).map(f32::from);
        for _ in 0..BLURS {
            gray = blurred(&gray);
        }
        let mean = gray.pixels().iter().sum::<f32>() / gray.pixels().len() as f32;
        Self { gray: gray.map(|value| value - mean), level }
    }

    /// The rotation from this image's camera to that of a later one, from `start` on. `moving` says
    /// of a pixel of level 0 of this image whether it shows something that moves.
    #[must_use]
    pub fn rotation_to(
        &self,
        later: &Self,
        camera: &FrameCamera,
        start: &So3,
        moving: impl Fn(&Vector2<f64>) -> bool,
    ) -> Option<So3> {
        let samples = self.samples(camera, moving);
        let scale_px = scale(self.level);
        let mut later_from_this = *start;
        for _ in 0..MAX_STEPS {
            let rotation = later_from_this.matrix();
            let mut hessian = Matrix3::zeros();
            let mut gradient = Vector3::zeros();
            let mut seen = 0;
            for sample in &samples {
                let Some(pixel) = camera.project(&(rotation * sample.ray)) else { continue };
                let pixel_later = pixel.map(|x| (x + 0.5) / scale_px - 0.5);
                let Some(gray) = sampled(&later.gray, pixel_later.x as f32, pixel_later.y as f32)
                else {
                    continue;
                };
                seen += 1;
                let residual = sample.gray - gray;
                let weight = f64::from(SCALE / (SCALE + residual.abs()));
                hessian += sample.slope * sample.slope.transpose() * weight;
                gradient += sample.slope * (weight * f64::from(residual));
            }
            if seen * 4 < samples.len() {
                return None;
            }
            let step = -hessian.cholesky()?.solve(&gradient);
            later_from_this = later_from_this.compose(&So3::exp(&step).inverse());
            if step.norm() * camera.model().fx < SHORT_PX * scale_px {
                break;
            }
        }
        Some(later_from_this)
    }

    fn samples(&self, camera: &FrameCamera, moving: impl Fn(&Vector2<f64>) -> bool) -> Vec<Sample> {
        let (width, height) = self.gray.size();
        let scale_px = scale(self.level);
        let mut samples = Vec::with_capacity(width * height);
        for v in 1..height - 1 {
            for u in 1..width - 1 {
                let pixel = Vector2::new(u as f64, v as f64).map(|x| (x + 0.5) * scale_px - 0.5);
                if moving(&pixel) {
                    continue;
                }
                let ray = camera.ray(&pixel);
                let Some((_, by_point)) = camera.project_with_jacobian(&ray) else { continue };
                let gx = 0.5 * (self.gray.at(u + 1, v) - self.gray.at(u - 1, v));
                let gy = 0.5 * (self.gray.at(u, v + 1) - self.gray.at(u, v - 1));
                let by_ray = by_point.transpose() * Vector2::new(f64::from(gx), f64::from(gy));
                let slope = ray.cross(&by_ray) / scale_px;
                samples.push(Sample { ray, gray: self.gray.at(u, v), slope });
            }
        }
        samples
    }
}

/// Averages each pixel with its neighbors, with weights 1 2 1 along rows and columns.
fn blurred(image: &Image<f32>) -> Image<f32> {
    let (width, height) = image.size();
    let pass = |image: &Image<f32>, du: usize, dv: usize| {
        let mut out = image.clone();
        for v in 0..height {
            for u in 0..width {
                let before = image.at(u.saturating_sub(du), v.saturating_sub(dv));
                let after = image.at((u + du).min(width - 1), (v + dv).min(height - 1));
                out.set(u, v, 0.25 * before + 0.5 * image.at(u, v) + 0.25 * after);
            }
        }
        out
    };
    pass(&pass(image, 1, 0), 0, 1)
}

fn sampled(image: &Image<f32>, u: f32, v: f32) -> Option<f32> {
    if !(u >= 0.0 && v >= 0.0)
        || u as usize + 1 >= image.width()
        || v as usize + 1 >= image.height()
    {
        return None;
    }
    let (left, top) = (u as usize, v as usize);
    let (s, t) = (u - left as f32, v - top as f32);
    let upper = (1.0 - s) * image.at(left, top) + s * image.at(left + 1, top);
    let lower = (1.0 - s) * image.at(left, top + 1) + s * image.at(left + 1, top + 1);
    Some((1.0 - t) * upper + t * lower)
}
