//! Losses with a lane an observation.
//!
//! Branches become minima and maxima, which hand on NaN as [`Loss::evaluate`] does: under
//! [`Loss::Tukey`] an s that is not finite costs the constant, under every other loss ρ is not
//! finite either. Cauchy's logarithms are taken together, once for all lanes; where their product
//! overflows, ρ is infinite too.

use crate::loss::Loss;
use crate::simd::{Lanes, WIDTH};

/// ρ and ρ' of eight s.
pub(crate) struct LaneLoss<L: Lanes> {
    /// Its lanes add up to Σ ρ(s).
    pub(crate) rho: L::V,
    /// ρ'(s).
    pub(crate) weight: L::V,
}

/// ρ and ρ' at `s`.
#[inline(always)]
pub(crate) fn evaluate<L: Lanes>(l: L, loss: &Loss, s: L::V) -> LaneLoss<L> {
    let one = l.splat(1.0);
    match *loss {
        Loss::Trivial => LaneLoss { rho: s, weight: one },
        Loss::Huber(width) => {
            let width = l.splat(width);
            let root = l.sqrt(s);
            let inside = l.min(width, root);
            LaneLoss {
                rho: l.mul(inside, l.sub(l.add(root, root), inside)),
                weight: l.div(width, l.max(width, root)),
            }
        }
        Loss::Cauchy(width) => {
            let ratio = l.mul(s, l.splat(1.0 / (width * width)));
            let mut row = [0.0; WIDTH];
            l.store(ratio, &mut row);
            let [a, b, c, d, e, f, g, h] = row;
            // ln(1 + x) + ln(1 + y) = ln(1 + x + y + x y), without a difference: x, y ≥ 0.
            let join = |x: f64, y: f64| x + y + x * y;
            let all = join(join(join(a, b), join(c, d)), join(join(e, f), join(g, h)));
            row = [0.0; WIDTH];
            row[0] = width * width * all.ln_1p();
            LaneLoss { rho: l.load(&row), weight: l.div(one, l.add(one, ratio)) }
        }
        Loss::Tukey(width) => {
            let ratio = l.min(l.mul(s, l.splat(1.0 / (width * width))), one);
            let rest = l.sub(one, ratio);
            // 1 − (1 − x)³ = 3 x (1 − x + x²/3), without the difference.
            let polynomial = l.fma(l.mul(ratio, l.splat(1.0 / 3.0)), ratio, rest);
            LaneLoss {
                rho: l.mul(l.mul(ratio, l.splat(width * width)), polynomial),
                weight: l.mul(rest, rest),
            }
        }
        Loss::GemanMcClure(width) => {
            let squared = l.splat(width * width);
            let u = l.div(squared, l.add(s, squared));
            LaneLoss { rho: l.mul(s, u), weight: l.mul(u, u) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{Class, Kernel, Row};

    struct Evaluate(Loss, Row);

    impl Kernel for Evaluate {
        type Output = [Row; 2];

        #[inline(always)]
        fn run<L: Lanes>(self, l: L) -> [Row; 2] {
            let value = evaluate(l, &self.0, l.load(&self.1));
            let mut rows = [[0.0; WIDTH]; 2];
            l.store(value.rho, &mut rows[0]);
            l.store(value.weight, &mut rows[1]);
            rows
        }
    }

    fn losses(width: f64) -> [Loss; 5] {
        [
            Loss::Trivial,
            Loss::Huber(width),
            Loss::Cauchy(width),
            Loss::Tukey(width),
            Loss::GemanMcClure(width),
        ]
    }

    fn classes() -> impl Iterator<Item = Class> {
        let all = [Class::Scalar, Class::Avx2, Class::Avx512, Class::Neon];
        all.into_iter().filter(|c| c.is_available())
    }

    #[test]
    fn lanes_say_what_the_loss_says() {
        for width in [0.3, 1.0, 40.0] {
            let squared = width * width;
            let rows = [
                [0.0, 1e-300, 1e-12, 0.1, 0.5, 0.999, 1.0, 1.001].map(|s| s * squared),
                [1.5, 2.0, 7.0, 100.0, 1e6, 1e12, 1e30, 3.0].map(|s| s * squared),
            ];
            for loss in losses(width) {
                for (row, class) in rows.iter().flat_map(|row| classes().map(move |c| (row, c))) {
                    let [rho, weight] = class.run(Evaluate(loss, *row));
                    let expected = row.map(|s| loss.evaluate(s));
                    for (lane, value) in expected.iter().enumerate() {
                        let error = (weight[lane] - value.weight).abs();
                        assert!(error <= 1e-15, "{class} {loss:?} {}", row[lane]);
                    }
                    let sum: f64 = expected.iter().map(|value| value.rho).sum();
                    let error = (rho.iter().sum::<f64>() - sum).abs();
                    assert!(error <= 1e-14 * sum, "{class} {loss:?}: off by {error:e} of {sum:e}");
                }
            }
        }
    }

    #[test]
    fn small_residuals_cost_as_in_least_squares() {
        for (loss, class) in losses(2.0).into_iter().flat_map(|x| classes().map(move |c| (x, c))) {
            let [rho, _] = class.run(Evaluate(loss, [1e-14; WIDTH]));
            assert!((rho.iter().sum::<f64>() / 8e-14 - 1.0).abs() < 1e-13, "{class} {loss:?}");
        }
    }

    #[test]
    fn what_is_not_finite_is_handed_on() {
        for bad in [f64::NAN, f64::INFINITY] {
            let mut row = [1.0; WIDTH];
            row[5] = bad;
            for (loss, class) in
                losses(2.0).into_iter().flat_map(|x| classes().map(move |c| (x, c)))
            {
                let [rho, weight] = class.run(Evaluate(loss, row));
                let bounded = matches!(loss, Loss::Tukey(_));
                assert_eq!(rho.iter().sum::<f64>().is_finite(), bounded, "{class} {loss:?}");
                assert!(!bounded || weight[5] == 0.0, "{class} {loss:?}");
            }
        }
    }
}
