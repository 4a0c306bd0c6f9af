//! `covis job`: submits, lists, shows, watches, cancels and deletes the jobs of a server.
//!
//! Everything goes through [`crate::client`]. `submit.rs` makes a spec of arguments, `files.rs` finds
//! and sends the files of a problem, `document.rs` prints a job. What a job does is the server's.

mod document;
mod files;
mod page;
mod submit;

use std::path::PathBuf;

use anyhow::Context;

use self::document::{Document, details, line, table};
use super::choices::{Choices, choice};
use super::config::Config;
use super::connect::with_client;
use super::html::ReportFlag;
use super::map::{path_lines, write_files};
use super::output::{print, show, succeed_if};
use super::overwrite::Overwrite;
use super::signals::Signals;
use crate::client::{Client, RetryPolicy};
use crate::wire::v1;
use v1::JobState;

/// The report among a job's files.
const REPORT: &str = "report.json";

/// Submits, lists, shows, watches, cancels and deletes the jobs of a server.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(subcommand)]
    action: Action,
    /// Print JSON instead of text.
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    /// Create a job on a map of the server, or on files that are sent to it.
    Submit(submit::Args),
    /// List the jobs, the newest first.
    #[command(visible_alias = "ls")]
    List {
        /// Only jobs on this map.
        #[arg(long, value_name = "NAME")]
        map: Option<String>,
        /// Only jobs in this state; may be repeated.
        #[arg(long, value_name = "STATE", value_parser = choice(STATES))]
        state: Vec<JobState>,
    },
    /// Show a job with its report.
    Show {
        /// The job.
        id: String,
        #[command(flatten)]
        report: ReportFlag,
    },
    /// Follow a job to its end and print a line at each change.
    Watch {
        /// The job.
        id: String,
    },
    /// Ask a job to stop without applying its result.
    Cancel {
        /// The job.
        id: String,
    },
    /// Delete a job that has ended, with its files.
    #[command(visible_alias = "rm")]
    Delete {
        /// The job.
        id: String,
    },
    /// Write the files that a job made: the report, solved problems, an export.
    Fetch {
        /// The job.
        id: String,
        /// The folder.
        #[arg(long, value_name = "PATH")]
        out: PathBuf,
        #[command(flatten)]
        overwrite: Overwrite,
    },
}

/// States by their names.
const STATES: &Choices<JobState> = &[
    ("pending", JobState::Pending, ""),
    ("running", JobState::Running, ""),
    ("succeeded", JobState::Succeeded, ""),
    ("failed", JobState::Failed, ""),
    ("cancelled", JobState::Cancelled, ""),
];

/// Does what the arguments say.
/// Fails for a server that is not there, a job that it does not have, a file that cannot be read or
/// written, and, where the job was waited for, a job that did not succeed.
pub(super) fn run(args: Args, config: &Config) -> anyhow::Result<()> {
    with_client(config, async |client| act(args, client).await)
}

async fn act(Args { action, json }: Args, client: Client) -> anyhow::Result<()> {
    match action {
        Action::Submit(args) => submit::submit(&client, args, json).await,
        Action::List { map, state } => {
            let request = v1::ListJobsRequest {
                map_id: map.unwrap_or_default(),
                states: state.into_iter().map(JobState::into).collect(),
                ..v1::ListJobsRequest::default()
            };
            let jobs = client.jobs(request).await?;
            let jobs: Vec<Document> = jobs.into_iter().map(Document::from).collect();
            show(json, &jobs, || table(&jobs))
        }
        Action::Show { id, report } => {
            let job = described(&client, client.job(&id).await?).await?;
            report.write(|| page::page(&job))?;
            show(json, &job, || details(&job))?;
            report.tell(json)
        }
        Action::Watch { id } => {
            let job = to_end(&client, &id, |job| {
                let document = Document::from(job.clone());
                if json { print(serde_json::to_string(&document)?) } else { print(line(&document)) }
            });
            succeed_if(job.await?.state() == JobState::Succeeded)
        }
        Action::Cancel { id } => {
            let job = Document::from(client.cancel_job(&id).await?);
            show(json, &job, || line(&job))
        }
        Action::Delete { id } => {
            client.delete_job(&id).await?;
            let document = serde_json::json!({ "id": id, "deleted": true });
            show(json, &document, || format!("job {id} is deleted"))
        }
        Action::Fetch { id, out, overwrite } => {
            let mut download = client.download_job_files(&id, None).await?;
            let paths: Vec<String> = download.files().iter().map(|f| f.path.clone()).collect();
            anyhow::ensure!(!paths.is_empty(), "job {id} has made no files");
            fs_err::create_dir_all(&out)?;
            let files =
                write_files(&paths, async || download.next().await, &out, overwrite).await?;
            let document = serde_json::json!({ "id": id, "files": files });
            show(json, &document, || path_lines(&files))
        }
    }
}

/// As [`follow`]; a signal ends the waiting and not the job, and the error says so.
async fn to_end(
    client: &Client,
    id: &str,
    on_change: impl FnMut(&v1::Job) -> anyhow::Result<()>,
) -> anyhow::Result<v1::Job> {
    let mut signals = Signals::new().context("signal handlers")?;
    tokio::select! {
        job = follow(client, id, on_change) => job,
        signal = signals.next() => anyhow::bail!(
            "{signal}; job {id} continues: `covis job watch {id}` follows it, `covis job cancel {id}` \
             stops it"
        ),
    }
}

/// Follows a job to its end, also over a server that restarts.
async fn follow(
    client: &Client,
    id: &str,
    mut on_change: impl FnMut(&v1::Job) -> anyhow::Result<()>,
) -> anyhow::Result<v1::Job> {
    let failure = std::cell::RefCell::new(None);
    let on_change = std::cell::RefCell::new(&mut on_change);
    let watch = || {
        client.watch_job(id, |job| {
            if failure.borrow().is_none()
                && let Err(error) = (on_change.borrow_mut())(job)
            {
                *failure.borrow_mut() = Some(error);
            }
        })
    };
    let job = RetryPolicy::default().run(watch).await?;
    failure.into_inner().map_or(Ok(job), Err)
}

/// A job with the report that it made.
async fn described(client: &Client, job: v1::Job) -> anyhow::Result<Document> {
    let has_report = job.state() == JobState::Succeeded;
    let mut document = Document::from(job);
    if has_report {
        let bytes = client.job_file(&document.id, REPORT).await?;
        document.report = Some(serde_json::from_slice(&bytes).context("the report")?);
    }
    Ok(document)
}
