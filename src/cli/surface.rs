//! What subcommands of dense maps share: a volume's measures and its memory as flags, and what
//! `covis fuse` and `covis run --mesh` leave.
//!
//! Options, files and figures only; fusion is [`crate::frontend::dense`]'s.

use std::path::Path;

use anyhow::bail;
use fs_err as fs;
use serde::Serialize;

use crate::frontend::dense::mapper::MemoryCeiling;
use crate::frontend::dense::paged::{PagedVolume, PagingFigures};
use crate::frontend::dense::surface::Mesh;
use crate::frontend::dense::volume::VolumeOptions;
use crate::frontend::dense::{export, file};

/// How much memory a stored volume may take.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct Memory {
    /// Megabytes of the volume that are in memory at most; the rest waits in a temporary file beside
    /// OUT [default: all is in memory, 4.2 KB a block].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    memory_mb: Option<u32>,
}

impl Memory {
    /// Reads a volume for a file that will stand at `out`.
    pub(super) fn load(self, volume: &Path, out: &Path) -> anyhow::Result<PagedVolume> {
        // The folder of a bare name is the empty path.
        let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or_else(|| Path::new("."));
        let ceiling = self.memory_mb.map(|megabytes| ceiling(megabytes, folder));
        Ok(file::load(volume, ceiling.as_ref())?)
    }
}

fn ceiling(megabytes: u32, folder: &Path) -> MemoryCeiling {
    MemoryCeiling { bytes: megabytes as usize * 1_000_000, folder: Some(folder.to_owned()) }
}

/// The measures of a volume.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct Grid {
    /// Edge of a voxel, meters.
    #[arg(long, value_name = "METERS", default_value_t = 0.02)]
    voxel: f32,
    /// Distances are cut off at this many voxels.
    #[arg(long, value_name = "N", default_value_t = 8.0)]
    truncation_voxels: f32,
    /// Megabytes of the volume that are in memory at most; what is far from the camera waits in a
    /// temporary file in OUT [default: all is in memory].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    memory_mb: Option<u32>,
}

impl Grid {
    /// As the volume takes them.
    pub(super) fn options(&self) -> anyhow::Result<VolumeOptions> {
        if !(0.001..=1.0).contains(&self.voxel) {
            bail!("--voxel must be 0.001 to 1 m, not {}", self.voxel);
        }
        if !(3.0..=32.0).contains(&self.truncation_voxels) {
            bail!("--truncation-voxels must be 3 to 32, not {}", self.truncation_voxels);
        }
        let truncation_m = self.truncation_voxels * self.voxel;
        Ok(VolumeOptions { voxel_m: self.voxel, truncation_m })
    }

    /// How much memory volumes may take, and the folder for the rest.
    pub(super) fn ceiling(&self, out: &Path) -> Option<MemoryCeiling> {
        self.memory_mb.map(|megabytes| ceiling(megabytes, out))
    }
}

/// Writes `mesh.ply` and `volume.covis`.
pub(super) fn write_surface(
    volume: &mut PagedVolume,
    mesh: &Mesh,
    out: &Path,
) -> anyhow::Result<MeshFigures> {
    let ply = export::ply(mesh);
    fs::write(out.join("mesh.ply"), &ply)?;
    file::save(volume, &out.join("volume.covis"))?;
    let (vertices, triangles) = (mesh.positions.len(), mesh.triangles.len());
    Ok(MeshFigures { vertices, triangles, bytes: ply.len() })
}

/// What a mesh amounts to.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct MeshFigures {
    pub(super) vertices: usize,
    pub(super) triangles: usize,
    /// Of the PLY file.
    pub(super) bytes: usize,
}

/// What went to disk and came back, counted in blocks each time.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Paging {
    pub(super) paged_out: usize,
    pub(super) paged_in: usize,
    /// Frames that needed more than the memory they were given.
    pub(super) frames_above: usize,
    /// What the page file takes.
    pub(super) page_file_bytes: u64,
}

impl Paging {
    /// Of a volume that has a ceiling.
    pub(super) fn of(volume: &PagedVolume) -> Option<Self> {
        let figures = volume.paging()?;
        let PagingFigures { paged_out, paged_in, frames_above_ceiling, .. } = figures;
        let page_file_bytes = volume.page_file_bytes();
        Some(Self { paged_out, paged_in, frames_above: frames_above_ceiling, page_file_bytes })
    }
}
