//! A room with a post, from above: what is free, what is in the way, how far it is.

use nalgebra::Vector3;

use super::super::block::{Block, BlockKey};
use super::super::paged::PagedVolume;
use super::super::testing::{Shown, volume};
use super::super::volume::{Volume, VolumeOptions};
use super::*;

const GRID: VolumeOptions = VolumeOptions { voxel_m: 0.05, truncation_m: 0.2 };

/// Distance to what is in a room 2 m by 3 m, floor 1 m below the camera, y down: its inner walls, its
/// floor, and a post of 0.2 m radius at (0.5, 0.25).
fn room([x, y, z]: [f32; 3]) -> Shown {
    let walls = (1.0 - x.abs()).min(1.5 - z.abs());
    let post = ((x - 0.5).powi(2) + (z - 0.25).powi(2)).sqrt() - 0.2;
    let distance = walls.min(1.0 - y).min(post);
    // The far end of the room was not seen, nor what is deep in the walls.
    (distance > -0.2 && z < 1.2).then_some((distance, 2.0, [0; 3]))
}

fn seen_room() -> PagedVolume {
    volume(GRID, [-4, -3, -5], [3, 3, 4], room).into()
}

const HEIGHTS: NavigationOptions =
    NavigationOptions { up: Vector3::new(0.0, -1.0, 0.0), heights_m: [-0.8, 0.2] };

/// The cell at a place on the ground.
fn cell_at(ground: &Ground, x: f64, y: f64) -> usize {
    let [i, j] = [x - ground.corner_m[0], y - ground.corner_m[1]]
        .map(|d| (d / ground.resolution_m) as usize);
    assert!(i < ground.width && j < ground.height);
    i + ground.width * j
}

#[test]
fn a_room_from_above_is_free_between_its_walls_and_around_the_post() {
    let grid = occupancy_grid(&mut seen_room(), &HEIGHTS).unwrap();
    let at = |x, y| grid.cells[cell_at(&grid.ground, x, y)];
    assert_eq!(at(0.0, 0.0), Cell::Free);
    assert_eq!(at(-0.9, -1.4), Cell::Free);
    assert_eq!(at(0.5, 0.05), Cell::Occupied, "the post");
    assert_eq!(at(0.5, 0.25), Cell::Unknown, "inside the post");
    assert_eq!(at(1.0, 0.6), Cell::Occupied, "a wall");
    assert_eq!(at(0.3, -1.5), Cell::Occupied, "the wall behind");
    assert_eq!(at(0.0, 1.4), Cell::Unknown, "what was not seen");
    let floor = NavigationOptions { heights_m: [-1.2, 0.2], ..HEIGHTS };
    let with_floor = occupancy_grid(&mut seen_room(), &floor).unwrap();
    assert_eq!(with_floor.cells[cell_at(&with_floor.ground, 0.0, 0.0)], Cell::Occupied);
}

#[test]
fn any_direction_can_be_up() {
    // The room turned: z up, y backwards.
    let turned = volume(GRID, [-4, -5, -4], [3, 5, 3], |[x, y, z]| room([x, -z, y]));
    let mut turned = PagedVolume::from(turned);
    let up = NavigationOptions { up: Vector3::new(0.0, 0.0, 7.0), ..HEIGHTS };
    let (a, b) = (
        occupancy_grid(&mut seen_room(), &HEIGHTS).unwrap(),
        occupancy_grid(&mut turned, &up).unwrap(),
    );
    assert_eq!(b.ground.axes, [Vector3::x(), Vector3::y(), Vector3::z()]);
    for (x, y) in (-17..17).flat_map(|x| (-26..22).map(move |y| (x, y))) {
        let (x, y) = (0.05 * f64::from(x), 0.05 * f64::from(y));
        assert_eq!(
            a.cells[cell_at(&a.ground, x, y)],
            b.cells[cell_at(&b.ground, x, y)],
            "({x}, {y})"
        );
    }
    // Tilted by ten degrees: the post is where it was.
    let tilted = NavigationOptions { up: Vector3::new(0.17, -0.98, 0.0), ..HEIGHTS };
    let tilted = occupancy_grid(&mut seen_room(), &tilted).unwrap();
    let [x, y, _] = tilted.ground.axes.map(|axis| axis.dot(&Vector3::new(0.3, 0.0, 0.25)));
    assert_eq!(tilted.cells[cell_at(&tilted.ground, x, y)], Cell::Occupied);
}

#[test]
fn the_files_are_as_map_server_reads_them() {
    let mut grid = occupancy_grid(&mut seen_room(), &HEIGHTS).unwrap();
    let ground = grid.ground;
    let pgm = grid.to_pgm();
    let pixels = ground.width * ground.height;
    let header = String::from_utf8(pgm[..pgm.len() - pixels].to_vec()).unwrap();
    assert_eq!(header.lines().next(), Some("P5"));
    assert!(header.ends_with(&format!("\n{} {}\n255\n", ground.width, ground.height)));
    let image = &pgm[header.len()..];
    for (i, &pixel) in image.iter().enumerate() {
        let (u, v) = (i % ground.width, i / ground.width);
        let cell = grid.cells[u + ground.width * (ground.height - 1 - v)];
        // map_server's rule for images that are not negated.
        let occupancy = f64::from(255 - pixel) / 255.0;
        let read = match occupancy {
            o if o > 0.65 => Cell::Occupied,
            o if o < 0.196 => Cell::Free,
            _ => Cell::Unknown,
        };
        assert_eq!(read, cell, "pixel ({u}, {v})");
    }
    grid.ground.corner_m = [-1.025, -2.0];
    grid.ground.resolution_m = f64::from(0.05_f32);
    let expected = "image: \"map.pgm\"\nresolution: 0.05\norigin: [-1.025, -2.0, 0.0]\nnegate: 0\n\
                    occupied_thresh: 0.65\nfree_thresh: 0.196\n";
    assert_eq!(grid.to_yaml("map.pgm"), expected);
}

#[test]
fn distances_are_those_to_the_nearest_surface_voxel() {
    let mut room = seen_room();
    let slice = distance_slice(&mut room, &HEIGHTS, -0.3).unwrap();
    let columns = columns::Columns::new(&mut room, &HEIGHTS).unwrap();
    let (width, height) = (slice.ground.width, slice.ground.height);
    let mut surface = Vec::new();
    for h in (-16..=4).map(f64::from) {
        let at = columns.map(&mut room, [h; 2], false, |standing, i, j| {
            standing.at(i, j, h) == columns::VoxelState::Surface
        });
        let at = at.unwrap().into_iter().enumerate().filter(|(_, is_surface)| *is_surface);
        surface.extend(at.map(|(cell, _)| [(cell % width) as f64, (cell / width) as f64, h]));
    }
    assert!(surface.len() > 1_000);
    let slice_at = -0.3 / f64::from(GRID.voxel_m);
    for (cell, &distance) in slice.distances_m.iter().enumerate().step_by(7) {
        let (i, j) = ((cell % width) as f64, (cell / width) as f64);
        let squares = surface
            .iter()
            .map(|s| (s[0] - i).powi(2) + (s[1] - j).powi(2) + (s[2] - slice_at).powi(2));
        let nearest = squares.fold(f64::INFINITY, f64::min).sqrt() * slice.ground.resolution_m;
        assert!((f64::from(distance.abs()) - nearest).abs() < 1e-6, "cell {cell}");
    }
    let at = |x, y| slice.distances_m[cell_at(&slice.ground, x, y)];
    assert!((at(-0.45, 0.0) - 0.55).abs() < 0.05, "half a meter to the wall");
    assert!(at(1.15, 0.0) < -0.05, "behind the wall");
    let pfm = slice.to_pfm();
    let header = format!("Pf\n{width} {height}\n-1.0\n");
    assert!(pfm.starts_with(header.as_bytes()));
    assert_eq!(pfm.len(), header.len() + 4 * width * height);
    assert_eq!(pfm[header.len()..][..4], slice.distances_m[0].to_le_bytes());
}

#[test]
fn a_surface_where_distances_jump_has_no_holes() {
    let step = |[_, y, _]: [f32; 3]| Some((if y < 0.52 { 0.15 } else { -0.15 }, 1.0, [0; 3]));
    let mut floor = volume(GRID, [0; 3], [1; 3], step).into();
    let below = NavigationOptions { heights_m: [-1.0, 0.0], ..HEIGHTS };
    let grid = occupancy_grid(&mut floor, &below).unwrap();
    assert!(grid.cells.iter().all(|&cell| cell == Cell::Occupied));
}

#[test]
fn what_makes_no_sense_is_refused() {
    let mut room = seen_room();
    let told = |volume: &mut PagedVolume, options| {
        occupancy_grid(volume, &options).unwrap_err().to_string()
    };
    let up = |x| NavigationOptions { up: Vector3::new(x, 0.0, 0.0), ..HEIGHTS };
    assert_eq!(told(&mut room, up(0.0)), "up is (0, 0, 0), which is not a direction");
    assert_eq!(told(&mut room, up(f64::NAN)), "up is (NaN, 0, 0), which is not a direction");
    let heights = NavigationOptions { heights_m: [1.0, 0.5], ..HEIGHTS };
    assert_eq!(told(&mut room, heights), "heights from 1 to 0.5 m are not a range");
    assert_eq!(told(&mut PagedVolume::new(GRID), HEIGHTS), "the volume is empty");
    let mut wide = Volume::new(GRID);
    for x in [i32::MIN, i32::MAX] {
        wide.insert(BlockKey { x, y: 0, z: x }, Block::EMPTY);
    }
    let mut wide = wide.into();
    assert!(told(&mut wide, HEIGHTS).ends_with(" cells is too large"));
    assert!(distance_slice(&mut room, &HEIGHTS, f64::NAN).is_err());
    // Heights without anything: nothing is in the way, and nothing is known.
    let above = NavigationOptions { heights_m: [50.0, 60.0], ..HEIGHTS };
    assert!(occupancy_grid(&mut room, &above).unwrap().cells.iter().all(|&c| c == Cell::Unknown));
    let far = distance_slice(&mut room, &above, 55.0).unwrap();
    assert!(far.distances_m.iter().all(|&d| d == f32::INFINITY));
}

#[test]
fn a_volume_that_is_on_disk_in_parts_has_the_same_ground() {
    let mut whole = seen_room();
    let bytes = 20 * size_of::<Block>();
    let mut paged = PagedVolume::with_ceiling(GRID, bytes, None).unwrap();
    let room = whole.resident();
    for (&key, block) in room.keys().iter().zip(room.blocks().iter()) {
        paged.insert(key, block.clone()).unwrap();
    }
    assert!(paged.paging().unwrap().blocks_on_disk > 100);
    let tilted = NavigationOptions { up: Vector3::new(0.17, -0.98, 0.1), ..HEIGHTS };
    for options in [HEIGHTS, tilted] {
        let grids = [&mut whole, &mut paged].map(|v| occupancy_grid(v, &options).unwrap());
        assert!(grids[0] == grids[1], "the grids differ");
        let slices = [&mut whole, &mut paged].map(|v| distance_slice(v, &options, -0.3).unwrap());
        assert!(slices[0] == slices[1], "the slices differ");
    }
}
