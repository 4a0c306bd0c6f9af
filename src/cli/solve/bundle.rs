//! `covis solve bundle`: a file of BAL, Bundler or OpenMVG or a COLMAP folder.
//!
//! Minimizes ½ Σ ρ(‖predicted − measured‖²) in px² over every observation, also those behind their
//! camera, or over those that start in front of it (`--behind-camera drop`). The gauge is free, as
//! in Ceres' bundle adjuster: the damping holds it. With `--rebuild` the file's poses and points are no start.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use clap::ValueEnum;
use covis_solvers::bundle_adjustment::{self, LinearSolver};
use covis_solvers::evaluation::{ObservationLengths, bundle_cost};
use covis_solvers::geometry::ParameterKind;
use covis_solvers::io::IoError;
use covis_solvers::io::bal::BalFile;
use covis_solvers::io::bundler::BundlerFile;
use covis_solvers::io::colmap::{ColmapEncoding, ColmapModel, ColmapProblem};
use covis_solvers::io::format::{Content, Format};
use covis_solvers::io::openmvg::OpenMvgFile;
use covis_solvers::io::sparse_model::SparseModel;
use covis_solvers::optimizer::{self, Termination};
use covis_solvers::problem::BundleProblem;
use serde::Serialize;

use super::arguments::{SOLVERS, Shared};
use super::rebuild::{Rebuilt, rebuild};
use super::report::{Details, Report, Solved};
use super::residuals;
use crate::cli::choices::{choice, name_of};
use crate::cli::formats::{warn_of_left_out, with_kind};
use crate::cli::html::{self, solve::Residuals};
use crate::cli::output::writable;
use crate::cli::progress::Working;
use crate::report::{Page, Plan, views};

/// Arguments of `covis solve bundle`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// A BAL file, a Bundler file (.out), OpenMVG's sfm_data.json, or a folder with a COLMAP sparse model
    /// (text or binary).
    #[arg(value_name = "FILE")]
    input: PathBuf,
    #[command(flatten)]
    shared: Shared,
    /// Hold focal lengths, distortion and principal points fixed.
    #[arg(long)]
    fix_intrinsics: bool,
    /// Intrinsics to optimize, where the camera's model has them: a list with commas.
    #[arg(long, value_name = "KINDS", value_enum, value_delimiter = ',')]
    #[arg(conflicts_with = "fix_intrinsics")]
    #[arg(default_value = "focal-length,principal-point,distortion")]
    free_intrinsics: Vec<Intrinsics>,
    /// How the reduced camera system is stored and factored.
    #[arg(long, value_name = "SOLVER", value_parser = choice(SOLVERS), default_value = "auto")]
    linear_solver: LinearSolver,
    /// What to do with observations whose landmark starts at or behind the camera's center plane.
    #[arg(long, value_name = "MODE", value_enum, default_value_t = BehindCamera::Count)]
    behind_camera: BehindCamera,
    /// Discard the file's poses and points and reconstruct them from its observations first; the solve leaves
    /// out observations that do not agree with the reconstruction.
    #[arg(long)]
    rebuild: bool,
}

/// Intrinsics of one kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Intrinsics {
    /// One or two focal lengths, depending on the model.
    FocalLength,
    /// The principal point.
    PrincipalPoint,
    /// The coefficients of the distortion.
    Distortion,
}

impl From<ParameterKind> for Intrinsics {
    fn from(kind: ParameterKind) -> Self {
        match kind {
            ParameterKind::FocalLength => Self::FocalLength,
            ParameterKind::PrincipalPoint => Self::PrincipalPoint,
            ParameterKind::Distortion => Self::Distortion,
        }
    }
}

/// Observations that start behind their camera.
#[derive(Clone, Copy, Debug, clap::ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum BehindCamera {
    /// Use them like all others.
    Count,
    /// Leave them out of the solve; the written file keeps them.
    Drop,
}

#[derive(Debug, Serialize)]
struct BundleDetails {
    problem: &'static str,
    format: &'static str,
    linear_solver: &'static str,
    fixed_intrinsics: bool,
    free_intrinsics: Vec<Intrinsics>,
    poses: usize,
    cameras: usize,
    landmarks: usize,
    /// Those that were solved for.
    observations: usize,
    behind_camera: BehindCamera,
    behind_camera_at_start: usize,
    dropped_observations: usize,
    /// Of `observations`, at the end.
    behind_camera_observations: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    rebuilt: Option<Rebuilt>,
}

impl Details for BundleDetails {
    fn lines(&self) -> Vec<(&'static str, String)> {
        let size = format!(
            "{} poses, {} cameras{}, {} landmarks, {} observations",
            self.poses,
            self.cameras,
            match self.free_intrinsics[..] {
                [] => " (fixed)".to_owned(),
                [_, _, _] => String::new(),
                ref some => format!(" (free: {})", names_of(some)),
            },
            self.landmarks,
            self.observations
        );
        let behind = format!(
            "{} observations at the start{}, {} at the end",
            self.behind_camera_at_start,
            match self.behind_camera {
                BehindCamera::Count => "",
                BehindCamera::Drop => " (dropped)",
            },
            self.behind_camera_observations
        );
        let mut lines = vec![
            ("linear solver", self.linear_solver.to_owned()),
            ("problem", size),
            ("behind camera", behind),
        ];
        lines.extend(self.rebuilt.iter().flat_map(Rebuilt::lines));
        lines
    }
}

/// Reads, solves, writes, reports.
pub(super) fn run(args: &Args) -> anyhow::Result<Termination> {
    let shared = &args.shared;
    // A folder is made with all its parents.
    writable(shared.out.as_deref().filter(|_| !args.input.is_dir()))?;
    shared.out.iter().try_for_each(|out| shared.overwrite.allow(out))?;
    let working = Working::new(format_args!("reading {}", args.input.display()));
    let read = Source::read(&args.input);
    let mut source = read.map_err(|error| with_kind(error, &args.input, Content::Bundle))?;
    drop(working);
    let start = Instant::now();
    let name = || args.input.display().to_string();
    let mut solved = source.to_problem().with_context(name)?;
    let problem = &mut solved.problem;
    problem.observation_loss = shared.loss;
    let free_intrinsics = free_intrinsics(args);
    restrict(problem, &free_intrinsics);
    let rebuilt = if args.rebuild {
        let images = &solved.image_ids;
        let id = |pose: usize| images.get(pose).map_or(pose as u64, |&image| image.into());
        let rebuilt = rebuild(problem, id, args.linear_solver, shared.json).with_context(name)?;
        Some(rebuilt)
    } else {
        None
    };
    let behind_camera_at_start = problem.behind_camera_count();
    let dropped_observations = match args.behind_camera {
        BehindCamera::Count => 0,
        BehindCamera::Drop => problem.drop_behind_camera(),
    };
    let options = bundle_adjustment::Options {
        optimizer: optimizer::Options {
            max_iterations: shared.max_iterations,
            threads: None,
            ..optimizer::Options::default()
        },
        linear_solver: args.linear_solver,
        ..bundle_adjustment::Options::default()
    };
    let preparation = start.elapsed();
    let before = bundle_cost(problem);
    let start_of_page = shared.report.path.as_ref().map(|_| Drawn::of(problem));
    let mut report = Report::start(shared.json, preparation);
    let mut observer = |row: &optimizer::IterationSummary| report.observe(row);
    let summary = bundle_adjustment::solve(problem, &options, &mut observer).with_context(name)?;
    let details = BundleDetails {
        problem: "bundle",
        format: source.format(),
        linear_solver: name_of(SOLVERS, &summary.linear_solver),
        fixed_intrinsics: args.fix_intrinsics,
        free_intrinsics,
        poses: problem.poses.len(),
        cameras: problem.cameras.len(),
        landmarks: problem.landmarks.len(),
        observations: problem.observation_count(),
        behind_camera: args.behind_camera,
        behind_camera_at_start,
        dropped_observations,
        behind_camera_observations: summary.behind_camera,
        rebuilt,
    };
    let residuals = residuals::rows(Some(&before), &bundle_cost(problem));
    let outcome = Solved { summary: summary.solve, residuals, details };
    report.check_reader()?;
    if let Some(out) = &shared.out {
        source.write(&solved, out)?;
    }
    shared.report.write(|| {
        let title = format!("Bundle adjustment of {}", args.input.display());
        let mut page = report.page(&title, &outcome);
        // Images of COLMAP and OpenMVG are in the order of their names, as a rule that of a camera's way.
        let is_path = matches!(source, Source::Colmap(..) | Source::OpenMvg(_));
        if let Some(start) = &start_of_page {
            start.show(&solved.problem, is_path, &mut page);
        }
        page
    })?;
    report.finish(&outcome)?;
    shared.report.tell(shared.json)?;
    Ok(outcome.summary.termination)
}

/// The kinds of intrinsics that are free, each once.
fn free_intrinsics(args: &Args) -> Vec<Intrinsics> {
    let all = Intrinsics::value_variants().iter().copied();
    all.filter(|kind| !args.fix_intrinsics && args.free_intrinsics.contains(kind)).collect()
}

fn names_of(kinds: &[Intrinsics]) -> String {
    let names =
        kinds.iter().filter_map(|kind| Some(kind.to_possible_value()?.get_name().to_owned()));
    names.collect::<Vec<_>>().join(", ")
}

/// Holds the intrinsics of all other kinds.
fn restrict(problem: &mut BundleProblem, free: &[Intrinsics]) {
    match free {
        [] => problem.constant_cameras.fill(true),
        [_, _, _] => {}
        some => {
            for camera in 0..problem.cameras.len() {
                let own = problem.free_parameters_of(camera);
                let own = own.only(&problem.cameras[camera], |kind| some.contains(&kind.into()));
                problem.set_free_parameters(camera, own);
            }
        }
    }
}

/// What a page shows of a problem as it stands.
struct Drawn {
    positions: Vec<[f64; 3]>,
    lengths: ObservationLengths,
}

impl Drawn {
    fn of(problem: &BundleProblem) -> Self {
        let positions = problem.poses.iter().map(|pose| pose.translation.into()).collect();
        Self { positions, lengths: ObservationLengths::of(problem) }
    }

    /// The start beside the solved problem.
    fn show(&self, solved: &BundleProblem, is_path: bool, page: &mut Page) {
        let after = Self::of(solved);
        let residuals = |name, unit, of: fn(&ObservationLengths) -> &Vec<f64>| Residuals {
            name,
            unit,
            before: Some(of(&self.lengths)),
            after: of(&after.lengths),
        };
        let pixels = residuals("pixels", "px", |lengths| &lengths.pixels_px);
        let depths = residuals("depths", "m", |lengths| &lengths.depths_m);
        html::solve::residuals(page, &[pixels, depths]);
        page.section("Cameras");
        let errors = after.lengths.rmse_px_by_pose(solved.poses.len());
        let points: Vec<[f64; 3]> = solved.landmarks.iter().map(|&point| point.into()).collect();
        let plan = Plan {
            name: "Cameras",
            positions: &after.positions,
            errors: &errors,
            error_name: "reprojection RMSE, px",
            is_path,
            reference: is_path.then_some(("the start", &self.positions[..])),
            points: &points,
            links: &[],
        };
        page.row(&views(&plan), &[]);
    }
}

/// The input's own numbers, so that it can be written back with all that the problem leaves out.
enum Source {
    Bal(BalFile),
    Bundler(Box<SparseModel>),
    Colmap(ColmapModel, ColmapEncoding),
    /// Is written as a COLMAP model.
    OpenMvg(Box<SparseModel>),
}

impl Source {
    fn read(path: &Path) -> Result<Self, IoError> {
        if path.extension().is_some_and(|extension| extension == "out") {
            let model = SparseModel::from_bundler(&BundlerFile::read(path)?)?;
            return Ok(Self::Bundler(Box::new(model)));
        }
        if path.is_dir() {
            let encoding = ColmapEncoding::of_folder(path).unwrap_or(ColmapEncoding::Text);
            return Ok(Self::Colmap(ColmapModel::read(path)?, encoding));
        }
        let read = std::fs::read(path);
        let bytes = read.map_err(|source| IoError::Read { path: path.to_owned(), source })?;
        // No other file of a problem is JSON.
        let is_json = path.extension().is_some_and(|extension| extension == "json");
        if is_json || Format::of_file(path, &bytes) == Format::OpenMvg {
            let file = OpenMvgFile::parse(&bytes, path)?;
            let (model, left_out) = SparseModel::from_openmvg(&file, path)?;
            warn_of_left_out(path, &left_out);
            return Ok(Self::OpenMvg(Box::new(model)));
        }
        Ok(Self::Bal(BalFile::parse(&bytes, path)?))
    }

    fn format(&self) -> &'static str {
        match self {
            Self::Bal(_) => "bal",
            Self::Bundler(_) => "bundler",
            Self::OpenMvg(_) => "openmvg",
            Self::Colmap(_, ColmapEncoding::Text) => "colmap-text",
            Self::Colmap(_, ColmapEncoding::Binary) => "colmap-binary",
        }
    }

    /// The problem; only a COLMAP model has ids that are not its indices.
    fn to_problem(&self) -> Result<ColmapProblem, IoError> {
        match self {
            Self::Bal(file) => {
                Ok(ColmapProblem { problem: file.to_problem(), ..ColmapProblem::default() })
            }
            Self::Bundler(model) | Self::OpenMvg(model) => {
                Ok(ColmapProblem { problem: model.problem.clone(), ..ColmapProblem::default() })
            }
            Self::Colmap(model, _) => model.to_problem(),
        }
    }

    fn write(&mut self, solved: &ColmapProblem, out: &Path) -> Result<(), IoError> {
        match self {
            Self::Bal(file) => {
                file.update_from(&solved.problem)?;
                file.write(out)
            }
            Self::Bundler(model) => {
                update(model, &solved.problem);
                model.to_bundler()?.write(out)
            }
            Self::OpenMvg(model) => {
                update(model, &solved.problem);
                model.to_colmap()?.write(out, ColmapEncoding::Binary)
            }
            Self::Colmap(model, encoding) => {
                model.update_from(solved)?;
                model.write(out, *encoding)
            }
        }
    }
}

/// Takes poses, cameras and landmarks. Observations stay the file's, also those that were left out of the
/// solve.
fn update(model: &mut SparseModel, solved: &BundleProblem) {
    model.problem.poses.clone_from(&solved.poses);
    model.problem.cameras.clone_from(&solved.cameras);
    model.problem.landmarks.clone_from(&solved.landmarks);
}
