//! What a split solve tells besides its result: sections, workers, and where the time went.
//! Figures only; whoever solves fills them in.

use crate::bundle_adjustment::BundleSummary;

/// What sections were asked in a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// To be loaded and planned.
    Load,
    /// For their cost.
    Cost,
    /// To linearize and eliminate all but their border.
    Contribute,
    /// To take a step.
    Move,
}

/// One question to all sections.
#[derive(Clone, Debug, PartialEq)]
pub struct Round {
    /// Which.
    pub kind: Task,
    /// Section and the seconds that its worker took, in the order of the answers.
    pub tasks: Vec<(usize, f64)>,
    /// Seconds from the question to the last answer.
    pub seconds: f64,
}

/// A section.
#[derive(Clone, Debug, PartialEq)]
pub struct SectionReport {
    /// Its poses, those of its border included.
    pub poses: usize,
    /// Its landmarks.
    pub landmarks: usize,
    /// Its observations.
    pub observations: usize,
    /// What it takes in a worker, estimated, bytes.
    pub bytes: u64,
}

/// A worker.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WorkerReport {
    /// Its sections.
    pub sections: Vec<usize>,
    /// Most memory that its process ever had, bytes; 0 where unknown. Workers in one process share it.
    pub peak_bytes: u64,
    /// Seconds in which it worked.
    pub busy_seconds: f64,
    /// How often it was lost and started anew.
    pub restarts: usize,
}

/// The outcome of a split solve.
#[derive(Clone, Debug, PartialEq)]
pub struct SplitSummary {
    /// What the loop did, as without a split.
    pub bundle: BundleSummary,
    /// The sections.
    pub sections: Vec<SectionReport>,
    /// Poses that several sections may have.
    pub separator_poses: usize,
    /// Unknowns of the separators' system.
    pub separator_dimension: usize,
    /// The workers.
    pub workers: Vec<WorkerReport>,
    /// Every question to the sections, in order.
    pub rounds: Vec<Round>,
    /// Seconds to cut the problem.
    pub partition_seconds: f64,
    /// Seconds to write the sections to their file; 0 where they are sent.
    pub write_seconds: f64,
    /// Seconds of the solve in which the coordinator did not wait for workers.
    pub coordinator_seconds: f64,
}

impl SplitSummary {
    /// Seconds of all rounds of a kind.
    #[must_use]
    pub fn seconds_of(&self, kind: Task) -> f64 {
        self.rounds.iter().filter(|round| round.kind == kind).map(|round| round.seconds).sum()
    }

    /// Seconds that the solve would take with `workers` workers of which each serves the sections with
    /// its number modulo their count one after the other, from the measured times of all tasks: in each
    /// round the last worker counts, and the coordinator's own time is added.
    #[must_use]
    pub fn scheduled_seconds(&self, workers: usize) -> f64 {
        let workers = workers.max(1);
        let round = |round: &Round| {
            let mut sums = vec![0.0; workers];
            for &(section, seconds) in &round.tasks {
                sums[section % workers] += seconds;
            }
            sums.into_iter().fold(0.0, f64::max)
        };
        self.coordinator_seconds + self.rounds.iter().map(round).sum::<f64>()
    }
}
