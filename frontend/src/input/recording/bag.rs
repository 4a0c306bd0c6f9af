//! The files of a rosbag2 folder, in order: as `metadata.yaml` lists them, or by their names where a killed
//! recorder left no such file.
//!
//! Of `metadata.yaml` two keys matter, `relative_file_paths` and `compression_mode`; rosbag2 writes them as
//! plain block YAML, one a line, and the files say all else themselves. No YAML library is taken for that.

use std::path::{Component, Path, PathBuf};

use super::error::RecordingError;
use super::note::Note;

/// What describes a bag.
pub(super) const METADATA: &str = "metadata.yaml";
/// How the files of bags end.
const EXTENSIONS: [&str; 2] = ["mcap", "db3"];
/// A description that is longer has nothing in it for us.
const MAX_METADATA_BYTES: u64 = 16 << 20;

/// Whether a folder looks like a bag.
pub(super) fn is_bag(folder: &Path) -> bool {
    folder.join(METADATA).is_file() || files_by_name(folder).is_ok_and(|files| !files.is_empty())
}

/// The files of a recording: of a folder, or one file.
pub(super) fn files(path: &Path) -> Result<(Vec<PathBuf>, Option<Note>), RecordingError> {
    if !path.is_dir() {
        return Ok((vec![path.to_owned()], None));
    }
    let metadata = path.join(METADATA);
    if !metadata.exists() {
        let failed = |source| RecordingError::Read { path: path.to_owned(), source };
        let files = files_by_name(path).map_err(failed)?;
        if files.is_empty() {
            return Err(RecordingError::NotABag { path: path.to_owned() });
        }
        return Ok((files, Some(Note::WithoutMetadata { path: path.to_owned() })));
    }
    let failed = |source| RecordingError::Read { path: metadata.clone(), source };
    let size = std::fs::metadata(&metadata).map_err(failed)?.len();
    if size > MAX_METADATA_BYTES {
        let most = MAX_METADATA_BYTES;
        return Err(RecordingError::TooLong { path: metadata, bytes: size, most });
    }
    let bytes = std::fs::read(&metadata).map_err(failed)?;
    let Description { files, is_compressed } = parse(&String::from_utf8_lossy(&bytes));
    if is_compressed {
        return Err(RecordingError::Compressed { path: metadata });
    }
    let files = files.into_iter().map(|name| {
        let relative = Path::new(&name);
        let inside = |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
        if !relative.components().all(inside) {
            return Err(RecordingError::Outside { path: metadata.clone(), found: name });
        }
        // Early versions listed files with the bag's own folder before them.
        let found = path.join(relative);
        match relative.file_name() {
            Some(name) if !found.exists() => Ok(path.join(name)),
            _ => Ok(found),
        }
    });
    let files = files.collect::<Result<Vec<_>, _>>()?;
    if files.is_empty() {
        return Err(RecordingError::NotABag { path: path.to_owned() });
    }
    Ok((files, None))
}

/// What a `metadata.yaml` says.
#[derive(Debug, Default, PartialEq)]
struct Description {
    files: Vec<String>,
    /// Whether messages or files are compressed as a whole.
    is_compressed: bool,
}

fn parse(text: &str) -> Description {
    let mut found = Description::default();
    let mut is_list = false;
    for line in text.lines() {
        let line = line.trim();
        let item = line.strip_prefix("- ").map(|item| item.trim().trim_matches(['"', '\'']));
        match (is_list, item) {
            (true, Some(item)) => {
                found.files.push(item.to_owned());
                continue;
            }
            (true, None) if line.is_empty() || line.starts_with('#') => continue,
            _ => is_list = false,
        }
        let Some((key, value)) = line.split_once(':') else { continue };
        let value = value.trim().trim_matches(['"', '\'']);
        match key {
            // Other lists of this name follow the first one, below `files`.
            "relative_file_paths" => is_list = found.files.is_empty(),
            "compression_mode" => {
                found.is_compressed = !["", "none"].contains(&&*value.to_lowercase());
            }
            _ => {}
        }
    }
    found
}

/// The files of a folder that a bag can have, `bag_10` behind `bag_9`.
fn files_by_name(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let is_ours = EXTENSIONS.iter().any(|e| path.extension().is_some_and(|x| x == *e));
        if is_ours && path.is_file() {
            files.push(path);
        }
    }
    let key = |path: &PathBuf| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let name = stem.trim_end_matches(|c: char| c.is_ascii_digit());
        let number = stem[name.len()..].parse::<u64>().unwrap_or_default();
        (name.to_owned(), number, path.clone())
    };
    files.sort_by_cached_key(key);
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_description_lists_files_in_order() {
        let text = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  \
                    relative_file_paths:\n    - bag_0.mcap\n    - \"bag_1.mcap\"\n  duration:\n    \
                    nanoseconds: 3\n  topics_with_message_count:\n    - topic_metadata:\n        \
                    name: /a\n        offered_qos_profiles: \"- history: 3\\n  depth: 0\"\n      \
                    message_count: 4\n  compression_format: \"\"\n  compression_mode: \"\"\n  files:\n    \
                    - path: bag_0.mcap\n";
        let expected = Description {
            files: vec!["bag_0.mcap".to_owned(), "bag_1.mcap".to_owned()],
            is_compressed: false,
        };
        assert_eq!(parse(text), expected);
        let compressed = text.replace("compression_mode: \"\"", "compression_mode: FILE");
        assert!(parse(&compressed).is_compressed);
    }

    #[test]
    fn a_folder_without_a_description_has_its_files_by_number() {
        let folder = tempfile::tempdir().unwrap();
        assert!(!is_bag(folder.path()));
        let error = files(folder.path()).unwrap_err();
        assert!(matches!(error, RecordingError::NotABag { .. }), "{error}");
        for name in ["bag_10.db3", "bag_9.db3", "bag_0.db3", "notes.txt"] {
            fs_err::write(folder.path().join(name), "").unwrap();
        }
        assert!(is_bag(folder.path()));
        let (found, note) = files(folder.path()).unwrap();
        let names: Vec<_> = found.iter().map(|path| path.file_name().unwrap()).collect();
        assert_eq!(names, ["bag_0.db3", "bag_9.db3", "bag_10.db3"]);
        assert!(matches!(note, Some(Note::WithoutMetadata { .. })));
    }

    #[test]
    fn a_description_names_files_of_its_folder_only() {
        let folder = tempfile::tempdir().unwrap();
        let describe = |file: &str| {
            let text = format!("relative_file_paths:\n  - {file}\n");
            fs_err::write(folder.path().join(METADATA), text).unwrap();
            files(folder.path())
        };
        for outside in ["../bag.mcap", "/tmp/bag.mcap"] {
            let error = describe(outside).unwrap_err();
            assert!(matches!(error, RecordingError::Outside { .. }), "{error}");
        }
        fs_err::write(folder.path().join("bag.mcap"), "").unwrap();
        for name in ["bag.mcap", "./bag.mcap", "walk/bag.mcap"] {
            let (found, note) = describe(name).unwrap();
            assert!(found[0].is_file() && note.is_none(), "{name}: {found:?}");
        }
        assert!(describe("").is_err());
    }
}
