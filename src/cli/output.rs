//! Standard output for people and scripts, and how the program ends.
//!
//! All of the cli's output goes through [`print()`], so that a reader that closes the pipe early
//! (`covis … | head`) ends the program quietly and successfully, and only it: a broken connection
//! to a server stays an error. Exit codes: 0 success, 1 failure, 2 wrong usage.

use std::fmt::Display;
use std::io::{self, Write};
use std::path::Path;
use std::process::ExitCode;

use anyhow::bail;
use serde::Serialize;

use super::advice::next_step;
use crate::client::ClientError;
use crate::service::escaped;

/// The reader of standard output went away; not a failure.
#[derive(Debug, thiserror::Error)]
#[error("standard output was closed")]
pub(super) struct ClosedPipe;

/// Writes one line (or several) to standard output and flushes it. What a terminal would obey is escaped:
/// names of other clients are among what is printed.
///
/// # Errors
/// [`ClosedPipe`] where the reader has gone; any other error of the system.
pub(super) fn print(text: impl Display) -> anyhow::Result<()> {
    let text = text.to_string();
    let text = escaped(&text, &['\n', '\t']);
    let mut out = io::stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Ok(()) => Ok(()),
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Err(ClosedPipe.into()),
        Err(error) => Err(anyhow::Error::new(error).context("standard output")),
    }
}

/// As [`print()`], of a line that nobody needs to read for the program to be of use.
pub(super) fn announce(text: impl Display) -> anyhow::Result<()> {
    match print(text) {
        Err(error) if error.is::<ClosedPipe>() => Ok(()),
        printed => printed,
    }
}

/// Prints what a command found: as one JSON object, or as text for people.
///
/// # Errors
/// As those of [`print()`].
pub(super) fn show<T: Display>(
    json: bool,
    document: &impl Serialize,
    text: impl FnOnce() -> T,
) -> anyhow::Result<()> {
    if json { print(serde_json::to_string(document)?) } else { print(text()) }
}

/// The names of columns, then lines of cells, those of a column below each other.
pub(super) fn table<const N: usize>(
    head: [&str; N],
    rows: impl Iterator<Item = [String; N]>,
) -> String {
    let rows = rows.map(|row| row.map(|cell| escaped(&cell, &[]).into_owned()));
    let lines: Vec<[String; N]> = std::iter::once(head.map(str::to_owned)).chain(rows).collect();
    let width = |column: usize| lines.iter().map(|line| line[column].chars().count()).max();
    let widths: Vec<usize> = (0..N).map(|column| width(column).unwrap_or(0)).collect();
    let text = |line: &[String; N]| {
        let cells = line.iter().zip(&widths).map(|(cell, &width)| format!("{cell:<width$}"));
        cells.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    lines.iter().map(text).collect::<Vec<_>>().join("\n")
}

/// Sees before the work, not after it, that the folder of a file to write is there.
///
/// # Errors
/// Where it is not.
pub(super) fn writable(out: Option<&Path>) -> anyhow::Result<()> {
    let folder = out.and_then(Path::parent).filter(|folder| !folder.as_os_str().is_empty());
    match (out, folder) {
        (Some(out), Some(folder)) if !folder.is_dir() => {
            bail!("{}: cannot be written: there is no folder {}", out.display(), folder.display())
        }
        _ => Ok(()),
    }
}

/// What a command found bad is printed already; only its exit code is left to tell.
#[derive(Debug, thiserror::Error)]
#[error("not all is good")]
struct AlreadyPrinted(u8);

/// The exit code of a program that a signal ended, as shells have it.
pub(super) fn signal_code(signal: &str) -> u8 {
    if signal == "SIGTERM" { 143 } else { 130 }
}

/// Ends a command that has written what there was when the signal came.
pub(super) fn ended_by(signal: &str) -> anyhow::Error {
    AlreadyPrinted(signal_code(signal)).into()
}

/// Ends a command that has printed all it has to say with success or failure.
pub(super) fn succeed_if(is_good: bool) -> anyhow::Result<()> {
    if is_good { Ok(()) } else { Err(AlreadyPrinted(1).into()) }
}

/// Turns a command's result into an exit code; an error becomes one line on standard error.
pub(super) fn exit_code(result: anyhow::Result<()>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if error.is::<ClosedPipe>() => ExitCode::SUCCESS,
        Err(error) => {
            if let Some(AlreadyPrinted(code)) = error.downcast_ref() {
                return ExitCode::from(*code);
            }
            // Nothing can be told when standard error is gone as well.
            let next = next_step(&error).map(|step| format!("; {step}")).unwrap_or_default();
            let _ = writeln!(io::stderr(), "error: {}{next}", one_line(&error));
            ExitCode::FAILURE
        }
    }
}

/// The chain of causes, outermost first. A cause that its parent's text ends with is not repeated.
fn one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain() {
        // A user of commands need not know the calls that they make.
        let text = cause.downcast_ref::<ClientError>().map(ClientError::without_call);
        let text = text.unwrap_or_else(|| cause.to_string()).replace('\n', " ");
        let text = escaped(&text, &['\t']).into_owned();
        if line.is_empty() {
            line = text;
        } else if !line.ends_with(&text) {
            line.push_str(": ");
            line.push_str(&text);
        }
    }
    line
}

#[cfg(test)]
mod tests {
    use anyhow::anyhow;

    use super::{ClientError, one_line};

    #[test]
    fn an_error_of_a_call_does_not_name_it() {
        let error = ClientError::Protocol { rpc: "GetMap", what: "no map" };
        assert_eq!(
            one_line(&anyhow::Error::new(error).context("reading it")),
            "reading it: no map"
        );
    }

    #[test]
    fn the_chain_of_causes_is_one_line_without_repetitions() {
        let error = anyhow!("no such file").context("cannot be read: no such file");
        assert_eq!(one_line(&error), "cannot be read: no such file");
        let error = anyhow!("line 3:\nbad").context("map.txt");
        assert_eq!(one_line(&error), "map.txt: line 3: bad");
        let error = anyhow!("bad \u{1b}[31m name");
        assert_eq!(one_line(&error), "bad \\u001b[31m name");
    }
}
