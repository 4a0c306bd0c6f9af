//! Checks of a keyframe's observations: references, numbers, doubles, projections.
//!
//! An observation whose landmark lies behind its camera passes: it is a fact about the estimate.

use std::fmt::Arguments;

use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::Vector3;

use super::super::{CameraEntity, EntityId, ItemObservation, NewLandmark, Observation, Reason};
use super::{Check, repeated};

/// Side of the largest image in pixels, where the camera does not say how large its images are.
const LARGEST_IMAGE: f64 = 65_536.0;

/// Where observations are made from.
pub(super) struct Viewpoint<'a> {
    /// `None` where the camera is unknown or missing, which is a violation of its own.
    pub(super) camera: Option<CameraEntity>,
    pub(super) world_from_camera: Se3,
    /// Landmarks of the same item.
    pub(super) new_landmarks: &'a [NewLandmark],
    /// Observations that the keyframe has already.
    pub(super) present: &'a [Observation],
}

impl Check<'_> {
    /// Checks the observations and returns those whose landmark is named by a known client.
    pub(super) fn observations(
        &mut self,
        path: &str,
        sent: &[ItemObservation],
        view: &Viewpoint<'_>,
    ) -> Vec<Observation> {
        let mut new: Vec<&NewLandmark> = view.new_landmarks.iter().collect();
        new.sort_by_key(|landmark| landmark.id);
        let present = view.present.iter().map(|known| (known.key(), None));
        let mut keys: Vec<_> = present.collect();
        let mut observations = Vec::with_capacity(sent.len());
        for (index, sent) in sent.iter().enumerate() {
            let at = format_args!("{path}[{index}]");
            self.numbers(at, sent, view);
            let Some(landmark) = self.resolve(&sent.landmark) else {
                self.unknown(format_args!("{at}.landmark"), "landmark", &sent.landmark);
                continue;
            };
            // The map's estimate is the better one where it knows the landmark already.
            let position = match self.map.landmarks.get(&landmark) {
                Some(known) => known.position,
                None => match new.binary_search_by_key(&landmark, |new| new.id) {
                    Ok(place) => new[place].position,
                    Err(_absent) => {
                        self.unknown(format_args!("{at}.landmark"), "landmark", &sent.landmark);
                        None
                    }
                },
            };
            if let Some(position) = &position {
                self.projection(at, landmark, position, view);
            }
            let observation = Observation {
                landmark,
                pixel: sent.pixel,
                sigma_px: sent.sigma_px,
                depth: sent.depth,
                descriptor: sent.descriptor.clone(),
            };
            if sent.pixel.iter().all(|value| value.is_finite()) {
                keys.push((observation.key(), Some(index)));
            }
            observations.push(observation);
        }
        for (index, (landmark, ..)) in repeated(keys) {
            let text = format!("landmark {} is observed twice at this pixel", landmark.id);
            self.fields.add(format_args!("{path}[{index}].landmark"), Reason::Duplicate, text);
        }
        observations
    }

    fn numbers(&mut self, at: Arguments<'_>, sent: &ItemObservation, view: &Viewpoint<'_>) {
        let sizes = view.camera.map_or([0, 0], |c| [c.width_px, c.height_px]);
        for ((name, value), size) in ["x", "y"].into_iter().zip(sent.pixel.iter()).zip(sizes) {
            let (field, size) = (format_args!("{at}.pixel.{name}"), f64::from(size));
            // Refined features may lie a little outside the image; a whole image away is no feature.
            let size = if size > 0.0 { size } else { LARGEST_IMAGE };
            let is_far = *value < -size || *value > 2.0 * size;
            if self.fields.finite(field, *value) && is_far {
                let text = format!("{value} is far outside an image of at most {size} pixels");
                self.fields.add(field, Reason::OutOfRange, text);
            }
        }
        self.fields.positive(format_args!("{at}.sigma_px"), sent.sigma_px);
        if let Some(depth) = &sent.depth {
            self.fields.positive(format_args!("{at}.depth_m"), depth.depth_m);
            self.fields.positive(format_args!("{at}.sigma_depth_m"), depth.sigma_m);
        }
    }

    fn projection(
        &mut self,
        at: Arguments<'_>,
        id: EntityId,
        position: &Vector3<f64>,
        view: &Viewpoint<'_>,
    ) {
        // Values that are not finite have their own violation.
        let numbers = view.world_from_camera.is_finite() && position.iter().all(|v| v.is_finite());
        let Some(CameraEntity { camera, .. }) = view.camera.filter(|_| numbers) else { return };
        let point_in_camera = view.world_from_camera.inverse_transform(position);
        let pixel = camera.project(&point_in_camera);
        if !pixel.is_some_and(|p| p.x.is_finite() && p.y.is_finite()) {
            let text = format!("landmark {} has no finite projection at the start", id.id);
            self.fields.add(format_args!("{at}.landmark"), Reason::ProjectionNotFinite, text);
        }
    }
}
