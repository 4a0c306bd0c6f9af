//! Essential matrices of five pairs of rays.
//!
//! Nistér, "An efficient solution to the five-point relative pose problem" (PAMI 2004), written from
//! its equations: E = xX + yY + zZ + W in the null space of the five epipolar constraints, ten cubic
//! constraints (2 E EᵀE − tr(E Eᵀ) E = 0 and det E = 0), Gauss-Jordan elimination, and the roots of a
//! polynomial of degree ten in z. It knows no camera model and judges no solution.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::real_roots::{MAX_DEGREE, real_roots};

/// Monomials up to degree one: x, y, z, 1.
type Linear = [f64; 4];
/// Up to degree two: x², y², z², xy, xz, yz, x, y, z, 1.
type Quadratic = [f64; 10];
/// Up to degree three, in the paper's order of elimination: x³, y³, x²y, xy², x²z, x², y²z, y², xyz, xy,
/// xz², xz, x, yz², yz, y, z³, z², z, 1.
type Cubic = [f64; 20];

/// Which quadratic monomial the product of two linear ones is.
const LINEAR_LINEAR: [[usize; 4]; 4] = [[0, 3, 4, 6], [3, 1, 5, 7], [4, 5, 2, 8], [6, 7, 8, 9]];

/// Which cubic monomial the product of a quadratic and a linear one is.
const QUADRATIC_LINEAR: [[usize; 4]; 10] = [
    [0, 2, 4, 5],
    [3, 1, 6, 7],
    [10, 13, 16, 17],
    [2, 3, 8, 9],
    [4, 8, 10, 11],
    [8, 6, 13, 14],
    [5, 9, 11, 12],
    [9, 7, 14, 15],
    [11, 14, 17, 18],
    [12, 15, 18, 19],
];

/// A pivot below this share of the largest coefficient leaves the elimination without a solution.
const LEAST_PIVOT: f64 = 1e-12;

/// The matrices E with bᵀ E a = 0 for the five pairs (a, b), at most ten, of Frobenius norm one.
pub(super) fn essential_matrices(pairs: &[(Vector3<f64>, Vector3<f64>); 5]) -> Vec<Matrix3<f64>> {
    let Some(basis) = null_space(pairs) else { return Vec::new() };
    let Some(rows) = eliminated(&constraints(&basis)) else { return Vec::new() };
    // Rows e to j of the paper; k = e − z f, l = g − z h, m = i − z j have x, y and 1 with
    // polynomials in z for coefficients.
    let b: [[[f64; 5]; 3]; 3] = std::array::from_fn(|k| difference(&rows[2 * k], &rows[2 * k + 1]));
    let mut determinant = [0.0; MAX_DEGREE + 1];
    for (i, j, k, sign) in [
        (0, 1, 2, 1.0),
        (1, 2, 0, 1.0),
        (2, 0, 1, 1.0),
        (0, 2, 1, -1.0),
        (1, 0, 2, -1.0),
        (2, 1, 0, -1.0),
    ] {
        add_product(&mut determinant, [&b[i][0], &b[j][1], &b[k][2]], sign);
    }
    let (roots, count) = real_roots(&determinant);
    let of_root = |&z: &f64| {
        let at = |p: &[f64; 5]| p.iter().rev().fold(0.0, |sum, &c| sum * z + c);
        let rows: [Vector3<f64>; 3] =
            std::array::from_fn(|k| Vector3::new(at(&b[k][0]), at(&b[k][1]), at(&b[k][2])));
        // (x, y, 1) is orthogonal to all three rows; the product of two that are least parallel.
        let products = [rows[0].cross(&rows[1]), rows[1].cross(&rows[2]), rows[2].cross(&rows[0])];
        let longest = products.iter().max_by(|p, q| p.norm().total_cmp(&q.norm()))?;
        let (x, y) = (longest.x / longest.z, longest.y / longest.z);
        let e = basis[0] * x + basis[1] * y + basis[2] * z + basis[3];
        let norm = e.norm();
        (norm > 0.0 && norm.is_finite()).then(|| e / norm)
    };
    roots[..count].iter().filter_map(of_root).collect()
}

/// Four orthonormal matrices that meet the five constraints.
fn null_space(pairs: &[(Vector3<f64>, Vector3<f64>); 5]) -> Option<[Matrix3<f64>; 4]> {
    let mut columns = SMatrix::<f64, 9, 9>::zeros();
    for (k, (a, b)) in pairs.iter().enumerate() {
        let outer = b * a.transpose();
        columns.fixed_view_mut::<9, 1>(0, k).copy_from_slice(outer.as_slice());
    }
    // Columns past the fifth are zero, so that those of Q are orthogonal to all that are not.
    let q = columns.qr().q();
    q.iter()
        .all(|v| v.is_finite())
        .then(|| std::array::from_fn(|k| Matrix3::from_column_slice(q.column(5 + k).as_slice())))
}

/// The ten constraints.
fn constraints(basis: &[Matrix3<f64>; 4]) -> [Cubic; 10] {
    let entry = |r: usize, c: usize| -> Linear { std::array::from_fn(|k| basis[k][(r, c)]) };
    let e: [[Linear; 3]; 3] = std::array::from_fn(|r| std::array::from_fn(|c| entry(r, c)));
    // E Eᵀ − ½ tr(E Eᵀ) I
    let mut gram = [[[0.0; 10]; 3]; 3];
    for r in 0..3 {
        for c in 0..3 {
            for k in 0..3 {
                add_linear_product(&mut gram[r][c], &e[r][k], &e[c][k], 1.0);
            }
        }
    }
    let half_trace: Quadratic =
        std::array::from_fn(|m| 0.5 * (gram[0][0][m] + gram[1][1][m] + gram[2][2][m]));
    for (r, row) in gram.iter_mut().enumerate() {
        row[r].iter_mut().zip(&half_trace).for_each(|(entry, half)| *entry -= half);
    }
    let mut all = [[0.0; 20]; 10];
    for r in 0..3 {
        for c in 0..3 {
            for k in 0..3 {
                add_quadratic_product(&mut all[3 * r + c], &gram[r][k], &e[k][c], 1.0);
            }
        }
    }
    // det E along the first row.
    for c in 0..3 {
        let (i, j) = ((c + 1) % 3, (c + 2) % 3);
        let mut minor = [0.0; 10];
        add_linear_product(&mut minor, &e[1][i], &e[2][j], 1.0);
        add_linear_product(&mut minor, &e[1][j], &e[2][i], -1.0);
        add_quadratic_product(&mut all[9], &minor, &e[0][c], 1.0);
    }
    all
}

fn add_linear_product(sum: &mut Quadratic, a: &Linear, b: &Linear, sign: f64) {
    for (i, &a) in a.iter().enumerate() {
        for (j, &b) in b.iter().enumerate() {
            sum[LINEAR_LINEAR[i][j]] += sign * a * b;
        }
    }
}

fn add_quadratic_product(sum: &mut Cubic, a: &Quadratic, b: &Linear, sign: f64) {
    for (i, &a) in a.iter().enumerate() {
        for (j, &b) in b.iter().enumerate() {
            sum[QUADRATIC_LINEAR[i][j]] += sign * a * b;
        }
    }
}

/// Gauss-Jordan elimination of the first ten monomials; the last ten coefficients of rows e to j.
fn eliminated(rows: &[Cubic; 10]) -> Option<[[f64; 10]; 6]> {
    let mut m = *rows;
    let scale = m.iter().flatten().fold(0.0, |largest: f64, v| largest.max(v.abs()));
    for column in 0..10 {
        let pivot =
            (column..10).max_by(|&r, &s| m[r][column].abs().total_cmp(&m[s][column].abs()))?;
        m.swap(column, pivot);
        let value = m[column][column];
        if value.is_nan() || value.abs() <= LEAST_PIVOT * scale {
            return None;
        }
        m[column][column..].iter_mut().for_each(|entry| *entry /= value);
        let row = m[column];
        for (r, other) in m.iter_mut().enumerate() {
            let factor = other[column];
            if r != column && factor != 0.0 {
                other[column..].iter_mut().zip(&row[column..]).for_each(|(o, p)| *o -= factor * p);
            }
        }
    }
    Some(std::array::from_fn(|k| std::array::from_fn(|c| m[4 + k][10 + c])))
}

/// Row p minus z times row q: the coefficients of x, y and 1, each a polynomial in z by rising power.
fn difference(p: &[f64; 10], q: &[f64; 10]) -> [[f64; 5]; 3] {
    [
        [p[2], p[1] - q[2], p[0] - q[1], -q[0], 0.0],
        [p[5], p[4] - q[5], p[3] - q[4], -q[3], 0.0],
        [p[9], p[8] - q[9], p[7] - q[8], p[6] - q[7], -q[6]],
    ]
}

/// Adds a product of three polynomials; degrees 3, 3 and 4 make ten.
fn add_product(sum: &mut [f64; MAX_DEGREE + 1], factors: [&[f64; 5]; 3], sign: f64) {
    let [p, q, r] = factors;
    let mut pq = [0.0; 7];
    for (i, &p) in p[..4].iter().enumerate() {
        for (j, &q) in q[..4].iter().enumerate() {
            pq[i + j] += sign * p * q;
        }
    }
    for (i, &pq) in pq.iter().enumerate() {
        for (j, &r) in r.iter().enumerate() {
            sum[i + j] += pq * r;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Se3, hat};
    use crate::testing::random::{element, seeded, uniform_vector};

    #[test]
    fn the_true_essential_matrix_is_among_the_solutions() {
        let mut rng = seeded(3);
        let (mut found, mut solutions) = (0, 0);
        for _ in 0..1000 {
            let b_from_a: Se3 = element(&mut rng, 0.7);
            let true_one = hat(&b_from_a.translation.normalize()) * b_from_a.rotation.matrix();
            let pairs = [(); 5].map(|()| {
                let spread: Vector3<f64> = uniform_vector(&mut rng, 2.0);
                let a = spread + Vector3::new(0.0, 0.0, 5.0);
                (a.normalize(), b_from_a.transform(&a).normalize())
            });
            let all = essential_matrices(&pairs);
            assert!(all.len() <= 10);
            solutions += all.len();
            for e in &all {
                for (a, b) in &pairs {
                    assert!(b.dot(&(e * a)).abs() < 1e-9);
                }
            }
            let e = true_one / true_one.norm();
            let error = |s: &Matrix3<f64>| (s - e).norm().min((s + e).norm());
            found += usize::from(all.iter().map(error).fold(f64::INFINITY, f64::min) < 1e-4);
        }
        assert!(found >= 985, "{found} of 1000");
        assert!(solutions > 2000 && solutions < 8000, "{solutions}");
    }

    #[test]
    fn rays_that_say_nothing_have_no_solution() {
        let same = [(Vector3::z(), Vector3::z()); 5];
        assert!(essential_matrices(&same).is_empty());
        let not_finite = [(Vector3::repeat(f64::NAN), Vector3::z()); 5];
        assert!(essential_matrices(&not_finite).is_empty());
    }
}
