//! Tells the program how it was built: commit, target, profile, features, compiler (`covis --version`).
//!
//! The commit is `$COVIS_COMMIT` where a packager sets it, else git's, in release builds only: a debug
//! build would compile anew with each commit. Needs neither git nor a history, and no crate.

#![allow(clippy::print_stdout, reason = "a build script speaks to cargo")]

use std::env;
use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=COVIS_COMMIT");
    let of_cargo = |name: &str| env::var(name).unwrap_or_else(|_| "unknown".to_owned());
    let profile = of_cargo("PROFILE");
    let mut features: Vec<String> = env::vars()
        .filter_map(|(name, _)| Some(name.strip_prefix("CARGO_FEATURE_")?.to_lowercase()))
        .filter(|feature| feature != "default")
        .collect();
    features.sort();
    let features = if features.is_empty() { "none".to_owned() } else { features.join(", ") };
    let given = env::var("COVIS_COMMIT").ok().filter(|commit| !commit.trim().is_empty());
    let commit = match given {
        Some(commit) => commit.trim().to_owned(),
        None if profile == "release" => git_commit().unwrap_or_else(|| "unknown".to_owned()),
        None => "not told by debug builds".to_owned(),
    };
    let rustc = of_cargo("RUSTC");
    let compiler = first_line(Command::new(rustc).arg("--version"));
    for (name, value) in [
        ("COMMIT", commit),
        ("TARGET", of_cargo("TARGET")),
        ("PROFILE", profile),
        ("FEATURES", features),
        ("COMPILER", compiler.unwrap_or_else(|| "unknown".to_owned())),
    ] {
        println!("cargo::rustc-env=COVIS_BUILD_{name}={value}");
    }
}

/// The commit that is checked out, marked where files differ from it.
fn git_commit() -> Option<String> {
    let git = |arguments: &[&str]| first_line(Command::new("git").args(arguments));
    let commit = git(&["rev-parse", "HEAD"])?;
    // Another commit, or another branch, changes one of these files.
    for name in ["HEAD", "logs/HEAD"] {
        let path = git(&["rev-parse", "--git-path", name])?;
        if Path::new(&path).exists() {
            println!("cargo::rerun-if-changed={path}");
        }
    }
    let is_changed = git(&["status", "--porcelain", "--untracked-files=no"]).is_some();
    Some(if is_changed { format!("{commit}, changed") } else { commit })
}

/// The first line of what a program prints; `None` where it fails or prints nothing.
fn first_line(command: &mut Command) -> Option<String> {
    let output = command.output().ok().filter(|output| output.status.success())?;
    let text = String::from_utf8(output.stdout).ok()?;
    text.lines().next().map(str::to_owned)
}
