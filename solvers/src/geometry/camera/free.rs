//! Which parameters of a camera are free, and which of these share one unknown.
//!
//! A step of n unknowns moves the P parameters by E · step, where E (P × n) has at most one 1 in each
//! row: a constant parameter has a row of zeros, and fx and fy may have the same row. So
//! ∂pixel/∂unknowns = ∂pixel/∂parameters · E. The unknowns have the order of the parameters. Nothing
//! here depends on the values of the parameters.

use nalgebra::SMatrix;

use super::{Camera, MAX_PARAMETERS};

/// Marks a parameter that is constant.
const CONSTANT: u8 = u8::MAX;

/// What a parameter of a camera describes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterKind {
    /// A focal length.
    FocalLength,
    /// A coordinate of the principal point.
    PrincipalPoint,
    /// A coefficient of the distortion.
    Distortion,
}

/// The free parameters of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FreeParameters {
    /// The unknown of each parameter, or [`CONSTANT`].
    unknowns: [u8; MAX_PARAMETERS],
}

impl FreeParameters {
    /// Every parameter is free and has an unknown of its own.
    pub const ALL: Self = Self { unknowns: [0, 1, 2, 3, 4, 5, 6, 7, 8] };

    /// No parameter is free.
    pub const NONE: Self = Self { unknowns: [CONSTANT; MAX_PARAMETERS] };

    /// The parameters that are marked are free. With `has_one_focal_length`, the first two share one
    /// unknown where both are free: they move by the same amount, so that equal ones stay equal. Models
    /// with one focal length take no such mark.
    #[must_use]
    pub fn new(is_free: [bool; MAX_PARAMETERS], has_one_focal_length: bool) -> Self {
        let mut unknowns = [CONSTANT; MAX_PARAMETERS];
        let mut next = 0;
        for (parameter, unknown) in unknowns.iter_mut().enumerate().filter(|(k, _)| is_free[*k]) {
            if parameter == 1 && has_one_focal_length && is_free[0] {
                *unknown = 0;
                continue;
            }
            *unknown = next;
            next += 1;
        }
        Self { unknowns }
    }

    /// Whether each parameter is free.
    #[must_use]
    pub fn is_free(&self) -> [bool; MAX_PARAMETERS] {
        self.unknowns.map(|unknown| unknown != CONSTANT)
    }

    /// Whether the first two parameters share one unknown.
    #[must_use]
    pub fn has_one_focal_length(&self) -> bool {
        self.unknowns[0] != CONSTANT && self.unknowns[0] == self.unknowns[1]
    }

    /// The same, with the parameters constant whose kind is not wanted.
    #[must_use]
    pub fn only(&self, camera: &Camera, is_wanted: impl Fn(ParameterKind) -> bool) -> Self {
        let mut is_free = self.is_free();
        for (parameter, is_free) in is_free.iter_mut().enumerate() {
            *is_free &= is_wanted(camera.parameter_kind(parameter));
        }
        Self::new(is_free, self.has_one_focal_length())
    }

    /// The number of unknowns of a camera with so many parameters.
    #[must_use]
    pub fn count(&self, parameters: usize) -> usize {
        let own = self.unknowns.iter().take(parameters).filter(|&&unknown| unknown != CONSTANT);
        own.max().map_or(0, |&last| usize::from(last) + 1)
    }

    /// ∂pixel/∂unknowns from ∂pixel/∂parameters; the columns past the unknowns are zero.
    #[inline]
    #[must_use]
    pub fn of_unknowns(
        &self,
        d_parameters: &SMatrix<f64, 2, MAX_PARAMETERS>,
    ) -> SMatrix<f64, 2, MAX_PARAMETERS> {
        let mut d_unknowns = SMatrix::<f64, 2, MAX_PARAMETERS>::zeros();
        for (column, &unknown) in d_parameters.column_iter().zip(&self.unknowns) {
            if unknown != CONSTANT {
                let mut sum = d_unknowns.column_mut(unknown.into());
                sum += column;
            }
        }
        d_unknowns
    }

    /// The step of the parameters for one of the unknowns; unknowns that are missing count as zero.
    #[must_use]
    pub fn of_parameters(&self, step: &[f64]) -> [f64; MAX_PARAMETERS] {
        self.unknowns.map(|unknown| step.get(usize::from(unknown)).copied().unwrap_or(0.0))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{SVector, Vector3};

    use super::*;
    use crate::geometry::{KannalaBrandt, PinholeRadialTangential, Snavely};
    use crate::testing::assert_jacobian;

    const FOCAL: [bool; 9] = [true, true, false, false, false, false, false, false, false];

    #[test]
    fn unknowns_are_numbered_in_the_order_of_the_parameters() {
        assert_eq!(FreeParameters::new([true; 9], false), FreeParameters::ALL);
        assert_eq!(FreeParameters::new([false; 9], true), FreeParameters::NONE);
        assert_eq!([9, 8, 3].map(|p| FreeParameters::ALL.count(p)), [9, 8, 3]);
        assert_eq!(FreeParameters::NONE.count(9), 0);
        let one = FreeParameters::new(FOCAL, true);
        assert_eq!((one.count(9), one.has_one_focal_length(), one.is_free()), (1, true, FOCAL));
        assert_eq!(one.of_parameters(&[2.0])[..3], [2.0, 2.0, 0.0]);
        let two = FreeParameters::new(FOCAL, false);
        assert_eq!((two.count(9), two.has_one_focal_length()), (2, false));
        // A free fy beside a constant fx has an unknown of its own.
        let mut only_fy = FOCAL;
        only_fy[0] = false;
        let only_fy = FreeParameters::new(only_fy, true);
        assert_eq!((only_fy.count(9), only_fy.of_parameters(&[2.0])[1]), (1, 2.0));
    }

    #[test]
    fn kinds_of_parameters_are_chosen_for_every_model() {
        let pinhole: Camera = PinholeRadialTangential::undistorted(500.0, 500.0, 1.0, 2.0).into();
        let [fx, fy, cx, cy] = [300.0, 301.0, 320.0, 240.0];
        let fisheye: Camera =
            KannalaBrandt { fx, fy, cx, cy, k1: 0.0, k2: 0.0, k3: 0.0, k4: 0.0 }.into();
        let snavely: Camera = Snavely { focal: 500.0, k1: 0.0, k2: 0.0 }.into();
        use ParameterKind::{Distortion, FocalLength, PrincipalPoint};
        for (camera, counts) in [(pinhole, [2, 2, 5]), (fisheye, [2, 2, 4]), (snavely, [1, 0, 2])] {
            let found = [FocalLength, PrincipalPoint, Distortion].map(|wanted| {
                FreeParameters::ALL
                    .only(&camera, |kind| kind == wanted)
                    .count(camera.parameter_count())
            });
            assert_eq!(found, counts, "{camera:?}");
        }
        let shared = FreeParameters::new([true; 9], true);
        let focal = shared.only(&pinhole, |kind| kind == FocalLength);
        assert_eq!(focal, FreeParameters::new(FOCAL, true), "the focal length stays one unknown");
    }

    #[test]
    fn the_jacobian_of_the_unknowns_is_that_of_central_differences() {
        let camera: Camera = PinholeRadialTangential {
            k1: 0.1,
            k2: -0.02,
            p1: 0.003,
            p2: -0.001,
            k3: 0.004,
            ..PinholeRadialTangential::undistorted(500.0, 500.0, 320.0, 240.0)
        }
        .into();
        let point = Vector3::new(0.4, -0.3, 1.1);
        let mut is_free = [true; 9];
        (is_free[3], is_free[6]) = (false, false);
        for has_one_focal_length in [false, true] {
            let free = FreeParameters::new(is_free, has_one_focal_length);
            let pixel = |step: &SVector<f64, 9>| {
                let mut moved = camera;
                moved.plus_parameters(&free.of_parameters(step.as_slice()));
                moved.project(&point).unwrap_or_default()
            };
            let projection = camera.project_with_jacobians(&point).expect("it is in front");
            let analytic = free.of_unknowns(&projection.d_parameters);
            assert_jacobian("unknowns", pixel, &analytic, 1e-9);
            let zeros = analytic.columns(free.count(9), 9 - free.count(9)).norm();
            assert_eq!(zeros, 0.0, "columns past the unknowns");
        }
    }
}
