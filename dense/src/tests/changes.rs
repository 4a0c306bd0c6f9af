//! Objects that disappear, appear, walk through the scene, or change color.

use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::Vector3;

use super::scene::{Scene, Shape, camera, path, render, room, surface};
use super::{extract, fuse, volume};
use crate::camera::FrameCamera;
use crate::integrate::{DenseFrame, IntegrationOptions, Integrator};
use crate::surface::SurfaceCache;
use crate::volume::Volume;

/// A second in view.
const SECOND: usize = 30;

/// A volume of noisy frames of a scene that changes.
struct Film {
    camera: FrameCamera,
    integrator: Integrator,
    volume: Volume,
    frame: usize,
}

impl Film {
    fn new(options: IntegrationOptions) -> Self {
        let camera = camera();
        let integrator = Integrator::new(&camera, options);
        Self { camera, integrator, volume: volume(0.02), frame: 0 }
    }

    /// One frame; solids from `first_moving` on are masked.
    fn show(&mut self, scene: &Scene, first_moving: u8) {
        let pose: Se3 = path(self.frame);
        let view = render(scene, &self.camera, &pose, Some(self.frame as u64));
        let moving = view.solid.map(|solid| if solid >= first_moving { 255 } else { 0 });
        let frame = DenseFrame {
            depth_m: &view.depth_m,
            color: &view.color,
            moving: Some(&moving),
            world_from_camera: &pose,
        };
        self.integrator.integrate(&mut self.volume, &frame).unwrap();
        self.frame += 1;
    }

    /// How many points of the surface lie within a voxel of a shape and away from the room.
    fn points_of(&self, shape: &Shape) -> usize {
        let (room, _) = room()[0];
        let is_its = |point: &Vector3<f64>| {
            shape.distance(point).abs() < 0.02 && room.distance(point) > 0.05
        };
        surface(&self.volume).iter().filter(|(point, _)| is_its(point)).count()
    }
}

fn carton() -> Shape {
    Shape::Box(Vector3::new(0.7, 0.1, -0.9), Vector3::new(0.25, 0.25, 0.3))
}

fn with(shape: Shape) -> Scene {
    let mut scene = room();
    scene.push((shape, [40, 160, 40]));
    scene
}

#[test]
fn a_box_that_is_taken_away_is_gone_within_a_second() {
    let mut film = Film::new(IntegrationOptions::default());
    for _ in 0..3 * SECOND {
        film.show(&with(carton()), 9);
    }
    let before = film.points_of(&carton());
    let mut left = Vec::new();
    for _ in 0..SECOND {
        film.show(&room(), 9);
        left.push(film.points_of(&carton()));
    }
    println!("{before} points, then {left:?}");
    assert!(before > 1000 && left[SECOND - 1] * 100 <= before);
}

#[test]
fn a_box_that_is_put_down_is_there_within_a_second() {
    let mut film = Film::new(IntegrationOptions::default());
    for _ in 0..3 * SECOND {
        film.show(&room(), 9);
    }
    let mut there = vec![film.points_of(&carton())];
    for _ in 0..3 * SECOND {
        film.show(&with(carton()), 9);
        there.push(film.points_of(&carton()));
    }
    println!("{there:?}");
    assert!(there[0] == 0 && there[SECOND] * 10 >= there[3 * SECOND] * 9);
}

#[test]
fn someone_who_walked_by_leaves_nothing() {
    let figure = |frame: usize| {
        // In from the side, two seconds in the middle, out at the other side.
        let t = frame as f64 / SECOND as f64;
        let y = if t < 3.0 { 1.5 * (t - 1.0).min(0.0) } else { 1.5 * (t - 3.0) };
        let mut scene = room();
        let torso = Shape::Box(Vector3::new(0.6, y, -0.3), Vector3::new(0.12, 0.2, 0.7));
        scene.push((torso, [200, 200, 30]));
        scene.push((Shape::Ball(Vector3::new(0.6, y, 0.55), 0.12), [220, 180, 160]));
        scene
    };
    let ghosts = |first_moving: u8| {
        let mut film = Film::new(IntegrationOptions::default());
        for _ in 0..SECOND {
            film.show(&room(), 9);
        }
        for frame in 0..4 * SECOND {
            film.show(&figure(frame), first_moving);
        }
        for _ in 0..SECOND / 3 {
            film.show(&room(), 9);
        }
        // Anything that is not the room, where the camera looked until the end.
        let (room, _) = room()[0];
        let is_ghost = |point: &Vector3<f64>| point.y.abs() < 0.8 && room.distance(point) > 0.1;
        surface(&film.volume).iter().filter(|(point, _)| is_ghost(point)).count()
    };
    let (masked, alone) = (ghosts(1), ghosts(9));
    println!("masked {masked}, not masked {alone}");
    // Averages of all frames left more than 300 such points.
    assert!(masked <= 3 && alone <= 15, "masked {masked}, not masked {alone}");
}

#[test]
fn a_still_scene_is_not_worn_away() {
    let mut film = Film::new(IntegrationOptions::default());
    for _ in 0..2 * SECOND {
        film.show(&with(carton()), 9);
    }
    let before = film.points_of(&carton());
    for _ in 0..4 * SECOND {
        film.show(&with(carton()), 9);
    }
    let after = film.points_of(&carton());
    println!("{before}, then {after}");
    assert!(after * 100 >= before * 97);
}

#[test]
fn a_color_that_changed_is_taken_over_at_once() {
    let mut film = Film::new(IntegrationOptions::default());
    for _ in 0..3 * SECOND {
        film.show(&room(), 9);
    }
    let mut painted = room();
    painted[0].1 = [30, 160, 60];
    for _ in 0..SECOND / 2 {
        film.show(&painted, 9);
    }
    // What lies well inside of the last image was seen all the time.
    let (pose, camera) = (path(film.frame - 1).inverse(), camera());
    let seen = |point: &Vector3<f64>| {
        let pixel = camera.project(&pose.transform(point));
        pixel.is_some_and(|p| p.x > 60.0 && p.x < 260.0 && p.y > 50.0 && p.y < 190.0)
    };
    let points = surface(&film.volume);
    let colors: Vec<_> = points.iter().filter(|(point, _)| seen(point)).map(|&(_, c)| c).collect();
    let new = colors.iter().filter(|c| c[0].abs_diff(30) < 25 && c[1].abs_diff(160) < 25).count();
    println!("{new} of {}", colors.len());
    assert!(colors.len() > 1000 && new * 100 >= colors.len() * 95);
}

#[test]
fn a_surface_that_follows_shows_colors_that_change_alone() {
    let options = IntegrationOptions { max_weight: 1.0, weigh_noise: false, ..Default::default() };
    let (camera, pose) = (camera(), path(0));
    let mut integrator = Integrator::new(&camera, options);
    let mut volume = volume(0.02);
    let mut cache = SurfaceCache::default();
    let apart = |(a, b): (&[u8; 3], &[u8; 3])| {
        let [r, g, b] = [0, 1, 2].map(|k| u32::from(a[k].abs_diff(b[k])));
        r + 2 * g + b
    };
    let (mut pieces, mut remade, mut worst, mut scene) = (0, 0, 0, room());
    for frame in 0..60_u8 {
        // At rest until voxels have all the weight that they may have; then the light fades, by less
        // than an eye sees from frame to frame.
        let gray = 200 - frame.saturating_sub(15);
        scene[0].1 = [gray, gray, gray / 2];
        fuse(&mut integrator, &mut volume, &render(&scene, &camera, &pose, None), &pose);
        let made = cache.update(&mut volume.clone().into(), usize::MAX).unwrap();
        if frame == 0 {
            pieces = made;
        } else if frame >= 15 {
            remade += made;
            let (followed, anew) = (cache.mesh(), extract(&volume));
            assert_eq!(followed.positions, anew.positions);
            let off = followed.colors.iter().zip(&anew.colors).map(apart).max();
            worst = worst.max(off.unwrap());
        }
    }
    println!("{pieces} pieces, {remade} made again, worst {worst}");
    // Eight levels of gray, and rounding between two voxels.
    assert!(worst > 0 && worst <= 36, "a color is off by {worst}");
    assert!(remade > pieces && remade < 15 * pieces, "{remade} of {pieces} pieces in 45 frames");
}
