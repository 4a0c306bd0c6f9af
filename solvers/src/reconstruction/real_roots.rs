//! The real roots of a polynomial.
//!
//! Between two neighboring real roots of its derivative a polynomial is monotone and has at most one
//! root: so those of a polynomial follow from those of all its derivatives, lowest degree first, each by
//! Newton's method within its bracket. Roots of even multiplicity may be missed; it knows no geometry.

/// The highest degree.
pub(super) const MAX_DEGREE: usize = 10;

/// Roots farther out are not looked for.
const FARTHEST: f64 = 1e5;
/// Steps within a bracket, more than halving it takes.
const STEPS: usize = 200;

/// The real roots, rising, and how many they are. Coefficients stand by rising power.
pub(super) fn real_roots(polynomial: &[f64; MAX_DEGREE + 1]) -> ([f64; MAX_DEGREE], usize) {
    let mut roots = [0.0; MAX_DEGREE];
    let largest = polynomial.iter().fold(0.0, |largest: f64, c| largest.max(c.abs()));
    if !(largest > 0.0 && polynomial.iter().all(|c| c.is_finite())) {
        return (roots, 0);
    }
    let degree = (0..=MAX_DEGREE).rev().find(|&k| polynomial[k].abs() > 1e-14 * largest);
    let Some(degree) = degree.filter(|&degree| degree > 0) else { return (roots, 0) };
    // All derivatives; entry k is the k-th one.
    let mut derivatives = [[0.0; MAX_DEGREE + 1]; MAX_DEGREE + 1];
    derivatives[0] = *polynomial;
    for k in 1..degree {
        for power in 1..=degree {
            derivatives[k][power - 1] = derivatives[k - 1][power] * power as f64;
        }
    }
    // Fujiwara's bound of the roots of the polynomial (1916), and so, by Gauss and Lucas, of its
    // derivatives'.
    let lead = polynomial[degree].abs();
    let root = |power: usize| (polynomial[power].abs() / lead).powf(1.0 / (degree - power) as f64);
    let bound = 2.0 * (0..degree).map(root).fold(f64::MIN_POSITIVE, f64::max);
    let bound = bound.min(FARTHEST);
    let mut count = 0;
    for k in (0..degree).rev() {
        let (p, slope) = (&derivatives[k][..=degree - k], &derivatives[(k + 1).min(degree)]);
        let slope = if k + 1 < degree { &slope[..degree - k] } else { &[][..] };
        let mut found = [0.0; MAX_DEGREE];
        let mut next = 0;
        let mut low = -bound;
        for end in 0..=count {
            let high = if end < count { roots[end] } else { bound };
            if let Some(root) = root_between(p, slope, low, high) {
                found[next] = root;
                next += 1;
            }
            low = high;
        }
        (roots, count) = (found, next);
    }
    (roots, count)
}

fn value(p: &[f64], x: f64) -> f64 {
    p.iter().rev().fold(0.0, |sum, &c| sum * x + c)
}

/// The root in a bracket over which the polynomial is monotone, where its sign changes.
fn root_between(p: &[f64], slope: &[f64], mut low: f64, mut high: f64) -> Option<f64> {
    let (at_low, at_high) = (value(p, low), value(p, high));
    if at_low == 0.0 {
        return Some(low);
    }
    // A root at the upper end is the lower end of the next bracket.
    if at_low * at_high >= 0.0 || low >= high {
        return None;
    }
    let rises = at_high > 0.0;
    let mut x = 0.5 * (low + high);
    let mut last_step = high - low;
    for _ in 0..STEPS {
        let at = value(p, x);
        if at == 0.0 {
            return Some(x);
        }
        if (at > 0.0) == rises {
            high = x;
        } else {
            low = x;
        }
        let linear = if slope.is_empty() { p[1] } else { value(slope, x) };
        let newton = x - at / linear;
        // Far from the root Newton's steps are short for their distance: then halving is faster.
        let is_fast = newton > low && newton < high && 2.0 * (newton - x).abs() < last_step;
        let next = if is_fast { newton } else { 0.5 * (low + high) };
        last_step = (next - x).abs();
        if last_step <= 1e-15 * x.abs() {
            return Some(next);
        }
        x = next;
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with_roots(roots: &[f64]) -> [f64; MAX_DEGREE + 1] {
        let mut p = [0.0; MAX_DEGREE + 1];
        p[0] = 1.0;
        for (degree, root) in roots.iter().enumerate() {
            for power in (0..=degree + 1).rev() {
                let below = if power > 0 { p[power - 1] } else { 0.0 };
                p[power] = below - root * p[power];
            }
        }
        p
    }

    #[test]
    fn all_real_roots_are_found() {
        let wanted = [-7.5, -2.0, -0.3, 0.01, 0.5, 0.9, 1.4, 3.0, 6.0, 11.0];
        for count in 1..=wanted.len() {
            let (roots, found) = real_roots(&with_roots(&wanted[..count]));
            assert_eq!(found, count);
            for (root, wanted) in roots.iter().zip(&wanted[..count]) {
                assert!((root - wanted).abs() < 1e-6, "{root} for {wanted}");
            }
        }
    }

    #[test]
    fn what_has_no_real_root_has_none() {
        // x⁴ + 1, a constant, zero, and what is not finite.
        let mut p = [0.0; MAX_DEGREE + 1];
        assert_eq!(real_roots(&p).1, 0);
        p[0] = 1.0;
        assert_eq!(real_roots(&p).1, 0);
        p[4] = 1.0;
        assert_eq!(real_roots(&p).1, 0);
        p[2] = f64::NAN;
        assert_eq!(real_roots(&p).1, 0);
    }
}
