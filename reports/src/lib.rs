//! What a result is worth, and how a reader sees it: errors of trajectories and masks, and reports as HTML.
//!
//! Both are functions of numbers and text: no clock, no files, no wire, no map. This crate may use the geometry
//! of `covis-solvers` and nothing else of covis. Recordings (MCAP) are in the command line, which follows maps.
//!
//! | module | role |
//! |---|---|
//! | [`evaluation`] | trajectory errors as evo and the TUM scripts define them, overlap of masks |
//! | [`html`] | reports as HTML files: pages, tables, pictures |

pub mod evaluation;
pub mod html;
