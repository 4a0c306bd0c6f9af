//! By how much the stated deviations of a client's views are off.
//!
//! After a window was solved, the median of its squared residuals says how large their deviations are, also
//! where a good part of the views is wrong: of a χ² with two degrees of freedom (pixels) it is 2 ln 2, of one
//! with one (depths) 0.455. A solve that frees much makes residuals smaller than errors are; on average the
//! share of measurements that no unknown takes up is left (the redundancy of a window).
//!
//! What is larger than stated counts as what it is. What is smaller does not count for more: tracks that
//! slide along an edge fit each other better than they fit the world. It does decide from when on a loss lets
//! go ([`ViewNoise::width`]).
//!
//! The views that a window's loss let go of are counted: things that move, tracks that slid to another point.
//! The loss decides anew in each window, so that a view which fits again counts again. Nothing is solved here.

use std::collections::BTreeMap;

use covis_solvers::loss::Loss;

use super::numbers::{is_positive, median};
use super::{ClientIndex, MapProblem};

/// Median of χ² with two degrees of freedom.
const PIXEL_MEDIAN: f64 = 1.386_294_361_119_890_6;
/// Median of χ² with one degree of freedom.
const DEPTH_MEDIAN: f64 = 0.454_936_423_119_572_4;
/// What the factors may become.
const FACTORS: std::ops::RangeInclusive<f64> = 0.1..=100.0;
/// Windows before which nothing is said, and those that are remembered.
const LEAST_WINDOWS: f64 = 5.0;
const MOST_WINDOWS: f64 = 30.0;
/// Views of a client from which on a median counts.
const LEAST_VIEWS: usize = 30;
/// Share of the measurements that has to be left.
const LEAST_REDUNDANCY: f64 = 0.2;
/// Widths of a loss in real deviations past which it lets go.
const REAL_WIDTHS: f64 = 2.0;
/// Widths past which a view does not fit: that of Geman and McClure leaves it a hundredth of its weight there.
const OUTLIER_WIDTHS: f64 = 3.0;

/// The real deviations of a client's views, as multiples of the stated ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewNoise {
    /// Of pixels.
    pub pixel_factor: f64,
    /// Of depths.
    pub depth_factor: f64,
    /// Share of the views that did not fit: past three widths of the loss. On average over the windows.
    pub outlier_share: f64,
    /// How many windows say so.
    pub windows: f64,
}

impl Default for ViewNoise {
    /// As stated.
    fn default() -> Self {
        Self { pixel_factor: 1.0, depth_factor: 1.0, outlier_share: 0.0, windows: 0.0 }
    }
}

impl ViewNoise {
    /// Whether a map may have it.
    pub(super) fn is_possible(&self) -> bool {
        FACTORS.contains(&self.pixel_factor)
            && FACTORS.contains(&self.depth_factor)
            && (0.0..=1.0).contains(&self.outlier_share)
            && (0.0..=MOST_WINDOWS).contains(&self.windows)
    }

    fn is_found(&self) -> bool {
        self.windows >= LEAST_WINDOWS
    }

    /// By what stated deviations of pixels and depths are multiplied in a window.
    pub(super) fn counted(&self) -> (f64, f64) {
        match self.is_found() {
            true => (self.pixel_factor.max(1.0), self.depth_factor.max(1.0)),
            false => (1.0, 1.0),
        }
    }

    /// By what the width of a loss that lets go is multiplied, so that it does so past two widths of real
    /// deviations, and past one of stated ones at the least. Its residuals are in [counted](Self::counted)
    /// deviations.
    pub(super) fn width(&self) -> f64 {
        match self.is_found() {
            true => (REAL_WIDTHS * self.pixel_factor).max(1.0) / self.counted().0,
            false => 1.0,
        }
    }

    /// The noise after one more window, whose residuals are these multiples of [counted](Self::counted)
    /// deviations, and this share of whose views do not fit.
    fn after(&self, pixel: f64, depth: Option<f64>, outlier_share: f64) -> Self {
        let (pixels, depths) = self.counted();
        let before = self.windows.min(MOST_WINDOWS - 1.0);
        // Of factors the geometric mean.
        let mean = |old: f64, seen: f64| {
            let seen = seen.clamp(*FACTORS.start(), *FACTORS.end());
            let mean = ((old.ln() * before + seen.ln()) / (before + 1.0)).exp();
            mean.clamp(*FACTORS.start(), *FACTORS.end())
        };
        Self {
            pixel_factor: mean(self.pixel_factor, pixels * pixel),
            depth_factor: depth
                .map_or(self.depth_factor, |depth| mean(self.depth_factor, depths * depth)),
            outlier_share: (self.outlier_share * before + outlier_share) / (before + 1.0),
            windows: before + 1.0,
        }
    }
}

/// A loss whose width fits the noise of these clients, the largest of them. One that follows what does not
/// fit, as Huber's, stays as it is.
pub(super) fn widened(loss: Loss, noises: impl Iterator<Item = ViewNoise>) -> Loss {
    let factor = noises.map(|noise| noise.width()).fold(1.0, f64::max);
    match loss {
        Loss::GemanMcClure(width) => Loss::GemanMcClure(width * factor),
        Loss::Tukey(width) => Loss::Tukey(width * factor),
        Loss::Cauchy(width) => Loss::Cauchy(width * factor),
        Loss::Trivial | Loss::Huber(_) => loss,
    }
}

/// Squared residuals of one client.
#[derive(Default)]
struct Squared {
    pixels: Vec<f64>,
    depths: Vec<f64>,
    /// How many views do not fit.
    outliers: usize,
}

impl MapProblem {
    /// Finds anew how uncertain views are, from the residuals of the solved problem.
    pub fn learn_view_noise(&mut self) {
        let bundle = &self.problem;
        let mut squared: BTreeMap<ClientIndex, Squared> = BTreeMap::new();
        let mut measured = 0_usize;
        let width = bundle.observation_loss.width().unwrap_or(REAL_WIDTHS);
        let farthest = (OUTLIER_WIDTHS * width).powi(2);
        for observation in bundle.observations() {
            let pose = observation.pose as usize;
            let depth_m = observation.seen.depth_m;
            measured += if depth_m.is_some() { 3 } else { 2 };
            let residual = bundle.residual(&observation);
            let residual = residual.map_or([f64::INFINITY; 3], |r| [r.x, r.y, r.z]);
            let of_client = squared.entry(self.keyframes[pose].client).or_default();
            of_client.pixels.push(residual[0].powi(2) + residual[1].powi(2));
            if depth_m.is_some() {
                of_client.depths.push(residual[2].powi(2));
            }
            of_client.outliers +=
                usize::from(residual.iter().map(|r| r * r).sum::<f64>() > farthest);
        }
        let count = |constant: &[bool]| constant.iter().filter(|&&constant| !constant).count();
        let free = 6 * count(&bundle.constant_poses) + 3 * count(&bundle.constant_landmarks);
        let redundancy = 1.0 - free as f64 / measured.max(1) as f64;
        if redundancy < LEAST_REDUNDANCY {
            return;
        }
        let factor = |squared: Vec<f64>, expected: f64| {
            median(squared).map(|found| (found / (expected * redundancy)).sqrt())
        };
        for (client, squared) in squared {
            let Some(noise) = self.noise.get_mut(&client) else { continue };
            if squared.pixels.len() < LEAST_VIEWS {
                continue;
            }
            let outlier_share = squared.outliers as f64 / squared.pixels.len() as f64;
            let has_depths = squared.depths.len() >= LEAST_VIEWS;
            let depths = if has_depths { squared.depths } else { Vec::new() };
            let depth = factor(depths, DEPTH_MEDIAN);
            // A median that is no number has nothing to say.
            if let Some(pixel) = factor(squared.pixels, PIXEL_MEDIAN).filter(|&f| is_positive(f))
                && depth.is_none_or(is_positive)
            {
                noise.views = noise.views.after(pixel, depth, outlier_share);
            }
        }
    }
}
