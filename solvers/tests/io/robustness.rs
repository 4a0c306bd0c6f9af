//! No bytes make a reader panic: arbitrary ones, and valid files with bytes changed, cut, repeated.

use std::path::Path;

use covis_solvers::io::bal::BalFile;
use covis_solvers::io::bundler::BundlerFile;
use covis_solvers::io::colmap::{ColmapEncoding, ColmapModel};
use covis_solvers::io::format::Format;
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::io::openmvg::OpenMvgFile;
use covis_solvers::io::sparse_model::SparseModel;
use covis_solvers::io::trajectory::{Trajectory, TrajectoryFormat};
use proptest::prelude::*;

use super::{bal, bundler, colmap, g2o, g2o_landmarks, openmvg};

/// Reads `bytes` as every format; what is accepted must also convert without a panic.
fn read_as_everything(bytes: &[u8]) {
    let path = Path::new("bytes");
    if let Ok(file) = BalFile::parse(bytes, path) {
        let _ = file.to_problem();
    }
    match G2oGraph::parse(bytes, path) {
        Ok(G2oGraph::Se2(file)) => drop(file.to_pose_graph().unwrap()),
        Ok(G2oGraph::Se3(file)) => drop(file.to_pose_graph().unwrap()),
        Err(_) => {}
    }
    if let Ok(file) = BundlerFile::parse(bytes, path) {
        let _ = SparseModel::from_bundler(&file).unwrap();
    }
    if let Ok(file) = OpenMvgFile::parse(bytes, path)
        && let Ok((model, _)) = SparseModel::from_openmvg(&file, path)
    {
        let _ = model.to_colmap().unwrap();
    }
    for format in [TrajectoryFormat::Tum, TrajectoryFormat::Kitti, TrajectoryFormat::Euroc] {
        let _ = Trajectory::parse_as(bytes, path, format);
    }
    let _ = Format::of_file(path, bytes);
}

/// Replaces one of a valid model's files by `bytes`.
fn read_as_colmap(file: usize, bytes: &[u8], encoding: ColmapEncoding) {
    let valid = colmap::model().to_files(encoding).unwrap();
    let mut files = [&valid[0].1, &valid[1].1, &valid[2].1].map(Vec::as_slice);
    files[file] = bytes;
    if let Ok(model) = ColmapModel::parse(encoding, files, Path::new("bytes")) {
        let _ = model.to_problem();
        let _ = model.to_files(encoding);
    }
}

/// Changes a byte, cuts the tail, or repeats a piece.
fn mutate(bytes: &mut Vec<u8>, changes: &[(u8, usize, u8)]) {
    for &(kind, at, value) in changes {
        if bytes.is_empty() {
            return;
        }
        let at = at % bytes.len();
        match kind % 4 {
            0 | 1 => bytes[at] = value,
            2 => bytes.truncate(at),
            _ => {
                let end = (at + usize::from(value)).min(bytes.len());
                let piece = bytes[at..end].to_vec();
                bytes.splice(at..at, piece);
            }
        }
    }
}

fn changes() -> impl Strategy<Value = Vec<(u8, usize, u8)>> {
    // Bytes that matter in text are likelier than the others.
    let value = prop_oneof![any::<u8>(), prop::sample::select(b"0123456789-.einaf \n#".to_vec())];
    prop::collection::vec((any::<u8>(), any::<usize>(), value), 1..6)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, failure_persistence: None, ..Default::default() })]

    #[test]
    fn arbitrary_bytes(bytes in prop::collection::vec(any::<u8>(), 0..400), file in 0..3usize) {
        read_as_everything(&bytes);
        read_as_colmap(file, &bytes, ColmapEncoding::Text);
        read_as_colmap(file, &bytes, ColmapEncoding::Binary);
    }

    #[test]
    fn arbitrary_text(text in "[0-9eE+. \n\t#-]{0,200}", tag in 0..12usize) {
        let tags = [
            "", "VERTEX_SE2", "EDGE_SE2", "VERTEX_SE3:QUAT", "EDGE_SE3:QUAT", "VERTEX_XY",
            "EDGE_SE2_XY", "EDGE_SE3_TRACKXYZ", "PARAMS_SE3OFFSET", "EDGE_SE3_PRIOR", "EDGE2", "EDGE3",
        ];
        let text = format!("{} {text}", tags[tag]);
        read_as_everything(text.as_bytes());
        read_as_colmap(tag % 3, text.as_bytes(), ColmapEncoding::Text);
    }

    #[test]
    fn mutated_text_files(changes in changes(), which in 0..10usize) {
        let trajectory = b"1.5 1 2 3 0 0 0 1\n2.5 1 2 3 0 0.6 0 0.8\n".to_vec();
        let mut bytes = [
            bal::small().to_bytes(),
            g2o::se2().to_bytes(),
            g2o::se3().to_bytes(),
            trajectory,
            b"1 0 0 5 0 0 -1 6 0 1 0 7\n".to_vec(),
            b"#timestamp [ns], p_x\n1403636580838555648,1,2,3,0.8,0,0.6,0,9\n".to_vec(),
            bundler::small().to_bytes(),
            g2o_landmarks::PLANE.into(),
            g2o_landmarks::SOLID.into(),
            openmvg::ROOM.into(),
        ][which].clone();
        mutate(&mut bytes, &changes);
        read_as_everything(&bytes);
    }

    #[test]
    fn mutated_models(changes in changes(), file in 0..3usize, binary in any::<bool>()) {
        let encoding = if binary { ColmapEncoding::Binary } else { ColmapEncoding::Text };
        let mut bytes = colmap::model().to_files(encoding).unwrap()[file].1.clone();
        mutate(&mut bytes, &changes);
        read_as_colmap(file, &bytes, encoding);
    }

    #[test]
    fn any_finite_numbers_survive_bal(
        numbers in prop::array::uniform9(prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL),
    ) {
        let mut file = bal::small();
        file.cameras[0] = numbers;
        prop_assert_eq!(&BalFile::parse(&file.to_bytes(), Path::new("copy")).unwrap(), &file);
    }
}
