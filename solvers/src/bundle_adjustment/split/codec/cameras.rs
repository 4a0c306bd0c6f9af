//! Camera models by their parameters, and which of these are free.

use nalgebra::SMatrix;

use super::{CodecError, Coded, Input};
use crate::geometry::{
    CameraModel, FreeParameters, KannalaBrandt, PinholeRadialTangential, Snavely,
};

macro_rules! camera_models {
    ($($model:ty, $count:literal;)*) => {$(
        impl Coded for $model {
            const LEAST: usize = 8 * $count;
            fn put(&self, out: &mut Vec<u8>) {
                CameraModel::<$count>::parameters(self).put(out);
            }
            fn take(input: &mut Input<'_>) -> Result<Self, CodecError> {
                let parameters = SMatrix::<f64, $count, 1>::take(input)?;
                Ok(<$model as CameraModel<$count>>::from_parameters(&parameters))
            }
        }
    )*};
}

camera_models! {
    PinholeRadialTangential, 9;
    KannalaBrandt, 8;
    Snavely, 3;
}

/// A flag for each parameter, and one for the focal lengths that share an unknown.
impl Coded for FreeParameters {
    const LEAST: usize = 10;

    fn put(&self, out: &mut Vec<u8>) {
        self.is_free().iter().for_each(|is_free| is_free.put(out));
        self.has_one_focal_length().put(out);
    }

    fn take(input: &mut Input<'_>) -> Result<Self, CodecError> {
        let mut is_free = [false; 9];
        for is_free in &mut is_free {
            *is_free = bool::take(input)?;
        }
        Ok(Self::new(is_free, bool::take(input)?))
    }
}
