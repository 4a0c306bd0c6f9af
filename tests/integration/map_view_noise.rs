//! Views whose deviations are not those that their client states: what windows find, and what they believe.

use covis::map::{
    Change, Item, MapPolicy, Reach, SolveKind, Solved, ViewNoise, applied, local_problem,
};
use covis_solvers::bundle_adjustment;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::testing::random::{normal_vector, seeded};

use crate::map_support::{Journal, ROBOT, id, pose_at, street_keyframe, window_around};

/// A street of 30 keyframes whose pixels are `deviation` off and state 1 px, after a window of each.
fn seen_with(deviation: f64) -> Journal {
    seen_with_wrong(deviation, usize::MAX)
}

/// The same, and each `nth` view is 40 px off.
fn seen_with_wrong(deviation: f64, nth: usize) -> Journal {
    let mut rng = seeded(5);
    let mut journal = Journal::new(MapPolicy::default());
    for k in 0..30 {
        let mut item = street_keyframe(k, pose_at(k as f64), &journal.map);
        if let Item::Keyframe { observations, .. } = &mut item {
            // Each keyframe has other wrong views: a landmark that all see 40 px off is there.
            for (index, seen) in (1 + 3 * k as usize..).zip(observations) {
                seen.pixel += normal_vector::<2>(&mut rng, deviation);
                if index % nth == 0 {
                    seen.pixel.y += 40.0;
                }
            }
        }
        journal.send(ROBOT, &item).unwrap();
        let mut problem = local_problem(&journal.map, &window_around(&journal.map, &[id(k)]));
        if !problem.is_solvable() {
            continue;
        }
        problem.problem.observation_loss = Loss::Huber(2.0);
        let options = bundle_adjustment::Options::default();
        bundle_adjustment::solve(&mut problem.problem, &options, &mut ignore_iterations).unwrap();
        problem.learn_view_noise();
        let solved = Solved::Bundle(&problem);
        let solve = applied(
            &journal.map,
            solved,
            SolveKind::LocalBundle,
            Vec::new(),
            (1.0, 0.5),
            Reach::All,
        );
        journal.push(Change::SolveApplied { solve });
    }
    journal
}

fn noise(journal: &Journal) -> ViewNoise {
    journal.map.client(ROBOT).unwrap().noise.views
}

/// The deviation of a pixel in the newest window, and the width of its loss.
fn believed(journal: &Journal) -> (f64, Loss) {
    let problem = local_problem(&journal.map, &window_around(&journal.map, &[id(29)]));
    let seen = problem.problem.observations().next().unwrap().seen;
    (seen.sigma_px, problem.problem.observation_loss)
}

#[test]
fn views_that_are_worse_than_stated_count_as_what_they_are() {
    let journal = seen_with(3.0);
    let found = noise(&journal).pixel_factor;
    assert!((2.4..3.6).contains(&found), "{found}");
    let (sigma, loss) = believed(&journal);
    assert!((sigma - found).abs() < 1e-12, "{sigma}");
    assert_eq!(loss, Loss::GemanMcClure(4.0), "two widths of real deviations");
}

#[test]
fn views_that_are_better_than_stated_count_as_stated() {
    let journal = seen_with(0.1);
    let found = noise(&journal).pixel_factor;
    assert!((0.1..0.2).contains(&found), "{found}");
    assert_eq!(believed(&journal), (1.0, Loss::GemanMcClure(2.0)));
}

#[test]
fn views_that_are_as_stated_widen_a_loss_that_lets_go() {
    let journal = seen_with(1.0);
    let found = noise(&journal).pixel_factor;
    assert!((0.8..1.2).contains(&found), "{found}");
    let (sigma, loss) = believed(&journal);
    assert!((sigma - found.max(1.0)).abs() < 1e-12, "{sigma}");
    let Loss::GemanMcClure(width) = loss else { panic!("{loss:?}") };
    assert!((width * sigma - 4.0 * found).abs() < 1e-12, "{width}");
}

#[test]
fn views_that_a_window_lets_go_of_are_counted() {
    let share = |nth| noise(&seen_with_wrong(0.5, nth)).outlier_share;
    assert_eq!(share(usize::MAX), 0.0);
    let found = share(10);
    assert!((0.07..0.11).contains(&found), "a tenth is wrong: {found}");
}
