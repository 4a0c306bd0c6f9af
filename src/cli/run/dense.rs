//! `covis run --mesh`: the dense map beside tracking, and the files it leaves.
//!
//! Starts it, waits for it and writes; fusion is [`crate::frontend::dense`]'s.

use std::path::Path;

use anyhow::{Context, bail};
use fs_err as fs;

use super::super::progress::Progress;
use super::super::volume::{MeshFigures, write_surface};
use crate::frontend::camera::FrameCamera;
use crate::frontend::dense::export;
use crate::frontend::dense::integrate::IntegrationOptions;
use crate::frontend::dense::mapper::{DenseMapper, MemoryCeiling};
use crate::frontend::dense::surface::{Mesh, extract};
use crate::frontend::dense::thread::{DenseReport, DenseThread};
use crate::frontend::dense::volume::VolumeOptions;

/// How a run maps densely.
#[derive(Clone, Debug)]
pub(in crate::cli) struct DenseOptions {
    /// The volume's measures.
    pub(in crate::cli) volume: VolumeOptions,
    /// How much memory volumes may take, where there is a limit.
    pub(in crate::cli) ceiling: Option<MemoryCeiling>,
    /// Every how many frames one is integrated.
    pub(in crate::cli) every: usize,
}

/// Starts dense mapping on threads of its own.
pub(super) fn start(
    options: &DenseOptions,
    camera: &FrameCamera,
    threads: usize,
) -> anyhow::Result<DenseThread> {
    // One is tracking's.
    let threads = threads.saturating_sub(1).max(1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().context("threads")?;
    let mapper = DenseMapper::new(
        camera,
        options.volume,
        IntegrationOptions::default(),
        options.ceiling.clone(),
    )?;
    Ok(DenseThread::start(mapper, pool))
}

/// What was mapped densely: the volume on the final map, and its surface.
pub(in crate::cli) struct Dense {
    pub(super) report: DenseReport,
    pub(super) mesh: Mesh,
}

/// Waits until the volume stands on the final map, and extracts its surface.
pub(super) fn finish(thread: DenseThread) -> anyhow::Result<Dense> {
    let mut progress: Option<Progress> = None;
    let mut report = thread.finish(&mut |_, frames| {
        progress.get_or_insert_with(|| Progress::new("fused again", frames as u64)).advance(1);
    })?;
    if let Some(progress) = progress {
        progress.finish();
    }
    let mesh = extract(&mut report.volume)?;
    Ok(Dense { report, mesh })
}

/// Writes `mesh.ply`, `mesh.glb` and `volume.covis`.
pub(super) fn write(dense: &mut Dense, out: &Path) -> anyhow::Result<MeshFigures> {
    let figures = write_surface(&mut dense.report.volume, &dense.mesh, out)?;
    let Some(glb) = export::glb(&dense.mesh) else {
        bail!("the mesh is too large for a GLB file (4 GiB): covis mesh writes PLY");
    };
    fs::write(out.join("mesh.glb"), glb)?;
    Ok(figures)
}
