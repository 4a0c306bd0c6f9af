//! What reading uploaded files takes, before they are read: their words and bytes are counted in one pass
//! that holds a piece of them. What they mean is known to the parsers alone.
//!
//! What a job reads is priced before it is read, as a solve is: past the limit of one solve the job fails,
//! and what is read counts in `running_solve_bytes` as long as it is in memory.
//!
//! | kind | reads | what prices or bounds it |
//! |---|---|---|
//! | `optimize_map`, `reconstruct` of a map | a snapshot of the map | the map's own account; the solve by `Estimate::of_map` |
//! | `merge_maps` | snapshots of both maps | the map's own accounts; room in the target is reserved before |
//! | `compact_map` | a snapshot, and the one on disk to compare with | the map's own account; the file is read in pieces |
//! | `evaluate_trajectory` | the truth of a file | `reading`: words of the file, and matched poses |
//! | `evaluate_trajectory` | the truth of the spec | at most 10,000 poses, in the job's bytes as they are in memory |
//! | `export_map` | a snapshot | `exports`; files are made chunk by chunk, a pose graph by `Estimate::of_graph` |
//! | `solve_files`, `reconstruct` of files | the files of one problem | `reading`: words or bytes, until its solution is written |
//! | the same, by a worker | the files of one problem | a server sends them in pieces; the worker compares with the limit that came along |
//! | any with several problems | reports of the problems | one at a time, into the job's report |

use std::io::BufRead;
use std::sync::Arc;

use covis_solvers::io::colmap::ColmapEncoding;
use covis_solvers::io::reading::{Content, FileCounts};
use covis_solvers::price::{Ceiling, Price};
use covis_solvers::problem::SolveError;

use super::solving::Format;
use crate::service::context::Context;
use crate::service::error::ServiceError;
use crate::service::job_error::JobError;
use crate::store::{JobFile, JobFiles, JobUid};

impl Format {
    /// What the files of a problem hold.
    pub(super) fn content(self) -> Content {
        match self {
            Self::Bal => Content::Bal,
            Self::Graph => Content::Graph,
            Self::Colmap(ColmapEncoding::Text) => Content::ColmapText,
            Self::Colmap(ColmapEncoding::Binary) => Content::ColmapBinary,
        }
    }
}

/// Counts files of a job, by their numbers.
///
/// # Errors
/// [`JobError`].
pub(super) async fn count(
    files: &Arc<JobFiles>,
    uid: JobUid,
    inputs: Vec<u32>,
) -> Result<FileCounts, ServiceError> {
    let files = Arc::clone(files);
    let counted = Context::blocking(move || {
        let mut counts = FileCounts::default();
        for input in inputs {
            let add = |body: &mut dyn BufRead| {
                loop {
                    let piece = body.fill_buf()?;
                    let length = piece.len();
                    if length == 0 {
                        return Ok(());
                    }
                    counts.add(piece);
                    body.consume(length);
                }
            };
            files.read(&uid, JobFile::Input(input), add).map_err(JobError::from)?;
            counts.end_file();
        }
        Ok(counts)
    });
    counted.await
}

/// Refuses to read what takes more than a solve may.
///
/// # Errors
/// [`ServiceError::Unsolvable`] with [`SolveError::TooExpensive`].
pub(super) fn admit(
    field: &'static str,
    bytes: u64,
    ceiling: &Ceiling,
) -> Result<Price, ServiceError> {
    let price = Price { bytes, flops_per_iteration: 0.0 };
    let admitted = ceiling.admit(&price).map_err(SolveError::TooExpensive);
    admitted.map_err(|error| ServiceError::Unsolvable { field, error })?;
    Ok(price)
}
