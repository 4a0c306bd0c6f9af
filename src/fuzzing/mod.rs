//! The fuzz targets: every parser of what comes from outside, as a function of any bytes.
//!
//! Built for tests and with the feature `fuzzing` only. A target returns for whatever it is given;
//! it panics where a promise is broken, and the allocator of the `fuzz` crate ends it where an input
//! of at most 1 MiB holds more than 64 MiB. The tests here run the corpus of each target and
//! mutations of it; `fuzz/run` looks for new inputs, guided by coverage (docs/fuzzing.md).

mod files;

#[cfg(test)]
mod tests;

use crate::frontend::dense::file::fuzzing as volume;
use crate::frontend::input::fuzzing as input;

/// A parser under test.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// Its name; its corpus is the folder `fuzz/corpus/NAME`.
    pub name: &'static str,
    /// Takes any bytes; panics where a promise is broken.
    pub run: fn(&[u8]),
}

/// Every target, by name.
pub const TARGETS: [Target; 26] = [
    Target { name: "bal", run: files::bal },
    Target { name: "bundler", run: files::bundler },
    Target { name: "camera_file", run: input::camera_file },
    Target { name: "capture", run: input::capture },
    Target { name: "capture_archive", run: input::capture_archive },
    Target { name: "colmap_binary", run: files::colmap_binary },
    Target { name: "colmap_text", run: files::colmap_text },
    Target { name: "config", run: files::config },
    Target { name: "frame_list", run: input::frame_list },
    Target { name: "g2o", run: files::g2o },
    Target { name: "image", run: input::image },
    Target { name: "journal", run: crate::store::fuzzing::journal },
    Target { name: "journal_folder", run: crate::store::fuzzing::journal_folder },
    Target { name: "jwt", run: crate::service::fuzzing::jwt },
    Target { name: "map_file", run: crate::store::fuzzing::map_file },
    Target { name: "openmvg", run: files::openmvg },
    Target { name: "pem", run: crate::service::fuzzing::pem },
    Target { name: "pose_matrix", run: files::pose_matrix },
    Target { name: "pyfg", run: files::pyfg },
    Target { name: "ros_message", run: input::ros_message },
    Target { name: "snapshot", run: crate::store::fuzzing::snapshot },
    Target { name: "tokens", run: crate::service::fuzzing::tokens },
    Target { name: "trajectory", run: files::trajectory },
    Target { name: "volume", run: volume::volume },
    Target { name: "wire_item", run: crate::service::fuzzing::wire_item },
    Target { name: "wire_requests", run: crate::service::fuzzing::wire_requests },
];

/// Hands out inputs of at most `length` bytes that make a target hold much: a corpus' inputs with
/// pieces of them repeated, and lists of entries that are next to nothing.
pub fn largest(name: &str, corpus: &[Vec<u8>], length: usize, take: &mut dyn FnMut(&[u8])) {
    for input in corpus {
        let starts = (0..input.len()).step_by(1 + input.len() / 6);
        let words = (1..input.len()).filter(|&at| input[at - 1].is_ascii_whitespace()).take(3);
        for start in starts.chain(words) {
            for size in [1, 2, 4, 9, input.len()] {
                let piece = &input[start..input.len().min(start + size)];
                let room = length.saturating_sub(input.len());
                let middle = piece.repeat(room / piece.len().max(1));
                take(&[&input[..start], &middle, &input[start..]].concat());
            }
        }
    }
    let [items, requests] = crate::service::fuzzing::largest(length);
    let [events, parts] = crate::store::fuzzing::largest(length);
    let dense = match name {
        "wire_item" => items,
        "wire_requests" => requests,
        "journal" => events,
        "snapshot" | "map_file" => parts,
        "volume" => volume::largest(length),
        _ => Vec::new(),
    };
    dense.iter().for_each(|input| take(input));
}

/// Runs the target of this name.
///
/// # Panics
/// Where there is none, and where the input breaks a promise.
pub fn run(name: &str, input: &[u8]) {
    match TARGETS.iter().find(|target| target.name == name) {
        Some(target) => (target.run)(input),
        None => panic!("there is no target {name}"),
    }
}
