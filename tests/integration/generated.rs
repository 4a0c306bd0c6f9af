//! The code that is generated from `proto/` is in the repository, so that a build needs no compiler
//! of protos. Here it is generated again, by protox and tonic-prost-build.
//!
//! `COVIS_TEST_REGENERATE=1 cargo test --test integration generated` writes what has changed.
//! The test itself is built with the code that is there: where that does not compile, bring back what
//! git has first.

use std::path::{Path, PathBuf};

/// Each folder of protos, and where its code and its descriptors stand.
const PACKAGES: [(&str, &str, &str); 4] = [
    ("proto/covis/v1", "covis.v1", "client/src/wire/generated"),
    ("proto/covis/recording/v1", "covis.recording.v1", "src/cli/record/generated"),
    ("proto/foxglove", "foxglove", "src/cli/record/generated"),
    ("proto/covis/storage/v1", "covis.storage.v1", "store/src/encoding/generated"),
];

/// A compiler that has opened all files of a folder.
pub(crate) fn compiler(root: &Path, folder: &str) -> protox::Compiler {
    let files = fs_err::read_dir(root.join(folder)).unwrap();
    let mut files: Vec<PathBuf> = files.map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|e| e == "proto"));
    files.sort();
    let mut compiler = protox::Compiler::new([root.join("proto")]).unwrap();
    compiler.include_imports(true).include_source_info(true).open_files(&files).unwrap();
    compiler
}

#[test]
fn generated_code_is_that_of_the_protos() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let writes = std::env::var_os("COVIS_TEST_REGENERATE").is_some();
    let mut stale = Vec::new();
    for (folder, package, at) in PACKAGES {
        let package_compiler = compiler(root, folder);
        let out = tempfile::tempdir().unwrap();
        // Names lead from a message to its descriptor, by which its memory is judged.
        let mut names = tonic_prost_build::Config::new();
        names.enable_type_names();
        if package != "covis.v1" {
            // Of private modules: whoever reads these messages has the protos.
            names.disable_comments(["."]);
        }
        tonic_prost_build::configure()
            .out_dir(out.path())
            .codec_path("crate::wire::Codec")
            .emit_rerun_if_changed(false)
            .compile_fds_with_config(package_compiler.file_descriptor_set(), names)
            .unwrap();
        let code = fs_err::read(out.path().join(format!("{package}.rs"))).unwrap();
        // Reflection and the snapshot test of the wire read the descriptors, and what a message takes
        // in memory is told by them.
        let descriptors = package_compiler.encode_file_descriptor_set();
        for (bytes, end) in [(code, "rs"), (descriptors, "bin")] {
            let file = root.join(at).join(format!("{package}.{end}"));
            if fs_err::read(&file).is_ok_and(|present| present == bytes) {
                continue;
            }
            if writes {
                fs_err::write(&file, bytes).unwrap();
            } else {
                stale.push(file);
            }
        }
    }
    assert!(stale.is_empty(), "not of the protos as they are: {stale:?}; see this file's head");
}
