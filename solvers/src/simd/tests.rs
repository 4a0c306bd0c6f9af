//! Each operation in each class, against plain numbers: the same bits, where products are fused with
//! sums the bits of a fused one. A NaN has whatever bits the processor gives it.

use super::*;

/// Numbers that are ordinary, tiny, huge, without a value or of either sign.
const A: [Row; 2] = [
    [0.0, -0.0, 1.5, -2.5, 1.0 + f64::EPSILON, 1e308, 5e-324, -7.25],
    [f64::INFINITY, f64::NEG_INFINITY, f64::NAN, 3.0, -0.1, 1e-200, 1.0 / 3.0, 4.0],
];
const B: [Row; 2] = [
    [-0.0, 0.0, 2.5, -2.5, 1.0 + f64::EPSILON, 10.0, 0.3, f64::NAN],
    [1.0, f64::INFINITY, 1.0, f64::NAN, 0.1, 1e-200, 3.0, -9.0],
];
const C: [Row; 2] = [
    [1.0, -1.0, 0.1, -6.25, -1.0, 1e300, 1e-323, 2.0],
    [2.0, 1.0, -1.0, 5.0, 0.01, 1e-308, -1.0, 36.0],
];

/// Everything that gives the same bits whether or not products are fused.
struct Plain(usize);

impl Kernel for Plain {
    type Output = Vec<Row>;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Vec<Row> {
        let (a, b, c) = (l.load(&A[self.0]), l.load(&B[self.0]), l.load(&C[self.0]));
        let results = [
            l.splat(-0.1),
            a,
            l.add(a, b),
            l.sub(a, b),
            l.mul(a, b),
            l.div(a, b),
            l.sqrt(a),
            l.max(a, b),
            l.max(b, a),
            l.min(a, b),
            l.min(b, a),
            l.select(a, b, c),
            l.select(b, c, a),
        ];
        let rows = [a, b, c, l.splat(1.0), l.add(a, c), l.sub(a, c), l.mul(a, c), l.div(a, c)];
        let transposed = l.transpose(rows);
        results
            .into_iter()
            .chain(transposed)
            .chain(l.call(Stored(rows)))
            .map(|v| stored(l, v))
            .collect()
    }
}

/// Hands on what it was given.
struct Stored<V>([V; WIDTH]);

impl<L: Lanes> Subroutine<L> for Stored<L::V> {
    type Output = [L::V; WIDTH];

    #[inline(always)]
    fn run(self, _: L) -> [L::V; WIDTH] {
        self.0
    }
}

/// a · b + c and c − a · b, of lanes and of single numbers.
struct Fused(usize);

impl Kernel for Fused {
    type Output = [Row; 3];

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> [Row; 3] {
        let (a, b, c) = (&A[self.0], &B[self.0], &C[self.0]);
        let single = each!(i < WIDTH, 0.0 => l.fnma_one(a[i], b[i], c[i]));
        let (a, b, c) = (l.load(a), l.load(b), l.load(c));
        [stored(l, l.fma(a, b, c)), stored(l, l.fnma(a, b, c)), single]
    }
}

#[inline(always)]
fn stored<L: Lanes>(l: L, v: L::V) -> Row {
    let mut row = [f64::NAN; WIDTH];
    l.store(v, &mut row);
    row
}

fn bits(row: Row) -> [u64; WIDTH] {
    row.map(|x| if x.is_nan() { f64::NAN.to_bits() } else { x.to_bits() })
}

/// The classes of this processor. One of its architecture that it lacks is reported.
fn classes() -> impl Iterator<Item = Class> {
    Class::ALL.into_iter().filter(|&class| {
        if !class.is_available() && cfg!(target_arch = "x86_64") && class != Class::Neon {
            crate::testing::skip(&format!("no {class} here"));
        }
        class.is_available()
    })
}

#[test]
fn every_class_gives_the_bits_of_plain_numbers() {
    for k in 0..A.len() {
        let expected: Vec<_> = Class::Scalar.run(Plain(k)).into_iter().map(bits).collect();
        for class in classes() {
            let got = class.run(Plain(k)).into_iter().map(bits);
            for (i, (got, expected)) in got.zip(&expected).enumerate() {
                assert_eq!(got, *expected, "{class}: result {i} of row {k}");
            }
        }
    }
}

#[test]
fn comparisons_go_by_the_second_where_one_is_no_number() {
    for class in classes() {
        let got = class.run(Plain(1));
        assert_eq!((got[7][2], got[9][2]), (1.0, 1.0), "{class}: b");
        assert_eq!((got[8][3], got[10][3]), (3.0, 3.0), "{class}: a");
        assert_eq!(got[12][3], 3.0, "{class}: a mask without a value selects the second");
        assert_eq!(class.run(Plain(0))[11][..2], C[0][..2], "{class}: neither zero is positive");
    }
}

#[test]
fn products_are_fused_in_every_class_but_the_scalar_one() {
    for k in 0..A.len() {
        for class in classes() {
            let of = |f: fn(f64, f64, f64) -> f64| -> Row {
                std::array::from_fn(|i| f(A[k][i], B[k][i], C[k][i]))
            };
            let (sum, difference) = if class == Class::Scalar {
                (of(|a, b, c| a * b + c), of(|a, b, c| c - a * b))
            } else {
                (of(f64::mul_add), of(|a, b, c| (-a).mul_add(b, c)))
            };
            let got = class.run(Fused(k)).map(bits);
            assert_eq!(got, [sum, difference, difference].map(bits), "{class}, row {k}");
        }
    }
}

#[test]
fn a_transposed_matrix_has_rows_for_columns() {
    for class in classes() {
        let got = class.run(Plain(0));
        let (columns, rows) = (&got[13..21], &got[21..]);
        assert_eq!(rows.len(), WIDTH);
        for (i, column) in columns.iter().enumerate() {
            let expected: Row = std::array::from_fn(|j| rows[j][i]);
            assert_eq!(bits(*column), bits(expected), "{class}");
        }
    }
}
