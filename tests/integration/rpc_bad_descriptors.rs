//! Descriptors on an ingest stream that nothing can be compared with: each is refused by name, and those that
//! serve something are accepted.

use covis::wire::v1;
use v1::ViolationReason as Reason;

use crate::common::{Stream, TestServer, run};
use crate::rpc_bad_input::{bad_keyframe, check, described};

#[test]
fn descriptors_that_nothing_can_be_compared_with_are_refused() {
    use v1::DescriptorKind::{Binary, Float32, Uint8};
    let image = |kind, data: &[u8], field, reason| {
        let descriptor = described(kind, data);
        (bad_keyframe(|k| k.global_descriptor = Some(descriptor)), field, reason)
    };
    let feature = |kind, data: &[u8], reason| {
        let descriptor = described(kind, data);
        let item = bad_keyframe(|k| k.observations[2].descriptor = Some(descriptor));
        (item, "keyframe.observations[2].descriptor.data", reason)
    };
    let (kind, data) = ("keyframe.global_descriptor.kind", "keyframe.global_descriptor.data");
    let floats = |numbers: &[f32]| -> Vec<u8> {
        numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
    };
    check(vec![
        image(Binary, &[7; 32], kind, Reason::OutOfRange),
        image(Uint8, &[7; 32], kind, Reason::OutOfRange),
        image(Float32, &[], data, Reason::Missing),
        image(Float32, &[7; 6], data, Reason::WrongLength),
        image(Float32, &floats(&[1.0, f32::NAN]), data, Reason::NotFinite),
        // No direction, and a length that no 32-bit number holds.
        image(Float32, &floats(&[0.0, -0.0]), data, Reason::OutOfRange),
        image(Float32, &floats(&[f32::MAX, f32::MAX]), data, Reason::OutOfRange),
        feature(Binary, &[], Reason::Missing),
        feature(Float32, &[7; 6], Reason::WrongLength),
        feature(Float32, &floats(&[f32::INFINITY]), Reason::NotFinite),
    ]);
    // Features of every kind serve to find landmarks that are one point.
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        server.build_map("room", 2).await;
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        let good = bad_keyframe(|k| {
            k.global_descriptor = Some(described(Float32, &floats(&[0.0, -2.5])));
            let all = [(Binary, vec![7; 8]), (Uint8, vec![7; 3]), (Float32, floats(&[0.0]))];
            for (observation, (kind, data)) in k.observations.iter_mut().zip(all) {
                observation.descriptor = Some(described(kind, &data));
            }
        });
        let ack = stream.put(100, good).await;
        assert_eq!(ack.status(), v1::AckStatus::Received, "{ack:?}");
    });
}
