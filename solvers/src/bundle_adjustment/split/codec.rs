//! Messages as bytes: little-endian numbers one after the other, lists with their count first.
//!
//! A count is checked against the bytes that are left before anything is reserved for it. What is read
//! is of the right form; whether indices exist is for the reader of the message to check.

mod cameras;

use std::path::PathBuf;

use nalgebra::{Quaternion, SMatrix, UnitQuaternion, Vector2, Vector3};

use super::message::{
    Answer, BorderPart, Contribution, Linearize, Motion, Reply, Request, Source, StepPart,
};
use super::section::{Section, Values};
use crate::factors::{
    DepthReprojectionBatch, PosePrior, PositionPrior, RelativePose, ReprojectionBatch,
};
use crate::geometry::{Camera, FreeParameters, Se3, So3};
use crate::information::Information;
use crate::loss::Loss;
use crate::problem::BundleProblem;
use crate::simd::Class;

/// Why bytes are no message.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CodecError {
    /// The bytes end within a value.
    #[error("the message ends at byte {at}, within {what}")]
    Truncated {
        /// Where.
        at: usize,
        /// In what.
        what: &'static str,
    },
    /// A value that its kind does not have.
    #[error("byte {at} has no valid {what}")]
    Invalid {
        /// Where.
        at: usize,
        /// Of what.
        what: &'static str,
    },
    /// Bytes follow the message.
    #[error("{count} bytes follow the message")]
    Trailing {
        /// How many.
        count: usize,
    },
}

/// The bytes of a value.
pub(super) fn encode<T: Coded>(value: &T) -> Vec<u8> {
    let mut bytes = Vec::new();
    value.put(&mut bytes);
    bytes
}

/// The value that bytes are, all of them.
pub(super) fn decode<T: Coded>(bytes: &[u8]) -> Result<T, CodecError> {
    let mut input = Input { bytes, at: 0 };
    let value = T::take(&mut input)?;
    match bytes.len() - input.at {
        0 => Ok(value),
        count => Err(CodecError::Trailing { count }),
    }
}

/// Bytes and how far they are read.
pub(super) struct Input<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Input<'a> {
    fn slice(&mut self, length: usize, what: &'static str) -> Result<&'a [u8], CodecError> {
        let truncated = CodecError::Truncated { at: self.bytes.len(), what };
        let end = self.at.checked_add(length).ok_or_else(|| truncated.clone())?;
        let slice = self.bytes.get(self.at..end).ok_or(truncated)?;
        self.at = end;
        Ok(slice)
    }

    fn array<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N], CodecError> {
        let at = self.at;
        let slice = self.slice(N, what)?;
        slice.try_into().map_err(|_never| CodecError::Invalid { at, what })
    }

    fn invalid<T>(&self, what: &'static str) -> Result<T, CodecError> {
        Err(CodecError::Invalid { at: self.at, what })
    }
}

/// A value with a form in bytes.
pub(super) trait Coded: Sized {
    /// The fewest bytes that one takes.
    const LEAST: usize;
    fn put(&self, out: &mut Vec<u8>);
    fn take(input: &mut Input<'_>) -> Result<Self, CodecError>;
}

macro_rules! numbers {
    ($($number:ty, $name:literal;)*) => {$(
        impl Coded for $number {
            const LEAST: usize = size_of::<$number>();
            fn put(&self, out: &mut Vec<u8>) {
                out.extend_from_slice(&self.to_le_bytes());
            }
            fn take(input: &mut Input<'_>) -> Result<Self, CodecError> {
                Ok(Self::from_le_bytes(input.array($name)?))
            }
        }
    )*};
}

numbers! {
    u8, "a byte";
    u32, "a number";
    u64, "a number";
    f64, "a number";
}

/// Structs: their fields one after the other.
macro_rules! structs {
    ($($name:ty { $($field:ident: $kind:ty),* $(,)? })*) => {$(
        impl Coded for $name {
            const LEAST: usize = 0 $(+ <$kind as Coded>::LEAST)*;
            fn put(&self, out: &mut Vec<u8>) {
                $(self.$field.put(out);)*
            }
            fn take(input: &mut Input<'_>) -> Result<Self, CodecError> {
                Ok(Self { $($field: Coded::take(input)?),* })
            }
        }
    )*};
}

structs! {
    Section {
        problem: BundleProblem,
        cameras_apart: Vec<bool>,
        border_poses: Vec<bool>,
        border_cameras: Vec<bool>,
    }
    BundleProblem {
        poses: Vec<Se3>,
        cameras: Vec<Camera>,
        landmarks: Vec<Vector3<f64>>,
        constant_poses: Vec<bool>,
        constant_cameras: Vec<bool>,
        free_parameters: Vec<FreeParameters>,
        constant_landmarks: Vec<bool>,
        reprojections: ReprojectionBatch,
        depth_reprojections: DepthReprojectionBatch,
        relative_poses: Vec<RelativePose<Se3, 6>>,
        pose_priors: Vec<PosePrior>,
        position_priors: Vec<PositionPrior>,
        observation_loss: Loss,
        relative_pose_loss: Loss,
    }
    ReprojectionBatch {
        poses: Vec<u32>,
        cameras: Vec<u32>,
        landmarks: Vec<u32>,
        pixels: Vec<Vector2<f64>>,
        sigmas_px: Vec<f64>,
    }
    DepthReprojectionBatch {
        poses: Vec<u32>,
        cameras: Vec<u32>,
        landmarks: Vec<u32>,
        pixels: Vec<Vector2<f64>>,
        depths_m: Vec<f64>,
        sigmas_px: Vec<f64>,
        sigmas_depth_m: Vec<f64>,
    }
    RelativePose<Se3, 6> {
        i: usize,
        j: usize,
        i_from_j: Se3,
        information: Information<6>,
        loss: Option<Loss>,
    }
    PosePrior {
        pose: usize,
        world_from_camera: Se3,
        information: Information<6>,
        loss: Loss,
    }
    PositionPrior {
        pose: usize,
        position_in_world: Vector3<f64>,
        point_in_camera: Vector3<f64>,
        information: Information<3>,
        loss: Loss,
    }
    Values {
        poses: Vec<Se3>,
        cameras: Vec<Camera>,
        landmarks: Vec<Vector3<f64>>,
    }
    Linearize {
        base: u64,
        damping: f64,
        stiffness: f64,
    }
    Motion {
        length: f64,
        has_inner_iterations: bool,
    }
    Contribution {
        gradient_max_norm: f64,
        is_definite: bool,
        matrix: Vec<f64>,
        right: Vec<f64>,
        gradient: Vec<f64>,
        diagonal: Vec<f64>,
    }
    StepPart {
        decrease: f64,
        squared: f64,
        residual_squared: f64,
        right_squared: f64,
        border_residual: Vec<f64>,
        border_right: Vec<f64>,
    }
    Answer {
        seconds: f64,
        peak_bytes: u64,
        reply: Reply,
    }
}

/// Enums: a byte for the variant, then its fields.
macro_rules! enums {
    ($($name:ty, $what:literal {
        $($tag:literal => $variant:ident $(($inner:ident))? $({ $($field:ident),* })?,)*
    })*) => {$(
        impl Coded for $name {
            const LEAST: usize = 1;
            fn put(&self, out: &mut Vec<u8>) {
                match self {
                    $(Self::$variant $(($inner))? $({ $($field),* })? => {
                        out.push($tag);
                        $($inner.put(out);)?
                        $($($field.put(out);)*)?
                    })*
                }
            }
            fn take(input: &mut Input<'_>) -> Result<Self, CodecError> {
                match u8::take(input)? {
                    $($tag => {
                        $(let $inner = Coded::take(input)?;)?
                        $($(let $field = Coded::take(input)?;)*)?
                        Ok(Self::$variant $(($inner))? $({ $($field),* })?)
                    })*
                    _ => input.invalid($what),
                }
            }
        }
    )*};
}

enums! {
    Loss, "loss" {
        0 => Trivial,
        1 => Huber(width),
        2 => Cauchy(width),
        3 => Tukey(width),
        4 => GemanMcClure(width),
    }
    Camera, "camera model" {
        0 => Pinhole(camera),
        1 => Fisheye(camera),
        2 => Snavely(camera),
    }
    Class, "instruction set" {
        0 => Scalar,
        1 => Avx2,
        2 => Avx512,
        3 => Neon,
    }
    BorderPart, "part of a border" {
        0 => Pose(index),
        1 => Camera(index),
    }
    Source, "source" {
        0 => Here(section),
        1 => File { path, offset, length },
    }
    Request, "request" {
        0 => Open { class, ceiling_bytes, ceiling_flops, keep_bytes },
        1 => Load { section, source },
        2 => SetValues { section, version, values },
        3 => Cost { section, base },
        4 => Contribute { section, linearize },
        5 => Move { section, linearize, step, motion, version },
    }
    Reply, "reply" {
        0 => Done,
        1 => Opened(class),
        2 => Loaded { border, bytes },
        3 => Cost(cost),
        4 => Contributed(contribution),
        5 => Moved { part, cost, values },
        6 => Refused(reason),
    }
}

impl Coded for bool {
    const LEAST: usize = 1;

    fn put(&self, out: &mut Vec<u8>) {
        out.push(u8::from(*self));
    }

    fn take(input: &mut Input<'_>) -> Result<Self, CodecError> {
        match u8::take(input)? {
            0 => Ok(false),
            1 => Ok(true),
            _ => input.invalid("flag"),
        }
    }
}

impl Coded for usize {
    const LEAST: usize = 8;

    fn put(&self, out: &mut Vec<u8>) {
        (*self as u64).put(out);
    }

    fn take(input: &mut Input<'_>) -> Result<Self, CodecError> {
        let number = u64::take(input)?;
        Self::try_from(number).or_else(|_too_large| input.invalid("index"))
    }
}

impl<T: Coded> Coded for Vec<T> {
    const LEAST: usize = 8;

    fn put(&self, out: &mut Vec<u8>) {
        self.len().put(out);
        out.reserve(self.len() * T::LEAST);
        self.iter().for_each(|item| item.put(out));
    }

    fn take(input: &mut Input<'_>) -> Result<Self, CodecError> {
        let count = usize::take(input)?;
        if count > (input.bytes.len() - input.at) / T::LEAST.max(1) {
            return Err(CodecError::Truncated { at: input.bytes.len(), what: "a list" });
        }
        let mut list = Self::with_capacity(count);
        for _ in 0..count {
            list.push(T::take(input)?);
        }
        Ok(list)
    }
}

impl<T: Coded> Coded for Box<T> {
    const LEAST: usize = T::LEAST;

    fn put(&self, out: &mut Vec<u8>) {
        T::put(self, out);
    }

    fn take(input: &mut Input<'_>) -> Result<Self, CodecError> {
        T::take(input).map(Self::new)
    }
}

impl<T: Coded> Coded for Option<T> {
    const LEAST: usize = 1;

    fn put(&self, out: &mut Vec<u8>) {
        self.is_some().put(out);
        self.iter().for_each(|value| value.put(out));
    }

    fn take(input: &mut Input<'_>) -> Result<Self, CodecError> {
        if bool::take(input)? { T::take(input).map(Some) } else { Ok(None) }
    }
}

impl Coded for String {
    const LEAST: usize = 8;

    fn put(&self, out: &mut Vec<u8>) {
        self.len().put(out);
        out.extend_from_slice(self.as_bytes());
    }

    fn take(input: &mut Input<'_>) -> Result<Self, CodecError> {
        let length = usize::take(input)?;
        let bytes = input.slice(length, "a text")?;
        match std::str::from_utf8(bytes) {
            Ok(text) => Ok(text.to_owned()),
            Err(_not_text) => input.invalid("text"),
        }
    }
}

/// A path that is text, as those of scratch files are.
impl Coded for PathBuf {
    const LEAST: usize = 8;

    fn put(&self, out: &mut Vec<u8>) {
        self.to_string_lossy().into_owned().put(out);
    }

    fn take(input: &mut Input<'_>) -> Result<Self, CodecError> {
        String::take(input).map(Self::from)
    }
}

impl<const R: usize, const C: usize> Coded for SMatrix<f64, R, C> {
    const LEAST: usize = 8 * R * C;

    fn put(&self, out: &mut Vec<u8>) {
        self.iter().for_each(|x| x.put(out));
    }

    fn take(input: &mut Input<'_>) -> Result<Self, CodecError> {
        let mut matrix = Self::zeros();
        for x in matrix.iter_mut() {
            *x = f64::take(input)?;
        }
        Ok(matrix)
    }
}

impl<const N: usize> Coded for Information<N> {
    const LEAST: usize = 8 * N * N;

    fn put(&self, out: &mut Vec<u8>) {
        self.matrix().put(out);
    }

    fn take(input: &mut Input<'_>) -> Result<Self, CodecError> {
        let matrix = SMatrix::<f64, N, N>::take(input)?;
        if matrix.iter().all(|x| x.is_finite()) && matrix == matrix.transpose() {
            return Ok(Self::from_checked(matrix));
        }
        input.invalid("information matrix")
    }
}

/// Quaternion (x, y, z, w) and translation.
impl Coded for Se3 {
    const LEAST: usize = 56;

    fn put(&self, out: &mut Vec<u8>) {
        self.rotation.quaternion().coords.put(out);
        self.translation.put(out);
    }

    fn take(input: &mut Input<'_>) -> Result<Self, CodecError> {
        let quaternion = Quaternion::from(SMatrix::<f64, 4, 1>::take(input)?);
        if (quaternion.norm() - 1.0).abs() > 1e-9 {
            return input.invalid("rotation");
        }
        // Its bits are kept.
        let rotation = So3::from_unit_quaternion(UnitQuaternion::new_unchecked(quaternion));
        Ok(Self { rotation, translation: Coded::take(input)? })
    }
}
