//! What a session sends, without naming the oneof: each kind of message is its item.

use super::ingest::Item;
use crate::wire::v1;

macro_rules! items {
    ($($message:ident => $variant:ident,)*) => {
        $(
            impl From<v1::$message> for Item {
                fn from(message: v1::$message) -> Self {
                    Self::$variant(message)
                }
            }
        )*
    };
}

items! {
    Camera => Camera,
    Keyframe => Keyframe,
    LandmarkBatch => Landmarks,
    ObservationBatch => Observations,
    RelativePoseConstraint => RelativePose,
    PositionPrior => PositionPrior,
    PosePrior => PosePrior,
}
