//! FAST against its definition, written out; the grid, the mask and the fallback.

use super::super::corners::{Corner, CornerOptions, detect};
use super::super::splitmix::SplitMix64;
use super::{render, texture};
use crate::image::Image;

const ALL: fn(usize, usize) -> bool = |_, _| true;

/// Every corner is told, one a pixel.
fn every(threshold: u8) -> CornerOptions {
    CornerOptions { threshold, fallback_threshold: threshold, cell_px: 1, border_px: 4 }
}

fn pixels(corners: &[Corner]) -> Vec<(usize, usize)> {
    corners.iter().map(|c| (c.u, c.v)).collect()
}

/// The largest threshold for which 9 in a row are brighter or darker, plus 1; 0 where there is none.
fn strength_by_definition(image: &Image<u8>, u: usize, v: usize) -> i32 {
    let circle = [
        (0, -3),
        (1, -3),
        (2, -2),
        (3, -1),
        (3, 0),
        (3, 1),
        (2, 2),
        (1, 3),
        (0, 3),
        (-1, 3),
        (-2, 2),
        (-3, 1),
        (-3, 0),
        (-3, -1),
        (-2, -2),
        (-1, -3),
    ];
    let center = i32::from(image.at(u, v));
    let ring = circle.map(|(du, dv): (isize, isize)| {
        i32::from(image.at(u.wrapping_add_signed(du), v.wrapping_add_signed(dv)))
    });
    let arc = |first: usize| (0..9).map(move |k| ring[(first + k) % 16]);
    let is_corner = |threshold: i32| {
        (0..16).any(|first| {
            arc(first).all(|p| p > center + threshold) || arc(first).all(|p| p < center - threshold)
        })
    };
    (0..255).rev().find(|&threshold| is_corner(threshold)).map_or(0, |threshold| threshold + 1)
}

#[test]
fn corners_are_those_of_the_definition() {
    let textured = render(71, 53, |u, v| texture(5, 1.7 * u, 1.7 * v));
    let mut generator = SplitMix64(9);
    let mut random = Image::filled(64, 48, 0);
    random.pixels_mut().iter_mut().for_each(|pixel| *pixel = (generator.bits() >> 56) as u8);
    for (image, threshold) in [(&textured, 10), (&textured, 0), (&random, 40), (&random, 90)] {
        let (width, height) = image.size();
        let mut strength = Image::filled(width, height, 0);
        for v in 4..height - 4 {
            for u in 4..width - 4 {
                let value = strength_by_definition(image, u, v);
                strength.set(u, v, if value > i32::from(threshold) { value } else { 0 });
            }
        }
        let mut expected = Vec::new();
        for v in 4..height - 4 {
            for u in 4..width - 4 {
                let own = strength.at(u, v);
                let outshone = (0..9).filter(|&k| k != 4).any(|k| {
                    let other = strength.at(u + k % 3 - 1, v + k / 3 - 1);
                    if k < 4 { other >= own } else { other > own }
                });
                if own > 0 && !outshone {
                    expected.push((u, v));
                }
            }
        }
        assert!(expected.len() > 10, "{} at {threshold}", expected.len());
        assert_eq!(pixels(&detect(image, &every(threshold), ALL)), expected);
    }
}

#[test]
fn a_square_has_four_corners_and_no_more() {
    let inside = |u: f64, v: f64| (20.0..=50.0).contains(&u) && (15.0..=40.0).contains(&v);
    let image = render(80, 60, |u, v| if inside(u, v) { 200.0 } else { 50.0 });
    let options = CornerOptions { cell_px: 10, ..every(20) };
    let found = detect(&image, &options, ALL);
    // Without noise or blur, pixels beside the very corner are as strong as it is.
    for (u, v) in [(20, 15), (50, 15), (20, 40), (50, 40)] {
        let near = found.iter().filter(|c| c.u.abs_diff(u) <= 2 && c.v.abs_diff(v) <= 2).count();
        assert_eq!(near, 1, "{u} {v}: {found:?}");
    }
    assert_eq!(found.len(), 4, "{found:?}");
}

#[test]
fn the_score_is_the_smaller_eigenvalue() {
    // Two pixels left and right of the dot see a gradient of 50 along u, two along v, of 49.
    let dot = render(40, 40, |u, v| if (u, v) == (20.0, 20.0) { 100.0 } else { 0.0 });
    let found = detect(&dot, &every(20), ALL);
    assert_eq!(pixels(&found), [(20, 20)]);
    assert!((found[0].score - 2.0 * 50.0 * 50.0 / 49.0).abs() < 1e-3, "{found:?}");
    // Three in a row: along u at columns 18, 19, 21 and 22, along v at six pixels.
    let bar = render(40, 40, |u, v| if v == 20.0 && (u - 20.0).abs() <= 1.0 { 100.0 } else { 0.0 });
    let found = detect(&bar, &every(20), ALL);
    assert_eq!(pixels(&found), [(19, 20)], "the first of three that are equally strong");
    assert!((found[0].score - 4.0 * 50.0 * 50.0 / 49.0).abs() < 1e-3, "{found:?}");
}

#[test]
fn each_cell_has_its_best_corner_and_weak_ones_only_where_nothing_else_is() {
    // The right half has a fifth of the contrast.
    let contrast = |u: f64| if u < 160.0 { 1.0 } else { 0.2 };
    let image = render(320, 240, |u, v| 128.0 + contrast(u) * (texture(3, u, v) - 128.0));
    let strict =
        CornerOptions { threshold: 20, fallback_threshold: 20, cell_px: 20, border_px: 16 };
    let lenient = CornerOptions { fallback_threshold: 3, ..strict };
    let (few, many) = (detect(&image, &strict, ALL), detect(&image, &lenient, ALL));
    let in_half = |corners: &[Corner]| corners.iter().filter(|c| c.u > 163).count();
    assert!(few.len() > 30 && in_half(&few) == 0, "{} {}", few.len(), in_half(&few));
    assert!(in_half(&many) > 50, "{}", in_half(&many));

    let cell = |c: &Corner| (c.v / 20, c.u / 20);
    assert!(many.is_sorted_by(|a, b| cell(a) < cell(b)), "row by row, one a cell");
    assert!(many.iter().all(|c| (16..304).contains(&c.u) && (16..224).contains(&c.v)));
    // Where the high threshold finds one, the low one changes nothing.
    assert!(few.iter().all(|c| many.contains(c)));
    // The best of a cell: of all corners in it none has a higher score.
    for other in detect(&image, &CornerOptions { border_px: 16, ..every(20) }, ALL) {
        let best = few.iter().find(|c| cell(c) == cell(&other)).unwrap();
        assert!(best.score >= other.score, "{best:?} {other:?}");
    }
}

#[test]
fn forbidden_pixels_give_way_to_the_next_best() {
    let image = render(320, 240, |u, v| texture(8, u, v));
    let options = CornerOptions::default();
    let all = detect(&image, &options, ALL);
    let allowed = |u: usize, v: usize| (u / 7 + v / 7).is_multiple_of(2);
    let some = detect(&image, &options, allowed);
    assert!(some.iter().all(|c| allowed(c.u, c.v)));
    assert!(some.len() > all.len() * 3 / 4, "{} of {}", some.len(), all.len());
    assert!(all.iter().filter(|c| allowed(c.u, c.v)).all(|c| some.contains(c)));
    assert_eq!(detect(&image, &options, |_, _| false), []);
}

#[test]
fn images_without_corners_or_too_small_for_any_give_none() {
    let options = every(0);
    for size in [(0, 0), (1, 1), (8, 8), (3, 200), (200, 3)] {
        let image = render(size.0, size.1, |u, v| texture(1, 9.0 * u, 9.0 * v));
        assert_eq!(detect(&image, &options, ALL), [], "{size:?}");
    }
    for value in [0, 128, 255] {
        assert_eq!(detect(&Image::filled(100, 80, value), &options, ALL), []);
    }
    let strange = CornerOptions { cell_px: 0, border_px: usize::MAX / 2, ..options };
    assert_eq!(detect(&Image::filled(30, 30, 0), &strange, ALL), []);
    let ramp = render(100, 80, |u, v| u + v);
    assert_eq!(detect(&ramp, &every(5), ALL), [], "a slope is no corner");
}
