//! `covis grid`: the ground of a stored volume, as robots plan on it.
//!
//! Writes occupancy as ROS' map_server reads it (PGM and YAML), or distances to the nearest surface
//! on a slice (PFM). The mathematics is [`crate::frontend::dense::navigation`]'s.

use std::path::PathBuf;
use std::process::ExitCode;
use std::str::FromStr;

use anyhow::{Context, bail};
use fs_err as fs;
use nalgebra::Vector3;

use super::output::print;
use super::surface::Memory;
use crate::frontend::dense::navigation::{
    Ground, NavigationOptions, distance_slice, occupancy_grid,
};

/// Arguments of `covis grid`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// A volume, as `covis fuse` and `covis run --mesh` write it.
    volume: PathBuf,
    /// OUT.pgm for occupancy, with OUT.yaml beside it; OUT.pfm for distances on a slice.
    #[arg(value_name = "OUT.pgm|OUT.pfm")]
    out: PathBuf,
    /// Up in the volume's frame [default: 0,-1,0, for a first camera that was held level].
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

/// Writes the grid.
///
/// # Errors
/// A volume that cannot be read, is damaged or empty, options that make no sense, a file that cannot
/// be written.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let is_distance = match args.out.extension().and_then(|extension| extension.to_str()) {
        Some("pgm") => false,
        Some("pfm") => true,
        _ => bail!("{}: must end in .pgm or .pfm", args.out.display()),
    };
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
    print(format_args!("{out}: {width} x {height} cells of {resolution} m"))?;
    Ok(ExitCode::SUCCESS)
}
