//! `covis convert`: a file of one format as a file of another one.
//!
//! Reads all of the input before it writes. What is converted stays what it is: poses, points and
//! residuals; what a format cannot hold is refused or named in the report. Conventions of formats are
//! [`covis_solvers::io`]'s; `named` has what is special about graphs of named variables.

mod named;

use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use covis_solvers::geometry::{Se2, Se3, So3};
use covis_solvers::io::bal::BalFile;
use covis_solvers::io::bundler::BundlerFile;
use covis_solvers::io::colmap::{ColmapEncoding, ColmapModel};
use covis_solvers::io::format::{Content, Format};
use covis_solvers::io::g2o::{G2oChanges, G2oGraph, G2oReading};
use covis_solvers::io::openmvg::OpenMvgFile;
use covis_solvers::io::ply::{PlyEncoding, PlyFile, PlyVertex};
use covis_solvers::io::pyfg::PyfgGraph;
use covis_solvers::io::sparse_model::SparseModel;
use covis_solvers::io::trajectory::{Trajectory, TrajectoryFormat, read_times};
use fs_err as fs;
use nalgebra::Vector3;
use serde::Serialize;

use self::named::NamedGraph;
use super::formats::{self, joined};
use super::output::show;
use super::overwrite::Overwrite;
use super::progress::Working;

/// Color of landmarks that have none.
const LANDMARK_COLOR: [u8; 3] = [128, 128, 128];

/// Color of paths for viewers.
const PATH_COLOR: [u8; 3] = [220, 80, 40];

/// Arguments of `covis convert`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The file, a folder with a COLMAP sparse model, or a recording of ROS 2 with poses, as PATH or
    /// PATH:TOPIC.
    input: PathBuf,
    /// The file to write; a folder for COLMAP.
    output: PathBuf,
    /// Format of the input [default: detected from its name or its first line].
    #[arg(long, value_name = "FORMAT", value_parser = formats::readable(), hide_possible_values = true)]
    from: Option<Format>,
    /// Format of the output: tum, kitti, euroc, bal, bundler, colmap-text, colmap-binary, g2o, pyfg or
    /// ply [default: by its name; a name without extension is a COLMAP folder].
    #[arg(long, value_name = "FORMAT", value_parser = formats::writable(), hide_possible_values = true)]
    to: Option<Format>,
    /// Times of the poses of a KITTI file, seconds, one per line.
    #[arg(long, value_name = "FILE")]
    times: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
    /// The robot of a pyfg file whose trajectory is written, by the letter of its poses; needed if the file
    /// has several.
    #[arg(long, value_name = "LETTER")]
    robot: Option<char>,
    /// Skip the lines of a g2o or pyfg file that covis does not read, and say how many of each tag. Without this
    /// flag such a line is an error.
    #[arg(long)]
    skip_unknown: bool,
    /// Print one JSON object instead of a sentence.
    #[arg(long)]
    json: bool,
}

/// The object of `--json`.
#[derive(Debug, Serialize)]
struct Document {
    from: &'static str,
    to: &'static str,
    output: PathBuf,
    poses: usize,
    landmarks: usize,
    observations: usize,
    /// Points of a COLMAP output that fewer than two images observe.
    #[serde(skip_serializing_if = "Option::is_none")]
    single_view_points: Option<usize>,
    /// What stands for times where the input has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    times: Option<&'static str>,
}

/// What a file holds.
enum Input {
    Trajectory(Trajectory),
    /// With COLMAP's own numbers, where it is one.
    Bundle(Box<SparseModel>, Option<ColmapModel>),
    PoseGraph(G2oGraph),
    /// Of variables with names.
    Named(Box<NamedGraph>),
}

/// Converts.
/// Fails for what cannot be read or written, and for what the other format cannot hold.
pub(super) fn run(args: &Args) -> anyhow::Result<()> {
    args.overwrite.allow(&args.output)?;
    let working = Working::new(format_args!("reading {}", args.input.display()));
    let (from, mut input) = read(args)?;
    ensure!(
        args.robot.is_none() || from == Format::Pyfg,
        "--robot is for pyfg files, and {} is not one",
        args.input.display()
    );
    take_times(args, &mut input)?;
    working.tell(format_args!("writing {}", args.output.display()));
    let content = from.entry().content;
    let told = args.to.or_else(|| Format::to_write(&args.output, content));
    let to = told.with_context(|| {
        format!(
            "{}: the format does not follow from the name; set it with --to",
            args.output.display()
        )
    })?;
    let (poses, landmarks, observations) = input.counts();
    let is_numbered = !matches!(from.entry().content, Content::Trajectory) && from != Format::Pyfg
        || from == Format::Trajectory(TrajectoryFormat::Kitti) && args.times.is_none();
    let has_times = matches!(to, Format::Trajectory(format) if format.has_times());
    let single_view_points = write(&input, from, to, &args.output)?.filter(|&count| count > 0);
    drop(working);
    let document = Document {
        from: from.entry().name,
        to: to.entry().name,
        output: args.output.clone(),
        poses,
        landmarks,
        observations,
        single_view_points,
        times: (is_numbered && has_times).then(|| numbers(&input)),
    };
    show(args.json, &document, || sentence(&document))
}

fn sentence(document: &Document) -> String {
    let Document { from, to, output, poses, landmarks, observations, times, .. } = document;
    let more = if *landmarks > 0 {
        format!(", {landmarks} points, {observations} observations")
    } else {
        String::new()
    };
    let times = times.map(|times| format!("; times are {times}")).unwrap_or_default();
    let single = document.single_view_points.map(|count| {
        format!(
            "; {count} points in fewer than two images, which COLMAP's bundle adjustment refuses"
        )
    });
    let single = single.unwrap_or_default();
    format!("{from} to {to}: {poses} poses{more} in {}{times}{single}", output.display())
}

/// What stands for times.
fn numbers(input: &Input) -> &'static str {
    match input {
        Input::Trajectory(_) | Input::Named(_) => "the numbers of rows (--times FILE gives others)",
        Input::Bundle(..) => "the names of images where these are numbers, else their numbers",
        Input::PoseGraph(graph) if ids_are_times(graph) => "the ids of vertices",
        Input::PoseGraph(_) => {
            "the numbers of vertices by rising id, since ids above 2^53 have no exact times"
        }
    }
}

fn read(args: &Args) -> anyhow::Result<(Format, Input)> {
    let path = &args.input;
    if args.from.is_none()
        && let Some(trajectory) = formats::read_recorded(path)?
    {
        return Ok((Format::Trajectory(TrajectoryFormat::Tum), Input::Trajectory(trajectory)));
    }
    let told = match args.from {
        None if path.is_dir() => {
            Some(ColmapEncoding::of_folder(path).map(Format::Colmap).with_context(|| {
                format!("{}: neither cameras.bin nor cameras.txt is in this folder", path.display())
            })?)
        }
        told => told,
    };
    if let Some(from @ Format::Colmap(encoding)) = told {
        ensure!(path.is_dir(), "{}: a COLMAP model is a folder", path.display());
        let model = ColmapModel::read_as(path, encoding)?;
        let bundle =
            SparseModel::from_colmap(&model).with_context(|| format!("{}", path.display()))?;
        return Ok((from, Input::Bundle(Box::new(bundle), Some(model))));
    }
    let bytes = fs::read(path)?;
    let from = told.unwrap_or_else(|| Format::of_file(path, &bytes));
    let bundle = |model| Input::Bundle(Box::new(model), None);
    let input = match from {
        Format::Trajectory(format) => {
            Input::Trajectory(Trajectory::parse_as(&bytes, path, format)?)
        }
        Format::Bal => bundle(SparseModel::from_bal(&BalFile::parse(&bytes, path)?)),
        Format::Bundler => bundle(SparseModel::from_bundler(&BundlerFile::read(path)?)?),
        Format::OpenMvg => {
            let file = OpenMvgFile::parse(&bytes, path)?;
            let (model, left_out) = SparseModel::from_openmvg(&file, path)
                .with_context(|| format!("{}", path.display()))?;
            formats::warn_of_left_out(path, &left_out);
            bundle(model)
        }
        Format::G2o => {
            let reading = G2oReading { skip_unknown: args.skip_unknown, ..G2oReading::default() };
            let (graph, changes) =
                G2oGraph::parse_with(&bytes, path, reading).map_err(formats::with_skipping)?;
            formats::warn_of_changes(path, &changes);
            Input::PoseGraph(graph)
        }
        Format::Pyfg => {
            let (graph, skipped) = PyfgGraph::parse(&bytes, path, args.skip_unknown)
                .map_err(formats::with_skipping)?;
            formats::warn_of_changes(path, &G2oChanges { skipped, ..G2oChanges::default() });
            Input::Named(Box::new(NamedGraph::new(path, graph, args.robot)?))
        }
        Format::Colmap(_) | Format::Ply => {
            bail!("{}: covis writes {} but cannot read it", path.display(), from.entry().name)
        }
    };
    Ok((from, input))
}

/// Takes the times of a file beside the trajectory, where one is given.
fn take_times(args: &Args, input: &mut Input) -> anyhow::Result<()> {
    let Some(path) = &args.times else { return Ok(()) };
    let Input::Trajectory(trajectory) = input else {
        bail!("--times is for trajectories, and {} is not one", args.input.display())
    };
    let times = read_times(path)?;
    ensure!(
        times.len() == trajectory.len(),
        "{}: {} times, but {} has {} poses",
        path.display(),
        times.len(),
        args.input.display(),
        trajectory.len()
    );
    trajectory.timestamps = times;
    Ok(())
}

impl Input {
    /// Poses, landmarks, observations.
    fn counts(&self) -> (usize, usize, usize) {
        match self {
            Self::Trajectory(trajectory) => (trajectory.len(), 0, 0),
            Self::Bundle(model, _) => {
                let problem = &model.problem;
                (problem.poses.len(), problem.landmarks.len(), problem.observation_count())
            }
            Self::PoseGraph(graph) => {
                let poses = graph_trajectory(graph).map_or(0, |trajectory| trajectory.len());
                let measured = match graph {
                    G2oGraph::Se2(file) => file.sightings.len(),
                    G2oGraph::Se3(file) => file.sightings.len(),
                };
                (poses, points(graph).len(), measured)
            }
            Self::Named(graph) => graph.counts(),
        }
    }

    /// The trajectory, whose times rise where it `needs_times`.
    fn trajectory(&self, needs_times: bool) -> anyhow::Result<Trajectory> {
        match self {
            Self::Trajectory(trajectory) => Ok(trajectory.clone()),
            Self::Bundle(model, _) => Ok(model.trajectory()),
            Self::PoseGraph(graph) => graph_trajectory(graph),
            Self::Named(graph) => graph.trajectory(needs_times),
        }
    }
}

/// Writes all that the input holds. Returns how many points of a COLMAP output fewer than two images
/// observe.
fn write(input: &Input, from: Format, to: Format, out: &Path) -> anyhow::Result<Option<usize>> {
    match (to, input) {
        (Format::Trajectory(format), input) => {
            input.trajectory(format.has_times())?.write_as(out, format)?;
        }
        // COLMAP's own numbers, with keypoints that have no point.
        (Format::Colmap(encoding), Input::Bundle(_, Some(own))) => {
            own.write(out, encoding)?;
            return Ok(Some(own.single_view_points()));
        }
        (Format::Colmap(encoding), Input::Bundle(model, None)) => {
            let made = model.to_colmap()?;
            made.write(out, encoding)?;
            return Ok(Some(made.single_view_points()));
        }
        (Format::Bal, Input::Bundle(model, _)) => model.to_bal()?.write(out)?,
        (Format::Bundler, Input::Bundle(model, _)) => model.to_bundler()?.write(out)?,
        (Format::G2o, Input::PoseGraph(graph)) => graph.write(out)?,
        (Format::G2o, Input::Named(graph)) => graph.whole()?.to_g2o()?.write(out)?,
        (Format::Pyfg, Input::PoseGraph(graph)) => PyfgGraph::from_g2o(graph)?.write(out)?,
        (Format::Pyfg, Input::Named(graph)) => graph.whole()?.write(out)?,
        (Format::Ply, input) => picture(input)?.write(out, PlyEncoding::Binary)?,
        (Format::OpenMvg, _) => bail!("{}: covis reads openmvg but cannot write it", out.display()),
        (Format::Colmap(_) | Format::Bal | Format::Bundler, _)
        | (Format::G2o | Format::Pyfg, _) => {
            let named = |format: Format| {
                let entry = format.entry();
                format!("{} ({})", entry.name, entry.content.name())
            };
            bail!("{} cannot be made from {}", named(to), named(from));
        }
    }
    Ok(None)
}

/// Points, and the path of the poses.
fn picture(input: &Input) -> anyhow::Result<PlyFile> {
    let mut file = PlyFile::default();
    if let Input::Bundle(model, _) = input {
        let points = model.problem.landmarks.iter().zip(&model.colors);
        file.vertices.extend(points.map(|(&position, &color)| PlyVertex { position, color }));
    }
    let mut put_points = |points: &[Vector3<f64>]| {
        let vertex = |&position: &_| PlyVertex { position, color: LANDMARK_COLOR };
        file.vertices.extend(points.iter().map(vertex));
    };
    let paths = match input {
        Input::Named(graph) => {
            graph.whole()?;
            put_points(&graph.points);
            graph.paths().collect()
        }
        Input::PoseGraph(_) | Input::Trajectory(_) | Input::Bundle(..) => {
            if let Input::PoseGraph(graph) = input {
                put_points(&points(graph));
            }
            let poses = input.trajectory(false)?.world_from_body;
            vec![poses.iter().map(|pose| pose.translation).collect::<Vec<_>>()]
        }
    };
    paths.iter().for_each(|path| file.push_polyline(path, PATH_COLOR));
    Ok(file)
}

/// The landmarks of a graph.
fn points(graph: &G2oGraph) -> Vec<Vector3<f64>> {
    let points = match graph {
        G2oGraph::Se2(file) => &file.points,
        G2oGraph::Se3(file) => &file.points,
    };
    points.iter().map(|point| point.position.into()).collect()
}

/// Poses of a graph by rising id, those of a plane at z = 0. Times are the ids, or the numbers of the
/// poses where ids are too large.
fn graph_trajectory(graph: &G2oGraph) -> anyhow::Result<Trajectory> {
    ensure!(graph.has_vertices(), "the graph has edges only: `covis solve pose-graph` finds poses");
    let mut poses: Vec<(i64, Se3)> = match graph {
        G2oGraph::Se2(file) => {
            let graph = file.to_pose_graph()?;
            graph.ids.iter().zip(&graph.poses).map(|(&id, pose)| (id, in_space(pose))).collect()
        }
        G2oGraph::Se3(file) => {
            let graph = file.to_pose_graph()?;
            graph.ids.iter().copied().zip(graph.poses.iter().copied()).collect()
        }
    };
    poses.sort_unstable_by_key(|(id, _)| *id);
    let by_id = ids_are_times(graph);
    let timed = poses.into_iter().enumerate();
    Ok(joined(timed.map(|(k, (id, pose))| (if by_id { id as f64 } else { k as f64 }, pose))))
}

/// Whether each id is a number of seconds to the last digit.
fn ids_are_times(graph: &G2oGraph) -> bool {
    let is_exact = |id: i64| id.unsigned_abs() <= 1 << f64::MANTISSA_DIGITS;
    match graph {
        G2oGraph::Se2(file) => file.vertices.iter().all(|vertex| is_exact(vertex.id)),
        G2oGraph::Se3(file) => file.vertices.iter().all(|vertex| is_exact(vertex.id)),
    }
}

fn in_space(pose: &Se2) -> Se3 {
    let half = 0.5 * pose.rotation.angle();
    let rotation = So3::from_quaternion_xyzw(0.0, 0.0, half.sin(), half.cos());
    let translation = Vector3::new(pose.translation.x, pose.translation.y, 0.0);
    Se3::new(rotation.unwrap_or_else(covis_solvers::geometry::LieGroup::identity), translation)
}
