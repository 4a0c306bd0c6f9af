//! `covis completions`: what a shell completes after `covis`, made of the arguments themselves.
//!
//! A build knows its own arguments, so that these are never those of another version.

use clap_complete::{Shell, generate};

use super::output::print;

/// Arguments of `covis completions`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The shell.
    shell: Shell,
}

/// Prints them.
pub(super) fn run(args: &Args) -> anyhow::Result<()> {
    let mut text = Vec::new();
    generate(args.shell, &mut super::command(), "covis", &mut text);
    print(String::from_utf8(text)?.trim_end())
}
