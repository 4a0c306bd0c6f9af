//! `covis eval mask`: how well masks of what moves agree with the truth.
//!
//! A mask is an 8-bit gray PNG, more than 127 is masked, and belongs to the time that its name
//! tells in seconds. A folder is either full of them or has a `mask.txt` in TUM's form (`time
//! path`). All counting is in [`crate::evaluation`]; this file reads and prints.

use std::io::BufReader;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use serde::Serialize;

use super::super::html::{self, ReportFlag};
use super::super::output::show;
use crate::evaluation::{LEAST_COVERAGE, MaskEvaluation, MaskOverlap, Statistics};
use crate::report::{Labels, Line, Page, Role, Span, Table, count, lines, number};

/// Names are told to a microsecond; frames are milliseconds apart.
const SAME_TIME_S: f64 = 1e-4;

/// Arguments of `covis eval mask`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The folder of ground-truth masks, then the folder of estimated masks; with --static only the
    /// latter.
    #[arg(required = true, num_args = 1..=2, value_name = "FOLDER")]
    folders: Vec<PathBuf>,
    /// Nothing moves in the sequence: every masked pixel is false.
    #[arg(long = "static")]
    is_static: bool,
    #[command(flatten)]
    report: ReportFlag,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
}

/// The object of `--json`. Without a truth there is no IoU.
#[derive(Debug, Serialize)]
struct Document {
    /// Frames that were compared.
    frames: usize,
    /// True masks without an estimated one, and the other way around.
    truth_only: usize,
    estimate_only: usize,
    /// Over the frames whose truth covers at least 2 %; null where there is none.
    iou: Option<Statistics>,
    false_share: Statistics,
    masked_share: Statistics,
}

/// Reads the masks of both folders, compares, prints.
pub(super) fn run(args: &Args) -> anyhow::Result<()> {
    let Compared { frames, truth_only, estimate_only } = match (&args.folders[..], args.is_static) {
        ([estimate], true) => {
            let masks = list(estimate)?.into_iter().map(|mask| Mask::read(&mask.path));
            let overlaps = masks.map(|mask| mask.map(|mask| MaskOverlap::of_static(&mask.pixels)));
            let frames = overlaps.collect::<anyhow::Result<_>>()?;
            Compared { frames, truth_only: 0, estimate_only: 0 }
        }
        ([truth, estimate], false) => compare(truth, estimate)?,
        (_, true) => bail!("--static takes the folder of the estimated masks only"),
        (_, false) => {
            bail!("two folders are needed, the truth and the estimate, or one and --static")
        }
    };
    let evaluation = MaskEvaluation::of(&frames);
    let document = Document {
        frames: frames.len(),
        truth_only,
        estimate_only,
        iou: (evaluation.iou.count > 0).then_some(evaluation.iou),
        false_share: evaluation.false_share,
        masked_share: evaluation.masked_share,
    };
    args.report.write(|| page(&frames, &evaluation))?;
    show(args.json, &document, || table(&document, &evaluation))?;
    args.report.tell(args.json)
}

/// What came out, in a sentence.
fn verdict(evaluation: &MaskEvaluation) -> String {
    let percent = |share: f64| number(100.0 * share);
    let falsely = percent(evaluation.false_share.mean);
    match evaluation.iou.count {
        0 => format!("{falsely} % of what stands still is masked."),
        _ => {
            let found = percent(evaluation.iou.mean);
            format!(
                "Masks meet {found} % of the union with the truth; {falsely} % of what stands still is masked."
            )
        }
    }
}

/// The page: the figures of the table, and each frame's.
fn page(frames: &[MaskOverlap], evaluation: &MaskEvaluation) -> Page {
    let facts = [
        ("frames", count(frames.len())),
        ("frames with moving objects", count(evaluation.iou.count)),
    ];
    let mut page = html::page("Masks of moving objects", &verdict(evaluation), &facts);
    let row = |name: &str, s: &Statistics| {
        let figures = [s.mean, s.median, s.min, s.max].map(number);
        std::iter::once(name.to_owned()).chain(figures).collect::<Vec<_>>()
    };
    let mut rows = vec![
        row("falsely masked share", &evaluation.false_share),
        row("masked share", &evaluation.masked_share),
    ];
    if evaluation.iou.count > 0 {
        rows.insert(0, row("IoU", &evaluation.iou));
    }
    let head = ["figure", "mean", "median", "least", "most"];
    page.table(&Table::new("Over all frames", &head, rows));
    page.section("Frames");
    let line = |of: &dyn Fn(&MaskOverlap) -> Option<f64>| {
        let all = frames.iter().enumerate();
        let points = all.filter_map(|(k, frame)| Some((k as f64, of(frame)?))).collect();
        Line { points, ..Line::default() }
    };
    let named = |name: &str, role, line: Line| Line { name: Some(name.to_owned()), role, ..line };
    let iou = Labels {
        title: "Intersection over union",
        description: "Of each frame whose truth covers enough of it.",
        x: "frame",
        y: "IoU",
    };
    let shares = Labels {
        title: "Masked share",
        description: "Of the pixels of each frame: what the truth masks, and what the estimate does.",
        x: "frame",
        y: "%",
    };
    let covered = |frame: &MaskOverlap| frame.iou().filter(|_| frame.coverage() >= LEAST_COVERAGE);
    let truth = |frame: &MaskOverlap| Some(100.0 * frame.coverage());
    let masked = |frame: &MaskOverlap| Some(100.0 * frame.masked_share());
    let both = [
        named("truth", Role::Reference, line(&truth)),
        named("estimate", Role::After, line(&masked)),
    ];
    page.row(
        &[lines(iou, Span::FromZero, &[line(&covered)]), lines(shares, Span::FromZero, &both)],
        &[],
    );
    page
}

/// What two folders of masks have in common.
pub(in crate::cli) struct Compared {
    /// Of the frames that both have, at least one.
    pub(in crate::cli) frames: Vec<MaskOverlap>,
    /// True masks without an estimated one, and the other way around.
    truth_only: usize,
    estimate_only: usize,
}

/// Compares the masks of a folder with those of the truth that are of the same times.
pub(in crate::cli) fn compare(truth: &Path, estimate: &Path) -> anyhow::Result<Compared> {
    let (true_masks, masks) = (list(truth)?, list(estimate)?);
    let pairs = pair(&true_masks, &masks);
    let truth_only = true_masks.len() - pairs.len();
    let estimate_only = masks.len() - pairs.len();
    let mut frames = Vec::new();
    for (a, b) in pairs {
        frames.push(overlap(&true_masks[a].path, &masks[b].path)?);
    }
    ensure!(
        !frames.is_empty(),
        "no masks of {} and {} have the same time",
        truth.display(),
        estimate.display()
    );
    Ok(Compared { frames, truth_only, estimate_only })
}

fn table(document: &Document, evaluation: &MaskEvaluation) -> String {
    let Document { frames, truth_only, estimate_only, .. } = document;
    let mut text = format!("masks of {frames} frames");
    if truth_only + estimate_only > 0 {
        let more = format!(
            " ({truth_only} true ones have no estimate, {estimate_only} estimates have no ground truth)"
        );
        text.push_str(&more);
    }
    let (covered, least) = (evaluation.iou.count, 100.0 * LEAST_COVERAGE);
    let shown = |name: &str, s: &Statistics| {
        format!("\n{name:>24}  {:>8.4}  {:>8.4}  {:>8.4}  {:>8.4}", s.mean, s.median, s.min, s.max)
    };
    text.push_str(&format!(
        "\n\n{:>24}  {:>8}  {:>8}  {:>8}  {:>8}",
        "", "mean", "median", "min", "max"
    ));
    if covered > 0 {
        text.push_str(&shown("IoU", &evaluation.iou));
    }
    text.push_str(&shown("falsely masked share", &evaluation.false_share));
    text.push_str(&shown("masked share", &evaluation.masked_share));
    if covered > 0 {
        text.push_str(&format!(
            "\n\nIoU over the {covered} frames whose truth covers at least {least} %"
        ));
    }
    text
}

/// A mask's time and file.
struct Listed {
    time_s: f64,
    path: PathBuf,
}

/// The masks of a folder by their time, at least one.
fn list(folder: &Path) -> anyhow::Result<Vec<Listed>> {
    let index = folder.join("mask.txt");
    let mut masks = if index.is_file() { from_index(&index, folder)? } else { by_names(folder)? };
    ensure!(!masks.is_empty(), "{} has no masks", folder.display());
    masks.sort_unstable_by(|a, b| a.time_s.total_cmp(&b.time_s).then_with(|| a.path.cmp(&b.path)));
    if let Some(twins) = masks.windows(2).find(|pair| pair[1].time_s - pair[0].time_s < SAME_TIME_S)
    {
        let [first, second] = [0, 1].map(|k| twins[k].path.display());
        bail!("{first} and {second} have the same time");
    }
    Ok(masks)
}

/// The lines `time path` of a `mask.txt`; paths are relative to its folder.
fn from_index(index: &Path, folder: &Path) -> anyhow::Result<Vec<Listed>> {
    let text = fs_err::read_to_string(index)?;
    let mut masks = Vec::new();
    for (number, line) in text.lines().enumerate() {
        if line.trim().is_empty() || line.starts_with('#') {
            continue;
        }
        let listed = line.trim().split_once([' ', '\t']).and_then(|(time, path)| {
            Some(Listed { time_s: seconds(time)?, path: folder.join(path.trim()) })
        });
        let location = || format!("{}, line {}: not `time path`", index.display(), number + 1);
        masks.push(listed.with_context(location)?);
    }
    Ok(masks)
}

/// The PNG files of a folder, each named by its time.
fn by_names(folder: &Path) -> anyhow::Result<Vec<Listed>> {
    let mut masks = Vec::new();
    for entry in fs_err::read_dir(folder)? {
        let path = entry?.path();
        if path.extension().is_none_or(|extension| extension != "png") {
            continue;
        }
        let time_s = time_of_name(&path).with_context(|| {
            format!("{}: the name of a mask is its time in seconds", path.display())
        })?;
        masks.push(Listed { time_s, path });
    }
    Ok(masks)
}

/// The time that a file's name tells, seconds.
pub(in crate::cli) fn time_of_name(path: &Path) -> Option<f64> {
    path.file_stem().and_then(|stem| stem.to_str()).and_then(seconds)
}

fn seconds(text: &str) -> Option<f64> {
    text.parse::<f64>().ok().filter(|time| time.is_finite())
}

/// Indices of the masks of the same time. Both lists rise by more than the tolerance.
fn pair(truth: &[Listed], estimate: &[Listed]) -> Vec<(usize, usize)> {
    let mut pairs = Vec::new();
    let (mut a, mut b) = (0, 0);
    while let (Some(one), Some(other)) = (truth.get(a), estimate.get(b)) {
        let difference = one.time_s - other.time_s;
        if difference.abs() < SAME_TIME_S {
            pairs.push((a, b));
            (a, b) = (a + 1, b + 1);
        } else if difference < 0.0 {
            a += 1;
        } else {
            b += 1;
        }
    }
    pairs
}

fn overlap(truth: &Path, estimate: &Path) -> anyhow::Result<MaskOverlap> {
    let (true_mask, mask) = (Mask::read(truth)?, Mask::read(estimate)?);
    let both = || format!("{} and {}", truth.display(), estimate.display());
    let ([width, height], [other_width, other_height]) = (true_mask.size, mask.size);
    ensure!(
        true_mask.size == mask.size,
        "{}: {width} x {height} and {other_width} x {other_height} pixels",
        both()
    );
    MaskOverlap::of(&true_mask.pixels, &mask.pixels).with_context(both)
}

/// One byte a pixel, row by row.
struct Mask {
    /// Columns and rows.
    size: [u32; 2],
    pixels: Vec<u8>,
}

impl Mask {
    fn read(path: &Path) -> anyhow::Result<Self> {
        Self::decode(path).with_context(|| format!("{}", path.display()))
    }

    fn decode(path: &Path) -> anyhow::Result<Self> {
        let file = BufReader::new(fs_err::File::open(path)?);
        let mut reader = png::Decoder::new(file).read_info()?;
        let (color, depth) = reader.output_color_type();
        ensure!(
            color == png::ColorType::Grayscale && depth == png::BitDepth::Eight,
            "a mask is an 8-bit gray PNG, this one is {color:?} with {} bits",
            depth as u8
        );
        let size = reader.output_buffer_size().context("too large")?;
        let mut pixels = vec![0; size];
        let frame = reader.next_frame(&mut pixels)?;
        pixels.truncate(frame.buffer_size());
        Ok(Self { size: [frame.width, frame.height], pixels })
    }
}
