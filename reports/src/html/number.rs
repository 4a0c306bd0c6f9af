//! Numbers as people read them: few digits, powers of ten where there are many zeros.
//!
//! No locale: digits and points are the same everywhere.

/// Four significant digits.
#[must_use]
pub fn number(value: f64) -> String {
    with_digits(value, 4)
}

/// `digits` significant digits; whole numbers below a million without a point.
pub(super) fn with_digits(value: f64, digits: usize) -> String {
    if !value.is_finite() {
        return if value.is_nan() { "not a number".to_owned() } else { "infinite".to_owned() };
    }
    let size = value.abs();
    if size == 0.0 {
        return "0".to_owned();
    }
    if size < 1e6 && value.fract() == 0.0 {
        return format!("{value:.0}");
    }
    if !(1e-4..1e6).contains(&size) {
        return format!("{value:.*e}", digits.saturating_sub(1));
    }
    let before_point = size.log10().floor() as i32 + 1;
    let decimals = (digits as i32 - before_point).max(0) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

/// A whole number with a thin space between groups of three digits.
#[must_use]
pub fn count(value: usize) -> String {
    let digits = value.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push('\u{2009}');
        }
        text.push(digit);
    }
    text
}

/// The figures of a set of sizes: count, median, 90 % and 99 % quantile, largest.
#[must_use]
pub fn quantiles(values: &[f64]) -> [String; 5] {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|value| !value.is_nan()).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let at = |share: f64| {
        let index = (share * sorted.len().saturating_sub(1) as f64).round() as usize;
        sorted.get(index).map_or_else(|| "–".to_owned(), |value| number(*value))
    };
    [count(sorted.len()), at(0.5), at(0.9), at(0.99), at(1.0)]
}
