//! A client of a map as the message of a snapshot, with what is to be solved for it, and back to the same
//! values. Its items are parts of their own. Nothing here knows where messages are kept.

use super::entities::{
    decode_ids, decode_pose, decode_scale, encode_id, encode_ids, encode_pose, encode_scale,
};
use super::{EncodingError, v1};
use covis_map::{
    Affected, Client, ClientIndex, Noise, OdometryNoise, PendingSolve, SolveRequest, ViewNoise,
};

pub(super) fn encode_client(client: &Client) -> v1::Client {
    let Client {
        name,
        epoch,
        next_sequence,
        optimized_sequence,
        pending_solve,
        closure_variance,
        noise,
        earlier_frames,
        scale,
        has_left,
        // Parts of their own.
        items: _,
    } = client;
    v1::Client {
        name: name.clone(),
        epoch: *epoch,
        next_sequence: *next_sequence,
        optimized_sequence: *optimized_sequence,
        closure_variance: Some(closure_variance.to_bits()),
        unsolved: pending_solve.as_ref().map(encode_unsolved),
        earlier_frames: earlier_frames.iter().map(encode_pose).collect(),
        scale: encode_scale(*scale),
        has_left: *has_left,
        noise: (*noise != Noise::default()).then(|| encode_noise(ClientIndex(0), noise)),
    }
}

pub(super) fn encode_noise(client: ClientIndex, noise: &Noise) -> v1::Noise {
    let Noise { odometry, views } = *noise;
    let OdometryNoise { translation_share, rotation_rad, pairs } = odometry;
    let ViewNoise { pixel_factor, depth_factor, outlier_share, windows } = views;
    v1::Noise {
        client: client.0,
        translation_share: translation_share.to_bits(),
        rotation_rad: rotation_rad.to_bits(),
        pairs: pairs.to_bits(),
        pixel_factor: pixel_factor.to_bits(),
        depth_factor: depth_factor.to_bits(),
        windows: windows.to_bits(),
        outlier_share: outlier_share.to_bits(),
    }
}

pub(super) fn decode_noise(noise: &v1::Noise) -> (ClientIndex, Noise) {
    let &v1::Noise {
        client,
        translation_share,
        rotation_rad,
        pairs,
        pixel_factor,
        depth_factor,
        windows,
        outlier_share,
    } = noise;
    let odometry = OdometryNoise {
        translation_share: f64::from_bits(translation_share),
        rotation_rad: f64::from_bits(rotation_rad),
        pairs: f64::from_bits(pairs),
    };
    let views = ViewNoise {
        pixel_factor: f64::from_bits(pixel_factor),
        depth_factor: f64::from_bits(depth_factor),
        outlier_share: f64::from_bits(outlier_share),
        windows: f64::from_bits(windows),
    };
    (ClientIndex(client), Noise { odometry, views })
}

pub(super) fn decode_client(client: v1::Client) -> Result<Client, EncodingError> {
    let v1::Client {
        name,
        epoch,
        next_sequence,
        optimized_sequence,
        closure_variance,
        unsolved,
        earlier_frames,
        scale,
        has_left,
        noise,
    } = client;
    let frame = |pose| decode_pose(Some(pose), "an earlier frame");
    Ok(Client {
        name,
        epoch,
        next_sequence,
        optimized_sequence,
        pending_solve: unsolved.map(decode_unsolved).transpose()?,
        // An earlier version had none.
        closure_variance: closure_variance.map_or(1.0, f64::from_bits),
        noise: noise.as_ref().map(|noise| decode_noise(noise).1).unwrap_or_default(),
        earlier_frames: earlier_frames.into_iter().map(frame).collect::<Result<_, _>>()?,
        scale: decode_scale(scale),
        has_left,
        items: Default::default(),
    })
}

fn encode_unsolved(unsolved: &PendingSolve) -> v1::Unsolved {
    let (kind, keyframes, graph) = match &unsolved.request {
        SolveRequest::Views(keyframe) => (1, vec![encode_id(*keyframe)], false),
        SolveRequest::LoopClosure => (2, Vec::new(), true),
        SolveRequest::Prior => (3, Vec::new(), true),
        SolveRequest::Edited(Affected { graph, keyframes }) => (4, encode_ids(keyframes), *graph),
    };
    v1::Unsolved { sequence: unsolved.sequence, kind, keyframes, graph }
}

fn decode_unsolved(unsolved: v1::Unsolved) -> Result<PendingSolve, EncodingError> {
    let v1::Unsolved { sequence, kind, keyframes, graph } = unsolved;
    let keyframes = decode_ids(keyframes);
    let request = match (kind, &keyframes[..], graph) {
        (1, &[keyframe], false) => SolveRequest::Views(keyframe),
        (2, [], true) => SolveRequest::LoopClosure,
        (3, [], true) => SolveRequest::Prior,
        (4, ..) => SolveRequest::Edited(Affected { graph, keyframes }),
        _ => return Err(EncodingError::Invalid("what is to be solved for a client")),
    };
    Ok(PendingSolve { sequence, request })
}
