//! Surfaces of known shapes: closed, in place, and independent of how they are made.

use std::collections::HashMap;

use super::super::block::{Block, BlockKey};
use super::super::testing::{CENTIMETER, Shown, block, noise, sphere, volume};
use super::super::tests::extract;
use super::super::volume::Volume;
use super::{Mesh, SurfaceCache};

/// Follows a volume in memory.
fn update(cache: &mut SurfaceCache, volume: &Volume, most: usize) -> usize {
    cache.update(&mut volume.clone().into(), most).unwrap()
}

/// How often each directed edge is used more than its reverse.
fn open_edges(mesh: &Mesh) -> Vec<[u32; 2]> {
    let mut balance: HashMap<[u32; 2], i32> = HashMap::new();
    for t in &mesh.triangles {
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            *balance.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
        }
    }
    let mut open: Vec<_> = balance.into_iter().filter(|&(_, n)| n != 0).map(|(e, _)| e).collect();
    open.sort_unstable();
    open
}

fn edges(mesh: &Mesh) -> usize {
    let mut all: Vec<_> = mesh
        .triangles
        .iter()
        .flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]].map(|[a, b]| [a.min(b), a.max(b)]))
        .collect();
    all.sort_unstable();
    all.dedup();
    all.len()
}

/// The corners of a mesh's triangles, whatever their order.
fn triangles(mesh: &Mesh) -> Vec<[[u32; 3]; 3]> {
    let corner = |i: u32| mesh.positions[i as usize].map(f32::to_bits);
    let mut all: Vec<_> = mesh.triangles.iter().map(|t| t.map(corner)).collect();
    all.sort_unstable();
    all
}

fn ball(radius: f32) -> impl Fn([f32; 3]) -> Shown {
    move |p| {
        let color = [if p[0] > 0.0 { 200 } else { 100 }, 50, 25];
        Some((sphere(p, [0.003, -0.002, 0.001], radius), 2.0, color))
    }
}

#[test]
fn a_ball_is_a_closed_surface_in_its_place() {
    let mesh = extract(&volume(CENTIMETER, [-3; 3], [2; 3], ball(0.17)));
    assert!(mesh.triangles.len() > 5_000);
    assert_eq!(open_edges(&mesh), [[0; 2]; 0]);
    let euler = mesh.positions.len() + mesh.triangles.len() - edges(&mesh);
    assert_eq!(euler, 2, "one closed surface without handles");
    for (position, normal) in mesh.positions.iter().zip(&mesh.normals) {
        let error = sphere(*position, [0.003, -0.002, 0.001], 0.17).abs();
        assert!(error < 2e-4, "{position:?} is {error} m off");
        let radial: f32 =
            (0..3).map(|i| normal[i] * (position[i] - [0.003, -0.002, 0.001][i]) / 0.17).sum();
        assert!(radial > 0.999, "the normal at {position:?} is {normal:?}");
    }
    for (position, color) in mesh.positions.iter().zip(&mesh.colors) {
        let expected = if position[0] > 0.01 { 200 } else { 100 };
        let is_between = (0.0..=0.01).contains(&position[0]);
        assert!(is_between || color == &[expected, 50, 25], "{position:?} is {color:?}");
    }
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
        let (u, v) = ([0, 1, 2].map(|i| b[i] - a[i]), [0, 1, 2].map(|i| c[i] - a[i]));
        let outward: f32 = (0..3)
            .map(|i| (u[(i + 1) % 3] * v[(i + 2) % 3] - u[(i + 2) % 3] * v[(i + 1) % 3]) * a[i])
            .sum();
        assert!(outward > 0.0, "{t:?} faces inwards");
    }
}

#[test]
fn any_signs_give_a_surface_that_is_open_at_the_end_of_sight_only() {
    let mut grid = Volume::new(CENTIMETER);
    for i in 0..27 {
        let mut block = Block::EMPTY;
        for (k, distance) in block.distances.iter_mut().enumerate() {
            // Near enough to a surface to carry one.
            *distance = noise(1_000 * i + k) as i16 / 2;
        }
        block.weights = [256; 512];
        let [x, y, z] = [i % 3, i / 3 % 3, i / 9].map(|k| k as i32 - 1);
        grid.insert(BlockKey { x, y, z }, block);
    }
    let mesh = extract(&grid);
    assert!(mesh.triangles.len() > 10_000);
    let (lowest, highest) = (-0.08, 0.15);
    for edge in open_edges(&mesh) {
        let [a, b] = edge.map(|i| mesh.positions[i as usize]);
        let is_at_end = |i: usize, end: f32| (a[i] - end).abs() < 1e-6 && (b[i] - end).abs() < 1e-6;
        assert!((0..3).any(|i| is_at_end(i, lowest) || is_at_end(i, highest)), "{a:?} {b:?}");
    }
    let mut used = vec![false; mesh.positions.len()];
    mesh.triangles.iter().flatten().for_each(|&i| used[i as usize] = true);
    assert!(used.iter().all(|&used| used), "a vertex without a triangle");
    let mut positions: Vec<_> = mesh.positions.iter().map(|p| p.map(f32::to_bits)).collect();
    positions.sort_unstable();
    positions.dedup();
    assert_eq!(positions.len(), mesh.positions.len(), "a vertex made twice");
}

#[test]
fn nothing_is_made_of_what_was_not_seen() {
    let half = |p: [f32; 3]| (p[0] < 0.055).then(|| (sphere(p, [0.0; 3], 0.1), 1.0, [0; 3]));
    let grid = volume(CENTIMETER, [-2; 3], [1; 3], half);
    let mesh = extract(&grid);
    let farthest = mesh.positions.iter().map(|p| p[0]).fold(f32::MIN, f32::max);
    assert!((farthest - 0.05).abs() < 1e-6, "the last voxel seen is at 0.05, not {farthest}");
    let twice = |p: [f32; 3]| half(p).map(|(distance, _, color)| (distance, 2.0 / 256.0, color));
    assert_eq!(extract(&volume(CENTIMETER, [-2; 3], [1; 3], twice)), Mesh::default());
    assert_eq!(extract(&Volume::new(CENTIMETER)), Mesh::default());
}

#[test]
fn a_lone_block_at_the_end_of_the_grid_has_its_own_cells() {
    for x in [i32::MIN, i32::MAX] {
        let mut grid = Volume::new(CENTIMETER);
        let wall = block(CENTIMETER, BlockKey::default(), &|p| Some((0.035 - p[1], 1.0, [9; 3])));
        grid.insert(BlockKey { x, y: 0, z: 0 }, wall);
        let mesh = extract(&grid);
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (64, 2 * 49));
        assert_eq!(mesh.colors[0], [9; 3]);
    }
}

#[test]
fn an_updated_surface_is_the_one_made_anew() {
    let mut grid = volume(CENTIMETER, [-2; 3], [1; 3], ball(0.12));
    let mut cache = SurfaceCache::default();
    assert!((8..=64).contains(&update(&mut cache, &grid, usize::MAX)));
    assert_eq!(update(&mut cache, &grid, usize::MAX), 0);
    // A block changes, one comes, and the surface leaves one.
    let mut shapes: Vec<(BlockKey, Block)> = vec![];
    let corner = BlockKey { x: 0, y: 0, z: 0 };
    shapes.push((corner, block(CENTIMETER, corner, &ball(0.1))));
    let beyond = BlockKey { x: 2, y: 0, z: 0 };
    shapes.push((beyond, block(CENTIMETER, beyond, &|_| Some((-0.01, 1.0, [0; 3])))));
    let gone = BlockKey { x: -1, y: -1, z: -1 };
    shapes.push((gone, Block::EMPTY));
    for (key, block) in shapes {
        grid.insert(key, block);
        let remade = update(&mut cache, &grid, usize::MAX);
        assert!((1..=27).contains(&remade), "{remade} pieces were made anew");
        assert_eq!(cache.mesh(), extract(&grid));
    }
}

#[test]
fn any_changes_are_followed_in_any_portions() {
    // Voxels of a noisy ball appear, disappear and change their distance, a few blocks at a time.
    let mut grid = volume(CENTIMETER, [-2; 3], [1; 3], ball(0.11));
    let mut cache = SurfaceCache::default();
    for round in 0..60 {
        let slot = noise(round) as usize % grid.len();
        let mut block = grid.blocks()[slot].clone();
        for k in 0..1 + noise(round + 100) as usize % 40 {
            let voxel = noise(1_000 * round + k) as usize;
            let distance = &mut block.distances[voxel % 512];
            match voxel >> 20 & 3 {
                0 => block.weights[voxel % 512] ^= 512,
                1 => *distance = -*distance,
                _ => *distance = (*distance / 2) + (voxel >> 30) as i16 % 900,
            }
        }
        grid.insert(grid.keys()[slot], block);
        assert!(update(&mut cache, &grid, 3) <= 3);
        if round % 7 == 0 {
            update(&mut cache, &grid, usize::MAX);
            assert_eq!(cache.lag(), 0);
            assert_eq!(cache.mesh(), extract(&grid), "round {round}");
        }
    }
}

#[test]
fn blocks_that_went_or_changed_places_are_followed() {
    let all = volume(CENTIMETER, [-2; 3], [1; 3], ball(0.12));
    let mut cache = SurfaceCache::default();
    update(&mut cache, &all, usize::MAX);
    // The same blocks from the last to the first, without every seventh.
    let mut some = Volume::new(CENTIMETER);
    for slot in (0..all.len()).rev().filter(|slot| slot % 7 != 0) {
        some.insert(all.keys()[slot], all.blocks()[slot].clone());
    }
    update(&mut cache, &some, usize::MAX);
    let anew = extract(&some);
    assert!(triangles(&cache.mesh()) == triangles(&anew));
    assert_eq!(cache.mesh().positions.len(), anew.positions.len());
}

#[test]
fn the_surface_does_not_depend_on_the_threads() {
    let grid = volume(CENTIMETER, [-3; 3], [2; 3], ball(0.2));
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| extract(&grid))
    };
    assert_eq!(on(1), on(2));
    assert_eq!(on(1), on(4));
}

#[test]
fn between_free_space_and_what_a_silhouette_hides_there_is_no_surface() {
    // In front of a wall at z = 0.1, which ends at x = 0; beyond it the camera looks far behind.
    let shape = |p: [f32; 3]| {
        let distance = if p[0] < 0.0 { 0.1 - p[2] } else { 1.0 };
        Some((distance, 3.0, [0; 3]))
    };
    let mesh = extract(&volume(CENTIMETER, [-2; 3], [2; 3], shape));
    assert!(!mesh.triangles.is_empty());
    let rightmost = mesh.positions.iter().map(|p| p[0]).fold(f32::MIN, f32::max);
    assert!(rightmost < 0.0, "the wall is closed towards free space at {rightmost}");
}
