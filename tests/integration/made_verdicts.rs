//! Verdicts on the loop closures of sequences that are made from a seed and chose no constant: a room, a
//! corridor and two blocks. Nothing here looks at how closures are judged.

use crate::common::{TestServer, run};
use crate::made_sequence::{Course, walls};
use crate::sequence::{Sequence, judged, stated_information};

/// Of the scenes, the noise and the false closures.
const SEED: u64 = 1;

/// Three times around in a room of 5 m by 4 m.
pub(crate) fn room() -> Course {
    let corner = |k: i32| {
        let angle = f64::from(k) * std::f64::consts::FRAC_PI_6;
        [1.2 * angle.cos(), 1.0 * angle.sin()]
    };
    let way = (0..=36).map(corner).collect();
    let walls = walls([-2.5, -2.0], [2.5, 2.0]).to_vec();
    Course {
        way,
        walls,
        copies: Vec::new(),
        points_per_m: 60.0,
        step_m: 0.17,
        closure_step: 2,
        calibration_error: 0.01,
    }
}

/// A corridor of 16 m, there and back twice.
pub(crate) fn corridor() -> Course {
    let way = vec![[0.0, 0.0], [12.0, 0.0], [0.0, 0.0], [12.0, 0.0], [0.0, 0.0]];
    let walls = walls([-2.0, -1.5], [14.0, 1.5]).to_vec();
    Course {
        way,
        walls,
        copies: Vec::new(),
        points_per_m: 50.0,
        step_m: 0.32,
        closure_step: 2,
        calibration_error: 0.01,
    }
}

/// Around two blocks in turn, always through the corridor between them in the same direction.
pub(crate) fn eight() -> Course {
    let [a, b, c, d, e, f] =
        [[0.0, 0.0], [6.0, 0.0], [6.0, 6.0], [0.0, 6.0], [12.0, 0.0], [12.0, 6.0]];
    let way = vec![b, c, d, a, b, c, f, e, b, c, d, a, b, c];
    let outside = walls([-1.0, -1.0], [13.0, 7.0]);
    let blocks = [walls([1.0, 1.0], [5.0, 5.0]), walls([7.0, 1.0], [11.0, 5.0])];
    let walls = [outside, blocks[0], blocks[1]].concat();
    Course {
        way,
        walls,
        copies: Vec::new(),
        points_per_m: 40.0,
        step_m: 0.5,
        closure_step: 2,
        calibration_error: 0.01,
    }
}

/// Closures that claim 3 cm and 1.5°: at most a twentieth of the true ones that hold is off.
fn stated(name: &str, course: &Course) {
    let mut sequence = course.make(SEED).sequence;
    for closure in &mut sequence.closures {
        closure.information = stated_information();
    }
    tell(name, &sequence);
    run(async {
        let server = TestServer::lock_step().await;
        for (share, agree) in [(0.0, false), (0.1, false), (0.2, true)] {
            let closures = sequence.with_false(share, agree, SEED);
            let judged = judged(&server, &label(name, share, agree), &sequence, &closures).await;
            assert!(20 * judged.off.len() <= judged.holding, "{:?} are off", judged.off);
        }
    });
}

/// Closures with the information that RefinePose answers: at most a fifth of the true ones is off.
fn refined(name: &str, course: &Course) {
    let mut sequence = course.make(SEED).sequence;
    run(async {
        let server = TestServer::lock_step().await;
        sequence.closures = sequence.with_refined_information(&server).await;
        tell(name, &sequence);
        for (share, agree) in [(0.2, false), (0.2, true)] {
            let closures = sequence.with_false(share, agree, SEED);
            let judged = judged(&server, &label(name, share, agree), &sequence, &closures).await;
            let off = judged.off.len() + judged.off_beyond.len();
            assert!(5 * off <= sequence.closures.len(), "{off} are off");
        }
    });
}

fn label(name: &str, share: f64, agree: bool) -> String {
    let kind = if agree { "agreeing" } else { "independent" };
    format!("{name}-{:.0}-{kind}", 100.0 * share)
}

#[allow(clippy::print_stdout, reason = "a test shows what it measured")]
fn tell(name: &str, sequence: &Sequence) {
    let [meters, degrees] = sequence.median_errors();
    println!(
        "{name}: {} keyframes, {} closures, median errors {:.1} mm and {degrees:.2}°",
        sequence.truth.len(),
        sequence.closures.len(),
        1e3 * meters
    );
}

#[test]
fn closures_of_a_room_are_judged_the_same_in_any_order() {
    stated("room", &room());
}

#[test]
fn closures_of_a_room_that_claim_too_much_count() {
    refined("room", &room());
}

#[test]
fn closures_of_a_corridor_are_judged_the_same_in_any_order() {
    stated("corridor", &corridor());
}

#[test]
fn closures_of_a_corridor_that_claim_too_much_count() {
    refined("corridor", &corridor());
}

#[test]
fn closures_of_two_blocks_are_judged_the_same_in_any_order() {
    stated("eight", &eight());
}

#[test]
fn closures_of_two_blocks_that_claim_too_much_count() {
    refined("eight", &eight());
}
