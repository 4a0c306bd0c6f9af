//! The floors of the engine: parts own their state and know neither each other nor who calls them.

use std::collections::BTreeMap;

use crate::report;
use crate::source::rust_files;

/// The modules of `src/service/engine`, lowest floor first. A module uses those on lower floors.
const FLOORS: [&[&str]; 10] = [
    &["error", "cancellation"],
    &["account", "outcome", "places", "measured_pairs"],
    &["pool", "meters"],
    &["context"],
    &["merged_name", "events"],
    &["ingest", "journal", "solving", "recognition", "watching"],
    &["actor"],
    &["handle"],
    &["maps"],
    &["mod"],
];

const ENGINE: &str = "crate::service::engine::";

/// The module that each name of `mod.rs` comes from.
fn exported(text: &str) -> BTreeMap<String, String> {
    let mut names = BTreeMap::new();
    for statement in text.split(';').filter_map(|part| part.split("pub use ").nth(1)) {
        let module = statement.split("::").next().unwrap_or_default();
        let list = statement.rsplit("::").next().unwrap_or_default();
        for name in list.split(|c: char| !(c.is_alphanumeric() || c == '_')) {
            names.insert(name.to_owned(), module.to_owned());
        }
    }
    names
}

/// What a file names of the engine: the first word of each path.
fn named(text: &str) -> Vec<String> {
    let mut words = Vec::new();
    for rest in text.split(ENGINE).skip(1) {
        let is_list = rest.starts_with('{');
        let list = if is_list { rest.split('}').next().unwrap_or(rest) } else { rest };
        for part in list.trim_start_matches('{').split(',') {
            let part = part.trim();
            let end = part.find(|c: char| !(c.is_alphanumeric() || c == '_'));
            words.push(part[..end.unwrap_or(part.len())].to_owned());
            if !is_list {
                break;
            }
        }
    }
    words.retain(|word| !word.is_empty());
    words
}

#[test]
fn modules_of_the_engine_use_only_lower_floors() {
    let floor = |module: &str| FLOORS.iter().position(|floor| floor.contains(&module));
    let files: Vec<_> =
        rust_files().into_iter().filter(|file| file.is_in("src/service/engine")).collect();
    let names = files.iter().find(|file| file.path.ends_with("engine/mod.rs"));
    let names = exported(&names.expect("the engine has a mod.rs").text);
    let mut offenders = Vec::new();
    for file in &files {
        let inside = file.path.split_once("service/engine/").map_or("", |(_, rest)| rest);
        let own = inside.split('/').next().unwrap_or(inside).trim_end_matches(".rs");
        let Some(here) = floor(own) else {
            offenders.push(format!("{}: `{own}` is on no floor", file.path));
            continue;
        };
        for word in named(&file.text) {
            let module = names.get(&word).unwrap_or(&word);
            let is_above = floor(module).is_some_and(|floor| floor >= here);
            if module != own && is_above {
                offenders.push(format!("{}: `{word}` of `{module}`", file.path));
            }
        }
    }
    assert!(files.len() > 30 && !names.is_empty(), "the engine was found");
    report("Modules of the engine use only lower floors (tests/tidy/engine.rs).", &offenders);
}
