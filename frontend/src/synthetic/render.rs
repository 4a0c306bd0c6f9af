//! From solids to what each pixel shows: its depth, which solid, and its color.
//!
//! A ray goes through each pixel's center and is tried against the solids whose outline touches its
//! tile, nearest first, so that what is hidden costs little. Depth is of the center ray alone; color is
//! averaged over four rays where a pixel's neighbors show something else. Rows are drawn in parallel
//! and each pixel by itself. Noise and exposure are added by `sensor`.

use covis_solvers::geometry::{LieGroup, PinholeRadialTangential, Se3};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::material::Albedo;
use super::solid::{Hit, NEAR_M, Shape, Solid};
use crate::image::Image;

/// Edge of the tiles that share a list of solids, px.
const TILE: usize = 16;

/// The lamp, in the world, m.
const LAMP_IN_WORLD: [f64; 3] = [0.4, -0.5, 2.45];
/// Light from everywhere, and from the lamp at right angles.
const AMBIENT: f64 = 0.42;
const DIRECT: f64 = 0.5;

/// What the center of a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Surface {
    /// Along the optical axis, m; 0 where nothing is.
    pub(super) depth_m: f32,
    /// The solid's index.
    pub(super) solid: u16,
    /// Its face.
    face: u8,
    /// Of the angle between the ray and the surface's normal.
    pub(super) cosine: f32,
    /// Reflected light, 0 to 1.
    color: Albedo,
}

/// A camera without distortion at its pose.
#[derive(Clone, Copy, Debug)]
pub(super) struct RenderCamera {
    pub(super) camera: PinholeRadialTangential,
    pub(super) world_from_camera: Se3,
    pub(super) size: (usize, usize),
}

/// A solid as one view sees it.
struct SolidInView<'a> {
    solid: &'a Solid,
    index: u16,
    /// Rotation of a camera's direction into the solid's axes.
    solid_from_camera: Matrix3<f64>,
    /// The camera's center and the lamp in the solid's axes.
    camera_in_solid: Vector3<f64>,
    lamp_in_solid: Vector3<f64>,
    /// No point is nearer, m along the optical axis.
    nearest_m: f64,
    /// What holds its outline, px: from column and row, to column and row.
    outline: [f64; 4],
}

/// A scene as one view sees it.
pub(super) struct Picture<'a> {
    view: RenderCamera,
    /// Nearest first, the room before all.
    seen: Vec<SolidInView<'a>>,
}

impl<'a> Picture<'a> {
    pub(super) fn new(solids: &'a [Solid], view: RenderCamera) -> Self {
        let mut seen: Vec<_> = (0..)
            .zip(solids)
            .filter_map(|(index, solid)| SolidInView::new(solid, index, &view))
            .collect();
        seen.sort_unstable_by(|a, b| {
            a.nearest_m.total_cmp(&b.nearest_m).then(a.index.cmp(&b.index))
        });
        Self { view, seen }
    }

    /// What the pixels' centers show.
    pub(super) fn surfaces(&self) -> Image<Surface> {
        let (width, height) = self.view.size;
        let nothing =
            Surface { depth_m: 0.0, solid: u16::MAX, face: 0, cosine: 0.0, color: [0.0; 3] };
        let mut image = Image::filled(width, height, nothing);
        self.draw(&mut image, |seen, u, v| self.cast(seen, u as f64, v as f64).unwrap_or(nothing));
        image
    }

    /// The light of each pixel, edges averaged.
    pub(super) fn colors(&self, surfaces: &Image<Surface>) -> Image<Albedo> {
        let (width, height) = self.view.size;
        let mut image = Image::filled(width, height, [0.0; 3]);
        self.draw(&mut image, |seen, u, v| {
            let center = surfaces.at(u, v);
            let differs = |u: usize, v: usize| {
                let other = surfaces.at(u.min(width - 1), v.min(height - 1));
                (other.solid, other.face) != (center.solid, center.face)
            };
            let inside = !(differs(u + 1, v)
                || differs(u, v + 1)
                || differs(u.saturating_sub(1), v)
                || differs(u, v.saturating_sub(1)));
            if inside {
                return center.color;
            }
            let mut sum = [0.0; 3];
            for (du, dv) in [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)] {
                let color = self
                    .cast(seen, u as f64 + du, v as f64 + dv)
                    .map_or(center.color, |surface| surface.color);
                for (sum, channel) in sum.iter_mut().zip(color) {
                    *sum += 0.25 * channel;
                }
            }
            sum
        });
        image
    }

    /// Sets each pixel by its position and the solids that its tile may show.
    fn draw<T: Copy + Send>(
        &self,
        image: &mut Image<T>,
        pixel: impl Fn(&[&SolidInView<'a>], usize, usize) -> T + Sync,
    ) {
        let width = image.width();
        let bands = image.pixels_mut().par_chunks_mut(TILE * width).enumerate();
        bands.for_each(|(band, rows)| {
            let first_row = band * TILE;
            for first in (0..width).step_by(TILE) {
                let seen: Vec<_> =
                    self.seen.iter().filter(|seen| seen.touches(first, first_row)).collect();
                for (dv, row) in rows.chunks_exact_mut(width).enumerate() {
                    for u in first..width.min(first + TILE) {
                        row[u] = pixel(&seen, u, first_row + dv);
                    }
                }
            }
        });
    }

    /// The first surface behind a point of the image.
    fn cast(&self, seen: &[&SolidInView<'a>], u: f64, v: f64) -> Option<Surface> {
        let camera = &self.view.camera;
        let ray = Vector3::new((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
        let mut first: Option<(Hit, &SolidInView<'a>, Vector3<f64>)> = None;
        for &candidate in seen {
            let best = first.as_ref().map_or(f64::INFINITY, |(hit, ..)| hit.t);
            if candidate.nearest_m > best {
                break;
            }
            if !candidate.may_show(u, v) {
                continue;
            }
            let direction = candidate.direction(&ray);
            if let Some(hit) = candidate.solid.shape.hit(&candidate.camera_in_solid, &direction)
                && hit.t < best
            {
                first = Some((hit, candidate, direction));
            }
        }
        let (hit, seen, direction) = first?;
        let point = seen.camera_in_solid + direction * hit.t;
        let cosine = -hit.normal.dot(&direction) / direction.norm();
        let lamp = seen.lamp_in_solid - point;
        let light = AMBIENT + DIRECT * (hit.normal.dot(&lamp) / lamp.norm()).max(0.0);
        // A pixel covers more of a surface that it sees at an angle.
        let footprint = (hit.t / (camera.fx * cosine.max(0.15))) as f32;
        let material = &seen.solid.material;
        let at = point.map(|coordinate| coordinate as f32);
        let albedo = match hit.face {
            // Books and boards lie along the longer axis of a face.
            Some(face @ 0..=1) => material.flat(at.y, at.z, face, footprint),
            Some(face @ 2..=3) => material.flat(at.x, at.z, face, footprint),
            Some(face) => material.flat(at.x, at.y, face, footprint),
            None => material.solid(&at, footprint),
        };
        Some(Surface {
            depth_m: hit.t as f32,
            solid: seen.index,
            face: hit.face.unwrap_or(u8::MAX),
            cosine: cosine as f32,
            color: albedo.map(|channel| channel * light as f32),
        })
    }
}

impl<'a> SolidInView<'a> {
    /// `None` where all of it lies behind the camera.
    fn new(solid: &'a Solid, index: u16, view: &RenderCamera) -> Option<Self> {
        let camera_from_solid = view.world_from_camera.inverse() * solid.world_from_solid;
        let corners = solid.shape.corners().map(|corner| camera_from_solid.transform(&corner));
        let depths = corners.iter().map(|corner| corner.z);
        let nearest_m = depths.clone().fold(f64::INFINITY, f64::min);
        if depths.fold(f64::NEG_INFINITY, f64::max) < NEAR_M {
            return None;
        }
        let mut outline = [f64::NEG_INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::INFINITY];
        if nearest_m > NEAR_M {
            outline = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
            for corner in &corners {
                let u = view.camera.fx * corner.x / corner.z + view.camera.cx;
                let v = view.camera.fy * corner.y / corner.z + view.camera.cy;
                let [left, top, right, bottom] = outline;
                outline = [left.min(u), top.min(v), right.max(u), bottom.max(v)];
            }
        }
        let inside = matches!(solid.shape, Shape::Room(_));
        let solid_from_world = solid.world_from_solid.inverse();
        Some(Self {
            solid,
            index,
            solid_from_camera: camera_from_solid.rotation.inverse().matrix(),
            camera_in_solid: camera_from_solid.inverse().translation,
            lamp_in_solid: solid_from_world.transform(&LAMP_IN_WORLD.into()),
            nearest_m: if inside { f64::NEG_INFINITY } else { nearest_m },
            outline,
        })
    }

    /// A camera's direction in the solid's axes. Written out: the general product of nalgebra is a call for
    /// each column, an eighth of what a picture takes.
    fn direction(&self, ray: &Vector3<f64>) -> Vector3<f64> {
        let m = &self.solid_from_camera;
        let row = |i: usize| m[(i, 0)] * ray.x + m[(i, 1)] * ray.y + m[(i, 2)] * ray.z;
        Vector3::new(row(0), row(1), row(2))
    }

    /// Whether a point of the image lies within what holds the outline.
    fn may_show(&self, u: f64, v: f64) -> bool {
        let [left, top, right, bottom] = self.outline;
        left <= u && u <= right && top <= v && v <= bottom
    }

    /// Whether the outline reaches into a tile, or within a pixel of it.
    fn touches(&self, first_column: usize, first_row: usize) -> bool {
        let [left, top, right, bottom] = self.outline;
        let (u, v) = (first_column as f64, first_row as f64);
        let last = TILE as f64;
        left <= u + last && right >= u - 1.0 && top <= v + last && bottom >= v - 1.0
    }
}
