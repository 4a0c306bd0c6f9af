//! `covis solve FILE`: the kind of problem that a file holds, put where the arguments leave it out.
//!
//! Looks at names and first lines only. A file that is not there, or of another kind, is left to the command
//! that would take it: its error says more than one about arguments.

use std::ffi::OsString;
use std::io::Read;
use std::path::Path;

use covis_solvers::io::format::{Content, Format};
use fs_err as fs;

/// How much of a file is enough to tell its format.
const HEAD_BYTES: u64 = 1 << 16;

const BUNDLE: &str = "bundle";
const POSE_GRAPH: &str = "pose-graph";

/// The arguments of the program, with the kind of problem after `solve` where a file alone is named.
pub(in crate::cli) fn named(mut arguments: Vec<OsString>) -> Vec<OsString> {
    // Only flags and their values precede the command.
    let is_solve = |argument: &OsString| argument == "solve";
    let Some(solve) = arguments.iter().position(is_solve).filter(|&at| at > 0) else {
        return arguments;
    };
    let (before, after) = (&arguments[1..solve], &arguments[solve + 1..]);
    let follows_another = before.iter().any(|argument| super::super::is_command(argument));
    let is_kind =
        |argument: &OsString| [BUNDLE, POSE_GRAPH, "help"].iter().any(|&kind| argument == kind);
    let words = || after.iter().filter(|argument| !argument.to_string_lossy().starts_with('-'));
    if follows_another || words().next().is_none() || after.iter().any(is_kind) {
        return arguments;
    }
    let kind = words().find_map(|word| kind_of(Path::new(word))).unwrap_or(BUNDLE);
    arguments.insert(solve + 1, kind.into());
    arguments
}

/// The command that takes a file, `None` for what no kind of problem is in.
fn kind_of(path: &Path) -> Option<&'static str> {
    if path.is_dir() {
        return Some(BUNDLE);
    }
    match format_of(path).entry().content {
        Content::Bundle => Some(BUNDLE),
        Content::PoseGraph => Some(POSE_GRAPH),
        Content::Trajectory | Content::Points => None,
    }
}

/// The format of a file, by its name or its head.
pub(super) fn format_of(path: &Path) -> Format {
    let mut head = Vec::new();
    if let Ok(file) = fs::File::open(path) {
        // The rest of a file that cannot be read is missed by the command, which says so.
        let _read = file.take(HEAD_BYTES).read_to_end(&mut head);
    }
    Format::of_file(path, &head)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named_in(line: &str) -> String {
        let words = named(line.split(' ').map(OsString::from).collect());
        words.iter().map(|word| word.to_str().unwrap_or("?")).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn a_file_is_enough_to_solve() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str, text: &str| {
            let path = folder.path().join(name);
            fs::write(&path, text).unwrap();
            path.display().to_string()
        };
        let bal = path("problem.txt", "1 1 1\n0 0 1 2\n");
        let graph = path("graph.txt", "VERTEX_SE2 0 0 0 0\n");
        let page = path("report.html", "<!doctype html>\n");
        let folder = folder.path().display().to_string();
        for (arguments, kind) in [
            (&bal, "bundle"),
            (&graph, "pose-graph"),
            (&folder, "bundle"),
            (&format!("--report {page} --threads 2 {graph} --json"), "pose-graph"),
            // Whoever reads it says what is wrong with it.
            (&"none.g2o".to_owned(), "pose-graph"),
            (&"none.txt".to_owned(), "bundle"),
        ] {
            let expected = format!("covis --config a.toml solve {kind} {arguments}");
            assert_eq!(named_in(&format!("covis --config a.toml solve {arguments}")), expected);
        }
    }

    #[test]
    fn arguments_that_say_it_stay_as_they_are() {
        for line in [
            "covis",
            "solve",
            "covis solve",
            "covis solve --help",
            "covis solve bundle pose-graph",
            "covis solve --log debug pose-graph a.txt",
            "covis help solve",
            "covis map show solve none.g2o",
        ] {
            assert_eq!(named_in(line), line);
        }
    }
}
