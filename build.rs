//! Compiles `proto/` without protoc: protox parses, tonic-prost-build generates into `OUT_DIR`.
//!
//! The descriptor sets are kept beside the generated code: server reflection and the snapshot test of
//! the wire read the one, and what a message takes in memory is told by both. What the store keeps on
//! disk is a package of its own, of which neither reflection nor the edge knows.

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=proto");
    let wire = compiler("proto/covis/v1")?;
    let out = std::env::var("OUT_DIR")?;
    // `compile_fds` writes no descriptors, so they are written here.
    fs::write(Path::new(&out).join("covis.v1.bin"), wire.encode_file_descriptor_set())?;
    let storage = compiler("proto/covis/storage/v1")?;
    fs::write(Path::new(&out).join("covis.storage.v1.bin"), storage.encode_file_descriptor_set())?;
    for package in [wire, storage] {
        // Names lead from a message to its descriptor, by which its memory is judged.
        let mut names = tonic_prost_build::Config::new();
        names.enable_type_names();
        tonic_prost_build::configure()
            .codec_path("crate::wire::Codec")
            .compile_fds_with_config(package.file_descriptor_set(), names)?;
    }
    Ok(())
}

/// A compiler that has opened all files of a folder.
fn compiler(folder: &str) -> Result<protox::Compiler, Box<dyn Error>> {
    let mut files: Vec<PathBuf> =
        fs::read_dir(folder)?.map(|e| e.map(|e| e.path())).collect::<Result<_, _>>()?;
    files.retain(|path| path.extension().is_some_and(|e| e == "proto"));
    files.sort();
    let mut compiler = protox::Compiler::new(["proto"])?;
    compiler.include_imports(true).include_source_info(true).open_files(&files)?;
    Ok(compiler)
}
