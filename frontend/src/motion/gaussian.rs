//! The dual-mode single Gaussian model of a cell (Yi et al., CVPRW 2013).
//!
//! A background and a candidate, each a Gaussian of the cell's gray level with an age. Only the mode
//! that matches is updated, so that a passing object does not spoil the background. A candidate that is
//! older than the background replaces it. Independent of cameras.

/// Parameters of the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GaussianOptions {
    /// θ_s: squared distance to a mean, in variances, up to which a cell matches it.
    pub match_chi2: f32,
    /// θ_d: squared distance to the background, in variances, above which a cell is foreground.
    pub foreground_chi2: f32,
    /// Age from which on a background is known, frames.
    pub known_age: f32,
    /// Least variance of a mode, gray levels squared.
    pub least_variance: f32,
    /// α_max, frames.
    pub largest_age: f32,
    /// θ_v: variance above which the age of a model decreases, gray levels squared.
    pub decay_variance: f32,
    /// λ: rate of this decrease.
    pub decay: f32,
}

impl Default for GaussianOptions {
    fn default() -> Self {
        Self {
            match_chi2: 2.0,
            foreground_chi2: 4.0,
            known_age: 4.0,
            least_variance: 100.0,
            largest_age: 60.0,
            decay_variance: 2500.0,
            decay: 0.001,
        }
    }
}

/// A Gaussian of gray levels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mode {
    /// μ, gray levels.
    pub mean: f32,
    /// σ², gray levels squared.
    pub variance: f32,
    /// α, frames; 0 where there is no model yet.
    pub age: f32,
}

/// Gray level from which on a pixel is saturated.
const SATURATED: f32 = 250.0;

/// What a frame shows in a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CellView {
    /// M, the mean of its pixels, gray levels.
    pub mean: f32,
    /// The darkest pixel.
    pub least: f32,
    /// The brightest pixel.
    pub largest: f32,
    /// Depth, meters; 0 where none was measured.
    pub depth_m: f32,
}

impl CellView {
    /// Whether it is so bright that its gray levels carry no information.
    #[must_use]
    pub fn is_saturated(&self) -> bool {
        self.largest >= SATURATED
    }
}

/// Both modes of a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DualMode {
    /// The mode that was there for longest.
    pub background: Mode,
    /// The mode that may replace it.
    pub candidate: Mode,
}

impl Mode {
    /// A model of one frame.
    #[must_use]
    pub fn begin(view: &CellView, options: &GaussianOptions) -> Self {
        let variance = spread(view.mean, view).max(options.least_variance);
        Self { mean: view.mean, variance, age: 1.0 }
    }

    /// Whether a cell's mean lies within this model.
    #[must_use]
    pub fn matches(&self, mean: f32, options: &GaussianOptions) -> bool {
        let away = mean - self.mean;
        self.age > 0.0 && away * away < options.match_chi2 * self.variance
    }

    /// Decreases the age where the variance is large: such a model mixes different surfaces.
    #[inline(always)]
    pub fn fade(&mut self, options: &GaussianOptions) {
        if self.variance > options.decay_variance {
            self.age *= (-options.decay * (self.variance - options.decay_variance)).exp();
        }
    }

    /// Updates the model with another frame.
    pub fn update(&mut self, view: &CellView, options: &GaussianOptions) {
        let Self { mean, variance, age } = *self;
        self.mean = (age * mean + view.mean) / (age + 1.0);
        let spread = spread(self.mean, view);
        self.variance = ((age * variance + spread) / (age + 1.0)).max(options.least_variance);
        self.age = (age + 1.0).min(options.largest_age);
    }
}

/// max_j (μ − I_j)².
fn spread(mean: f32, view: &CellView) -> f32 {
    let reach = (mean - view.least).abs().max((mean - view.largest).abs());
    reach * reach
}

impl DualMode {
    /// Whether a cell is foreground; `None` where it is saturated or the background is not known yet.
    #[must_use]
    pub fn is_foreground(&self, view: &CellView, options: &GaussianOptions) -> Option<bool> {
        if self.background.age < options.known_age || view.is_saturated() {
            return None;
        }
        let away = view.mean - self.background.mean;
        Some(away * away > options.foreground_chi2 * self.background.variance)
    }

    /// Updates the mode that matches, begins a candidate where none does, and replaces the background
    /// by a candidate that is older. Returns whether the background matched.
    pub fn update(&mut self, view: &CellView, options: &GaussianOptions) -> bool {
        let is_background = self.background.matches(view.mean, options);
        if is_background {
            self.background.update(view, options);
        } else {
            if self.candidate.matches(view.mean, options) {
                self.candidate.update(view, options);
            } else {
                self.candidate = Mode::begin(view, options);
            }
            if self.candidate.age > self.background.age {
                self.background = self.candidate;
                self.candidate = Mode::default();
            }
        }
        is_background
    }
}

/// Modes of many cells as a structure of arrays.
#[derive(Clone, Copy, Debug)]
pub struct ModeLanes<const N: usize> {
    /// μ, gray levels.
    pub mean: [f32; N],
    /// σ², gray levels squared.
    pub variance: [f32; N],
    /// α, frames.
    pub age: [f32; N],
}

impl<const N: usize> ModeLanes<N> {
    /// No models.
    pub const NONE: Self = Self { mean: [0.0; N], variance: [0.0; N], age: [0.0; N] };

    /// Sets the mode of a cell.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, mode: &Mode) {
        self.mean[lane] = mode.mean;
        self.variance[lane] = mode.variance;
        self.age[lane] = mode.age;
    }

    /// The mode of a cell.
    #[inline(always)]
    #[must_use]
    pub fn get(&self, lane: usize) -> Mode {
        Mode { mean: self.mean[lane], variance: self.variance[lane], age: self.age[lane] }
    }
}

/// Weighted mixtures of modes: μ̃ = Σ w μ, σ̃² = Σ w (σ² + (μ − μ̃)²), over the sum of the weights. A
/// mode of age 0 has no weight; the age is 0 where no mode has weight.
#[inline(always)]
#[must_use]
pub fn mix<const N: usize, const P: usize>(
    weights: &[[f32; N]; P],
    parts: &[ModeLanes<N>; P],
) -> ModeLanes<N> {
    let mut mixed = ModeLanes::NONE;
    for lane in 0..N {
        let weight =
            |part: usize| if parts[part].age[lane] > 0.0 { weights[part][lane] } else { 0.0 };
        let (mut total, mut mean, mut age, mut variance) = (0.0, 0.0, 0.0, 0.0);
        for part in 0..P {
            total += weight(part);
            mean += weight(part) * parts[part].mean[lane];
            age += weight(part) * parts[part].age[lane];
        }
        let share = if total > 0.0 { 1.0 / total } else { 0.0 };
        mean *= share;
        for part in 0..P {
            let away = parts[part].mean[lane] - mean;
            variance += weight(part) * (parts[part].variance[lane] + away * away);
        }
        mixed.mean[lane] = mean;
        mixed.variance[lane] = variance * share;
        // A cell that is covered only in part gets a lower age.
        mixed.age[lane] = age * share * total.min(1.0);
    }
    mixed
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(least_variance: f32) -> GaussianOptions {
        GaussianOptions { least_variance, largest_age: 3.0, ..GaussianOptions::default() }
    }

    fn view(mean: f32, half: f32) -> CellView {
        CellView { mean, least: mean - half, largest: mean + half, depth_m: 0.0 }
    }

    #[test]
    fn the_two_models_follow_the_equations_on_a_sequence_computed_by_hand() {
        let options = plain(1.0);
        let mut cell = DualMode::default();
        // Nothing matches an empty model: a candidate begins and replaces the empty background.
        assert!(!cell.update(&view(100.0, 4.0), &options));
        let first = Mode { mean: 100.0, variance: 16.0, age: 1.0 };
        assert_eq!(cell, DualMode { background: first, candidate: Mode::default() });
        // (102 − 100)² = 4 < 2 · 16: μ = (100 + 102)/2 = 101, the farthest pixel is 106:
        // σ² = (16 + 25)/2 = 20.5, α = 2.
        assert!(cell.update(&view(102.0, 4.0), &options));
        let second = Mode { mean: 101.0, variance: 20.5, age: 2.0 };
        assert_eq!(cell.background, second);
        // (120 − 101)² = 361 > 41: a candidate begins, the background stays.
        assert!(!cell.update(&view(120.0, 2.0), &options));
        assert_eq!(cell.background, second);
        assert_eq!(cell.candidate, Mode { mean: 120.0, variance: 4.0, age: 1.0 });
        // It matches again: μ = 119, farthest pixel 116 or 120: 3² and 1²; σ² = (4 + 9)/2.
        assert!(!cell.update(&view(118.0, 2.0), &options));
        let candidate = Mode { mean: 119.0, variance: 6.5, age: 2.0 };
        assert_eq!((cell.background, cell.candidate), (second, candidate));
        // Once more, and it is older than the background: they swap and the candidate is gone.
        assert!(!cell.update(&view(119.0, 1.0), &options));
        let swapped = Mode { mean: 119.0, variance: 14.0 / 3.0, age: 3.0 };
        assert_eq!((cell.background, cell.candidate), (swapped, Mode::default()));
        // The age ends at α_max.
        assert!(cell.update(&view(119.0, 1.0), &options));
        assert_eq!(cell.background.age, 3.0);
    }

    #[test]
    fn foreground_is_what_is_far_from_a_background_that_is_known() {
        let options = plain(25.0);
        let background = Mode { mean: 100.0, variance: 25.0, age: 3.0 };
        let mut cell = DualMode { background, ..DualMode::default() };
        assert_eq!(cell.is_foreground(&view(200.0, 1.0), &options), None);
        cell.background.age = 4.0;
        // 2 σ = 10 gray levels.
        assert_eq!(cell.is_foreground(&view(111.0, 1.0), &options), Some(true));
        assert_eq!(cell.is_foreground(&view(91.0, 1.0), &options), Some(false));
        assert_eq!(cell.is_foreground(&view(240.0, 10.0), &options), None);
    }

    #[test]
    fn a_mixture_is_as_wide_as_its_parts_are_apart_and_fades_where_that_is_much() {
        let options = GaussianOptions { decay_variance: 50.0, decay: 0.1, ..plain(1.0) };
        let mixed = |weight: f32, parts: [(f32, f32, f32); 2]| {
            let parts = parts.map(|(mean, variance, age)| ModeLanes {
                mean: [mean],
                variance: [variance],
                age: [age],
            });
            let mut mode = mix(&[[weight]; 2], &parts).get(0);
            mode.fade(&options);
            mode
        };
        let near = mixed(0.5, [(10.0, 4.0, 8.0), (20.0, 6.0, 4.0)]);
        // Variance 5 + 25, below 50.
        assert_eq!(near, Mode { mean: 15.0, variance: 30.0, age: 6.0 });
        let far = mixed(0.5, [(10.0, 4.0, 8.0), (30.0, 6.0, 4.0)]);
        assert_eq!((far.mean, far.variance), (20.0, 105.0));
        assert!((far.age - 6.0 * (-5.5_f32).exp()).abs() < 1e-6, "{}", far.age);
        // Half covered by what is known, half by what is not.
        let part = mixed(0.5, [(10.0, 4.0, 8.0), (0.0, 0.0, 0.0)]);
        assert_eq!(part, Mode { mean: 10.0, variance: 4.0, age: 4.0 });
        assert_eq!(mixed(0.0, [(1.0, 1.0, 1.0); 2]).age, 0.0);
    }
}
