//! `Localize`: from the request to the answer, on a thread of the solver pool. The index of places and
//! the geometric verification do the work; nothing of the map is changed.

use covis_solvers::geometric_verification::Feature;
use covis_solvers::geometry::Camera;
use covis_solvers::interrupt::Interrupt;

use super::convert::camera::camera;
use super::convert::entities::to_place_candidate;
use super::convert::geometry::{to_covariance6, to_rigid_transform, vector2};
use super::convert::ids::{to_keyframe_ref, to_landmark_ref};
use super::convert::item::{depth, feature_descriptor, image_descriptor};
use super::convert::{Path, Violations, all, convert};
use super::engine::{MapHandle, UnknownType};
use super::error::ServiceError;
use crate::loop_closing::{Localization, Located, QueryView};
use crate::map::{Descriptor, DescriptorKind, Map, Reason};
use crate::place::{DESCRIPTOR_BYTES, DESCRIPTORS, KEYFRAME_BYTES};
use crate::wire::v1;

/// A request in the terms of loop closing.
#[derive(Debug)]
pub(super) struct Input {
    camera: Camera,
    features: Vec<Feature>,
    descriptors: Vec<Option<Descriptor>>,
    image: Option<Descriptor>,
}

/// Reads a request but for its map.
pub(super) fn input(request: v1::LocalizeRequest) -> Result<Input, ServiceError> {
    convert(|out| {
        let at = Path::root("camera");
        let camera = out.required(at, request.camera.as_ref()).and_then(|m| camera(at, m, out));
        let at = Path::root("features");
        out.at_most(at, &request.features, DESCRIPTORS)?;
        let features = all(at, request.features, out, |at, message, out| {
            let pixel = vector2(at.field("pixel"), message.pixel.as_ref(), out);
            let sigma = out.positive(at.field("sigma_px"), message.sigma_px.unwrap_or(1.0));
            let depth = depth(at, message.depth_m, message.sigma_depth_m, out);
            let field = at.field("descriptor");
            let descriptor = match message.descriptor {
                None => None,
                Some(sent) => Some(binary_descriptor(field, sent, out)?),
            };
            let depth_m = depth?.map(|depth| (depth.depth_m, depth.sigma_m));
            Some((Feature { pixel: pixel?, sigma_px: sigma?, depth_m }, descriptor))
        });
        let at = Path::root("global_descriptor");
        let image = request.global_descriptor;
        let image = image.and_then(|image| image_descriptor(at, image, out));
        let (features, mut descriptors): (_, Vec<Option<Descriptor>>) =
            features?.into_iter().unzip();
        // What a keyframe could not have is not compared.
        let mut left = KEYFRAME_BYTES;
        let is_searchable =
            |descriptor: &&Descriptor| DESCRIPTOR_BYTES.contains(&descriptor.data.len());
        for descriptor in &mut descriptors {
            let bytes = descriptor.as_ref().filter(is_searchable).map_or(0, |d| d.data.len());
            match left.checked_sub(bytes) {
                Some(rest) => left = rest,
                None => *descriptor = None,
            }
        }
        Some(Input { camera: camera?.camera, features, descriptors, image })
    })
    .map_err(Into::into)
}

/// A descriptor of a feature. The index of places compares binary ones only.
fn binary_descriptor(
    at: Path<'_>,
    message: v1::Descriptor,
    out: &mut Violations,
) -> Option<Descriptor> {
    let descriptor = feature_descriptor(at, message, out)?;
    if descriptor.kind == DescriptorKind::Binary {
        return Some(descriptor);
    }
    let text = "only BINARY descriptors of features find places";
    out.report(at.field("kind"), Reason::OutOfRange, text)
}

/// Finds the place. The index of places must be up to the map.
pub(super) fn run(
    handle: &MapHandle,
    map: &Map,
    input: &Input,
    interrupt: &Interrupt,
) -> Result<v1::LocalizeResponse, ServiceError> {
    let view = QueryView {
        camera: input.camera,
        camera_id: None,
        features: input.features.clone(),
        descriptors: input.descriptors.iter().map(Option::as_ref).collect(),
        image: input.image.as_ref(),
    };
    let Localization { candidates, located, rivals } = handle.localize(map, &view, interrupt)?;
    if interrupt.is_due() {
        return Err(ServiceError::DeadlineExceeded);
    }
    if let Some(unknown) = handle.unknown_descriptor_type(&view) {
        return Err(refused(&unknown));
    }
    let rival = |rival: &Located| v1::RivalPose {
        world_from_camera: Some(to_rigid_transform(&rival.world_from_view)),
        covariance: to_covariance6(&rival.verified.information),
        keyframe: Some(to_keyframe_ref(map, rival.keyframe)),
        inlier_count: i32::try_from(rival.landmarks.len()).unwrap_or(i32::MAX),
    };
    let answer = v1::LocalizeResponse {
        revision: map.revision(),
        candidates: candidates.iter().map(|c| to_place_candidate(map, c)).collect(),
        rivals: rivals.iter().map(rival).collect(),
        ..v1::LocalizeResponse::default()
    };
    let Some(Located { world_from_view, verified, landmarks, .. }) = located else {
        return Ok(answer);
    };
    let inlier = |&(landmark, feature): &(_, usize)| v1::LocalizedFeature {
        feature: i32::try_from(feature).unwrap_or(i32::MAX),
        landmark: Some(to_landmark_ref(map, landmark)),
    };
    Ok(v1::LocalizeResponse {
        world_from_camera: Some(to_rigid_transform(&world_from_view)),
        covariance: to_covariance6(&verified.information),
        inliers: landmarks.iter().map(inlier).collect(),
        variance_factor: verified.variance_factor,
        ..answer
    })
}

/// Descriptors that no keyframe can be compared with find nothing, wherever the camera is.
fn refused(unknown: &UnknownType) -> ServiceError {
    let UnknownType { feature, name, bytes, known } = unknown;
    let known: Vec<String> =
        known.iter().map(|(name, bytes)| format!("{name:?} of {bytes} bytes")).collect();
    let field = match feature {
        Some(feature) => format!("features[{feature}].descriptor.name"),
        None => "global_descriptor.name".to_owned(),
    };
    let known = known.join(", ");
    let description =
        format!("no keyframe has descriptors named {name:?} of {bytes} bytes; there are {known}");
    ServiceError::field(field, Reason::UnknownValue, description)
}
