//! The house rules as ordinary tests: floors, file heads, names, documents, manifests, the wire.
//!
//! Each test reads the project's own files, collects every offender and prints them all at once, with
//! file, line and what is wrong. Only the standard library is used. What a rule is for stands in
//! `ARCHITECTURE.md`; a rule that must change is changed there and here in one commit.

#[path = "tidy/book.rs"]
mod book;
#[path = "tidy/edges.rs"]
mod edges;
#[path = "tidy/engine.rs"]
mod engine;
#[path = "tidy/extending.rs"]
mod extending;
#[path = "tidy/manifests.rs"]
mod manifests;
#[path = "tidy/source.rs"]
mod source;
#[path = "tidy/text.rs"]
mod text;
#[path = "tidy/wire.rs"]
mod wire;

/// Fails with the whole list when it is not empty.
fn report(rule: &str, offenders: &[String]) {
    assert!(
        offenders.is_empty(),
        "{rule}\n{} offender(s):\n  {}\n",
        offenders.len(),
        offenders.join("\n  ")
    );
}
