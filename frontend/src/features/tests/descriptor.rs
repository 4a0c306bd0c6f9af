//! What a descriptor must survive: rotation, another distance, a change of exposure, noise; and that it never
//! changes.

use std::f64::consts::SQRT_2;

use super::super::corners::{CornerOptions, detect};
use super::super::descriptor::{Describer, Descriptor, Size};
use super::super::splitmix::SplitMix64;
use super::{normal, render, texture};
use crate::image::Image;
use crate::pyramid::Pyramid;

const SIZE: (usize, usize) = (320, 240);
const PLAIN: [Size; 2] = [Size::SMALLEST; 2];

/// In how many bits both differ, 0 to 256.
fn distance(a: &Descriptor, b: &Descriptor) -> u32 {
    a.0.iter().zip(&b.0).map(|(a, b)| (a ^ b).count_ones()).sum()
}

/// Corners of the plain texture that have a descriptor in both images; `moved` is where they are
/// in the second, where patches have the second of the two sizes. Returns how many there are and the shares of them that are matched and that are
/// matched rightly.
fn rates(
    second: &Image<u8>,
    sizes: [Size; 2],
    moved: impl Fn(f64, f64) -> (f64, f64),
) -> (usize, f64, f64) {
    let first = render(SIZE.0, SIZE.1, |u, v| texture(21, u, v));
    let options = CornerOptions { cell_px: 12, ..CornerOptions::default() };
    let corners = detect(&first, &options, |_, _| true);
    let pyramids = [first, second.clone()].map(|image| Pyramid::new(image, 3));
    let [from, to] = pyramids.each_ref().map(Describer::new);
    let mut queries = Vec::new();
    let mut candidates = Vec::new();
    for corner in corners {
        let (u, v) = moved(corner.u as f64, corner.v as f64);
        let described = (
            from.describe(corner.u as f32, corner.v as f32, sizes[0]),
            to.describe(u as f32, v as f32, sizes[1]),
        );
        if let (Some(query), Some(candidate)) = described {
            queries.push(query);
            candidates.push(candidate);
        }
    }
    let nearest = |from: &Descriptor, all: &[Descriptor]| -> Option<usize> {
        let mut by_distance: Vec<_> = all.iter().map(|to| distance(from, to)).zip(0..).collect();
        by_distance.sort_unstable();
        let [(first, index), (second, _), ..] = by_distance[..] else { return None };
        (first <= 64 && f64::from(first) < 0.8 * f64::from(second)).then_some(index)
    };
    // Mutual, and clearly nearer than the next.
    let matches: Vec<(usize, usize)> = (0..queries.len())
        .filter_map(|query| Some((query, nearest(&queries[query], &candidates)?)))
        .filter(|&(query, found)| {
            let from = &candidates[found];
            queries.iter().all(|other| distance(from, other) >= distance(from, &queries[query]))
        })
        .collect();
    let share = |count: usize| count as f64 / queries.len() as f64;
    let right = matches.iter().filter(|(query, found)| query == found).count();
    (queries.len(), share(matches.len()), share(right))
}

#[test]
fn points_are_recognized_after_any_rotation() {
    let center = (SIZE.0 as f64 / 2.0, SIZE.1 as f64 / 2.0);
    for angle_deg in [5.0, 17.0, 45.0, 90.0, 123.0, 180.0, 271.3] {
        let (sin, cos) = f64::to_radians(angle_deg).sin_cos();
        let turn = |u: f64, v: f64, sin: f64| {
            let (x, y) = (u - center.0, v - center.1);
            (center.0 + cos * x - sin * y, center.1 + sin * x + cos * y)
        };
        let second = render(SIZE.0, SIZE.1, |u, v| {
            let (u, v) = turn(u, v, -sin);
            texture(21, u, v)
        });
        let (points, matched, right) = rates(&second, PLAIN, |u, v| turn(u, v, sin));
        assert!(points > 100, "{points} points");
        assert!(right >= 0.85, "{angle_deg} deg: {right} right of {points}");
        assert!(matched - right <= 0.01, "{angle_deg} deg: {matched} matched, {right} right");
    }
}

#[test]
fn points_are_recognized_from_another_distance() {
    let center = (SIZE.0 as f64 / 2.0, SIZE.1 as f64 / 2.0);
    // Twice as near, and half a step between two sizes.
    for (nearer, least) in [(1.3, 0.85), (1.68, 0.85), (2.0, 0.85), (3.0, 0.7)] {
        let zoom = |u: f64, v: f64, by: f64| {
            (center.0 + by * (u - center.0), center.1 + by * (v - center.1))
        };
        let second = render(SIZE.0, SIZE.1, |u, v| {
            let (u, v) = zoom(u, v, 1.0 / nearer);
            texture(21, u, v)
        });
        let sizes = [3.0, 3.0 / nearer].map(|z| Size::at(z, 3.0 * 15.0 / 0.114));
        let (points, matched, right) = rates(&second, sizes, |u, v| zoom(u, v, nearer));
        assert!(points > 15, "{points} points");
        assert!(right >= least, "{nearer}: {right} right of {points}");
        assert!(matched - right <= 0.05, "{nearer}: {matched} matched, {right} right");
    }
}

#[test]
fn what_is_nearer_has_a_larger_patch_up_to_four_times() {
    let sizes = [9.0, 2.0, 1.0, 0.7, 0.5, 0.1].map(|z| Size::at(z, 2.0 * 15.0 / 0.114));
    assert!(sizes[0] == sizes[1] && sizes[1] == Size::SMALLEST);
    assert!(sizes[2] != sizes[1] && sizes[3] != sizes[2] && sizes[4] != sizes[3]);
    assert_eq!(sizes[4], sizes[5]);
    for no_depth in [-1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert_eq!(Size::at(no_depth, 500.0), Size::SMALLEST, "{no_depth}");
    }
    assert_eq!(Size::at(f64::MIN_POSITIVE, 500.0), sizes[5]);
}

#[test]
fn points_are_recognized_under_another_exposure_and_with_noise() {
    let here = |u: f64, v: f64| (u, v);
    for (gain, offset) in [(0.6, 5.0), (1.0, 40.0), (1.3, -40.0)] {
        let second = render(SIZE.0, SIZE.1, |u, v| gain * texture(21, u, v) + offset);
        let (points, matched, right) = rates(&second, PLAIN, here);
        assert!(points > 100 && right >= 0.98 && matched == right, "{gain} {offset}: {right}");
    }
    for (sigma, least) in [(5.0, 0.98), (15.0, 0.9)] {
        let mut generator = SplitMix64(4);
        let mut second = render(SIZE.0, SIZE.1, |u, v| texture(21, u, v));
        for pixel in second.pixels_mut() {
            *pixel = (f64::from(*pixel) + sigma * normal(&mut generator)).round() as u8;
        }
        let (points, matched, right) = rates(&second, PLAIN, here);
        assert!(points > 100 && right >= least && matched - right <= 0.01, "{sigma}: {right}");
    }
}

#[test]
fn different_places_differ_in_half_of_the_bits() {
    let image = Pyramid::new(render(SIZE.0, SIZE.1, |u, v| texture(2, u, v)), 1);
    let describer = Describer::new(&image);
    let mut descriptors = Vec::new();
    for v in (20..220).step_by(40) {
        for u in (20..300).step_by(40) {
            descriptors.push(describer.describe(u as f32, v as f32, Size::SMALLEST).unwrap());
        }
    }
    let mut distances = Vec::new();
    for (k, a) in descriptors.iter().enumerate() {
        assert_eq!(distance(a, a), 0);
        distances.extend(descriptors[..k].iter().map(|b| distance(a, b)));
    }
    let mean = f64::from(distances.iter().sum::<u32>()) / distances.len() as f64;
    assert!((105.0..140.0).contains(&mean), "{mean}");
    assert!(*distances.iter().min().unwrap() > 40);
}

#[test]
fn the_rim_and_no_numbers_have_no_descriptor() {
    let image = Pyramid::new(render(40, 50, |u, v| texture(2, u, v)), 1);
    let describer = Describer::new(&image);
    let has = |u: f32, v: f32| describer.describe(u, v, Size::SMALLEST).is_some();
    for (u, v) in [(15.0, 15.0), (24.0, 34.0), (14.6, 34.4)] {
        assert!(has(u, v), "{u} {v}");
    }
    for (u, v) in [(14.4, 20.0), (20.0, 14.4), (24.6, 20.0), (20.0, 34.6), (-1.0, 20.0)] {
        assert!(!has(u, v), "{u} {v}");
    }
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX] {
        assert!(!has(bad, 20.0) && !has(20.0, bad), "{bad}");
    }
    for size in [(0, 0), (1, 1), (30, 30), (31, 5)] {
        let image = Pyramid::new(Image::filled(size.0, size.1, 7), 1);
        let describer = Describer::new(&image);
        assert_eq!(describer.describe(15.0, 15.0, Size::SMALLEST), None, "{size:?}");
    }
    // Flat: all comparisons are false.
    let flat = Pyramid::new(Image::filled(31, 31, 7), 1);
    let flat = Describer::new(&flat).describe(15.0, 15.0, Size::SMALLEST);
    assert_eq!(flat, Some(Descriptor([0; 4])));
}

#[test]
fn bytes_are_little_endian() {
    let descriptor = Descriptor([1, 0x0203, 1 << 63, 0xff00_0000]);
    let bytes = descriptor.to_bytes();
    assert_eq!((bytes[0], bytes[8], bytes[9], bytes[23], bytes[27]), (1, 3, 2, 128, 255));
    assert_eq!(bytes.iter().map(|b| b.count_ones()).sum::<u32>(), 13);
}

/// Maps keep descriptors: the same image must have the same ones in every version.
#[test]
fn the_bits_of_a_point_never_change() {
    let mut generator = SplitMix64(77);
    let mut image = Image::filled(64, 64, 0);
    // Blocks of 4 × 4, so that the smoothing leaves contrast.
    let blocks: Vec<u8> = (0..256).map(|_| (generator.bits() >> 56) as u8).collect();
    for v in 0..64 {
        for u in 0..64 {
            image.set(u, v, blocks[v / 4 * 16 + u / 4]);
        }
    }
    let image = Pyramid::new(image, 1);
    let describer = Describer::new(&image);
    let found = [(20.0, 20.0), (30.0, 41.0), (45.0, 33.0)]
        .map(|(u, v)| describer.describe(u, v, Size::SMALLEST).unwrap().0);
    let expected: [[u64; 4]; 3] = [
        [
            0xacef_5a3f_dfab_eb54,
            0x53a9_e50f_7e46_918a,
            0x5a4b_4ca4_4406_320a,
            0x659d_b4a5_0631_1a55,
        ],
        [
            0x1931_8bbd_02fa_ba1e,
            0x3480_f84e_924a_7b0c,
            0x8b21_3c0b_b2a6_1a4f,
            0xe5eb_9e8c_4bb5_34f3,
        ],
        [
            0x5b9b_866f_3219_51f7,
            0x5866_d3ba_f4b2_3dc0,
            0xc310_e96e_21bb_11ba,
            0xcdfa_c232_d387_2ae3,
        ],
    ];
    assert_eq!(found, expected, "{found:#x?}");
    let larger = Size::at(1.0, SQRT_2 * 15.0 / 0.114);
    let found = describer.describe(30.0, 33.0, larger).unwrap().0;
    let expected = [
        0x8197_a2c7_2ac8_99dc,
        0xc8fc_334e_d9b6_bfe7,
        0x9e14_8027_c9e2_2b91,
        0x4cfa_8b61_0be7_806f,
    ];
    assert_eq!(found, expected, "{found:#x?}");
}
