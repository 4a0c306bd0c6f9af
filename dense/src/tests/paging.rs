//! A volume partly on disk equals the one in memory, block by block to the bit.

use std::collections::BTreeMap;

use covis_solvers::geometry::{PinholeRadialTangential, Se3};
use nalgebra::Vector3;
use proptest::prelude::*;

use super::extract;
use super::scene::{Rendered, Scene, Shape, looking, render};
use crate::block::{Block, BlockKey};
use crate::camera::FrameCamera;
use crate::file;
use crate::integrate::{DenseFrame, IntegrateError, IntegrationOptions, Integrator};
use crate::mapper::MemoryCeiling;
use crate::page_cache::Region;
use crate::paged::PagedVolume;
use crate::pages::PageError;
use crate::surface::{self, Mesh, SurfaceCache};
use crate::testing::CENTIMETER;
use crate::volume::{Volume, VolumeOptions};

const GRID: VolumeOptions = VolumeOptions { voxel_m: 0.04, truncation_m: 0.24 };
/// Frames of the walk, to the far end and back.
const FRAMES: usize = 120;
/// Half of the corridor's length, m.
const HALF_M: f64 = 14.0;

fn small_camera() -> FrameCamera {
    let lens = PinholeRadialTangential::undistorted(80.0, 80.0, 59.5, 44.5);
    FrameCamera::new(lens, 120, 90).unwrap()
}

/// A corridor with cartons along its walls; on the way back some are gone.
fn corridor(way_back: bool) -> Scene {
    let mut scene: Scene = vec![(Shape::Room(Vector3::new(HALF_M, 1.0, 1.2)), [120, 90, 60])];
    for k in 0..14 {
        if way_back && k % 3 == 0 {
            continue;
        }
        let (x, side) = (2.0 * f64::from(k) - 13.0, if k % 2 == 0 { 0.8 } else { -0.8 });
        let carton = Shape::Box(Vector3::new(x, side, -0.9), Vector3::new(0.2, 0.2, 0.3));
        scene.push((carton, [40, 160, (k * 17) as u8]));
    }
    scene
}

/// There along x and back, turned around at the far end.
fn pose(frame: usize) -> Se3 {
    let half = FRAMES / 2;
    let (step, turn) =
        if frame < half { (frame, 0.0) } else { (FRAMES - 1 - frame, std::f64::consts::PI) };
    let share = step as f64 / (half - 1) as f64;
    let sway = 0.3 * (0.4 * frame as f64).sin();
    looking([(2.0 * share - 1.0) * (HALF_M - 1.0), 0.2 * sway, 0.0], turn + sway, -0.1)
}

/// One frame of the walk into a volume.
fn show(
    integrator: &mut Integrator,
    volume: &mut PagedVolume,
    frame: usize,
) -> Result<(), IntegrateError> {
    let (pose, camera) = (pose(frame), small_camera());
    let scene = corridor(frame >= FRAMES / 2);
    let Rendered { depth_m, color, .. } = render(&scene, &camera, &pose, Some(frame as u64));
    let frame =
        DenseFrame { depth_m: &depth_m, color: &color, moving: None, world_from_camera: &pose };
    volume.integrate(integrator, &frame)
}

fn walk(volume: &mut PagedVolume, mut seen: impl FnMut(usize, &PagedVolume)) {
    let mut integrator = Integrator::new(&small_camera(), IntegrationOptions::default());
    for frame in 0..FRAMES {
        show(&mut integrator, volume, frame).unwrap();
        seen(frame, volume);
    }
}

/// All blocks by their keys.
fn blocks(volume: &mut PagedVolume) -> BTreeMap<BlockKey, Block> {
    let mut all = BTreeMap::new();
    let show = |blocks: &[(BlockKey, &Block)]| -> Result<(), PageError> {
        for &(key, block) in blocks {
            assert!(all.insert(key, block.clone()).is_none(), "{key:?} twice");
        }
        Ok(())
    };
    volume.visit(100, show).unwrap();
    all
}

fn with_ceiling(blocks: usize) -> PagedVolume {
    PagedVolume::with_ceiling(GRID, blocks * size_of::<Block>(), None).unwrap()
}

/// Asserts that two volumes have the same blocks; a failed comparison of all of them would be
/// unreadable.
fn assert_same(a: &mut PagedVolume, b: &mut PagedVolume) {
    let (a, b) = (blocks(a), blocks(b));
    assert!(a.keys().eq(b.keys()), "{} and {} blocks", a.len(), b.len());
    assert!(!a.is_empty());
    for (key, block) in &a {
        assert!(*block == b[key], "{key:?} differs");
    }
}

#[test]
fn a_volume_that_was_on_disk_in_parts_is_the_one_that_was_not() {
    let mut whole = PagedVolume::new(GRID);
    walk(&mut whole, |_, _| {});
    let ceiling = whole.len() * 2 / 5;
    let mut paged = with_ceiling(ceiling);
    let mut most = 0;
    walk(&mut paged, |_, paged| most = most.max(paged.resident().len()));
    let figures = paged.paging().unwrap();
    println!("{} blocks, ceiling {ceiling}, most {most}, {figures:?}", whole.len());
    assert_eq!(figures.frames_above_ceiling, 0);
    assert!(most <= ceiling && paged.resident().len() + figures.blocks_on_disk == whole.len());
    assert!(figures.paged_in > whole.len() / 3, "the way back needs what went");
    assert!(paged.resident().capacity() <= ceiling + 2 * 256, "memory that went is not used again");
    assert_same(&mut paged, &mut whole);
    // Which blocks are where does not depend on the threads either.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    let mut again = with_ceiling(ceiling);
    pool.install(|| walk(&mut again, |_, _| {}));
    assert_eq!(again.resident().keys(), paged.resident().keys());
    assert_eq!(again.paging(), paged.paging());
    assert_same(&mut again, &mut paged);
}

#[test]
fn a_frame_that_needs_more_than_the_limit_is_integrated_and_reported() {
    let mut whole = PagedVolume::new(GRID);
    walk(&mut whole, |_, _| {});
    let mut paged = with_ceiling(10);
    walk(&mut paged, |_, _| {});
    assert!(
        paged.paging().unwrap().frames_above_ceiling > FRAMES / 2,
        "{:?}",
        paged.paging().unwrap()
    );
    assert_same(&mut paged, &mut whole);
}

#[test]
fn a_page_that_is_damaged_is_an_error_of_the_frame_that_needs_it_and_of_no_other() {
    let mut paged = with_ceiling(500);
    let mut integrator = Integrator::new(&small_camera(), IntegrationOptions::default());
    for frame in 0..FRAMES / 2 {
        show(&mut integrator, &mut paged, frame).unwrap();
    }
    paged.cache().flip_pages(true);
    let (before, revision) = (paged.len(), paged.resident().revision());
    let refused = (FRAMES / 2..FRAMES).find_map(|frame| {
        let error = show(&mut integrator, &mut paged, frame).err()?;
        Some((frame, error))
    });
    let (frame, error) = refused.unwrap();
    assert!(matches!(error, IntegrateError::Pages(PageError::Damaged { .. })), "{error}");
    assert_eq!(paged.resident().revision(), revision + (frame - FRAMES / 2) as u64);
    assert!(paged.len() >= before, "blocks are lost");
    // Once the page is whole again, so is the volume.
    paged.cache().flip_pages(false);
    for frame in frame..FRAMES {
        show(&mut integrator, &mut paged, frame).unwrap();
    }
    let mut whole = PagedVolume::new(GRID);
    walk(&mut whole, |_, _| {});
    assert_same(&mut paged, &mut whole);
}

#[test]
fn on_a_full_disk_frames_are_refused_and_nothing_is_lost() {
    let folder = tempfile::tempdir().unwrap();
    let mut paged = with_ceiling(500);
    paged.cache().use_disk_of(100_000, folder.path());
    let mut integrator = Integrator::new(&small_camera(), IntegrationOptions::default());
    let refused = (0..FRAMES).find_map(|frame| {
        let before = blocks(&mut paged);
        let error = show(&mut integrator, &mut paged, frame).err()?;
        assert!(blocks(&mut paged) == before, "the volume is not as before");
        Some((frame, error))
    });
    let (full, error) = refused.unwrap();
    let path = folder.path().display().to_string();
    let told = error.to_string();
    assert!(told.contains("cannot write") && told.contains(&path), "{told}");
    assert!(paged.paging().unwrap().blocks_on_disk > 0, "the disk was full from the start");
    // The same frame is refused again; with memory enough it is not, and the volume is whole.
    assert!(show(&mut integrator, &mut paged, full).is_err());
    paged.set_ceiling(usize::MAX);
    for frame in full..FRAMES {
        show(&mut integrator, &mut paged, frame).unwrap();
    }
    let mut whole = PagedVolume::new(GRID);
    walk(&mut whole, |_, _| {});
    assert_same(&mut paged, &mut whole);
}

#[test]
fn a_frame_that_makes_no_sense_moves_nothing() {
    let mut paged = with_ceiling(500);
    let mut integrator = Integrator::new(&small_camera(), IntegrationOptions::default());
    for frame in 0..FRAMES / 2 {
        show(&mut integrator, &mut paged, frame).unwrap();
    }
    let before = paged.paging().unwrap();
    let Rendered { depth_m, color, .. } = render(&corridor(false), &small_camera(), &pose(0), None);
    let mut odd = pose(0);
    odd.translation.x = f64::NAN;
    let frame =
        DenseFrame { depth_m: &depth_m, color: &color, moving: None, world_from_camera: &odd };
    assert_eq!(paged.integrate(&mut integrator, &frame), Err(IntegrateError::Pose));
    assert_eq!(paged.paging().unwrap(), before);
}

#[test]
fn without_a_folder_for_pages_there_is_an_error() {
    let missing = tempfile::tempdir().unwrap().path().join("no");
    assert!(PagedVolume::with_ceiling(GRID, 1 << 20, Some(&missing)).is_err());
}

/// A mesh as a set: each triangle by its corners, each corner by all its bits.
fn triangles(mesh: &Mesh) -> Vec<[[u32; 7]; 3]> {
    let corner = |&i: &u32| {
        let (p, n) = (mesh.positions[i as usize], mesh.normals[i as usize]);
        let [r, g, b] = mesh.colors[i as usize];
        let color = u32::from_le_bytes([r, g, b, 0]);
        let [p, n] = [p, n].map(|v| v.map(f32::to_bits));
        [p[0], p[1], p[2], n[0], n[1], n[2], color]
    };
    let mut all: Vec<_> = mesh.triangles.iter().map(|t| t.each_ref().map(corner)).collect();
    all.sort_unstable();
    all
}

#[test]
fn the_surface_of_a_volume_that_is_on_disk_in_parts_is_the_one_of_the_whole() {
    let mut whole = PagedVolume::new(GRID);
    walk(&mut whole, |_, _| {});
    let expected = triangles(&extract(whole.resident()));
    assert!(expected.len() > 10_000);
    for ceiling in [whole.len() / 3, 10] {
        let mut paged = with_ceiling(ceiling);
        walk(&mut paged, |_, _| {});
        let mesh = surface::extract(&mut paged).unwrap();
        assert!(triangles(&mesh) == expected, "the surfaces differ");
        assert!(paged.paging().unwrap().blocks_on_disk > 0);
        assert_same(&mut paged, &mut whole);
    }
}

#[test]
fn a_surface_that_follows_keeps_what_goes_to_disk() {
    let mut whole = PagedVolume::new(GRID);
    let mut integrators =
        [(); 2].map(|()| Integrator::new(&small_camera(), IntegrationOptions::default()));
    let mut paged = with_ceiling(1500);
    let mut cache = SurfaceCache::default();
    let mut read_for_surface = 0;
    for frame in 0..FRAMES {
        show(&mut integrators[0], &mut whole, frame).unwrap();
        show(&mut integrators[1], &mut paged, frame).unwrap();
        // Now and then, and some pieces only: what is left for later may be on disk by then.
        if frame % 3 == 2 {
            let before = paged.paging().unwrap().paged_in;
            let most = if frame % 2 == 0 { 40 } else { usize::MAX };
            cache.update(&mut paged, most).unwrap();
            read_for_surface += paged.paging().unwrap().paged_in - before;
        }
        if frame % 40 == 39 {
            cache.update(&mut paged, usize::MAX).unwrap();
            assert_eq!(cache.lag(), 0);
            let expected = extract(whole.resident());
            assert!(triangles(&cache.mesh()) == triangles(&expected), "frame {frame}");
        }
    }
    let figures = paged.paging().unwrap();
    println!("{figures:?}, {read_for_surface} of them for the surface");
    assert!(figures.blocks_on_disk > 0);
}

#[test]
fn a_volume_that_is_on_disk_in_parts_is_saved_as_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("volume.covis");
    let mut whole = PagedVolume::new(GRID);
    walk(&mut whole, |_, _| {});
    let mut paged = with_ceiling(whole.len() / 3);
    walk(&mut paged, |_, _| {});
    let before = paged.paging().unwrap();
    file::save(&mut paged, &path).unwrap();
    assert_eq!(paged.paging().unwrap(), before, "saving moves blocks");
    assert_same(&mut file::load(&path, None).unwrap(), &mut whole);
    // And read under a ceiling, with the same surface.
    let bytes = whole.len() / 4 * size_of::<Block>();
    let folder = Some(folder.path().to_owned());
    let mut part = file::load(&path, Some(&MemoryCeiling { bytes, folder })).unwrap();
    assert!(
        part.resident().len() * size_of::<Block>() <= bytes
            && part.paging().unwrap().blocks_on_disk > 0
    );
    let surface = surface::extract(&mut part).unwrap();
    let expected = extract(whole.resident());
    assert!(triangles(&surface) == triangles(&expected), "the surfaces differ");
    assert_same(&mut part, &mut whole);
}

/// What is done to a volume and to a plain map.
#[derive(Clone, Debug)]
enum Step {
    Insert(i32, i32, u64),
    Read(i32, i32),
    Ceiling(usize),
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let step = prop_oneof![
        4 => (-20..20, -20..20, any::<u64>()).prop_map(|(x, z, seed)| Step::Insert(x, z, seed)),
        2 => (-20..20, -20..20).prop_map(|(x, z)| Step::Read(x, z)),
        1 => (0_usize..40).prop_map(Step::Ceiling),
    ];
    prop::collection::vec(step, 1..120)
}

proptest! {
    #[test]
    fn blocks_that_come_and_go_are_those_of_a_plain_map(steps in steps()) {
        let bytes = size_of::<Block>();
        let mut paged = PagedVolume::with_ceiling(CENTIMETER, 20 * bytes, None).unwrap();
        let mut plain = BTreeMap::new();
        for step in steps {
            match step {
                Step::Insert(x, z, seed) => {
                    let key = BlockKey { x, y: -3, z };
                    let mut block = Block::EMPTY;
                    block.distances[seed as usize % 512] = seed as i16;
                    block.weights[7] = (seed >> 16) as u16;
                    block.colors[511] = ((seed >> 32) as u32).to_le_bytes();
                    paged.insert(key, block.clone()).unwrap();
                    plain.insert(key, block);
                }
                Step::Read(x, z) => {
                    let key = BlockKey { x, y: -3, z };
                    let part = paged.bring(&[Region::of(key)]).unwrap();
                    prop_assert_eq!(part.block(key), plain.get(&key));
                }
                Step::Ceiling(blocks) => paged.set_ceiling(blocks * bytes),
            }
            prop_assert_eq!(paged.len(), plain.len());
        }
        prop_assert!(blocks(&mut paged) == plain);
    }
}

#[test]
fn slots_and_memory_of_blocks_that_are_taken_away_serve_others() {
    let mut volume = Volume::new(CENTIMETER);
    let key = |x: i32| BlockKey { x, y: 1, z: 2 };
    let block = |x: i32| {
        let mut block = Block::EMPTY;
        block.weights[3] = x as u16;
        block
    };
    for x in 0..1000 {
        volume.insert(key(x), block(x));
    }
    let capacity = volume.capacity();
    assert!((0..1000).filter(|x| x % 3 != 0).all(|x| volume.remove(key(x))));
    assert!(!volume.remove(key(1)) && !volume.remove(key(5000)));
    for x in 0..1000 {
        let expected = (x % 3 == 0).then(|| block(x));
        assert_eq!(volume.block(key(x)), expected.as_ref());
    }
    for x in 1000..1600 {
        let slot = volume.allocate(key(x));
        assert_eq!(volume.blocks()[slot], Block::EMPTY, "a new block has what another one left");
    }
    assert_eq!((volume.len(), volume.capacity()), (934, capacity));
    (1000..1600).for_each(|x| assert!(volume.remove(key(x))));
    volume.shrink_to(0);
    assert_eq!(volume.capacity(), 2 * 256);
    assert!((0..1000).step_by(3).all(|x| volume.block(key(x)) == Some(&block(x))));
}
