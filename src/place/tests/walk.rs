//! A walk of two laps: keyframes of the second are recognized, those of the first are not.

use covis_solvers::testing::random::seeded;
use rand::RngExt;

use super::*;

/// Keyframes of a lap.
const LAP: usize = 120;
/// Points that come into sight at each step, and for how many they stay.
const POINTS: usize = 30;
const SIGHT: usize = 10;

/// What a keyframe sees: each point that is in sight with a probability of 0.7, with `flipped` of its
/// bits changed, and as many others again in ten. One point in three has a texture that repeats.
fn seen(keyframe: usize, flipped: f64) -> Vec<Vec<u8>> {
    let mut rng = seeded(keyframe as u64 + 1);
    let mut data = Vec::new();
    for step in keyframe % LAP..keyframe % LAP + SIGHT {
        for point in 0..POINTS {
            let number = (step % LAP) * POINTS + point;
            let number = if point % 3 == 0 { number % 70 } else { 1000 + number };
            if rng.random::<f64>() < 0.7 {
                let mut point = descriptor(number as u64);
                for bit in 0..256 {
                    point[bit / 8] ^= u8::from(rng.random::<f64>() < flipped) << (bit % 8);
                }
                data.push(point);
            }
        }
    }
    data.extend((0..data.len() / 10).map(|_| rng.random::<[u8; 32]>().to_vec()));
    data
}

/// Share of the second lap's keyframes that are recognized in the first, and the wrong ones among all
/// candidates with at least 12 matches that two queries in a row support.
fn recognized(flipped: f64) -> (f64, usize) {
    let mut index = PlaceIndex::new();
    let mut support = Support::default();
    let (mut right, mut wrong) = (0, 0);
    for k in 0..2 * LAP {
        let data = seen(k, flipped);
        let features = orb(&data);
        let recent = |keyframe: EntityId| keyframe.id + 20 > k as i64;
        let candidates = index.query(&features, 3, recent).unwrap();
        let supported = support.of(&candidates);
        let mut found = false;
        for (candidate, support) in candidates.iter().zip(supported) {
            if candidate.matches.len() >= 12 && support >= 2 {
                let apart = (candidate.keyframe.id - k as i64).rem_euclid(LAP as i64);
                let is_right = apart.min(LAP as i64 - apart) <= SIGHT as i64;
                found |= is_right;
                wrong += usize::from(!is_right);
            }
        }
        right += usize::from(found && k >= LAP);
        index.add(id(0, k as i64), k as i64 * 100_000_000, &features).unwrap();
    }
    (right as f64 / LAP as f64, wrong)
}

#[test]
fn a_second_lap_is_recognized() {
    for flipped in [0.12, 0.2] {
        let (recall, wrong) = recognized(flipped);
        assert!(recall >= 0.95 && wrong == 0, "{flipped} flipped: {recall}, {wrong} wrong");
    }
}
