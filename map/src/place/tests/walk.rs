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

/// Recall of the second lap in the first.
fn recognized(flipped: f64) -> f64 {
    let mut index = PlaceIndex::default();
    let mut told = Vec::new();
    for k in 0..2 * LAP {
        let data = seen(k, flipped);
        let features = orb(&data);
        let recent = |keyframe: EntityId| keyframe.id + 20 > k as i64;
        let candidates = index.query(&features, None, 3, recent).unwrap();
        let is_near = |candidate: &Candidate| {
            let apart = (candidate.keyframe.id - k as i64).rem_euclid(LAP as i64);
            apart.min(LAP as i64 - apart) <= SIGHT as i64
        };
        told.push(Best {
            score: candidates.first().map_or(0.0, |candidate| candidate.score),
            is_again: k >= LAP,
            is_right: candidates.first().is_some_and(is_near),
        });
        index.add(id(0, k as i64), k as i64 * 100_000_000, &features).unwrap();
    }
    recall_at_precision_1(&told)
}

#[test]
fn a_second_lap_is_recognized() {
    for flipped in [0.12, 0.2] {
        let recall = recognized(flipped);
        assert!(recall >= 0.95, "{flipped} flipped: {recall}");
    }
}
