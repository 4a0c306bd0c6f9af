//! In place of `of_run` in a program that was built without MCAP: a recording that cannot be started.
//!
//! Its functions are those of `of_run`, so that `covis run` is written once for both builds.

use std::path::Path;

use super::LACKING;
use crate::client::Client;
use crate::frontend::dense::surface::Mesh;
use crate::frontend::image::RgbdFrame;
use crate::frontend::mapping::run::RunReport;
use crate::frontend::pipeline::Outcome;

/// There is none.
#[derive(Debug)]
pub(in crate::cli) enum RunRecording {}

/// There is none.
#[derive(Debug)]
pub(in crate::cli) enum FrameWriter {}

impl RunRecording {
    #[allow(clippy::unused_async, reason = "as the one of a program that records")]
    pub(in crate::cli) async fn start(
        _client: &Client,
        _map_and_client: (&str, &str),
        path: &Path,
        _lock_step: bool,
    ) -> anyhow::Result<Self> {
        anyhow::bail!("--mcap {}: {LACKING}", path.display())
    }

    pub(in crate::cli) fn frames(&self) -> FrameWriter {
        match *self {}
    }

    #[allow(clippy::unused_async, reason = "as the one of a program that records")]
    pub(in crate::cli) async fn finish(
        self,
        _frames: FrameWriter,
        _report: &RunReport,
        _mesh: Option<&Mesh>,
    ) -> anyhow::Result<u64> {
        match self {}
    }
}

impl FrameWriter {
    pub(in crate::cli) fn tracked(&mut self, _frame: &RgbdFrame, _outcome: &Outcome) {
        match *self {}
    }
}
