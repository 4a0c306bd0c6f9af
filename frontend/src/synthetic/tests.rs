//! Sequences against analysis, themselves on other threads, and the folder that they are written to.

use covis_solvers::geometry::CameraModel;
use covis_solvers::io::trajectory::Trajectory;
use nalgebra::{Vector2, Vector3};

use super::*;
use crate::input::{CameraOrigin, FolderOptions, open_folder};

fn small(frames: usize, seed: u64, noise: bool) -> SequenceOptions {
    SequenceOptions { width: 160, height: 120, frames, seed, noise }
}

/// Points in the world of all pixels of a frame with exact depth.
fn points(sequence: &Sequence, index: usize) -> Vec<Vector3<f64>> {
    let frame = sequence.frame(index);
    let world_from_camera = sequence.world_from_camera(index);
    let (width, height) = frame.depth_m.size();
    let pixels = (0..height).flat_map(|v| (0..width).map(move |u| (u, v)));
    let point = |(u, v)| {
        let ray = sequence.camera().unproject(&Vector2::new(u as f64, v as f64)).unwrap();
        world_from_camera.transform(&(ray * f64::from(frame.depth_m.at(u, v))))
    };
    pixels.map(point).collect()
}

#[test]
fn depth_is_the_distance_of_the_planes() {
    let sequence = Sequence::new(SceneName::Static, &small(2, 3, false));
    let points = points(&sequence, 1);
    let [hx, hy, hz] = room::HALF_ROOM_M;
    let inside = |p: &Vector3<f64>| {
        p.x.abs() < hx + 1e-5 && p.y.abs() < hy + 1e-5 && (-1e-5..2.0 * hz + 1e-5).contains(&p.z)
    };
    assert!(points.iter().all(inside));
    let on = |distance: &dyn Fn(&Vector3<f64>) -> f64| {
        points.iter().filter(|point| distance(point).abs() < 2e-6).count()
    };
    let far_wall = on(&|p| p.y - hy);
    let desk = on(&|p| if p.x.abs() < 1.1 && p.y > 1.35 { p.z - room::DESK_M } else { 1.0 });
    assert!(far_wall > 1000, "{far_wall} pixels on the far wall");
    assert!(desk > 150, "{desk} pixels on the desk");
}

#[test]
fn a_seed_decides_every_byte_and_threads_none() {
    let draw = |seed, threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let sequence = Sequence::new(SceneName::Walking, &small(40, seed, true));
        pool.install(|| sequence.frame_and_mask(17))
    };
    let first = draw(1, 1);
    assert_eq!(first, draw(1, 1));
    assert_eq!(first, draw(1, 2));
    let other = draw(2, 1);
    assert_ne!(first.0.color, other.0.color);
    assert_ne!(first.0.depth_m, other.0.depth_m);
}

#[test]
fn noise_is_what_a_kinect_has() {
    let exact = Sequence::new(SceneName::Static, &small(1, 4, false)).frame(0);
    let noisy = Sequence::new(SceneName::Static, &small(1, 4, true)).frame(0);
    let (mut squares, mut count) = (0.0, 0.0);
    for (a, b) in exact.gray().pixels().iter().zip(noisy.gray().pixels()) {
        if (30..225).contains(a) {
            squares += (f64::from(*a) - f64::from(*b)).powi(2);
            count += 1.0;
        }
    }
    let deviation = (squares / count).sqrt();
    assert!((1.8..2.3).contains(&deviation), "{deviation} gray levels");

    let mut none = 0;
    for (&z, &measured) in exact.depth_m.pixels().iter().zip(noisy.depth_m.pixels()) {
        if measured == 0.0 {
            none += 1;
            continue;
        }
        // 3.45 deviations, half a step of the disparity, and the rounding.
        let bound = 3.5 * (0.0012 + 0.0019 * (z - 0.4).powi(2)) + z * z / 600.0 + 2e-4;
        assert!((measured - z).abs() < bound, "{measured} m instead of {z} m");
        assert!((0.4..4.6).contains(&z));
    }
    let share = f64::from(none) / (160.0 * 120.0);
    assert!((0.01..0.35).contains(&share), "{share} of the pixels have no depth");
}

#[test]
fn the_same_place_looks_the_same_from_elsewhere() {
    let options = SequenceOptions { frames: 12, noise: false, ..SequenceOptions::default() };
    let sequence = Sequence::new(SceneName::Static, &options);
    let (from, to) = (sequence.frame(0), sequence.frame(10));
    let to_camera = sequence.world_from_camera(10).inverse() * sequence.world_from_camera(0);
    let (from_gray, to_gray) = (from.gray(), to.gray());
    let (mut close, mut shown) = (0, 0);
    for v in (4..476).step_by(4) {
        for u in (4..636).step_by(4) {
            let ray = sequence.camera().unproject(&Vector2::new(u as f64, v as f64)).unwrap();
            let point = to_camera.transform(&(ray * f64::from(from.depth_m.at(u, v))));
            let Some(pixel) = sequence.camera().project(&point) else { continue };
            let (x, y) = (pixel.x.round(), pixel.y.round());
            if !(0.0..640.0).contains(&x) || !(0.0..480.0).contains(&y) {
                continue;
            }
            let (x, y) = (x as usize, y as usize);
            if (f64::from(to.depth_m.at(x, y)) - point.z).abs() > 0.02 {
                continue;
            }
            shown += 1;
            close += usize::from(from_gray.at(u, v).abs_diff(to_gray.at(x, y)) <= 25);
        }
    }
    assert!(shown > 10_000, "{shown} pixels in both");
    assert!(close * 10 > shown * 9, "{close} of {shown} look alike");
}

#[test]
fn views_are_rich_in_corners() {
    for scene in SceneName::ALL {
        let options = SequenceOptions { frames: 300, ..SequenceOptions::default() };
        let sequence = Sequence::new(scene, &options);
        for index in [0, 75, 220] {
            let gray = sequence.frame(index).gray();
            let corners = corner_cells(&gray);
            assert!(corners > 300, "{scene}, frame {index}: corners in {corners} cells");
        }
    }
}

/// How many cells of 20 × 20 pixels have gradients in two directions (Shi and Tomasi).
fn corner_cells(gray: &Image<u8>) -> usize {
    let at = |u: usize, v: usize| f64::from(gray.at(u, v));
    let cells = (0..24).flat_map(|j| (0..32).map(move |i| (20 * i, 20 * j)));
    let strong = cells.filter(|&(left, top)| {
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for v in top + 1..top + 19 {
            for u in left + 1..left + 19 {
                let x = at(u + 1, v) - at(u - 1, v);
                let y = at(u, v + 1) - at(u, v - 1);
                (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
            }
        }
        let half = 0.5 * (xx + yy);
        let smaller = half - (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
        smaller / 324.0 > 60.0
    });
    strong.count()
}

#[test]
fn the_mask_is_where_figures_are() {
    let sequence = Sequence::new(SceneName::Walking, &small(60, 5, false));
    let mut seen = 0;
    for index in [10, 25, 40] {
        let mask = sequence.moving_mask(index);
        let standing = sequence.scene.solids(scene_time_s(index)).len() - 2 * 16;
        let solids = sequence.scene.solids(scene_time_s(index));
        // Each pixel of the mask shows a point on a figure's surface, each other one does not.
        for (point, &mask) in points(&sequence, index).iter().zip(mask.pixels()) {
            let on_figure = solids[standing..].iter().any(|solid| {
                let point = solid.world_from_solid.inverse_transform(point);
                let off = match solid.shape {
                    solid::Shape::Ellipsoid(radii) => point.component_div(&radii).norm() - 1.0,
                    solid::Shape::Capsule { half_length, radius } => {
                        let z = point.z.clamp(-half_length, half_length);
                        ((point - Vector3::new(0.0, 0.0, z)).norm() - radius) / radius
                    }
                    solid::Shape::Room(_) | solid::Shape::Box(_) => 1.0,
                };
                off.abs() < 1e-4
            });
            assert_eq!(mask == 255, on_figure, "frame {index} at {point}");
            seen += usize::from(on_figure);
        }
    }
    assert!(seen > 1000, "{seen} pixels of figures");
}

#[test]
fn what_rests_is_not_in_the_mask() {
    let share = |scene, frames: usize, index| {
        let mask = Sequence::new(scene, &small(frames, 6, false)).moving_mask(index);
        mask.pixels().iter().filter(|&&value| value == 255).count() as f64 / (160.0 * 120.0)
    };
    assert_eq!(share(SceneName::Static, 60, 30), 0.0);
    assert_eq!(share(SceneName::Pushed, 120, 10), 0.0);
    assert!(share(SceneName::Pushed, 120, 45) > 0.02);
    assert_eq!(share(SceneName::Pushed, 120, 100), 0.0);
    // Arms and head move, the rest of who sits does not.
    let sitting = share(SceneName::Sitting, 60, 30);
    assert!((0.005..0.15).contains(&sitting), "{sitting}");
}

#[test]
fn a_covered_camera_sees_nothing_for_a_second() {
    let sequence = Sequence::new(SceneName::Covered, &small(90, 0, true));
    let black = |index| {
        let frame = sequence.frame(index);
        frame.color.pixels().iter().all(|&pixel| pixel == [0; 3])
            && frame.depth_m.pixels().iter().all(|&z| z == 0.0)
    };
    let covered: Vec<usize> = (0..90).filter(|&index| black(index)).collect();
    assert_eq!((covered.len(), covered[0]), (30, 30));
}

#[test]
fn exposure_changes_brightness_and_nothing_else() {
    let options = small(90, 0, false);
    let mean = |scene, index| {
        let gray = Sequence::new(scene, &options).frame(index).gray();
        gray.pixels().iter().map(|&value| f64::from(value)).sum::<f64>() / (160.0 * 120.0)
    };
    let change = mean(SceneName::Exposure, 20) - mean(SceneName::Exposure, 70);
    assert!(change.abs() > 20.0, "{change} gray levels");
}

#[test]
fn a_loop_ends_where_it_began_and_looks_everywhere() {
    let sequence = Sequence::new(SceneName::Loop, &small(300, 0, false));
    let forward = |index| sequence.world_from_camera(index).rotation.rotate(&Vector3::z());
    assert!(forward(0).dot(&forward(299)) > 0.95);
    assert!(forward(0).dot(&forward(150)) < -0.9);
}

#[test]
fn a_written_sequence_reads_back_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let sequence = Sequence::new(SceneName::Walking, &small(5, 7, true));
    let mut done = Vec::new();
    write_sequence(&sequence, folder.path(), |index| done.push(index)).unwrap();
    assert_eq!(done, [0, 1, 2, 3, 4]);
    let mut open = open_folder(folder.path(), FolderOptions::default()).unwrap();
    assert!(matches!(open.camera_origin, CameraOrigin::File(_)));
    assert_eq!((open.source.camera(), open.without_depth), (sequence.camera(), 0));
    let mut drawn = SyntheticSource::new(sequence.clone());
    assert_eq!(drawn.len(), open.source.len());
    while let Some(frame) = drawn.next_frame() {
        assert_eq!(open.source.next_frame().unwrap().unwrap(), frame.unwrap());
    }
    assert!(open.source.next_frame().is_none());
    let truth = Trajectory::read(&folder.path().join("groundtruth.txt")).unwrap();
    let mask = fs_err::read(folder.path().join("mask/1.066667.png")).unwrap();
    let mask = crate::input::decode::mask(&mask).unwrap();
    assert_eq!(mask, sequence.moving_mask(2));
    for index in 0..5 {
        assert_eq!(truth.timestamps[index], sequence.timestamp_s(index));
        let difference = truth.world_from_body[index].inverse() * sequence.world_from_camera(index);
        assert!(difference.log().norm() < 1e-12);
    }
}
