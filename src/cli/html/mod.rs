//! `--report FILE`: what a command found as one HTML file. The subcommands say what is on the page; here is
//! what they share: the flag, the command line as a shell takes it, the file, and pages about solves and
//! trajectories.
//!
//! Pages are [`crate::report`]'s. They have no date and no name of the machine: the same input gives the same
//! bytes, so that two reports can be compared as files and kept beside results. Measured times differ.

pub(super) mod solve;
pub(super) mod trajectory;

use std::borrow::Cow;
use std::path::PathBuf;

use fs_err as fs;

use super::output::print;
use crate::report::Page;

/// The flag.
#[derive(Clone, Debug, Default, clap::Args)]
pub(super) struct ReportFlag {
    /// Write a report with plots and tables: one HTML file without scripts, for a browser.
    #[arg(long = "report", value_name = "FILE")]
    pub(super) path: Option<PathBuf>,
}

impl ReportFlag {
    /// Writes the page, where one is asked for.
    ///
    /// # Errors
    /// For a file that cannot be written.
    pub(super) fn write(&self, page: impl FnOnce() -> Page) -> anyhow::Result<()> {
        let Some(path) = &self.path else { return Ok(()) };
        Ok(fs::write(path, page().finish(concat!("covis ", env!("CARGO_PKG_VERSION"))))?)
    }

    /// Ends a command's text with the path of its page, if there is one.
    ///
    /// # Errors
    /// As those of [`print()`].
    pub(super) fn tell(&self, json: bool) -> anyhow::Result<()> {
        match &self.path {
            Some(path) if !json => print(format_args!("\nThe report is {}", path.display())),
            Some(_) | None => Ok(()),
        }
    }
}

/// A page with the command line of this process; `verdict` says in a sentence what came out of it.
pub(super) fn page(title: &str, verdict: &str, facts: &[(&str, String)]) -> Page {
    Page::new(title, &command_line(std::env::args_os()), verdict, facts)
}

/// The command as a shell takes it; the program by its name, wherever it is.
fn command_line(arguments: impl Iterator<Item = std::ffi::OsString>) -> String {
    let words = arguments.skip(1).map(|word| quoted(&word.to_string_lossy()).into_owned());
    std::iter::once("covis".to_owned()).chain(words).collect::<Vec<_>>().join(" ")
}

/// A word as a shell takes it.
fn quoted(word: &str) -> Cow<'_, str> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=,+@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        Cow::Borrowed(word)
    } else {
        Cow::Owned(format!("'{}'", word.replace('\'', "'\\''")))
    }
}

#[cfg(test)]
mod tests {
    use super::command_line;

    #[test]
    fn the_command_is_what_a_shell_takes() {
        let words = ["/usr/bin/covis", "solve", "my file.g2o", "--out=a,b", "it's", ""];
        let line = command_line(words.into_iter().map(Into::into));
        assert_eq!(line, "covis solve 'my file.g2o' --out=a,b 'it'\\''s' ''");
    }
}
