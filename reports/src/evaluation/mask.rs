//! How well a mask of what moves agrees with the truth: intersection over union, and what it takes
//! away without need.
//!
//! A mask has one byte a pixel, row by row; more than 127 is masked. Knows no files.

use super::{EvaluationError, Statistics};

/// A truth that covers less of the frame than this has no meaningful IoU: a figure that only just
/// enters it is a few pixels wide.
pub const LEAST_COVERAGE: f64 = 0.02;

/// What two masks of one frame have in common, in pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MaskOverlap {
    /// All pixels of the frame.
    pub pixels: usize,
    /// Those that the truth masks.
    pub truth: usize,
    /// Those that the estimate masks.
    pub estimate: usize,
    /// Those that both mask.
    pub both: usize,
}

impl MaskOverlap {
    /// Counts the pixels of one frame.
    ///
    /// # Errors
    /// [`EvaluationError::UnequalMasks`] where one has more pixels than the other.
    pub fn of(truth: &[u8], estimate: &[u8]) -> Result<Self, EvaluationError> {
        if truth.len() != estimate.len() {
            let (truth, estimate) = (truth.len(), estimate.len());
            return Err(EvaluationError::UnequalMasks { truth, estimate });
        }
        let mut overlap = Self { pixels: truth.len(), ..Self::default() };
        for (truth, estimate) in truth.iter().zip(estimate) {
            let (truth, estimate) = (*truth > 127, *estimate > 127);
            overlap.truth += usize::from(truth);
            overlap.estimate += usize::from(estimate);
            overlap.both += usize::from(truth && estimate);
        }
        Ok(overlap)
    }

    /// Counts the pixels of a frame in which nothing moves.
    #[must_use]
    pub fn of_static(estimate: &[u8]) -> Self {
        let masked = estimate.iter().filter(|&&pixel| pixel > 127).count();
        Self { pixels: estimate.len(), truth: 0, estimate: masked, both: 0 }
    }

    /// Both over either; `None` where neither masks anything.
    pub fn iou(&self) -> Option<f64> {
        let either = self.truth + self.estimate - self.both;
        (either > 0).then(|| self.both as f64 / either as f64)
    }

    /// The share of the frame that the truth masks, 0 for a frame without pixels.
    pub fn coverage(&self) -> f64 {
        share(self.truth, self.pixels)
    }

    /// The share of the frame that the estimate masks.
    pub fn masked_share(&self) -> f64 {
        share(self.estimate, self.pixels)
    }

    /// The share of the frame that the estimate masks and the truth does not.
    pub fn false_share(&self) -> f64 {
        share(self.estimate - self.both, self.pixels)
    }
}

fn share(part: usize, whole: usize) -> f64 {
    part as f64 / whole.max(1) as f64
}

/// The masks of a sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct MaskEvaluation {
    /// IoU of the frames whose truth covers at least [`LEAST_COVERAGE`]; its `count` is how many.
    pub iou: Statistics,
    /// The share of pixels that are masked although they do not move, of all frames.
    pub false_share: Statistics,
    /// The share of pixels that are masked, of all frames.
    pub masked_share: Statistics,
}

impl MaskEvaluation {
    /// Of these frames.
    #[must_use]
    pub fn of(frames: &[MaskOverlap]) -> Self {
        let of_all = |share: fn(&MaskOverlap) -> f64| {
            Statistics::of(&frames.iter().map(share).collect::<Vec<_>>())
        };
        let covered = frames.iter().filter(|frame| frame.coverage() >= LEAST_COVERAGE);
        Self {
            iou: Statistics::of(&covered.filter_map(MaskOverlap::iou).collect::<Vec<_>>()),
            false_share: of_all(MaskOverlap::false_share),
            masked_share: of_all(MaskOverlap::masked_share),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mask of 100 pixels of which `range` is masked.
    fn mask(range: std::ops::Range<usize>) -> Vec<u8> {
        (0..100).map(|k| if range.contains(&k) { 255 } else { 0 }).collect()
    }

    #[test]
    fn overlap_counts_pixels_above_127() {
        let overlap = MaskOverlap::of(&mask(10..30), &mask(20..60)).unwrap();
        assert_eq!(overlap, MaskOverlap { pixels: 100, truth: 20, estimate: 40, both: 10 });
        assert_eq!(overlap.iou(), Some(0.2));
        let shares = (overlap.coverage(), overlap.masked_share(), overlap.false_share());
        assert_eq!(shares, (0.2, 0.4, 0.3));
        let overlap = MaskOverlap::of(&[127, 128, 255, 0], &[128, 127, 200, 1]).unwrap();
        assert_eq!(overlap, MaskOverlap { pixels: 4, truth: 2, estimate: 2, both: 1 });
        assert_eq!(MaskOverlap::of_static(&mask(0..7)).false_share(), 0.07);
        let error = MaskOverlap::of(&[0; 4], &[0; 6]).unwrap_err().to_string();
        assert!(error.contains('4') && error.contains('6'), "{error}");
        assert_eq!(MaskOverlap::default().iou(), None);
        assert_eq!(MaskOverlap::default().false_share(), 0.0);
    }

    #[test]
    fn only_frames_with_enough_truth_have_an_iou_and_all_have_a_false_share() {
        let frame = |truth, estimate| MaskOverlap::of(&mask(truth), &mask(estimate)).unwrap();
        let evaluation = MaskEvaluation::of(&[
            frame(0..10, 0..10),
            frame(0..10, 5..10),
            // Exactly 2 % counts, and a mask that sees nothing of it has an IoU of 0.
            frame(0..2, 0..0),
            frame(0..1, 0..1),
            frame(0..0, 0..40),
        ]);
        assert_eq!((evaluation.iou.count, evaluation.iou.mean), (3, 0.5));
        assert_eq!((evaluation.false_share.count, evaluation.false_share.mean), (5, 0.08));
        assert!((evaluation.masked_share.mean - 0.112).abs() < 1e-15);
        let none = MaskEvaluation::of(&[]);
        assert_eq!((none.iou.count, none.false_share.count), (0, 0));
    }
}
