//! Robustness to false loop closures, and the results of a solve about closures and the chordal
//! cost.

use covis_solvers::graph_optimization::Proof;
use covis_solvers::robust::Kernel;

use super::{Path, Violations, small};
use crate::map::ClosureRobustness;
use crate::wire::v1;

/// How closures are judged; absent fields are those of `default`.
pub(in crate::service) fn robustness(
    at: Path<'_>,
    message: Option<&v1::ClosureRobustness>,
    default: ClosureRobustness,
    out: &mut Violations,
) -> Option<ClosureRobustness> {
    let Some(m) = message else { return Some(default) };
    let kernel = match out.known::<v1::RobustKernel>(at.field("kernel"), m.kernel) {
        None => None,
        Some(v1::RobustKernel::Unspecified) => Some(default.kernel),
        Some(v1::RobustKernel::None) => Some(None),
        Some(v1::RobustKernel::GncTls) => Some(Some(Kernel::TruncatedLeastSquares)),
        Some(v1::RobustKernel::GncGm) => Some(Some(Kernel::GemanMcClure)),
    };
    let threshold = match m.threshold {
        None => Some(default.threshold),
        Some(threshold) => out.positive(at.field("threshold"), threshold).map(Some),
    };
    Some(ClosureRobustness { kernel: kernel?, threshold: threshold? })
}

/// The message of how a map's closures are judged, its default threshold filled in.
pub(in crate::service) fn to_robustness(robustness: &ClosureRobustness) -> v1::ClosureRobustness {
    let kernel = match robustness.kernel {
        None => v1::RobustKernel::None,
        Some(Kernel::TruncatedLeastSquares) => v1::RobustKernel::GncTls,
        Some(Kernel::GemanMcClure) => v1::RobustKernel::GncGm,
    };
    v1::ClosureRobustness {
        kernel: kernel.into(),
        threshold: Some(robustness.threshold_of_dimension(6)),
    }
}

/// The message of a chordal certificate that took `seconds`.
pub(in crate::service) fn to_chordal_certificate(
    Proof { certificate, seconds }: &Proof,
) -> v1::ChordalCertificate {
    v1::ChordalCertificate {
        certified: certificate.certified,
        cost: certificate.cost,
        gap: certificate.gap,
        min_eigenvalue: certificate.min_eigenvalue,
        lift_count: small(certificate.lifts),
        duration_us: super::solve::microseconds(*seconds),
    }
}
