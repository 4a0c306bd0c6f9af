//! Scales of axes: values to pixels, linear or by powers of ten, and where the ticks are.
//! An axis of no extent is widened, so that no coordinate is ever not a number. It knows values and
//! pixels, and nothing of what is drawn.

use super::number::with_digits;

/// Most powers of ten that an axis shows: what is smaller lies at its end.
const MOST_DECADES: f64 = 12.0;

/// How values are spread over an axis.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Kind {
    Linear,
    /// By powers of ten; values that are not positive lie at the lower end.
    Log,
}

/// An axis: values from `low` to `high` on pixels from `start` to `end`, which may be the smaller one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    kind: Kind,
    low: f64,
    high: f64,
    start: f64,
    end: f64,
}

impl Scale {
    /// The scale of a range of values on a range of pixels. An empty range is widened around its value.
    pub(super) fn new(kind: Kind, (low, high): (f64, f64), (start, end): (f64, f64)) -> Self {
        let (mut low, mut high) =
            if low.is_finite() && high.is_finite() { (low, high) } else { (0.0, 1.0) };
        match kind {
            Kind::Linear if high <= low => {
                let margin = if low == 0.0 { 1.0 } else { 0.1 * low.abs() };
                (low, high) = (low - margin, high + margin);
            }
            Kind::Linear => {}
            Kind::Log => {
                high = if high > 0.0 { high } else { 1.0 };
                low = low.max(high * 10_f64.powf(-MOST_DECADES));
                if high <= low * 1.001 {
                    (low, high) = (low / 2.0, high * 2.0);
                }
            }
        }
        Self { kind, low, high, start, end }
    }

    /// The range of the finite values; of the positive ones for [`Kind::Log`].
    pub(super) fn range(kind: Kind, values: impl Iterator<Item = f64>) -> (f64, f64) {
        let counts = |value: &f64| value.is_finite() && (kind == Kind::Linear || *value > 0.0);
        values.filter(counts).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
            (low.min(value), high.max(value))
        })
    }

    /// The powers of ten around a range of positive values.
    pub(super) fn whole_decades((low, high): (f64, f64)) -> (f64, f64) {
        let power = |exponent: f64| 10_f64.powi(exponent as i32);
        (power(low.log10().floor()).min(low), power(high.log10().ceil()).max(high))
    }

    /// Where a value lies, pixels, at the ends where it is outside.
    pub(super) fn at(&self, value: f64) -> f64 {
        let share = match self.kind {
            Kind::Linear => (value - self.low) / (self.high - self.low),
            Kind::Log if value > 0.0 => (value / self.low).log10() / (self.high / self.low).log10(),
            Kind::Log => 0.0,
        };
        self.start + (self.end - self.start) * share.clamp(0.0, 1.0)
    }

    /// Values at which the axis has a tick, with their text.
    pub(super) fn ticks(&self) -> Vec<(f64, String)> {
        match self.kind {
            Kind::Linear => self.linear_ticks(),
            Kind::Log => self.log_ticks(),
        }
    }

    fn linear_ticks(&self) -> Vec<(f64, String)> {
        const ABOUT: f64 = 5.0;
        let span = self.high - self.low;
        let rough = span / ABOUT;
        let power = 10_f64.powf(rough.log10().floor());
        let step =
            [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|&s| s >= rough * 0.999);
        let step = step.unwrap_or(power);
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        // As many decimals as the step has, so that neighbors differ; with a power of ten where that is long.
        let size = self.low.abs().max(self.high.abs());
        let decimals = (-step.log10().floor()).max(0.0) as usize;
        let digits = ((size / step).log10().floor() as i32 + 2).clamp(1, 12) as usize;
        let text = |value: f64| {
            if size < 1e6 && decimals <= 5 {
                format!("{:.decimals$}", value + 0.0)
            } else {
                with_digits(value, digits)
            }
        };
        (first..=last).map(|k| k as f64 * step).map(|v| (v, text(v))).collect()
    }

    fn log_ticks(&self) -> Vec<(f64, String)> {
        const MOST: i32 = 7;
        // The logarithm of a power of ten may be off by its rounding.
        let (low, high) = (self.low.log10() - 1e-9, self.high.log10() + 1e-9);
        let (first, last) = (low.ceil() as i32, high.floor() as i32);
        if last - first < 1 {
            // Under two powers of ten: 1, 2 and 5 times each.
            let all = (first - 1..=last).flat_map(|p| [1.0, 2.0, 5.0].map(|m| m * 10_f64.powi(p)));
            let inside = all.filter(|v| (self.low..=self.high).contains(v));
            let ticks: Vec<_> = inside.map(|v| (v, with_digits(v, 2))).collect();
            return if ticks.len() > 1 {
                ticks
            } else {
                [self.low, self.high].map(|v| (v, with_digits(v, 4))).into()
            };
        }
        let step = (last - first) / MOST + 1;
        let powers = (first..=last).filter(|p| (p - first) % step == 0);
        powers.map(|p| (10_f64.powi(p), with_digits(10_f64.powi(p), 1))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::{Kind, Scale};

    #[test]
    fn neighboring_ticks_have_different_texts() {
        for (low, high) in
            [(0.074, 0.125), (0.6, 2.1), (-80.0, 15.0), (1e-9, 3e-9), (0.0, 4e7), (1e5, 1.00001e5)]
        {
            let scale = Scale::new(Kind::Linear, (low, high), (0.0, 500.0));
            let texts: Vec<String> = scale.ticks().into_iter().map(|(_, text)| text).collect();
            assert!((2..=12).contains(&texts.len()), "{low} {high}: {texts:?}");
            assert!(texts.windows(2).all(|pair| pair[0] != pair[1]), "{low} {high}: {texts:?}");
        }
    }
}
