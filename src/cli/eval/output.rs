//! What `covis eval ape|rpe` prints: a table for people, or one JSON object.
//!
//! One estimate has a table with a row a figure, several have one with a row an estimate. The object of one
//! estimate has its figures at the top level; that of several has a list of them, `estimates`.

use serde::Serialize;

use super::measure::{Measure, Motions, head};
use super::{CORRECTIONS, Compared, UNITS};
use crate::cli::choices::name_of;
use crate::cli::output;
use crate::evaluation::{Correction, Evaluation, PoseRelation, Statistics};

/// The object of `--json`.
#[derive(Debug, Serialize)]
pub(super) struct Document<'a> {
    metric: &'static str,
    /// evo's name of the relation whose statistics stand at the top level of an estimate.
    pose_relation: &'static str,
    /// The unit of these statistics, where they have one.
    unit: Option<&'static str>,
    align: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    n_to_align: Option<usize>,
    #[serde(flatten)]
    pairs: Option<Pairing>,
    truth_poses: usize,
    #[serde(flatten)]
    found: Found<'a>,
}

/// Which motions are compared.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum Pairing {
    Over {
        /// The time between the poses of a pair.
        delta_s: f64,
    },
    Between {
        delta: f64,
        delta_unit: &'static str,
        all_pairs: bool,
        #[serde(skip_serializing_if = "Option::is_none")]
        delta_tol: Option<f64>,
        pairs_from_reference: bool,
    },
}

#[derive(Debug, Serialize)]
#[serde(untagged)]
enum Found<'a> {
    One(Box<Estimate>),
    Several { estimates: Vec<Named<'a>> },
}

/// An estimate with its path, as it was given.
#[derive(Debug, Serialize)]
struct Named<'a> {
    estimate: std::borrow::Cow<'a, str>,
    #[serde(flatten)]
    figures: Estimate,
}

#[derive(Debug, Serialize)]
struct Estimate {
    estimate_poses: usize,
    pairs: usize,
    #[serde(flatten)]
    first: Statistics,
    translation_m: Statistics,
    angle_deg: Statistics,
    rotation_part: Statistics,
    #[serde(skip_serializing_if = "Option::is_none")]
    alignment: Option<Motion>,
}

/// `truth_from_estimate`: scale · rotation · p + translation.
#[derive(Debug, Serialize)]
struct Motion {
    rotation: [[f64; 3]; 3],
    translation: [f64; 3],
    scale: f64,
}

pub(super) fn document<'a>(
    measure: &Measure,
    truth_poses: usize,
    compared: &[Compared<'a>],
) -> Document<'a> {
    let correction = measure.alignment.correction;
    let pairs = measure.motions.map(|motions| match motions {
        Motions::Over { delta_s } => Pairing::Over { delta_s },
        Motions::Between(pairs) => Pairing::Between {
            delta: pairs.delta,
            delta_unit: name_of(UNITS, &pairs.unit),
            all_pairs: pairs.all_pairs,
            delta_tol: pairs.all_pairs.then_some(pairs.tolerance),
            pairs_from_reference: pairs.from_truth,
        },
    });
    let found = match compared {
        [one] => Found::One(Box::new(estimate(correction, one))),
        several => {
            let named = |one: &Compared<'a>| Named {
                estimate: one.path.to_string_lossy(),
                figures: estimate(correction, one),
            };
            Found::Several { estimates: several.iter().map(named).collect() }
        }
    };
    Document {
        metric: measure.metric(),
        pose_relation: measure.relation.name(),
        unit: measure.relation.unit(),
        align: name_of(CORRECTIONS, &correction),
        n_to_align: measure.alignment.first_poses.map(std::num::NonZeroUsize::get),
        pairs,
        truth_poses,
        found,
    }
}

fn estimate(correction: Correction, compared: &Compared<'_>) -> Estimate {
    let result = &compared.result;
    let motion = || {
        let moved = &result.truth_from_estimate;
        let matrix = moved.rotation.matrix();
        Motion {
            rotation: [0, 1, 2].map(|row| [0, 1, 2].map(|column| matrix[(row, column)])),
            translation: moved.translation.into(),
            scale: moved.scale,
        }
    };
    Estimate {
        estimate_poses: compared.estimate.len(),
        pairs: result.pairs,
        first: compared.first,
        translation_m: result.translation_m,
        angle_deg: result.angle_deg,
        rotation_part: result.rotation_part,
        alignment: (correction != Correction::None).then(motion),
    }
}

/// The statistics of a relation that is shown; all results have translation and angle.
pub(super) fn statistics(compared: &Compared<'_>, relation: PoseRelation) -> Statistics {
    let Evaluation { translation_m, angle_deg, .. } = &compared.result;
    match relation {
        PoseRelation::TranslationPart => *translation_m,
        PoseRelation::AngleDeg => *angle_deg,
        PoseRelation::RotationPart
        | PoseRelation::Full
        | PoseRelation::AngleRad
        | PoseRelation::PointDistance
        | PoseRelation::PointDistanceErrorRatio => compared.first,
    }
}

/// The figures of statistics by evo's names.
pub(super) fn figures(statistics: &Statistics) -> [(&'static str, f64); 7] {
    let Statistics { count: _, rmse, mean, median, std, min, max, sse } = *statistics;
    [
        ("rmse", rmse),
        ("mean", mean),
        ("median", median),
        ("std", std),
        ("min", min),
        ("max", max),
        ("sse", sse),
    ]
}

/// The table for people.
pub(super) fn table(measure: &Measure, truth_poses: usize, compared: &[Compared<'_>]) -> String {
    match compared {
        [one] => table_of_one(measure, truth_poses, one),
        several => table_of_several(measure, truth_poses, several),
    }
}

fn table_of_one(measure: &Measure, truth_poses: usize, compared: &Compared<'_>) -> String {
    let (result, poses) = (&compared.result, compared.estimate.len());
    let mut text = format!(
        "{}\n{} pairs of {truth_poses} true and {poses} estimated poses",
        measure.title(),
        result.pairs
    );
    if measure.alignment.correction.has_scale() {
        text.push_str(&format!(", scale {:.6}", result.truth_from_estimate.scale));
    }
    let columns: Vec<(usize, String, _)> = measure
        .relations()
        .into_iter()
        .map(|relation| {
            let head = head(relation);
            let width = head.chars().count().max(14).next_multiple_of(2);
            (width, head, figures(&statistics(compared, relation)))
        })
        .collect();
    text.push_str(&format!("\n\n{:>8}", ""));
    for (width, head, _) in &columns {
        text.push_str(&format!("  {head:>width$}"));
    }
    for (row, (name, _)) in figures(&compared.first).into_iter().enumerate() {
        text.push_str(&format!("\n{name:>8}"));
        for (width, _, figures) in &columns {
            text.push_str(&format!("  {:>width$.6}", figures[row].1));
        }
    }
    text
}

fn table_of_several(measure: &Measure, truth_poses: usize, compared: &[Compared<'_>]) -> String {
    let title = format!("{}: {}", measure.title(), head(measure.relation));
    let has_scale = measure.alignment.correction.has_scale();
    let row = |one: &Compared<'_>| {
        let [rmse, mean, median, std, min, max, sse] =
            figures(&one.first).map(|(_, figure)| format!("{figure:.6}"));
        let (path, pairs) = (one.path.display().to_string(), one.result.pairs.to_string());
        let scale = format!("{:.6}", one.result.truth_from_estimate.scale);
        [path, pairs, rmse, mean, median, std, min, max, sse, scale]
    };
    let head = ["estimate", "pairs", "rmse", "mean", "median", "std", "min", "max", "sse", "scale"];
    let rows = compared.iter().map(row);
    let table = if has_scale {
        output::table(head, rows)
    } else {
        let [head @ .., _] = head;
        output::table::<9>(head, rows.map(|[row @ .., _]| row))
    };
    format!("{title}\n{truth_poses} true poses\n\n{table}")
}
