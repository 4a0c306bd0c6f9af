//! Volumes of dense maps on the command line: `covis mesh` and `covis grid`, and the flags, files
//! and figures that `covis fuse` and `covis run --mesh` share with them.
//!
//! A mesh is written as PLY or GLB. A grid is for path planning: occupancy as ROS' map_server reads
//! it (PGM and YAML), or distances to the nearest surface on a slice (PFM).
//! [`crate::frontend::dense`] does fusion and navigation.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context, bail};
use fs_err as fs;
use nalgebra::Vector3;
use serde::Serialize;

use super::output::print;
use super::overwrite::Overwrite;
use super::progress::Working;
use crate::frontend::dense::file::VolumeFileError;
use crate::frontend::dense::mapper::MemoryCeiling;
use crate::frontend::dense::navigation::{
    Ground, NavigationOptions, distance_slice, occupancy_grid,
};
use crate::frontend::dense::paged::{PagedVolume, PagingFigures};
use crate::frontend::dense::surface::{Mesh, extract};
use crate::frontend::dense::volume::VolumeOptions;
use crate::frontend::dense::{export, file};

/// How much memory a stored volume may take.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct Memory {
    /// Maximum size of the volume in memory, megabytes; the rest moves to a temporary file beside
    /// OUT [default: no limit; 4.2 KB per block].
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
        let _working = Working::new(format_args!("reading {}", volume.display()));
        file::load(volume, ceiling.as_ref()).map_err(|error| {
            // One of the system names the file itself.
            if matches!(error, VolumeFileError::File { .. }) {
                return error.into();
            }
            let volume = volume.display();
            let context = format!("{volume}: `covis fuse` and `covis run --mesh` write volumes");
            anyhow::Error::new(error).context(context)
        })
    }
}

fn ceiling(megabytes: u32, folder: &Path) -> MemoryCeiling {
    MemoryCeiling { bytes: megabytes as usize * 1_000_000, folder: Some(folder.to_owned()) }
}

/// The measures of a volume.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct Measures {
    /// Edge length of a voxel, meters.
    #[arg(long, value_name = "METERS", default_value_t = 0.02)]
    voxel: f32,
    /// Truncation distance, voxels.
    #[arg(long, value_name = "N", default_value_t = 8.0)]
    truncation_voxels: f32,
    /// Maximum size of the volume in memory, megabytes; parts far from the camera move to a
    /// temporary file in OUT [default: no limit].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    memory_mb: Option<u32>,
}

impl Measures {
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

/// Arguments of `covis mesh`.
#[derive(Debug, clap::Args)]
pub(super) struct MeshArgs {
    /// A volume, as `covis fuse` and `covis run --mesh` write it.
    volume: PathBuf,
    /// The mesh to write; its extension, .ply or .glb, selects the format.
    #[arg(value_name = "OUT.ply|OUT.glb")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
    #[command(flatten)]
    memory: Memory,
}

/// Writes the mesh; fails where the volume is damaged, or a file cannot be read or written.
pub(super) fn mesh(args: &MeshArgs) -> anyhow::Result<()> {
    args.overwrite.allow(&args.out)?;
    let is_glb = is_second(&args.out, ["ply", "glb"])?;
    let mut volume = args.memory.load(&args.volume, &args.out)?;
    let mesh = extract(&mut volume)?;
    drop(volume);
    let bytes = if is_glb {
        export::glb(&mesh).context("the mesh is too large for a GLB file (4 GiB)")?
    } else {
        export::ply(&mesh)
    };
    fs::write(&args.out, bytes)?;
    let (vertices, triangles) = (mesh.positions.len(), mesh.triangles.len());
    let out = args.out.display();
    print(format_args!("{out}: {vertices} vertices, {triangles} triangles"))
}

/// Arguments of `covis grid`.
#[derive(Debug, clap::Args)]
pub(super) struct GridArgs {
    /// A volume, as `covis fuse` and `covis run --mesh` write it.
    volume: PathBuf,
    /// OUT.pgm for occupancy, with OUT.yaml beside it; OUT.pfm for distances on a slice.
    #[arg(value_name = "OUT.pgm|OUT.pfm")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Up direction in the volume's frame [default: 0,-1,0, for a first camera that was held
    /// level].
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    up: Option<Numbers<3>>,
    /// Heights between which a surface is an obstacle, meters along up from the volume's origin
    /// [default: -1.4,0.4].
    #[arg(long, value_name = "LOW,HIGH", allow_hyphen_values = true)]
    heights: Option<Numbers<2>>,
    /// Height of the slice of distances, meters along up.
    #[arg(long, value_name = "METERS", default_value_t = 0.0, allow_negative_numbers = true)]
    slice: f64,
    #[command(flatten)]
    memory: Memory,
}

/// Numbers with commas between them.
#[derive(Clone, Copy, Debug)]
struct Numbers<const N: usize>([f64; N]);

impl<const N: usize> FromStr for Numbers<N> {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(str::trim).map(str::parse).collect();
        let numbers = numbers.ok().and_then(|numbers| numbers.try_into().ok());
        numbers.map(Self).ok_or_else(|| format!("must be {N} numbers with commas between them"))
    }
}

/// Writes the grid; fails where the volume is damaged or empty, an option makes no sense, or a file
/// cannot be read or written.
pub(super) fn grid(args: &GridArgs) -> anyhow::Result<()> {
    args.overwrite.allow(&args.out)?;
    let is_distance = is_second(&args.out, ["pgm", "pfm"])?;
    let mut options = NavigationOptions::default();
    if let Some(Numbers(up)) = args.up {
        options.up = Vector3::from(up);
    }
    if let Some(Numbers(heights_m)) = args.heights {
        options.heights_m = heights_m;
    }
    let mut volume = args.memory.load(&args.volume, &args.out)?;
    let ground = if is_distance {
        let slice = distance_slice(&mut volume, &options, args.slice)?;
        fs::write(&args.out, slice.to_pfm())?;
        slice.ground
    } else {
        let grid = occupancy_grid(&mut volume, &options)?;
        let name = args.out.file_name().and_then(|name| name.to_str());
        let name = name.with_context(|| format!("{}: is no text", args.out.display()))?;
        fs::write(&args.out, grid.to_pgm())?;
        fs::write(args.out.with_extension("yaml"), grid.to_yaml(name))?;
        grid.ground
    };
    let Ground { width, height, .. } = ground;
    let (out, resolution) = (args.out.display(), ground.resolution());
    print(format_args!("{out}: {width} x {height} cells of {resolution} m"))
}

/// Whether the file has the second of these extensions; it must have one of them.
fn is_second(out: &Path, [first, second]: [&str; 2]) -> anyhow::Result<bool> {
    match out.extension().and_then(|extension| extension.to_str()) {
        Some(extension) if extension == first => Ok(false),
        Some(extension) if extension == second => Ok(true),
        _ => bail!("{}: must end in .{first} or .{second}", out.display()),
    }
}
