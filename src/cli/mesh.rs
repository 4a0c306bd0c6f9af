//! `covis mesh`: the surface of a stored volume as a file that other programs read.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, bail};
use fs_err as fs;

use super::output::print;
use super::surface::Memory;
use crate::frontend::dense::export;
use crate::frontend::dense::surface::{SurfaceOptions, extract_paged};

/// Arguments of `covis mesh`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// A volume, as `covis fuse` and `covis run --mesh` write it.
    volume: PathBuf,
    /// Where the mesh goes; .ply or .glb says how.
    #[arg(value_name = "OUT.ply|OUT.glb")]
    out: PathBuf,
    #[command(flatten)]
    memory: Memory,
}

/// Writes the mesh.
///
/// # Errors
/// A volume that cannot be read or is damaged, a file that cannot be written.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let extension = args.out.extension().and_then(|extension| extension.to_str());
    let is_glb = match extension {
        Some("glb") => true,
        Some("ply") => false,
        _ => bail!("{}: must end in .ply or .glb", args.out.display()),
    };
    let mut volume = args.memory.load(&args.volume, &args.out)?;
    let mesh = extract_paged(&mut volume, SurfaceOptions::default())?;
    drop(volume);
    let bytes = if is_glb {
        export::glb(&mesh).context("the mesh is too large for a GLB file (4 GiB)")?
    } else {
        export::ply(&mesh)
    };
    fs::write(&args.out, bytes)?;
    let (vertices, triangles) = (mesh.positions.len(), mesh.triangles.len());
    let out = args.out.display();
    print(format_args!("{out}: {vertices} vertices, {triangles} triangles"))?;
    Ok(ExitCode::SUCCESS)
}
