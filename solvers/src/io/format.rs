//! The list of formats: names, extensions, what is in them, and how the format of a path is told.
//!
//! docs/formats.md has the same table, which a test compares. Must not read more of a file than its first
//! lines.

use std::path::Path;

use super::colmap::ColmapEncoding;
use super::files;
use super::text::{Line, Text};
use super::trajectory::TrajectoryFormat;

/// How far into a file its first member is looked for.
const HEAD_BYTES: usize = 4096;

/// A format of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// A trajectory.
    Trajectory(TrajectoryFormat),
    /// Bundle adjustment in the large.
    Bal,
    /// Bundler's `bundle.out`.
    Bundler,
    /// A folder with COLMAP's sparse model.
    Colmap(ColmapEncoding),
    /// OpenMVG's `sfm_data.json`; is read only.
    OpenMvg,
    /// A pose graph.
    G2o,
    /// A pose graph with ranges and named variables.
    Pyfg,
    /// Points for viewers; is written only.
    Ply,
}

/// What a file describes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// Poses over time.
    Trajectory,
    /// Images, points and observations.
    Bundle,
    /// Poses and what was measured between them.
    PoseGraph,
    /// A picture.
    Points,
}

/// A row of the list.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// The format.
    pub format: Format,
    /// Its name, as arguments have it.
    pub name: &'static str,
    /// What is in it.
    pub content: Content,
    /// Extensions of its files; the first is usual.
    pub extensions: &'static [&'static str],
    /// What a person calls it.
    pub title: &'static str,
    /// Whether covis reads it.
    pub is_read: bool,
    /// Whether covis writes it.
    pub is_written: bool,
}

const fn entry(
    format: Format,
    name: &'static str,
    content: Content,
    extensions: &'static [&'static str],
    title: &'static str,
) -> Entry {
    let is_read = !matches!(format, Format::Ply);
    let is_written = !matches!(format, Format::OpenMvg);
    Entry { format, name, content, extensions, title, is_read, is_written }
}

/// Every format.
pub static FORMATS: [Entry; 11] = [
    entry(
        Format::Trajectory(TrajectoryFormat::Tum),
        "tum",
        Content::Trajectory,
        &["txt", "tum"],
        "TUM trajectory",
    ),
    entry(
        Format::Trajectory(TrajectoryFormat::Kitti),
        "kitti",
        Content::Trajectory,
        &["kitti", "txt"],
        "KITTI odometry poses",
    ),
    entry(
        Format::Trajectory(TrajectoryFormat::Euroc),
        "euroc",
        Content::Trajectory,
        &["csv"],
        "EuRoC (ASL) ground truth",
    ),
    entry(Format::Bal, "bal", Content::Bundle, &["txt", "bal"], "bundle adjustment in the large"),
    entry(
        Format::Bundler,
        "bundler",
        Content::Bundle,
        &["out"],
        "Bundler, with its list of images",
    ),
    entry(
        Format::Colmap(ColmapEncoding::Text),
        "colmap-text",
        Content::Bundle,
        &[],
        "folder with COLMAP's sparse model",
    ),
    entry(
        Format::Colmap(ColmapEncoding::Binary),
        "colmap-binary",
        Content::Bundle,
        &[],
        "folder with COLMAP's sparse model",
    ),
    entry(Format::OpenMvg, "openmvg", Content::Bundle, &["json"], "OpenMVG's sfm_data.json"),
    entry(Format::G2o, "g2o", Content::PoseGraph, &["g2o"], "pose graph"),
    entry(
        Format::Pyfg,
        "pyfg",
        Content::PoseGraph,
        &["pyfg", "pfg"],
        "PyFactorGraph's pose graph with ranges",
    ),
    entry(Format::Ply, "ply", Content::Points, &["ply"], "points and paths for viewers"),
];

impl Format {
    /// Its row of the list.
    #[must_use]
    pub fn entry(self) -> &'static Entry {
        let own = FORMATS.iter().find(|entry| entry.format == self);
        // Every format has a row; a test holds it.
        own.unwrap_or(&FORMATS[0])
    }

    /// The format of a file that is read: told by an extension that only one format has, else by the
    /// first lines.
    #[must_use]
    pub fn of_file(path: &Path, bytes: &[u8]) -> Self {
        match Self::of_extension(path)[..] {
            // A table may hold TUM's columns as well.
            [Self::Trajectory(TrajectoryFormat::Euroc)] => {
                Self::Trajectory(TrajectoryFormat::of_table(bytes))
            }
            // Other programs write JSON too.
            [] | [Self::OpenMvg] | [_, _, ..] => Self::of_bytes(bytes),
            [only] => only,
        }
    }

    /// The format of a file to write that holds `content`, by its name: a name without extension is a
    /// COLMAP folder. `None` where the extension says nothing.
    #[must_use]
    pub fn to_write(path: &Path, content: Content) -> Option<Self> {
        if content == Content::Bundle && (path.extension().is_none() || path.is_dir()) {
            return Some(Self::Colmap(ColmapEncoding::Binary));
        }
        let all = Self::of_extension(path);
        let fits = all.iter().find(|format| format.entry().content == content);
        fits.or(all.first()).copied()
    }

    fn of_extension(path: &Path) -> Vec<Self> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        let has =
            |entry: &&Entry| entry.extensions.iter().any(|own| extension.eq_ignore_ascii_case(own));
        FORMATS.iter().filter(has).map(|entry| entry.format).collect()
    }

    fn of_bytes(bytes: &[u8]) -> Self {
        if bytes.starts_with(b"# Bundle file") {
            return Self::Bundler;
        }
        let is_json = bytes.trim_ascii_start().starts_with(b"{");
        let version = b"\"sfm_data_version\"";
        if is_json && bytes.windows(version.len()).take(HEAD_BYTES).any(|part| part == version) {
            return Self::OpenMvg;
        }
        let unknown = Self::Trajectory(TrajectoryFormat::Tum);
        // The reader says that it is compressed.
        if files::compression(bytes).is_some() {
            return unknown;
        }
        let Some(mut line) = Text::new(bytes, Path::new("")).record() else { return unknown };
        let first = line.word().unwrap_or_default();
        if is_of_pyfg(first, line) {
            return Self::Pyfg;
        }
        let tags = [&b"VERTEX_"[..], b"EDGE_", b"FIX", b"PARAMS_"];
        // g2o's reader takes TORO's lines too.
        let toro = [&b"VERTEX2"[..], b"EDGE2", b"VERTEX3", b"EDGE3"];
        if tags.iter().any(|tag| first.starts_with(tag)) || toro.contains(&first) {
            return Self::G2o;
        }
        let more = std::iter::from_fn(|| line.word()).take(3).count();
        if more == 2 { Self::Bal } else { Self::Trajectory(TrajectoryFormat::of_bytes(bytes)) }
    }
}

/// Whether a record of a graph has names, which are letters and numbers, in place of ids.
fn is_of_pyfg(tag: &[u8], mut line: Line<'_>) -> bool {
    // Landmarks have no time before their name.
    let is_name = |word: &[u8]| word.first().is_some_and(u8::is_ascii_alphabetic);
    let is_graph = tag.starts_with(b"VERTEX_") || tag.starts_with(b"EDGE_");
    is_graph && std::iter::from_fn(|| line.word()).take(2).any(is_name)
}

impl Content {
    /// The word for it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Trajectory => "trajectory",
            Self::Bundle => "images and points",
            Self::PoseGraph => "pose graph",
            Self::Points => "points",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(path: &str, bytes: &str) -> &'static str {
        Format::of_file(Path::new(path), bytes.as_bytes()).entry().name
    }

    #[test]
    fn a_format_is_recognized_by_its_extension_or_its_first_line() {
        for entry in &FORMATS {
            assert_eq!(entry.format.entry().name, entry.name);
        }
        assert_eq!(told("a.csv", ""), "euroc");
        assert_eq!(told("a.KITTI", ""), "kitti");
        assert_eq!(told("a.tum", "1,2"), "tum");
        assert_eq!(told("bundle.out", ""), "bundler");
        assert_eq!(told("a.txt", "# t\n1 2 3 4 0 0 0 1\n"), "tum");
        assert_eq!(told("a.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n"), "kitti");
        assert_eq!(told("a", "#timestamp [ns]\n1,2,3\n"), "euroc");
        assert_eq!(told("a.csv", "1.5,1,2,3,0,0,0,1\n"), "tum");
        assert_eq!(told("a.g2", "PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1\n"), "g2o");
        assert_eq!(told("problem.txt.bz2", "BZh,,,"), "tum");
        assert_eq!(told("problem-16.txt", "16 22106 83718\n0 0 1 2\n"), "bal");
        assert_eq!(told("a.txt", "# Bundle file v0.3\n1 1\n"), "bundler");
        assert_eq!(told("a.txt", "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n"), "g2o");
        assert_eq!(told("a.graph", "VERTEX2 0 1 2 3\n"), "g2o");
        assert_eq!(told("a.PFG", "VERTEX_SE2 0 0 0 0\n"), "pyfg");
        assert_eq!(told("a.txt", "VERTEX_SE2 0.0 A0 0 0 0\n"), "pyfg");
        assert_eq!(told("a.txt", "VERTEX_XY L0 11 19\n"), "pyfg");
        assert_eq!(told("a.txt", ""), "tum");
        assert_eq!(told("a.json", "{\n  \"sfm_data_version\": \"0.3\"}"), "openmvg");
        assert_eq!(told("transforms.json", "{\"frames\": []}"), "tum");
    }

    #[test]
    fn the_format_to_write_follows_from_the_name_and_the_content() {
        let to = |path: &str, content| {
            Format::to_write(Path::new(path), content).map(|format| format.entry().name)
        };
        assert_eq!(to("a.txt", Content::Trajectory), Some("tum"));
        assert_eq!(to("a.txt", Content::Bundle), Some("bal"));
        assert_eq!(to("model", Content::Bundle), Some("colmap-binary"));
        assert_eq!(to("a.kitti", Content::Bundle), Some("kitti"));
        assert_eq!(to("model", Content::Trajectory), None);
        assert_eq!(to("a.doc", Content::Trajectory), None);
    }
}
