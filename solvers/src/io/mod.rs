//! Files: BAL, Bundler, COLMAP sparse models, OpenMVG, g2o, PyFactorGraph, trajectories of TUM, KITTI and
//! EuRoC, pose matrices, PLY.
//!
//! Each format has a plain struct that holds the file's own numbers and writes them back, and a
//! conversion to and from problems. Conventions of a format (axes, pixel centers, direction of a
//! transform) are converted here and nowhere else; [`mod@format`] has the one list of formats. Readers take any bytes without a panic, allocate
//! nothing from a count that the file has not proven, and name line or byte of what they refuse.
//! Writers come thrice: to a file, to bytes for a caller without a file system, and record by record
//! (`put_…`) for one that does not hold the whole either.
//!
//! | file | role |
//! |---|---|
//! | `bal`, `bundler`, `colmap` | bundle adjustment problems |
//! | `openmvg` | bundle adjustment problems, read only |
//! | `sparse_model`, `down_z` | the way between these; cameras that look down −z |
//! | `g2o` | pose graphs |
//! | `pyfg` | pose graphs with ranges and named variables |
//! | `trajectory`, `pose_matrix` | TUM, KITTI and EuRoC; one matrix a file |
//! | `ply` | written only |
//! | `format` | the list of formats, and how one is recognized |
//! | `reading` | memory of a reading, before it |
//! | `text`, `binary`, `files`, `rotation`, `symmetric`, `changed_lines`, `natural_order`, `error` | what they share |

pub mod bal;
mod binary;
pub mod bundler;
mod changed_lines;
pub mod colmap;
mod down_z;
mod error;
mod files;
pub mod format;
pub mod g2o;
mod natural_order;
pub mod openmvg;
pub mod ply;
pub mod pose_matrix;
pub mod pyfg;
pub mod reading;
mod rotation;
pub mod sparse_model;
mod symmetric;
mod text;
pub mod trajectory;

pub use error::{At, IoError, Location};
pub use natural_order::natural_cmp;
