//! How files look: heads, sizes, names, spelling.

use crate::report;
use crate::source::{File, files, rust_files};

/// A file longer than this has more to say at its head than one line.
const SHORT: usize = 60;

/// Verbs whose British ending is `ise`.
const STEMS: [&str; 34] = [
    "normal", "optim", "linear", "marginal", "initial", "parallel", "minim", "maxim", "regular",
    "organ", "recogn", "real", "general", "serial", "synchron", "visual", "final", "special",
    "util", "summar", "material", "quant", "discret", "vector", "custom", "equal", "factor",
    "penal", "priorit", "stabil", "symmetr", "central", "author", "categor",
];

/// Other words in British spelling; part of a longer word counts.
const WORDS: [&str; 13] = [
    "colour",
    "neighbour",
    "centre",
    "behaviour",
    "favour",
    "honour",
    "labelled",
    "labelling",
    "modelling",
    "travelled",
    "metres",
    "grey",
    "artefact",
];

/// This rule's own files name what they forbid.
fn is_tidy(file: &File) -> bool {
    file.path.starts_with("tests/tidy")
}

fn head(text: &str) -> Vec<&str> {
    text.lines().take_while(|line| line.starts_with("//!")).collect()
}

#[test]
fn every_file_opens_with_its_head() {
    let mut offenders = Vec::new();
    for file in rust_files() {
        let head = head(&file.text);
        let small = file.is_test() || file.path.contains("tests/");
        let wanted = if small || file.text.lines().count() <= SHORT { 1 } else { 2 };
        if head.len() < wanted {
            offenders.push(format!("{}: {} line(s) of `//!`, not {wanted}", file.path, head.len()));
        }
        let unfinished = ["placeholder", "todo", "fixme", "not written", "until its author"];
        let said = head.join(" ").to_lowercase();
        offenders.extend(
            unfinished
                .iter()
                .filter(|word| said.contains(**word) && !is_tidy(&file))
                .map(|word| format!("{}: its head says \"{word}\"", file.path)),
        );
    }
    report("Every Rust file says at its head what it is.", &offenders);
}

#[test]
fn tests_are_all_run() {
    let mut offenders = Vec::new();
    for file in rust_files().iter().filter(|f| !is_tidy(f)) {
        for (number, line) in file.text.lines().enumerate() {
            let line = line.trim_start();
            if line.starts_with("#[ignore") || line.starts_with("#[should_panic") {
                offenders.push(format!("{}:{}: {line}", file.path, number + 1));
            }
        }
    }
    report("No test is ignored and none expects a panic.", &offenders);
}

#[test]
fn tests_start_processes_by_the_guard_and_need_no_program_for_signals() {
    let guard = "tests/integration/process.rs";
    let mut offenders = Vec::new();
    for file in rust_files().iter().filter(|f| f.path.contains("tests/")) {
        for (number, line) in file.text.lines().enumerate() {
            // A `Command` is the only thing that is spawned without an argument.
            let spawns = line.contains(".spawn()") && file.path != guard;
            if !is_tidy(file) && (spawns || line.contains("Command::new(\"kill\")")) {
                offenders.push(format!("{}:{}: {}", file.path, number + 1, line.trim()));
            }
        }
    }
    report("Tests start processes by `Process`, which ends them with the test.", &offenders);
}

#[test]
fn nothing_names_a_machine() {
    let registries = ["crates", "pypi", "npmjs", "rubygems", "pythonhosted"];
    let hosts: Vec<String> = registries
        .iter()
        .flat_map(|name| ["io", "org", "com"].iter().map(move |end| format!("{name}.{end}")))
        .collect();
    let homes = ["/home/", "/root/", "/Users/", "/work/"];
    let mut offenders = Vec::new();
    // A lock file names where packages come from; that of `fuzz` lies about after a run.
    let is_read = |file: &&File| !is_tidy(file) && !file.path.ends_with("Cargo.lock");
    for file in files().iter().filter(is_read) {
        for (number, line) in file.text.lines().enumerate() {
            let hosts = hosts.iter().map(String::as_str).filter(|host| line.contains(host));
            let homes = homes.iter().copied().filter(|home| absolute(line, home));
            for word in hosts.chain(homes) {
                offenders.push(format!("{}:{}: {word}", file.path, number + 1));
            }
        }
    }
    report("No file names a machine's own path or a package registry's host.", &offenders);
}

/// Whether `home` begins a path in `line`, rather than standing inside a relative one or a URL.
fn absolute(line: &str, home: &str) -> bool {
    line.match_indices(home).any(|(at, _)| {
        let before = line[..at].chars().next_back();
        !before.is_some_and(|c| c.is_alphanumeric() || "._-/*~$})".contains(c))
    })
}

#[test]
fn spelling_is_american() {
    let mut offenders = Vec::new();
    let rooms = [
        "src", "client", "dense", "frontend", "map", "reports", "solvers", "store", "docs",
        "proto", "tests", "examples", "benches", "fuzz", "python", "page",
    ];
    let read = ["rs", "proto", "md", "toml", "py", "js", "mjs", "css", "html"];
    for file in files() {
        let top = !file.path.contains('/');
        let inside = top || rooms.iter().any(|room| file.is_in(room));
        if !inside || !read.contains(&file.extension()) || is_tidy(&file) {
            continue;
        }
        for (number, line) in file.text.lines().enumerate() {
            // The attribute of ARIA is spelled so.
            let line = line.to_lowercase().replace("aria-labelledby", "");
            let british = |stem: &&&str| {
                ["ise", "ising", "isation"].iter().any(|end| line.contains(&format!("{stem}{end}")))
            };
            let stems = STEMS.iter().filter(british).map(|stem| format!("{stem}ise"));
            let words = WORDS.iter().filter(|w| line.contains(**w)).map(|w| (*w).to_owned());
            for word in stems.chain(words) {
                offenders.push(format!("{}:{}: {word}", file.path, number + 1));
            }
        }
    }
    report("Spelling is American.", &offenders);
}
