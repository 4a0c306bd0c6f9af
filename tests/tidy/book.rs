//! The documents: links and their anchors lead somewhere, and `docs/` is a book (`book.toml`, mdBook)
//! that has all of its pages. mdBook itself is not needed here.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path};

use crate::report;
use crate::source::{File, files};

const SUMMARY: &str = "docs/SUMMARY.md";

/// A link of a document.
struct Link {
    /// Line, from 1.
    line: usize,
    /// As it is written.
    text: String,
    /// The file that it leads to, from the workspace's root.
    path: String,
    /// What stands behind `#`.
    anchor: Option<String>,
}

fn documents() -> Vec<File> {
    files().into_iter().filter(|f| f.extension() == "md").collect()
}

/// The lines of a document with their numbers, without blocks of code.
fn prose(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut is_code = false;
    text.lines().enumerate().filter_map(move |(index, line)| {
        let is_fence = line.trim_start().starts_with("```");
        is_code ^= is_fence;
        (!is_code && !is_fence).then_some((index + 1, line))
    })
}

/// The links to files and within the page; those to other sites are left out.
fn links(file: &File) -> Vec<Link> {
    let folder = Path::new(&file.path).parent().unwrap_or(Path::new(""));
    let mut found = Vec::new();
    for (line, text) in prose(&file.text) {
        let targets = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
        for target in targets.filter(|target| !target.contains("://")) {
            let (path, anchor) = match target.split_once('#') {
                Some((path, anchor)) => (path, Some(anchor.to_owned())),
                None => (target, None),
            };
            let path = if path.is_empty() { file.path.clone() } else { plain(&folder.join(path)) };
            found.push(Link { line, text: target.to_owned(), path, anchor });
        }
    }
    found
}

/// A path without `.` and `..`.
fn plain(path: &Path) -> String {
    let mut parts: Vec<String> = Vec::new();
    for part in path.components() {
        match part {
            Component::ParentDir => {
                parts.pop();
            }
            Component::Normal(name) => parts.push(name.to_string_lossy().into_owned()),
            Component::Prefix(_) | Component::RootDir | Component::CurDir => {}
        }
    }
    parts.join("/")
}

/// The anchors of a document's headings, as mdBook and GitHub make them: lower case, spaces become `-`,
/// punctuation goes, a second heading of the same name gets `-1`.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    let mut found = BTreeSet::new();
    for (_, line) in prose(text).filter(|(_, line)| line.starts_with('#')) {
        let title = line.trim_start_matches('#').trim().to_lowercase();
        let kept = title.chars().filter_map(|c| match c {
            ' ' => Some('-'),
            '-' | '_' => Some(c),
            _ => c.is_alphanumeric().then_some(c),
        });
        let slug: String = kept.collect();
        let count = seen.entry(slug.clone()).or_default();
        found.insert(if *count == 0 { slug } else { format!("{slug}-{count}") });
        *count += 1;
    }
    found
}

#[test]
fn links_in_documents_lead_somewhere() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let documents = documents();
    let anchors: BTreeMap<&str, BTreeSet<String>> =
        documents.iter().map(|file| (file.path.as_str(), anchors(&file.text))).collect();
    let mut offenders = Vec::new();
    for file in &documents {
        for link in links(file) {
            let is_there = root.join(&link.path).exists();
            let has_anchor = match (&link.anchor, anchors.get(link.path.as_str())) {
                (Some(anchor), Some(known)) => known.contains(anchor),
                _ => true,
            };
            if !is_there || !has_anchor {
                offenders.push(format!("{}:{}: {}", file.path, link.line, link.text));
            }
        }
    }
    report("Links between documents lead to files, their anchors to headings.", &offenders);
}

#[test]
fn the_book_has_every_page_once() {
    let documents = documents();
    let is_page = |path: &str| path.starts_with("docs/") && path != SUMMARY;
    let summary = documents.iter().find(|file| file.path == SUMMARY);
    let mut entries: BTreeMap<String, usize> = BTreeMap::new();
    for link in summary.map(links).unwrap_or_default() {
        *entries.entry(link.path).or_default() += 1;
    }
    let mut offenders: Vec<String> = entries
        .iter()
        .filter(|(_, count)| **count > 1)
        .map(|(path, count)| format!("{path}: stands {count} times in {SUMMARY}"))
        .collect();
    for file in documents.iter().filter(|file| is_page(&file.path)) {
        if entries.remove(&file.path).is_none() {
            offenders.push(format!("{}: is not in {SUMMARY}", file.path));
        }
    }
    offenders.extend(entries.keys().map(|path| format!("{path}: is in {SUMMARY} and no page")));
    report("Every page of docs/ is in the book's list once.", &offenders);
}

#[test]
fn pages_of_the_book_link_within_it() {
    let mut offenders = Vec::new();
    for file in documents().iter().filter(|file| file.path.starts_with("docs/")) {
        let outside = links(file).into_iter().filter(|link| !link.path.starts_with("docs/"));
        offenders.extend(outside.map(|link| format!("{}:{}: {}", file.path, link.line, link.text)));
    }
    report(
        "A page of the book links to pages of the book; other files are named by their path.",
        &offenders,
    );
}
