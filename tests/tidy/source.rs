//! Files of the project and what Rust code in them names.

use std::fs;
use std::path::{Path, PathBuf};

/// One text file.
pub(crate) struct File {
    /// From the workspace's root, with `/`.
    pub(crate) path: String,
    /// Its bytes as text.
    pub(crate) text: String,
}

/// A path that code names, spelled out from the crate's root.
pub(crate) struct Reference {
    /// Line, from 1.
    pub(crate) line: usize,
    /// For instance `["crate", "linear", "BlockMatrix"]` or `["tonic", "Status", "new"]`.
    pub(crate) to: Vec<String>,
}

impl File {
    /// Whether the path is `room` or lies in it; `room` has no extension: `src/meter` holds
    /// `src/meter.rs` and all of `src/meter/`.
    pub(crate) fn is_in(&self, room: &str) -> bool {
        let rest = self.path.strip_prefix(room);
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('/') || rest == ".rs")
    }

    /// Whether the file holds tests only.
    pub(crate) fn is_test(&self) -> bool {
        self.path.ends_with("/tests.rs")
            || self.path.split('/').any(|part| part == "tests" || part == "benches")
    }

    /// The extension.
    pub(crate) fn extension(&self) -> &str {
        self.path.rsplit_once('.').map_or("", |(_, extension)| extension)
    }

    /// What the code outside comments, literals and `#[cfg(test)]` items names.
    pub(crate) fn references(&self) -> Vec<Reference> {
        let code = code_only(&self.text);
        let code = without_test_items(&code);
        let mut found = Vec::new();
        let mut parser = Parser { code: &code, at: 0 };
        let (mut line, mut counted) = (1, 0);
        while let Some(start) = parser.next_path() {
            line += code[counted..start].iter().filter(|&&c| c == '\n').count();
            counted = start;
            parser.path(&mut Vec::new(), &mut |segments| {
                found.push(Reference { line, to: segments.to_vec() });
            });
        }
        let module = self.module();
        for reference in &mut found {
            absolute(&mut reference.to, &module);
        }
        found
    }

    /// The module that the file is, from the crate's root: `solvers/src/linear/mod.rs` is `linear`.
    fn module(&self) -> Vec<String> {
        let inside = self.path.split_once("src/").map_or(self.path.as_str(), |(_, rest)| rest);
        let inside = inside.trim_end_matches(".rs").trim_end_matches("/mod");
        let crate_root = ["lib", "main", "mod"].contains(&inside);
        if crate_root { Vec::new() } else { inside.split('/').map(str::to_owned).collect() }
    }
}

/// The text files below the workspace's root that are the project's own.
pub(crate) fn files() -> Vec<File> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = files_below(&[
        "src", "client", "dense", "frontend", "map", "reports", "solvers", "store", "proto",
        "docs", "tests", "examples", "benches", "fuzz", "page", "deploy", ".ci",
    ]);
    let mut paths = Vec::new();
    for path in fs::read_dir(root).into_iter().flatten().flatten().map(|entry| entry.path()) {
        let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        let known = ["rs", "toml", "md"].iter().any(|e| path.extension().is_some_and(|x| x == *e));
        if path.is_file() && (known || name.starts_with("LICENSE") || name == ".gitignore") {
            paths.push(path);
        }
    }
    assert!(!paths.is_empty(), "{} holds no files of the project", root.display());
    found.extend(read(&paths));
    found.sort_by(|a, b| a.path.cmp(&b.path));
    found
}

/// The text files in some folders below the workspace's root, without those that are made.
pub(crate) fn files_below(rooms: &[&str]) -> Vec<File> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut paths = Vec::new();
    for room in rooms {
        walk(&root.join(room), &mut paths);
    }
    paths.sort();
    read(&paths)
}

fn read(paths: &[PathBuf]) -> Vec<File> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let own = |path: &PathBuf| {
        let text = String::from_utf8(fs::read(path).ok()?).ok()?;
        let path = path.strip_prefix(root).ok()?.to_string_lossy().replace('\\', "/");
        Some(File { path, text })
    };
    paths.iter().filter_map(own).collect()
}

/// The Rust files among them.
pub(crate) fn rust_files() -> Vec<File> {
    files().into_iter().filter(|f| f.extension() == "rs").collect()
}

fn walk(folder: &Path, paths: &mut Vec<PathBuf>) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for path in entries.filter_map(|entry| entry.ok().map(|e| e.path())) {
        let made =
            ["target", "generated", "__pycache__", "node_modules", "corpus", "artifacts", "dist"];
        if !path.is_dir() {
            paths.push(path);
        } else if !made.iter().any(|name| path.ends_with(name)) {
            walk(&path, paths);
        }
    }
}

/// The code with comments and literals blanked out, line by line as before.
fn code_only(text: &str) -> Vec<char> {
    let source: Vec<char> = text.chars().collect();
    let mut code = source.clone();
    let mut at = 0;
    while at < source.len() {
        let end = match source[at] {
            '/' if source.get(at + 1) == Some(&'/') => {
                (at..source.len()).find(|&i| source[i] == '\n').unwrap_or(source.len())
            }
            '/' if source.get(at + 1) == Some(&'*') => block_comment_end(&source, at),
            '"' => string_end(&source, at),
            'r' if at == 0 || !is_word(source[at - 1]) || source[at - 1] == 'b' => {
                raw_string_end(&source, at).unwrap_or(at)
            }
            '\'' => char_end(&source, at),
            _ => at,
        };
        for c in &mut code[at..end] {
            *c = if *c == '\n' { '\n' } else { ' ' };
        }
        at = end.max(at + 1);
    }
    code
}

fn block_comment_end(source: &[char], start: usize) -> usize {
    let (mut depth, mut at) = (0, start);
    while at + 1 < source.len() {
        match (source[at], source[at + 1]) {
            ('/', '*') => (depth, at) = (depth + 1, at + 2),
            ('*', '/') if depth == 1 => return at + 2,
            ('*', '/') => (depth, at) = (depth - 1, at + 2),
            _ => at += 1,
        }
    }
    source.len()
}

fn string_end(source: &[char], start: usize) -> usize {
    let mut at = start + 1;
    while at < source.len() && source[at] != '"' {
        at += if source[at] == '\\' { 2 } else { 1 };
    }
    (at + 1).min(source.len())
}

fn raw_string_end(source: &[char], start: usize) -> Option<usize> {
    let hashes = source[start + 1..].iter().take_while(|&&c| c == '#').count();
    let open = start + 1 + hashes;
    if source.get(open) != Some(&'"') {
        return None;
    }
    let closes = |i: &usize| {
        source[*i] == '"' && source[*i + 1..].iter().take_while(|&&c| c == '#').count() >= hashes
    };
    let close = (open + 1..source.len()).find(closes)?;
    Some(close + 1 + hashes)
}

/// The end of a character literal; a lifetime is left as it is.
fn char_end(source: &[char], start: usize) -> usize {
    if source.get(start + 1) == Some(&'\\') {
        return (start + 3..source.len()).find(|&i| source[i] == '\'').map_or(start, |i| i + 1);
    }
    if source.get(start + 2) == Some(&'\'') { start + 3 } else { start }
}

/// Blanks out each item under `#[cfg(test)]`, up to its closing brace or semicolon.
fn without_test_items(code: &[char]) -> Vec<char> {
    let mark: Vec<char> = "#[cfg(test)]".chars().collect();
    let mut code = code.to_vec();
    let mut at = 0;
    while at + mark.len() <= code.len() {
        if code[at..at + mark.len()] != mark[..] {
            at += 1;
            continue;
        }
        let mut depth = 0;
        while at < code.len() {
            let c = code[at];
            depth += i32::from(c == '{') - i32::from(c == '}');
            if c != '\n' {
                code[at] = ' ';
            }
            at += 1;
            if (c == '}' || c == ';') && depth == 0 {
                break;
            }
        }
    }
    code
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Spells `self::` and `super::` out from the crate's root.
fn absolute(path: &mut Vec<String>, module: &[String]) {
    let ups = path.iter().take_while(|s| *s == "super" || *s == "self").count();
    let supers = path[..ups].iter().filter(|s| *s == "super").count();
    if ups > 0 {
        let kept = module.len().saturating_sub(supers);
        let head = std::iter::once("crate".to_owned()).chain(module[..kept].iter().cloned());
        path.splice(..ups, head);
    }
}

/// Finds paths such as `a::b::{c, d::e}` in code.
struct Parser<'a> {
    code: &'a [char],
    at: usize,
}

impl Parser<'_> {
    /// Goes to the next word.
    fn next_path(&mut self) -> Option<usize> {
        while !is_word(*self.code.get(self.at)?) {
            self.at += 1;
        }
        Some(self.at)
    }

    fn space(&mut self) {
        while self.code.get(self.at).is_some_and(|c| c.is_whitespace()) {
            self.at += 1;
        }
    }

    /// Reads one path, a group at its end expanded, and reports each.
    fn path(&mut self, head: &mut Vec<String>, report: &mut impl FnMut(&[String])) {
        let depth = head.len();
        loop {
            let start = self.at;
            while self.code.get(self.at).copied().is_some_and(is_word) {
                self.at += 1;
            }
            if self.at > start {
                head.push(self.code[start..self.at].iter().collect());
            }
            let separated = self.at;
            self.space();
            if !self.code[self.at..].starts_with(&[':', ':']) {
                self.at = separated;
                break;
            }
            self.at += 2;
            self.space();
            match self.code.get(self.at) {
                Some('{') => {
                    self.group(head, report);
                    head.truncate(depth);
                    return;
                }
                Some(&c) if is_word(c) => {}
                _ => break,
            }
        }
        if head.len() > depth {
            report(head);
        }
        head.truncate(depth);
    }

    fn group(&mut self, head: &mut Vec<String>, report: &mut impl FnMut(&[String])) {
        while self.at < self.code.len() && self.code[self.at] != '}' {
            self.at += 1;
            self.space();
            if self.code.get(self.at).copied().is_some_and(is_word) {
                self.path(head, report);
                // An `as name` or a star is passed over.
                while !matches!(self.code.get(self.at), None | Some(',' | '}')) {
                    self.at += 1;
                }
            } else if self.code.get(self.at) == Some(&'*') {
                report(head);
            }
        }
        self.at += 1;
    }
}

#[test]
fn references_are_spelled_out_and_only_code_counts() {
    let text = "//! crate::not::this\nuse crate::{a::{B, c::D}, e as f};\nuse super::g;\n\
                fn h<'a>(x: &'a str) { let _ = (\"crate::no\", r#\"crate::no\"#, '\"'); super::super::i(); }\n\
                /* crate::no /* nested */ crate::no */\n#[cfg(test)]\nmod tests { use crate::no; }\n\
                tonic::Status::new(self::j);";
    let file = File { path: "solvers/src/linear/sparse.rs".to_owned(), text: text.to_owned() };
    let found: Vec<(usize, String)> = file
        .references()
        .into_iter()
        .filter(|r| r.to.len() > 1)
        .map(|r| (r.line, r.to.join("::")))
        .collect();
    let wanted = [
        (2, "crate::a::B"),
        (2, "crate::a::c::D"),
        (2, "crate::e"),
        (3, "crate::linear::g"),
        (4, "crate::i"),
        (8, "tonic::Status::new"),
        (8, "crate::linear::sparse::j"),
    ];
    assert_eq!(found, wanted.map(|(line, path)| (line, path.to_owned())));
}
