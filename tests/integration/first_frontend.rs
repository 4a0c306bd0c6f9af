//! `docs/your-first-frontend.md`: its program is the example, and does what the document says.

use crate::common::{TestServer, run};

#[allow(dead_code, unreachable_pub, reason = "a program of its own, whose main is not called here")]
#[path = "../../examples/first_frontend.rs"]
mod example;

const PROGRAM: &str = include_str!("../../examples/first_frontend.rs");

#[test]
fn the_program_of_the_document_is_the_example() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/your-first-frontend.md");
    let document = fs_err::read_to_string(path).unwrap();
    let blocks: Vec<&str> = document.split("```rust\n").skip(1).collect();
    assert_eq!(blocks.len(), 1, "one program");
    let block = blocks[0].split("```").next().unwrap();
    if std::env::var_os("COVIS_TEST_REGENERATE").is_some() {
        fs_err::write(path, document.replace(block, PROGRAM)).unwrap();
    } else {
        assert!(block == PROGRAM, "COVIS_TEST_REGENERATE=1 takes it over from examples/");
    }
}

#[test]
fn the_program_ends_where_the_robot_is_although_its_odometry_drifts() {
    run(async {
        let server = TestServer::start().await;
        let url = format!("http://{}", server.running.local_addr());
        let poses = example::drive(&url, "first").await.unwrap();
        assert_eq!(poses.len(), 24);
        for pose in &poses {
            let id = pose.keyframe.as_ref().unwrap().id;
            let x = pose.world_from_camera.unwrap().translation.unwrap().x;
            let off = x - example::true_x(id);
            assert!(off.abs() < 0.04, "keyframe {id}: {off} m");
        }
        let drift = example::odom_x(23) - example::true_x(23);
        assert!(drift.abs() > 0.1, "odometry alone is off by {drift} m");

        let request =
            covis::wire::v1::GetMapRequest { map_id: "first".to_owned(), ..Default::default() };
        let map = server.maps().get_map(request).await.unwrap().into_inner().map.unwrap();
        let counts = map.counts.unwrap();
        assert_eq!(counts.landmark_count, counts.positioned_landmark_count, "placed by depth");
        assert_eq!((counts.constraint_count, counts.switched_off_constraint_count), (24, 0));
    });
}
