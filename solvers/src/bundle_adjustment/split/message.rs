//! What a coordinator and a worker say to each other: plain values in, plain values out.
//!
//! A request names its values by number, so that an answer depends on no earlier message: a worker that
//! was started again is sent the section and those values again, and the answer has the same bits.
//! Their bytes are made by `codec`.

use std::path::PathBuf;

use super::section::{Section, Values};
use crate::simd::Class;

/// The number of a state of all variables.
pub type Version = u64;

/// The values that a section comes with.
pub const START: Version = 0;

/// Where a section is.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// In the message.
    Here(Box<Section>),
    /// In a file that the worker can read: first byte and length.
    File {
        /// The file.
        path: PathBuf,
        /// First byte.
        offset: u64,
        /// Bytes.
        length: u64,
    },
}

/// Variables of a section's border, by its own indices, in the order of its unknowns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BorderPart {
    /// The six unknowns of a pose.
    Pose(u32),
    /// All unknowns of a camera.
    Camera(u32),
}

/// How to linearize.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Linearize {
    /// Where.
    pub base: Version,
    /// λ.
    pub damping: f64,
    /// The least curvature of a loss along its residual.
    pub stiffness: f64,
}

/// What a linearized system leaves on its border.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Contribution {
    /// Largest |g_i| / √D_i inside, landmarks included.
    pub gradient_max_norm: f64,
    /// Whether everything inside could be eliminated; the matrix is empty where not.
    pub is_definite: bool,
    /// Lower triangle over the border, column after column, without damping of the border.
    pub matrix: Vec<f64>,
    /// Right-hand side over the border.
    pub right: Vec<f64>,
    /// Gradient over the border before anything is eliminated.
    pub gradient: Vec<f64>,
    /// Diagonal of H over the border before anything is eliminated.
    pub diagonal: Vec<f64>,
}

/// What a system's own unknowns add to the figures of a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StepPart {
    /// δᵀ(λDδ − g) inside.
    pub decrease: f64,
    /// ‖δ‖² inside.
    pub squared: f64,
    /// Squared residual of the linear system inside.
    pub residual_squared: f64,
    /// Squared right-hand side inside.
    pub right_squared: f64,
    /// The residual's summand over the border.
    pub border_residual: Vec<f64>,
    /// The right-hand side's summand over the border, landmarks eliminated.
    pub border_right: Vec<f64>,
}

/// How the variables move along a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Multiple of the step.
    pub length: f64,
    /// Whether landmarks are minimized afterwards.
    pub has_inner_iterations: bool,
}

/// What is asked of a worker. Sections are numbered by the coordinator.
#[derive(Clone, Debug, PartialEq)]
pub enum Request {
    /// The first request of all.
    Open {
        /// The instruction set of the kernels.
        class: Class,
        /// Most bytes that one section may take; larger ones are refused.
        ceiling_bytes: Option<u64>,
        /// Most floating-point operations of one iteration of a section.
        ceiling_flops: Option<f64>,
        /// Bytes of sections that are kept between requests.
        keep_bytes: u64,
    },
    /// From now on the worker has this section, at its values, number [`START`].
    Load {
        /// Its number.
        section: u32,
        /// Where it is.
        source: Source,
    },
    /// The values of a version.
    SetValues {
        /// The section.
        section: u32,
        /// Their number.
        version: Version,
        /// The values.
        values: Values,
    },
    /// The cost of a version.
    Cost {
        /// The section.
        section: u32,
        /// The version.
        base: Version,
    },
    /// What the section leaves on its border.
    Contribute {
        /// The section.
        section: u32,
        /// How.
        linearize: Linearize,
    },
    /// The step inside for the border's, taken from the base to a new version.
    Move {
        /// The section.
        section: u32,
        /// How the system was made whose step it is.
        linearize: Linearize,
        /// The border's step.
        step: Vec<f64>,
        /// How far.
        motion: Motion,
        /// The number of the new version.
        version: Version,
    },
}

/// What a worker answers.
#[derive(Clone, Debug, PartialEq)]
pub enum Reply {
    /// To [`Request::SetValues`].
    Done,
    /// To [`Request::Open`]: the instruction set that will be used.
    Opened(Class),
    /// To [`Request::Load`].
    Loaded {
        /// The unknowns of the border, in order.
        border: Vec<BorderPart>,
        /// What the section takes, estimated, bytes.
        bytes: u64,
    },
    /// To [`Request::Cost`].
    Cost(f64),
    /// To [`Request::Contribute`].
    Contributed(Contribution),
    /// To [`Request::Move`].
    Moved {
        /// The step's figures.
        part: StepPart,
        /// The cost of the new version.
        cost: f64,
        /// The new version.
        values: Values,
    },
    /// The request cannot be served: why, in words.
    Refused(String),
}

/// A reply with what it took.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// Seconds from the request to the reply, by the worker's clock.
    pub seconds: f64,
    /// Most memory that the worker's process ever had, bytes; 0 where the system does not tell.
    pub peak_bytes: u64,
    /// The reply.
    pub reply: Reply,
}
