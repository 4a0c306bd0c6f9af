//! What benches print of many times.

/// Median, 99th percentile and most of some seconds, in milliseconds; not numbers where there are
/// none. Sorts them.
pub(crate) fn milliseconds(seconds: &mut [f64]) -> [f64; 3] {
    seconds.sort_by(f64::total_cmp);
    [0.5, 0.99, 1.0].map(|share| {
        let index = (share * seconds.len().saturating_sub(1) as f64).round() as usize;
        seconds.get(index).map_or(f64::NAN, |s| s * 1e3)
    })
}
