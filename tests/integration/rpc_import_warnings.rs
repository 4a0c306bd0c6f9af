//! What an import of g2o says: records that the map holds otherwise than the file, or not at all.

use covis::wire::v1;

use crate::common::{TestServer, run};
use crate::rpc_import::{answer, build, export, header, upload};

/// Priors become priors and landmarks keep their positions; what a map has no place for is reported.
#[test]
fn an_import_of_g2o_says_what_the_map_does_not_hold() {
    run(async {
        let server = TestServer::start().await;
        let unit = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1";
        let text = format!(
            "PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 4 0 0 0 0 0 0 2\n\
             VERTEX_SE3:QUAT 5 1 0 0 0 0 0 1\nVERTEX_TRACKXYZ 9 1 2 3\nFIX 4 5 9\n\
             EDGE_SE3:QUAT 4 5 1 0 0 0 0 0 1 {unit}\nEDGE_SE3:QUAT 5 5 0 0 0 0 0 0 1 {unit}\n\
             EDGE_SE3_TRACKXYZ 5 9 0 0 2 3 1 0 0 1 0 1\nEDGE_SE3_PRIOR 4 0 0 0 0 0 0 0 1 {unit}\n\
             EDGE_SE3_XYZ_PRIOR 5 0 1 0 0 1 0 0 1 0 1\nEDGE_POINTXYZ_PRIOR 9 1 2 3 1 0 0 1 0 1\n"
        );
        let file = ("graph.g2o".to_owned(), text.into_bytes());
        let messages = upload(header("room", v1::MapFormat::G2o), &[file]);
        let answer = answer(&server, messages).await.unwrap();
        let counts = answer.map.unwrap().counts.unwrap();
        let counts = (counts.keyframe_count, counts.landmark_count, counts.constraint_count);
        assert_eq!(counts, (2, 1, 3));
        use v1::ImportChange as Change;
        let warnings = answer.warnings.iter().map(|w| (w.change(), w.count, w.first_line));
        assert_eq!(
            warnings.collect::<Vec<_>>(),
            [
                (Change::QuaternionsNormalized, 1, 2),
                (Change::SelfEdgesLeftOut, 1, 7),
                (Change::FixedVerticesFreed, 3, 0),
                (Change::LandmarkMeasurementsLeftOut, 1, 0),
                (Change::LandmarkPriorsLeftOut, 1, 0),
            ]
        );
        for warning in &answer.warnings {
            assert!(warning.description.starts_with("graph.g2o: "), "{}", warning.description);
            assert_eq!(warning.path, "graph.g2o");
        }
    });
}

/// Lines that are not read are an error, or are left out where the client asks for it.
#[test]
fn an_import_of_g2o_leaves_out_unknown_lines_if_it_is_asked_to() {
    run(async {
        let server = TestServer::start().await;
        let text = "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nROBOTLASER1 0 1\n\
                    VERTEX_SE3:QUAT 1 1 0 0 0 0 0 1\nTAG 5\nROBOTLASER1 1 1\n\
                    EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1\n";
        let file = ("graph.g2o".to_owned(), text.into());
        let strict = header("room", v1::MapFormat::G2o);
        let refused = answer(&server, upload(strict.clone(), std::slice::from_ref(&file))).await;
        let refused = refused.unwrap_err();
        assert!(refused.message().contains("line 2"), "{refused}");
        let header = v1::ImportMapHeader { skip_unknown: true, ..strict };
        let answer = answer(&server, upload(header, &[file])).await.unwrap();
        assert_eq!(answer.map.unwrap().counts.unwrap().keyframe_count, 2);
        let warnings = answer.warnings.iter();
        let warnings: Vec<_> = warnings.map(|w| (w.change(), w.count, w.first_line)).collect();
        let change = v1::ImportChange::UnknownLinesLeftOut;
        assert_eq!(warnings, [(change, 2, 2), (change, 1, 4)]);
        let text = "graph.g2o: lines with the tag ROBOTLASER1 are left out: 2, the first in line 2";
        assert_eq!(answer.warnings[0].description, text);
    });
}

/// A file that a map holds as it is has no warnings.
#[test]
fn an_import_that_changes_nothing_says_nothing() {
    run(async {
        let server = TestServer::start().await;
        build(&server).await;
        let files = export(&server, "room", v1::MapFormat::G2o).await;
        let messages = upload(header("copy", v1::MapFormat::G2o), &files);
        let answer = answer(&server, messages).await.unwrap();
        assert_eq!(answer.warnings, []);
        assert!(answer.map.unwrap().counts.unwrap().keyframe_count > 0);
    });
}
