//! Lists of timed files, as the TUM RGB-D layout has them: lines `timestamp path`, `#` comments.
//!
//! A path must lead to a file below the folder: a list that was downloaded names nothing else.

use std::path::{Component, Path, PathBuf};

use super::error::InputError;

/// One line of a list.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Entry {
    /// Seconds.
    pub(super) timestamp_s: f64,
    /// The file, the list's folder included.
    pub(super) path: PathBuf,
    /// The line, from 1.
    pub(super) line: usize,
}

/// Reads the list `name` in `folder`, in file order.
pub(super) fn read(folder: &Path, name: &str) -> Result<Vec<Entry>, InputError> {
    let list = folder.join(name);
    let bytes =
        std::fs::read(&list).map_err(|source| InputError::Read { path: list.clone(), source })?;
    // A name that is not UTF-8 cannot be opened by its replacement, and that frame is reported.
    parse(&String::from_utf8_lossy(&bytes), folder, &list)
}

/// Parses a list's text.
pub(super) fn parse(text: &str, folder: &Path, list: &Path) -> Result<Vec<Entry>, InputError> {
    let mut entries = Vec::new();
    for (index, text) in text.lines().enumerate() {
        let text = text.trim();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let line = index + 1;
        let malformed = || InputError::Line { path: list.to_owned(), line, found: excerpt(text) };
        let (time, path) = text.split_once(char::is_whitespace).ok_or_else(malformed)?;
        let time = time.parse().ok().filter(|time: &f64| time.is_finite());
        let timestamp_s = time.ok_or_else(malformed)?;
        let path = Path::new(path.trim());
        let inside = |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
        if !path.components().all(inside) {
            let found = excerpt(&path.to_string_lossy());
            return Err(InputError::Outside { path: list.to_owned(), line, found });
        }
        entries.push(Entry { timestamp_s, path: folder.join(path), line });
    }
    Ok(entries)
}

/// The beginning of a line, short enough for a message.
fn excerpt(text: &str) -> String {
    text.chars().take(80).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &str) -> Result<Vec<Entry>, InputError> {
        parse(text, Path::new("seq"), Path::new("seq/rgb.txt"))
    }

    #[test]
    fn comments_and_empty_lines_are_passed_over_and_lines_counted() {
        let entries = lines("# color\n\n 1.5 rgb/a.png\r\n2\trgb/b b.png").unwrap();
        let a = Entry { timestamp_s: 1.5, path: "seq/rgb/a.png".into(), line: 3 };
        let b = Entry { timestamp_s: 2.0, path: "seq/rgb/b b.png".into(), line: 4 };
        assert_eq!(entries, [a, b]);
    }

    #[test]
    fn a_malformed_line_is_named() {
        for text in ["1.0 a.png\n1.5", "# x\nnan a.png", "\ninf a.png", "# x\n1,0 a.png"] {
            assert!(matches!(lines(text), Err(InputError::Line { line: 2, .. })), "{text}");
        }
    }

    #[test]
    fn paths_stay_inside_the_folder() {
        for path in ["../a.png", "rgb/../../a.png", "/a.png"] {
            let error = lines(&format!("1.0 b.png\n2.0 {path}")).unwrap_err();
            let InputError::Outside { line: 2, found, .. } = error else { panic!("{error}") };
            assert_eq!(found, path);
        }
    }
}
