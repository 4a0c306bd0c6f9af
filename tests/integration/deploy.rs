//! The files in `deploy/` fit this program: man pages, completions, and the commands of units,
//! images and manifests.
//!
//! `COVIS_TEST_REGENERATE=1 cargo test --test integration generated` writes man pages and completions
//! that have changed.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use clap_complete::Shell;
use covis_solvers::testing::skip;

fn deploy() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy")
}

fn names(folder: &Path) -> BTreeSet<String> {
    let entries = fs_err::read_dir(folder).into_iter().flatten();
    entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn generated_man_pages_and_completions_are_those_of_the_arguments() {
    let made = tempfile::tempdir().unwrap();
    let (man, completions) = (made.path().join("man"), made.path().join("completions"));
    fs_err::create_dir(&man).unwrap();
    fs_err::create_dir(&completions).unwrap();
    // Facts of a build are not those of another one.
    let mut command =
        covis::cli::command().long_version(clap::builder::Resettable::<clap::builder::Str>::Reset);
    clap_mangen::generate_to(command.clone(), &man).unwrap();
    for shell in [Shell::Bash, Shell::Fish, Shell::Zsh] {
        clap_complete::generate_to(shell, &mut command, "covis", &completions).unwrap();
    }
    let writes = std::env::var_os("COVIS_TEST_REGENERATE").is_some();
    let mut stale = Vec::new();
    for kind in ["man", "completions"] {
        let (made, kept) = (made.path().join(kind), deploy().join("generated").join(kind));
        for name in names(&made).union(&names(&kept)) {
            let read = |folder: &Path| fs_err::read(folder.join(name)).ok();
            let (new, old) = (read(&made), read(&kept));
            match new {
                new if new == old => {}
                Some(new) if writes => {
                    fs_err::create_dir_all(&kept).unwrap();
                    fs_err::write(kept.join(name), new).unwrap();
                }
                None if writes => fs_err::remove_file(kept.join(name)).unwrap(),
                Some(_) | None => stale.push(format!("{kind}/{name}")),
            }
        }
    }
    assert!(stale.is_empty(), "not of the arguments as they are: {stale:?}; see this file's head");
}

/// The lists of words that stand as JSON behind `key` in a file.
fn lists(file: &str, key: &str) -> Vec<Vec<String>> {
    let text = fs_err::read_to_string(deploy().join(file)).unwrap();
    let lines = text.lines().filter_map(|line| line.trim().strip_prefix(key));
    lines.map(|list| serde_json::from_str(list.trim()).unwrap()).collect()
}

/// Panics where the program does not take these arguments.
#[track_caller]
fn check(file: &str, arguments: &[String]) {
    let all = std::iter::once("covis").chain(arguments.iter().map(String::as_str));
    if let Err(error) = covis::cli::command().try_get_matches_from(all) {
        panic!("{file}: {error}");
    }
}

#[test]
fn every_command_of_units_images_and_manifests_is_one_that_covis_takes() {
    let mut count = 0;
    for (file, key) in [
        ("compose.yaml", "command:"),
        ("compose.cluster.yaml", "command:"),
        ("kubernetes/covis.yaml", "args:"),
        ("kubernetes/covis.yaml", "command:"),
        ("kubernetes/worker.yaml", "args:"),
        ("Dockerfile", "CMD"),
    ] {
        for mut arguments in lists(file, key) {
            if arguments.iter().any(|word| word == "/etc/nats/server.conf") {
                continue;
            }
            if arguments.first().is_some_and(|word| word == "/covis") {
                arguments.remove(0);
            }
            check(file, &arguments);
            count += 1;
        }
    }
    let unit = fs_err::read_to_string(deploy().join("systemd/covis.service")).unwrap();
    let start = unit.lines().find_map(|line| line.strip_prefix("ExecStart=/usr/bin/covis "));
    let words: Vec<String> = start.unwrap().split_whitespace().map(str::to_owned).collect();
    check("covis.service", &words);
    assert!(count >= 6, "{count} commands");
}

#[test]
fn the_configuration_of_the_manifests_is_one_that_covis_takes() {
    let text = fs_err::read_to_string(deploy().join("kubernetes/covis.yaml")).unwrap();
    let (_, rest) = text.split_once("covis.toml: |\n").unwrap();
    let lines = rest.lines().map_while(|line| line.strip_prefix("    "));
    let toml: Vec<&str> = lines.collect();
    assert!(toml.len() > 5, "{toml:?}");
    covis::cli::config::Config::parse(&toml.join("\n"), Path::new("covis.toml")).unwrap();
}

#[test]
fn the_image_is_built_with_the_toolchain_that_is_pinned() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let toolchain = fs_err::read_to_string(root.join("rust-toolchain.toml")).unwrap();
    let pinned = toolchain.lines().find_map(|line| line.strip_prefix("channel = "));
    let pinned = pinned.unwrap().trim_matches('"');
    let image = fs_err::read_to_string(deploy().join("Dockerfile")).unwrap();
    assert!(image.contains(&format!("FROM rust:{pinned}-alpine AS build")), "{pinned}");
    assert!(image.contains(&format!("RUSTUP_TOOLCHAIN={pinned}")), "{pinned}");
}

#[test]
fn systemd_takes_the_unit() {
    let unit = deploy().join("systemd/covis.service");
    let Ok(verified) = Command::new("systemd-analyze").arg("verify").arg(&unit).output() else {
        skip("no systemd-analyze");
        return;
    };
    let told = String::from_utf8_lossy(&verified.stderr).into_owned();
    // Neither the program nor its man page is installed here.
    let bad = told.lines().filter(|line| {
        line.contains("covis.service")
            && !line.contains("is not executable")
            && !line.contains("man covis-serve(1)")
    });
    assert_eq!(bad.collect::<Vec<_>>(), Vec::<&str>::new());
}
