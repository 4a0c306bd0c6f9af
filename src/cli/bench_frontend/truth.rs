//! What is known of a sequence: the camera's trajectory and the masks of what moves. A folder's own
//! files, or what a synthetic sequence tells; opened after the runs. Errors are
//! [`crate::evaluation`]'s.

use std::path::{Path, PathBuf};

use covis_solvers::io::trajectory::Trajectory;
use fs_err as fs;

use super::RunFigures;
use crate::cli::eval::mask;
use crate::cli::eval::truth::of_folder;
use crate::cli::run::{Source, report};
use crate::evaluation::{self, MaskEvaluation, PoseError};
use crate::frontend::input::encode;
use crate::frontend::mapping::run::RunReport;
use crate::frontend::synthetic::Sequence;

/// How far apart timestamps may be that belong together, in seconds, as of `covis eval`.
const MAX_TIME_DIFFERENCE_S: f64 = 0.01;
/// The drift of the paper's tables is over this time.
const DRIFT_S: f64 = 1.0;

/// What is known of a sequence.
pub(super) struct Truth {
    trajectory: Option<Trajectory>,
    masks: Option<PathBuf>,
}

impl Truth {
    /// That of a folder lies beside its images; that of a scene is written to `out`.
    pub(super) fn open(source: &Source, out: &Path) -> anyhow::Result<Self> {
        match source {
            Source::Folder(folder) => {
                let trajectory = of_folder(folder)?;
                let plain = folder.join("mask");
                let masks = if folder.join("mask.txt").is_file() {
                    Some(folder.clone())
                } else {
                    plain.is_dir().then_some(plain)
                };
                Ok(Self { trajectory, masks })
            }
            // The poses of a capture are a phone's estimate.
            Source::Recording(..) | Source::Capture(_) => {
                Ok(Self { trajectory: None, masks: None })
            }
            Source::Synthetic(scene, options) => Self::draw(&Sequence::new(*scene, options), out),
        }
    }

    fn draw(sequence: &Sequence, out: &Path) -> anyhow::Result<Self> {
        fs::create_dir_all(out)?;
        let mut trajectory = Trajectory::default();
        let mut index = "# time path\n".to_owned();
        for frame in 0..sequence.len() {
            let time_s = sequence.timestamp_s(frame);
            let name = format!("{time_s:.6}.png");
            fs::write(out.join(&name), encode::gray8(&sequence.moving_mask(frame))?)?;
            index.push_str(&format!("{time_s:.6} {name}\n"));
            trajectory.push(time_s, sequence.world_from_camera(frame));
        }
        fs::write(out.join("mask.txt"), index)?;
        Ok(Self { trajectory: Some(trajectory), masks: Some(out.to_owned()) })
    }

    /// Fills in a run's errors. Where they cannot be told, of too short a trajectory for instance,
    /// they stay unknown, and a warning says why. Gives the truth and the absolute errors of the poses.
    pub(super) fn compare(
        &self,
        run: &RunReport,
        figures: &mut RunFigures,
    ) -> Option<(Trajectory, Vec<PoseError>)> {
        let truth = self.trajectory.as_ref()?;
        let estimate = report::trajectory(run);
        match evaluation::rpe_over(truth, &estimate, DRIFT_S) {
            Ok(drift) => {
                figures.rpe_translation_m_per_s = Some(drift.translation_m.rmse);
                figures.rpe_rotation_deg_per_s = Some(drift.angle_deg.rmse);
            }
            Err(error) => tracing::warn!("no RPE: {error}"),
        }
        match evaluation::ape(truth, &estimate, MAX_TIME_DIFFERENCE_S) {
            Ok(absolute) => {
                figures.ate_m = Some(absolute.translation_m.rmse);
                Some((truth.clone(), absolute.errors))
            }
            Err(error) => {
                tracing::warn!("no ATE: {error}");
                None
            }
        }
    }

    /// The mean IoU of saved masks, where there is a truth with something that moves.
    pub(super) fn mask_iou(&self, saved: &Path) -> anyhow::Result<Option<f64>> {
        let Some(truth) = &self.masks else { return Ok(None) };
        let iou = MaskEvaluation::of(&mask::compare(truth, saved)?.frames).iou;
        Ok((iou.count > 0).then_some(iou.mean))
    }
}
