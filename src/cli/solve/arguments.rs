//! Arguments that subcommands of `covis solve` share, and values of flags by their names.
//!
//! A table has each value's name and help once; reports print the same names. What a value does is
//! documented and done in the solver crate.

use std::path::PathBuf;

use covis_solvers::bundle_adjustment::LinearSolver;
use covis_solvers::initialization::Start;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::Method;
use covis_solvers::robust::Kernel;

use crate::cli::choices::Choices;
use crate::cli::html::ReportFlag;
use crate::cli::overwrite::Overwrite;

/// How false loop closures are found. By this name clap takes `None` for a value, not for absence.
pub(super) type Robust = Option<Kernel>;

/// Values of `--linear-solver`.
pub(super) const SOLVERS: &Choices<LinearSolver> = &[
    ("auto", LinearSolver::Auto, "The cheapest by its cost, which may change during a solve"),
    ("dense-schur", LinearSolver::DenseSchur, "A dense factorization"),
    ("sparse-schur", LinearSolver::SparseSchur, "A sparse factorization"),
    (
        "iterative-schur",
        LinearSolver::IterativeSchur,
        "Conjugate gradients, without a factorization",
    ),
];

/// Values of `--method`.
pub(super) const METHODS: &Choices<Method> = &[
    ("lm", Method::LevenbergMarquardt, "Levenberg-Marquardt"),
    ("gn", Method::GaussNewton, "Gauss-Newton"),
];

/// Values of `--init`.
pub(super) const STARTS: &Choices<Start> = &[
    ("given", Start::Given, "The vertices of the file"),
    (
        "odometry",
        Start::Odometry,
        "Measurements between consecutive ids, chained; closures only where such a chain ends",
    ),
    (
        "spanning-tree",
        Start::SpanningTree,
        "Measurements chained along a spanning tree, as few as possible to each vertex",
    ),
    ("chordal", Start::Chordal, "Relaxed rotations, then positions"),
    (
        "auto",
        Start::Auto,
        "The vertices of the file or the chordal start, whichever has the lower cost",
    ),
];

/// Values of `--robust`.
pub(super) const KERNELS: &Choices<Robust> = &[
    ("none", None, "Trust all closures"),
    ("gnc-tls", Some(Kernel::TruncatedLeastSquares), "Truncated least squares"),
    ("gnc-gm", Some(Kernel::GemanMcClure), "Geman-McClure"),
];

/// What both kinds of problem share.
#[derive(Debug, clap::Args)]
pub(super) struct Shared {
    /// Maximum number of iterations, rejected ones included.
    #[arg(long, value_name = "N", default_value_t = 100)]
    pub(super) max_iterations: usize,
    /// Robust loss of every factor: trivial, huber:W or cauchy:W, W in standard deviations.
    #[arg(long, value_name = "LOSS", default_value = "trivial", value_parser = loss)]
    pub(super) loss: Loss,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    pub(super) json: bool,
    /// Write the solved problem in the input's own format, with 17 digits; that of OpenMVG as a folder with a
    /// COLMAP sparse model.
    #[arg(long, value_name = "PATH")]
    pub(super) out: Option<PathBuf>,
    #[command(flatten)]
    pub(super) overwrite: Overwrite,
    #[command(flatten)]
    pub(super) report: ReportFlag,
}

/// Parses the argument; the error is a sentence for clap.
fn loss(text: &str) -> Result<Loss, String> {
    let wrong = || "must be trivial, huber:W or cauchy:W with a positive W".to_owned();
    let loss = match text.split_once(':') {
        None if text == "trivial" => Loss::Trivial,
        Some(("huber", width)) => Loss::Huber(width.parse().map_err(|_error| wrong())?),
        Some(("cauchy", width)) => Loss::Cauchy(width.parse().map_err(|_error| wrong())?),
        None | Some(_) => return Err(wrong()),
    };
    if loss.is_valid() { Ok(loss) } else { Err(wrong()) }
}

#[cfg(test)]
mod tests {
    use covis_solvers::loss::Loss;

    use super::loss;

    #[test]
    fn reads_the_three_forms_and_refuses_others() {
        assert_eq!(loss("trivial"), Ok(Loss::Trivial));
        assert_eq!(loss("huber:1.5"), Ok(Loss::Huber(1.5)));
        assert_eq!(loss("cauchy:2"), Ok(Loss::Cauchy(2.0)));
        for text in ["", "huber", "huber:", "huber:-1", "cauchy:nan", "cauchy:inf", "tukey:1"] {
            assert!(loss(text).is_err(), "{text}");
        }
    }
}
