//! The parsers of files: formats of others that the solver crate reads, and covis' own settings.
//!
//! What is read is written and read again: the same numbers. What can become a problem does, and
//! the problem is judged; solving it is not for here.

use std::path::Path;

use covis_solvers::geometry::LieGroup;
use covis_solvers::io::bal::BalFile;
use covis_solvers::io::bundler::BundlerFile;
use covis_solvers::io::colmap::{ColmapEncoding, ColmapModel};
use covis_solvers::io::format::Format;
use covis_solvers::io::g2o::{G2oChanges, G2oGraph, G2oReading, Indefinite};
use covis_solvers::io::openmvg::OpenMvgFile;
use covis_solvers::io::pose_matrix;
use covis_solvers::io::pyfg::PyfgGraph;
use covis_solvers::io::sparse_model::SparseModel;
use covis_solvers::io::trajectory::{Trajectory, TrajectoryFormat};

use crate::cli::config::Config;
use crate::cli::policy::PolicyFile;

fn path() -> &'static Path {
    Path::new("fuzzed")
}

/// A BAL file.
pub(super) fn bal(input: &[u8]) {
    let Ok(mut file) = BalFile::parse(input, path()) else { return };
    let again = BalFile::parse(&file.to_bytes(), path());
    assert_eq!(again.ok().as_ref(), Some(&file), "what is written is read as another file");
    let problem = file.to_problem();
    let _refused = problem.validate();
    assert!(file.update_from(&problem).is_ok(), "a file does not take its own problem back");
}

/// A g2o file as it is, repaired, and without the lines that are not read.
pub(super) fn g2o(input: &[u8]) {
    let read = G2oGraph::parse(input, path());
    let repairing = G2oReading { indefinite: Indefinite::Repair, skip_unknown: false };
    let repaired = G2oGraph::parse_with(input, path(), repairing);
    let skipping = G2oReading { skip_unknown: true, ..repairing };
    let skipped = G2oGraph::parse_with(input, path(), skipping);
    if let Ok(file) = &read {
        let is_same =
            |(same, changes): &(_, G2oChanges)| same == file && changes.repaired.is_none();
        assert!(repaired.as_ref().is_ok_and(is_same), "repaired for no reason");
    }
    let changed = [repaired, skipped].map(|read| read.ok().map(|(file, _)| file));
    for file in changed.into_iter().chain([read.ok()]).flatten() {
        let again = G2oGraph::parse_with(&file.to_bytes(), path(), G2oReading::default());
        let unchanged = Some((&file, &G2oChanges::default()));
        let again = again.as_ref().ok().map(|(file, changes)| (file, changes));
        assert_eq!(again, unchanged, "what is written is read as another file");
        let judged = match &file {
            G2oGraph::Se2(file) => file.to_pose_graph().map(|graph| drop(graph.validate())),
            G2oGraph::Se3(file) => file.to_pose_graph().map(|graph| drop(graph.validate())),
        };
        assert!(judged.is_ok(), "a file that was read makes no graph: {judged:?}");
    }
}

/// A pyfg file as it is, and without the lines that are not read.
pub(super) fn pyfg(input: &[u8]) {
    let read = PyfgGraph::parse(input, path(), false);
    let skipped = PyfgGraph::parse(input, path(), true);
    if let Ok((file, _)) = &read {
        assert!(skipped.as_ref().is_ok_and(|(same, tags)| same == file && tags.is_empty()));
    }
    for (file, _) in [read, skipped].into_iter().flatten() {
        let again = PyfgGraph::parse(&file.to_bytes(), path(), false);
        let again = again.as_ref().ok().map(|(file, _)| file);
        assert_eq!(again, Some(&file), "what is written is read as another file");
        let judged = match &file {
            PyfgGraph::Se2(file) => file.to_pose_graph().map(|graph| drop(graph.validate())),
            PyfgGraph::Se3(file) => file.to_pose_graph().map(|graph| drop(graph.validate())),
        };
        assert!(judged.is_ok(), "a file that was read makes no graph: {judged:?}");
        if let Ok(g2o) = file.to_g2o() {
            let read = G2oGraph::parse(&g2o.to_bytes(), path());
            assert!(read.is_ok_and(|read| read == g2o), "the g2o file is read as another");
        }
    }
}

/// The three files of a COLMAP model as text.
pub(super) fn colmap_text(input: &[u8]) {
    colmap(input, ColmapEncoding::Text);
}

/// The three files of a COLMAP model as binary.
pub(super) fn colmap_binary(input: &[u8]) {
    colmap(input, ColmapEncoding::Binary);
}

/// Cameras, images and points, cut where the input's first four bytes say.
fn colmap(input: &[u8], encoding: ColmapEncoding) {
    let Some((&[a, b, c, d], rest)) = input.split_first_chunk::<4>() else { return };
    let cut = |share: u16| usize::from(share).min(rest.len());
    let one = cut(u16::from_le_bytes([a, b]));
    let two = cut(u16::from_le_bytes([c, d])).max(one);
    let files = [&rest[..one], &rest[one..two], &rest[two..]];
    let Ok(model) = ColmapModel::parse(encoding, files, path()) else { return };
    if let Ok(written) = model.to_files(encoding) {
        let parts: Vec<&[u8]> = written.iter().map(|(_, bytes)| &bytes[..]).collect();
        let [cameras, images, points] = parts[..] else { panic!("a model is three files") };
        let again = ColmapModel::parse(encoding, [cameras, images, points], path());
        assert_eq!(again.ok().as_ref(), Some(&model), "what is written is read as another model");
    }
    if let Ok(solved) = model.to_problem() {
        let _refused = solved.problem.validate();
    }
}

/// A trajectory in each of its forms, whichever the bytes are.
pub(super) fn trajectory(input: &[u8]) {
    let _told = Format::of_file(path(), input);
    for format in [TrajectoryFormat::Tum, TrajectoryFormat::Kitti, TrajectoryFormat::Euroc] {
        let Ok(read) = Trajectory::parse_as(input, path(), format) else { continue };
        // A time that is no 64-bit number of nanoseconds is refused.
        let Ok(written) = read.to_bytes_as(format) else { continue };
        // Normalizing once more may move the last bit, of a matrix half of the digits.
        let (reach_s, angle) = match format {
            TrajectoryFormat::Tum => (0.0, 1e-15),
            TrajectoryFormat::Kitti => (0.0, 1e-7),
            TrajectoryFormat::Euroc => (1e-9, 1e-15),
        };
        match Trajectory::parse_as(&written, path(), format) {
            Ok(again) => {
                assert_eq!(again.len(), read.len(), "another trajectory is read back");
                let times = again.timestamps.iter().zip(&read.timestamps);
                let poses = again.world_from_body.iter().zip(&read.world_from_body);
                for ((a, b), (pose, given)) in times.zip(poses) {
                    assert!((a - b).abs() <= reach_s + 4.0 * f64::EPSILON * b.abs(), "{a} {b}");
                    assert_eq!(pose.translation, given.translation);
                    let turn = pose.rotation.quaternion().angle_to(given.rotation.quaternion());
                    assert!(turn < angle, "another trajectory is read back: {turn}");
                }
            }
            Err(error) => panic!("what was written is not read: {error}"),
        }
    }
}

/// A Bundler file.
pub(super) fn bundler(input: &[u8]) {
    let Ok(file) = BundlerFile::parse(input, path()) else { return };
    let again = BundlerFile::parse(&file.to_bytes(), path());
    assert_eq!(again.ok().as_ref(), Some(&file), "what is written is read as another file");
    match SparseModel::from_bundler(&file) {
        Ok(model) => drop(model.problem.validate()),
        Err(error) => panic!("a file that was read makes no model: {error}"),
    }
}

/// OpenMVG's `sfm_data.json`: what becomes a model becomes one of COLMAP's too, with as many observations.
pub(super) fn openmvg(input: &[u8]) {
    let Ok(file) = OpenMvgFile::parse(input, path()) else { return };
    let Ok((model, left_out)) = SparseModel::from_openmvg(&file, path()) else { return };
    let _refused = model.problem.validate();
    let given: usize = file.points.values().map(|point| point.observations.len()).sum();
    assert_eq!(model.problem.observation_count() + left_out.observations, given);
    match model.to_colmap() {
        Ok(colmap) => assert_eq!(colmap.points.len(), file.points.len(), "points are lost"),
        Err(error) => panic!("a model has no form in COLMAP: {error}"),
    }
}

/// A pose as a 4x4 matrix: what is read is a rigid motion, and as a matrix it is read as the same.
pub(super) fn pose_matrix(input: &[u8]) {
    let Ok(Some(pose)) = pose_matrix::parse(input, path()) else { return };
    assert!(pose.is_finite(), "{pose:?}");
    let (rotation, t) = (pose.rotation.matrix(), pose.translation);
    let row = |i: usize| {
        let [a, b, c] = [0, 1, 2].map(|j| rotation[(i, j)]);
        format!("{a:?} {b:?} {c:?} {:?}\n", t[i])
    };
    let text = [row(0), row(1), row(2), "0 0 0 1\n".to_owned()].concat();
    match pose_matrix::parse(text.as_bytes(), path()) {
        Ok(Some(again)) => {
            let angle = again.rotation.quaternion().angle_to(pose.rotation.quaternion());
            assert!(again.translation == t && angle < 1e-7, "another pose is read back");
        }
        other => panic!("what was written is not read: {other:?}"),
    }
}

/// A `covis.toml`, and the policy of a map.
pub(super) fn config(input: &[u8]) {
    let text = String::from_utf8_lossy(input);
    if let Err(error) = Config::parse(&text, path()) {
        drop(error.to_string());
    }
    match PolicyFile::parse(&text, path()) {
        Err(error) => drop(error.to_string()),
        Ok(file) => {
            // Numbers that are none do not compare equal, and TOML has them.
            let written = file.policy.to_toml();
            let again = written.ok().and_then(|text| PolicyFile::parse(&text, path()).ok());
            let texts = again.map(|again| format!("{:?}", again.policy));
            assert_eq!(texts, Some(format!("{:?}", file.policy)), "another policy");
        }
    }
}
