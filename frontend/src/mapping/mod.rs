//! The bridge to the server: keyframes are sent as items, `WatchMap` returns corrections,
//! `Localize` finds where a lost camera is.
//!
//! | file | role |
//! |---|---|
//! | [`run`] | a whole sequence: starts tracking, serves it, and computes the trajectory |
//! | `tracker` | the tracking thread |
//! | `handover` | what both threads give each other without waiting |
//! | `mapper` | the session and the watch |
//! | `localizer` | asks where a lost camera is |
//! | [`solves`] | what the server's solves reached, for reports |
//! | `book` | which keyframes the server knows, and what its answers correct |
//! | `encode`, [`messages`] | messages |
//!
//! The only asynchronous part of the frontend, and the only one that uses messages; it decides nothing
//! about tracking. Ids are those of [`crate::local_map`], the client is the frontend's own.

mod book;
mod encode;
mod handover;
mod localizer;
mod mapper;
pub mod messages;
pub mod run;
pub mod solves;
mod tracker;
