//! Loop closures of a real sequence, with false ones among them: the verdict is a function of the map,
//! whatever the order, the grouping and the number of calls. Needs `closures/fr1_rpy`.

use std::path::Path;

use covis::wire::v1;
use covis_solvers::geometry::Se3;

use crate::cli_support::data;
use crate::common::{TestServer, run};
use crate::sequence::{
    Closure, Order, Sequence, adjusted, ate, build, judged, optimize, pose, state,
    stated_information,
};

fn rows(folder: &Path, name: &str) -> Vec<Vec<f64>> {
    let text = fs_err::read_to_string(folder.join(name)).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines.map(|l| l.split_whitespace().map(|x| x.parse().unwrap()).collect()).collect()
}

/// The recorded desk, with the closures that a frontend found.
pub(crate) fn read() -> Option<Sequence> {
    let folder = data("closures/fr1_rpy")?;
    let odometry: Vec<(f64, Se3)> =
        rows(&folder, "keyframes.txt").iter().map(|r| (r[1], pose(&r[2..]))).collect();
    let mut observations = vec![Vec::new(); odometry.len()];
    let mut descriptors = vec![Vec::new(); odometry.len()];
    let bytes = fs_err::read(folder.join("descriptors.bin")).unwrap();
    for (row, descriptor) in rows(&folder, "observations.txt").iter().zip(bytes.chunks(32)) {
        observations[row[0] as usize].push([row[1], row[2], row[3], row[4], row[5], row[6]]);
        descriptors[row[0] as usize].push(descriptor.to_vec());
    }
    let closures: Vec<Closure> = rows(&folder, "closures.txt")
        .iter()
        .map(|row| Closure {
            i: row[1] as usize,
            j: row[2] as usize,
            measured: pose(&row[3..]),
            information: stated_information(),
            is_true: true,
        })
        .collect();
    let mut matches = vec![Vec::new(); closures.len()];
    for row in rows(&folder, "closure_matches.txt") {
        let seen = [row[1], row[2], row[3], row[4], row[5], row[6], row[7]];
        matches[row[0] as usize].push(seen);
    }
    let truth = rows(&folder, "truth.txt").iter().map(|row| pose(&row[1..])).collect();
    Some(Sequence {
        camera: camera(),
        odometry,
        truth,
        observations,
        descriptors,
        closures,
        matches,
    })
}

fn camera() -> v1::Camera {
    let model = v1::camera::Model::PinholeRadialTangential(v1::PinholeRadialTangential {
        fx: 517.3,
        fy: 516.5,
        cx: 318.6,
        cy: 255.3,
        k1: 0.2624,
        k2: -0.9531,
        p1: -0.0054,
        p2: 0.0026,
        k3: 1.1633,
    });
    v1::Camera { width_px: 640, height_px: 480, model: Some(model), ..Default::default() }
}

#[test]
fn the_same_closures_are_off_in_any_order_and_after_any_number_of_calls() {
    let Some(sequence) = read() else { return };
    run(async {
        let server = TestServer::lock_step().await;
        for (share, agree) in [(0.0, false), (0.1, false), (0.2, true)] {
            let closures = sequence.with_false(share, agree, 7);
            let name = format!("stated-{}-{agree}", (share * 10.0) as i64);
            let judged = judged(&server, &name, &sequence, &closures).await;
            assert!(20 * judged.off.len() <= judged.holding, "{name}: {:?} are off", judged.off);
            assert!(judged.ate < 0.0515, "{name}: {} m", judged.ate);
        }
    });
}

#[test]
fn true_closures_that_claim_a_tenth_of_their_error_count() {
    let Some(mut sequence) = read() else { return };
    run(async {
        let server = TestServer::lock_step().await;
        sequence.closures = sequence.with_refined_information(&server).await;
        for (share, agree) in [(0.0, false), (0.2, true)] {
            let closures = sequence.with_false(share, agree, 7);
            let name = format!("refined-{}-{agree}", (share * 10.0) as i64);
            let judged = judged(&server, &name, &sequence, &closures).await;
            let off = judged.off.len() + judged.off_beyond.len();
            assert!(5 * off <= sequence.closures.len(), "{name}: {off} are off");
            assert!(judged.ate < 0.0515, "{name}: {} m", judged.ate);
        }
    });
}

#[test]
fn after_closures_the_whole_map_is_adjusted_and_a_request_goes_on_from_there() {
    let Some(sequence) = read() else { return };
    run(async {
        let server = TestServer::start().await;
        let policy = v1::MapPolicy::default();
        build(&server, "rpy", (&sequence, &sequence.closures), Order::Burst, policy).await;
        adjusted(&server, "rpy").await;
        let before = ate(&sequence.poses(), &sequence.truth);
        let after = ate(&state(&server, "rpy").await.poses, &sequence.truth);
        let result = optimize(&server, "rpy", v1::MapProblem::Full).await;
        let requested = ate(&state(&server, "rpy").await.poses, &sequence.truth);
        println!(
            "ATE {before:.4} m by odometry, {after:.4} m after the closures, {requested:.4} m \
             after OptimizeMap, which ended with {:?}",
            result.summary.map(|summary| (summary.termination(), summary.iteration_count))
        );
        assert!(2.0 * after <= before && 2.0 * requested <= before);
    });
}
