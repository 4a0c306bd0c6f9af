//! The recipes of `docs/extending.md`: each lists every file that knows its example, and no other.
//!
//! A recipe is a section with a line of words (`**Search for** …`) and numbered lines that begin with the
//! paths of files. Files that are generated, tests, decisions and changelogs need not be listed.

use std::collections::BTreeSet;
use std::path::Path;

use crate::report;
use crate::source::{File, files, files_below};

const PAGE: &str = "docs/extending.md";

/// Folders that [`files`] does not read.
const CLIENTS: [&str; 2] = ["cpp", "python"];

/// What a section lists, and how its example is found.
struct Recipe {
    title: String,
    words: Vec<String>,
    paths: BTreeSet<String>,
}

/// The pieces of `text` between backticks.
fn quoted(text: &str) -> impl Iterator<Item = String> {
    text.split('`').skip(1).step_by(2).map(str::to_owned)
}

fn recipes(page: &str) -> Vec<Recipe> {
    let sections = page.split("\n## ").skip(1);
    sections
        .map(|section| {
            let steps = section.lines().filter_map(|line| {
                let (number, rest) = line.split_once(". `")?;
                number.parse::<usize>().ok()?;
                Some(format!("`{}", rest.split_once("`: ")?.0) + "`")
            });
            Recipe {
                title: section.lines().next().unwrap_or_default().to_owned(),
                words: section
                    .lines()
                    .filter(|line| line.starts_with("**Search for**"))
                    .flat_map(quoted)
                    .collect(),
                paths: steps.flat_map(|step| quoted(&step).collect::<Vec<_>>()).collect(),
            }
        })
        .collect()
}

/// Whether `text` has `word` with no letter, digit or underscore beside it.
fn has_word(text: &str, word: &str) -> bool {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    text.match_indices(word).any(|(at, _)| {
        !text[..at].chars().next_back().is_some_and(is_word)
            && !text[at + word.len()..].chars().next().is_some_and(is_word)
    })
}

/// Whether a recipe must list the file where it knows the example.
fn is_source(file: &File) -> bool {
    let generated = ["docs/wire-reference.md", "python/src/covis/_sync.py"];
    let indexes = ["ARCHITECTURE.md", "CHANGELOG.md", "README.md", PAGE];
    let aside = ["docs/decisions", "proto/foxglove", "python/src/covis/v1", "examples", "fuzz"];
    let is_aside = |part: &str| part == "test" || part == "build" || part.starts_with('.');
    !file.is_test()
        && !generated.contains(&file.path.as_str())
        && !indexes.contains(&file.path.as_str())
        && !aside.iter().any(|room| file.is_in(room))
        && !file.path.split('/').any(is_aside)
}

/// The text without the module of tests at the end of a file.
fn without_tests(text: &str) -> &str {
    text.split("\n#[cfg(test)]\nmod tests {").next().unwrap_or(text)
}

#[test]
fn recipes_list_every_file_that_knows_their_example() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut all = files();
    all.extend(files_below(&CLIENTS));
    let page = all.iter().find(|file| file.path == PAGE).map_or("", |file| file.text.as_str());
    let recipes = recipes(page);
    let mut offenders = Vec::new();
    for recipe in &recipes {
        let knows = |text: &str| recipe.words.iter().any(|word| has_word(text, word));
        for file in &all {
            let is_listed = recipe.paths.contains(&file.path);
            if is_listed && !knows(&file.text) {
                offenders.push(format!("{}: {} knows none of the words", recipe.title, file.path));
            }
            if !is_listed && is_source(file) && knows(without_tests(&file.text)) {
                offenders.push(format!("{}: {} is not listed", recipe.title, file.path));
            }
        }
        let missing = recipe.paths.iter().filter(|path| !root.join(path).is_file());
        offenders.extend(missing.map(|path| format!("{}: there is no {path}", recipe.title)));
        for word in &recipe.words {
            if !all.iter().any(|f| recipe.paths.contains(&f.path) && has_word(&f.text, word)) {
                offenders.push(format!("{}: no listed file has `{word}`", recipe.title));
            }
        }
        if recipe.words.is_empty() || recipe.paths.len() < 5 {
            offenders.push(format!("{}: the recipe lacks words or files", recipe.title));
        }
    }
    assert!(recipes.len() >= 5, "{PAGE} has its recipes");
    report("Recipes list the files that know their example (docs/extending.md).", &offenders);
}
