//! The parsers of files: formats of others that the solver crate reads, and covis' own settings.
//!
//! What is read is written and read again: the same numbers. What can become a problem does, and
//! the problem is judged; solving it is not for here.

use std::path::Path;

use covis_solvers::geometry::LieGroup;
use covis_solvers::io::bal::BalFile;
use covis_solvers::io::colmap::{ColmapEncoding, ColmapModel};
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::io::pose_matrix;
use covis_solvers::io::trajectory::Trajectory;

use crate::cli::config::Config;

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

/// A g2o file, as it stands and repaired.
pub(super) fn g2o(input: &[u8]) {
    let read = G2oGraph::parse(input, path());
    let repaired = G2oGraph::parse_repaired(input, path());
    if let Ok(file) = &read {
        assert!(matches!(&repaired, Ok((same, None)) if same == file), "repaired for no reason");
    }
    for file in [read.ok(), repaired.ok().map(|(file, _)| file)].into_iter().flatten() {
        let again = G2oGraph::parse(&file.to_bytes(), path());
        assert_eq!(again.ok().as_ref(), Some(&file), "what is written is read as another file");
        let judged = match &file {
            G2oGraph::Se2(file) => file.to_pose_graph().map(|graph| drop(graph.validate())),
            G2oGraph::Se3(file) => file.to_pose_graph().map(|graph| drop(graph.validate())),
        };
        assert!(judged.is_ok(), "a file that was read makes no graph: {judged:?}");
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

/// A TUM trajectory.
pub(super) fn trajectory(input: &[u8]) {
    let Ok(read) = Trajectory::parse(input, path()) else { return };
    match Trajectory::parse(&read.to_bytes(), path()) {
        Ok(again) => {
            assert_eq!(again.timestamps, read.timestamps);
            let same = again.world_from_body.iter().zip(&read.world_from_body).all(|(a, b)| {
                // Normalizing once more may move the last bit.
                a.translation == b.translation
                    && a.rotation.quaternion().angle_to(b.rotation.quaternion()) < 1e-15
            });
            assert!(same && again.len() == read.len(), "another trajectory is read back");
        }
        Err(error) => panic!("what was written is not read: {error}"),
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

/// A `covis.toml`.
pub(super) fn config(input: &[u8]) {
    let text = String::from_utf8_lossy(input);
    if let Err(error) = Config::parse(&text, path()) {
        drop(error.to_string());
    }
}
