//! `covis fuse`, `run --mesh`, `mesh` and `grid` on short drawn sequences: the files they leave, poses
//! that are missing, volumes that are damaged.

use std::path::Path;

use fs_err as fs;
use serde_json::Value;

use crate::cli_support::{Workspace, number};

/// Runs a command that must succeed; its JSON object.
fn json(workspace: &Workspace, arguments: &str) -> Value {
    let ran = workspace.run(&format!("--log warn {arguments} --json"), &[]);
    assert_eq!(ran.code, Some(0), "{arguments}: {}", ran.stderr);
    serde_json::from_str(&ran.stdout).unwrap()
}

/// Runs a command that must fail; what it says.
fn failure(workspace: &Workspace, arguments: &str) -> String {
    let ran = workspace.run(&format!("--log error {arguments}"), &[]);
    assert_eq!(ran.code, Some(1), "{arguments}: {}", ran.stdout);
    ran.stderr
}

/// The number in a PLY header's line `element NAME n`.
fn elements(ply: &Path, name: &str) -> f64 {
    let bytes = fs::read(ply).unwrap();
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(1000)]).into_owned();
    let line = text.lines().find_map(|line| line.strip_prefix(&format!("element {name} ")));
    line.unwrap().parse().unwrap()
}

#[test]
fn a_surface_is_fused_at_given_poses_and_written_again_from_the_volume() {
    let workspace = Workspace::new();
    workspace.room(6);
    let fuse = "fuse tum:seq --poses seq/groundtruth.txt --voxel 0.05 --out fused";
    let document = json(&workspace, fuse);
    assert_eq!((&document["frames"], &document["skipped"]), (&6.into(), &0.into()));
    for stage in ["integrate", "extract"] {
        let stage = &document["stages"][stage];
        let (p50, p99) = (number(stage, "p50_ms"), number(stage, "p99_ms"));
        assert!(p50 > 0.0 && p50 <= p99, "{document}");
    }
    let (mesh, ply) = (&document["mesh"], workspace.path("fused/mesh.ply"));
    assert!(number(mesh, "triangles") > 1000.0, "{document}");
    assert_eq!(number(mesh, "vertices"), elements(&ply, "vertex"));
    assert_eq!(number(mesh, "triangles"), elements(&ply, "face"));
    assert_eq!(number(mesh, "bytes"), fs::read(&ply).unwrap().len() as f64);

    for out in ["again.ply", "again.glb", "ground.pgm", "ground.pfm"] {
        let command =
            if out.starts_with("again") { "mesh" } else { "grid --up 0,0,1 --heights 0.1,1.8" };
        let ran = workspace.run(&format!("{command} fused/volume.covis {out}"), &[]);
        assert_eq!(ran.code, Some(0), "{out}: {}", ran.stderr);
    }
    assert!(fs::read(&ply).unwrap() == fs::read(workspace.path("again.ply")).unwrap());
    assert!(fs::read(workspace.path("again.glb")).unwrap().starts_with(b"glTF\x02\0\0\0"));
    let yaml = fs::read_to_string(workspace.path("ground.yaml")).unwrap();
    assert!(yaml.starts_with("image: \"ground.pgm\"\nresolution: 0.05"), "{yaml}");
    let pgm = fs::read(workspace.path("ground.pgm")).unwrap();
    assert!(pgm.starts_with(b"P5\n") && pgm.contains(&0) && pgm.contains(&254));

    // The poses tell the surface, and one thread or two do not.
    json(&workspace, &format!("{fuse}2 --threads 1"));
    assert!(fs::read(&ply).unwrap() == fs::read(workspace.path("fused2/mesh.ply")).unwrap());

    // A surface that follows is beside the point of what is written.
    let followed = json(&workspace, &format!("{fuse}4 --remesh 40"));
    assert!(fs::read(&ply).unwrap() == fs::read(workspace.path("fused4/mesh.ply")).unwrap());
    assert!(number(&followed["remesh"], "pieces") > 40.0, "{followed}");
    assert!(number(&followed["remesh"], "most_behind") > 0.0, "{followed}");
    assert!(number(&followed["stages"]["remesh"], "p99_ms") > 0.0, "{followed}");

    // Nor does the memory, but for the order of vertices.
    let paged = json(&workspace, &format!("{fuse}3 --memory-mb 1"));
    let counts =
        |document: &Value| ["vertices", "triangles"].map(|key| document["mesh"][key].clone());
    assert_eq!(counts(&paged), counts(&document));
    assert!(paged["paging"]["paged_out"].is_u64(), "{paged}");
    assert!(document.get("paging").is_none(), "{document}");
    let ran = workspace.run("mesh fused/volume.covis paged.ply --memory-mb 1", &[]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    for (name, key) in [("vertex", "vertices"), ("face", "triangles")] {
        assert_eq!(elements(&workspace.path("paged.ply"), name), number(mesh, key));
    }
    let ran = workspace
        .run("grid fused/volume.covis paged.pgm --up 0,0,1 --heights 0.1,1.8 --memory-mb 1", &[]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    assert!(fs::read(workspace.path("paged.pgm")).unwrap() == pgm);
}

#[test]
fn frames_without_a_pose_are_skipped_and_bad_wishes_are_named() {
    let workspace = Workspace::new();
    let folder = workspace.room(6);
    let truth = fs::read_to_string(folder.join("groundtruth.txt")).unwrap();
    let poses: Vec<&str> = truth.lines().filter(|line| !line.starts_with('#')).collect();
    // Frames are 33 ms apart: with the first and the last pose left, four have none in reach.
    fs::write(workspace.path("ends.txt"), format!("{}\n{}\n", poses[0], poses[poses.len() - 1]))
        .unwrap();
    let document = json(&workspace, "fuse tum:seq --poses ends.txt --voxel 0.05 --out a");
    assert_eq!((&document["frames"], &document["skipped"]), (&2.into(), &4.into()));

    fs::write(workspace.path("never.txt"), "1e6 0 0 0 0 0 0 1\n").unwrap();
    fs::write(workspace.path("bad.txt"), "1 0 0 0 0 0 1\n").unwrap();
    for (arguments, reason) in [
        ("fuse tum:seq --poses never.txt --out b", "never.txt: no frame has a pose within 0.02 s"),
        ("fuse tum:seq --poses bad.txt --out b", "bad.txt"),
        ("fuse tum:seq --poses ends.txt --voxel 0 --out b", "--voxel must be 0.001 to 1 m"),
        ("fuse tum:seq --poses ends.txt --truncation-voxels 1 --out b", "--truncation-voxels"),
        ("fuse tum:seq --poses ends.txt --max-depth nan --out b", "--max-depth"),
        ("mesh a/volume.covis a.obj", "must end in .ply or .glb"),
        ("grid a/volume.covis a.png", "must end in .pgm or .pfm"),
        ("grid a/volume.covis a.pgm --up 0,0,0", "not a direction"),
        ("mesh nothing.covis a.ply", "nothing.covis"),
    ] {
        let said = failure(&workspace, arguments);
        assert!(said.contains(reason) && said.lines().count() == 1, "{arguments}: {said}");
    }
}

#[test]
fn a_volume_that_was_cut_short_or_changed_is_refused_with_a_reason() {
    let workspace = Workspace::new();
    workspace.room(1);
    json(&workspace, "fuse tum:seq --poses seq/groundtruth.txt --voxel 0.1 --out a");
    let bytes = fs::read(workspace.path("a/volume.covis")).unwrap();
    let mut flipped = bytes.clone();
    flipped[bytes.len() / 2] ^= 4;
    for (content, reason) in [
        (&bytes[..bytes.len() - 1], "truncated"),
        (&flipped[..], "damaged"),
        (b"PLY", "not a volume"),
    ] {
        fs::write(workspace.path("damaged.covis"), content).unwrap();
        let said = failure(&workspace, "mesh damaged.covis out.ply");
        assert!(said.contains(reason), "{reason}: {said}");
        assert!(!workspace.path("out.ply").exists());
    }
}

#[test]
fn a_run_leaves_a_mesh_on_its_final_map() {
    let workspace = Workspace::new();
    workspace.room(8);
    let document = json(
        &workspace,
        "run tum:seq --out a --mesh --voxel 0.05 --mesh-every 2 --lock-step --threads 2",
    );
    assert!(number(&document["mesh"], "triangles") > 1000.0, "{document}");
    assert!(number(&document["stages"]["integrate"], "p99_ms") > 0.0, "{document}");
    for file in ["mesh.ply", "mesh.glb", "volume.covis", "trajectory.txt"] {
        assert!(fs::metadata(workspace.path("a").join(file)).unwrap().len() > 100, "{file}");
    }
    // Again, to the bit: the thread beside tracking changes nothing.
    json(
        &workspace,
        "run tum:seq --out b --mesh --voxel 0.05 --mesh-every 2 --lock-step --threads 1",
    );
    let volume = |run: &str| fs::read(workspace.path(run).join("volume.covis")).unwrap();
    assert!(volume("a") == volume("b"), "two runs differ");

    let said = workspace.run("run tum:seq --out c --mesh-every 2", &[]);
    assert_eq!(said.code, Some(2), "{}", said.stderr);
}
