//! Compiles `proto/` without protoc: protox parses, tonic-prost-build generates into `OUT_DIR`.
//!
//! The descriptor set of the wire is kept beside the generated code: server reflection and the
//! snapshot test of the wire read it. What the store keeps on disk is a package of its own, of which
//! neither reflection nor the edge knows.

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=proto");
    let wire = compiler("proto/covis/v1")?;
    let out = std::env::var("OUT_DIR")?;
    // `compile_fds` writes no descriptors, so they are written here.
    fs::write(Path::new(&out).join("covis.v1.bin"), wire.encode_file_descriptor_set())?;
    tonic_prost_build::configure().compile_fds(wire.file_descriptor_set())?;
    let storage = compiler("proto/covis/storage/v1")?;
    tonic_prost_build::configure().compile_fds(storage.file_descriptor_set())?;
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
