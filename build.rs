//! Compiles `proto/` without protoc: protox parses, tonic-prost-build generates into `OUT_DIR`.
//!
//! The descriptor set is kept beside the generated code: server reflection and the snapshot test of
//! the wire read it.

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=proto");
    let mut files: Vec<PathBuf> =
        fs::read_dir("proto/covis/v1")?.map(|e| e.map(|e| e.path())).collect::<Result<_, _>>()?;
    files.retain(|path| path.extension().is_some_and(|e| e == "proto"));
    files.sort();
    let mut compiler = protox::Compiler::new(["proto"])?;
    compiler.include_imports(true).include_source_info(true).open_files(&files)?;
    let out = std::env::var("OUT_DIR")?;
    // `compile_fds` writes no descriptors, so they are written here.
    fs::write(Path::new(&out).join("covis.v1.bin"), compiler.encode_file_descriptor_set())?;
    tonic_prost_build::configure().compile_fds(compiler.file_descriptor_set())?;
    Ok(())
}
