//! The pose of a camera from three points: the perspective-three-point problem.
//!
//! Persson and Nordberg, "Lambda Twist: An Accurate Fast Robust Perspective Three Point (P3P) Solver"
//! (ECCV 2018), written from its equations. With the distances λ of the points and their rays y,
//! λᵢ² + λⱼ² − 2 λᵢ λⱼ yᵢ·yⱼ = ‖xᵢ − xⱼ‖². Two combinations of these without a constant are Λᵀ D₁ Λ = 0 and
//! Λᵀ D₂ Λ = 0; a root γ of det(D₁ + γ D₂) makes a pair of planes of them, whose cuts with D₂ are the
//! solutions. Other than in the paper, planes and cuts are written without a division by a component
//! that may be zero. It knows no camera model and judges no solution.

use nalgebra::{Matrix3, Vector3};

use crate::geometry::{LieGroup, RigidMotion, Se3};

/// Steps of Newton's method; from its start each of them doubles the digits.
const NEWTON_STEPS: usize = 50;
/// Steps that bring the distances to the accuracy of their numbers.
const REFINEMENTS: usize = 4;
/// Three points whose triangle has a smaller area than this share of its longest side squared are on
/// one line, and so are three rays: the distances are not determined.
const LEAST_AREA: f64 = 1e-6;

/// The poses `world_from_camera` in which the camera sees each of `points` (m, in the world) along its
/// `ray` (in the camera, of any length); at most four, none behind the camera.
#[must_use]
pub fn p3p(rays: &[Vector3<f64>; 3], points: &[Vector3<f64>; 3]) -> Vec<Se3> {
    let [x1, x2, x3] = *points;
    let [Some(y1), Some(y2), Some(y3)] = rays.map(|ray| ray.try_normalize(1e-12)) else {
        return Vec::new();
    };
    let squared = [(x1 - x2), (x1 - x3), (x2 - x3)].map(|side| side.norm_squared());
    let longest = squared.iter().fold(0.0, |longest: f64, &side| longest.max(side));
    let normal = (x1 - x2).cross(&(x1 - x3));
    let is_triangle = normal.norm() > LEAST_AREA * longest && longest.is_finite();
    if !is_triangle || y1.cross(&y2).dot(&y3).abs() < LEAST_AREA * LEAST_AREA {
        return Vec::new();
    }
    let [a12, a13, a23] = squared.map(|side| side / longest);
    let cosines = [y1.dot(&y2), y1.dot(&y3), y2.dot(&y3)];
    let pairs = [(0, 1), (0, 2), (1, 2)];
    let [m12, m13, m23] = std::array::from_fn(|k| {
        let (i, j) = pairs[k];
        let mut m = Matrix3::zeros();
        (m[(i, i)], m[(j, j)]) = (1.0, 1.0);
        (m[(i, j)], m[(j, i)]) = (-cosines[k], -cosines[k]);
        m
    });
    let (d1, d2) = (m12 * a23 - m23 * a12, m13 * a23 - m23 * a13);
    let Some((pair_of_planes, other)) = degenerate_conic(&d1, &d2) else { return Vec::new() };
    let all = m12 + m13 + m23;
    let mut poses = Vec::with_capacity(4);
    for plane in planes(&pair_of_planes).into_iter().flatten() {
        for direction in cuts(&plane, &other).into_iter().flatten() {
            // The lengths follow from the sum of the three equations.
            let scale = (a12 + a13 + a23) / direction.dot(&(all * direction));
            let distances = direction * (scale.max(0.0).sqrt() * direction.sum().signum());
            let distances = refined(distances, &cosines, &[a12, a13, a23]);
            // Two planes may cut in one solution twice; it is one hypothesis twice then.
            if distances.iter().all(|&distance| distance > 0.0 && distance.is_finite()) {
                let scale = longest.sqrt();
                let seen =
                    [y1 * distances.x, y2 * distances.y, y3 * distances.z].map(|p| p * scale);
                poses.extend(three_points(&seen, points));
            }
        }
    }
    poses
}

/// The motion that takes three points to three others, where the two triangles are congruent.
fn three_points(from: &[Vector3<f64>; 3], to: &[Vector3<f64>; 3]) -> Option<Se3> {
    let frame = |p: &[Vector3<f64>; 3]| {
        let (u, v) = (p[1] - p[0], p[2] - p[0]);
        Matrix3::from_columns(&[u, v, u.cross(&v)])
    };
    let rotation = frame(to) * frame(from).try_inverse()?;
    let turn = Se3::from_matrix(&rotation, &Vector3::zeros())?;
    let center = |p: &[Vector3<f64>; 3]| (p[0] + p[1] + p[2]) / 3.0;
    let motion = Se3::new(turn.rotation, center(to) - turn.transform(&center(from)));
    motion.is_finite().then_some(motion)
}

/// D₁ + γ D₂ with determinant 0, and the one of the two forms that has the smaller part in it: the other
/// one is nearly a multiple of the sum where γ is very small or very large.
fn degenerate_conic(d1: &Matrix3<f64>, d2: &Matrix3<f64>) -> Option<(Matrix3<f64>, Matrix3<f64>)> {
    // The root is finite if the leading coefficient is not the smaller one.
    let (d1, d2) =
        if d1.determinant().abs() > d2.determinant().abs() { (d2, d1) } else { (d1, d2) };
    let mixed = |a: &Matrix3<f64>, b: &Matrix3<f64>| {
        a.column(0).dot(&b.column(1).cross(&b.column(2)))
            + a.column(1).dot(&b.column(2).cross(&b.column(0)))
            + a.column(2).dot(&b.column(0).cross(&b.column(1)))
    };
    let lead = d2.determinant();
    let gamma = if lead == 0.0 {
        0.0
    } else {
        real_root(mixed(d1, d2) / lead, mixed(d2, d1) / lead, d1.determinant() / lead)
    };
    let conic = d1 + d2 * gamma;
    let other = if gamma.abs() * d2.norm() > d1.norm() { d1 } else { d2 };
    (conic.norm() > 0.0 && conic.iter().all(|v| v.is_finite())).then_some((conic, *other))
}

/// A real root of γ³ + b γ² + c γ + d: Newton's method from outside of the extrema, where the
/// polynomial is monotone and convex.
fn real_root(b: f64, c: f64, d: f64) -> f64 {
    let value = |x: f64| ((x + b) * x + c) * x + d;
    let spread = b * b - 3.0 * c;
    let mut x = -b / 3.0;
    // At a distance of 2/3 √spread from the middle lie the points with the extrema's values; the cubic
    // without its linear part tells how far away a root may be.
    let middle = value(x);
    let reach = (2.0 / 3.0 * spread.max(0.0).sqrt()).max(middle.abs().cbrt());
    x -= reach.copysign(middle);
    for _ in 0..NEWTON_STEPS {
        let slope = (3.0 * x + 2.0 * b) * x + c;
        let step = value(x) / slope;
        if !step.is_finite() || step == 0.0 {
            break;
        }
        x -= step;
        if step.abs() < 1e-15 * x.abs() {
            break;
        }
    }
    x
}

/// Normals of the planes whose product is the form of a singular symmetric matrix.
fn planes(conic: &Matrix3<f64>) -> [Option<Vector3<f64>>; 2] {
    let eigen = conic.symmetric_eigen();
    let (largest, smallest) = (eigen.eigenvalues.imax(), eigen.eigenvalues.imin());
    let (up, down) = (eigen.eigenvalues[largest], eigen.eigenvalues[smallest]);
    if up <= 0.0 || down > 0.0 {
        return [None, None];
    }
    let u = eigen.eigenvectors.column(largest) * up.sqrt();
    let v = eigen.eigenvectors.column(smallest) * (-down).sqrt();
    [Some(u - v), Some(u + v)]
}

/// The directions in a plane on which a form is zero.
fn cuts(normal: &Vector3<f64>, form: &Matrix3<f64>) -> [Option<Vector3<f64>>; 2] {
    let i = normal.iamax();
    let (j, k) = ((i + 1) % 3, (i + 2) % 3);
    let base = |axis: usize| {
        let mut direction = Vector3::zeros();
        direction[axis] = 1.0;
        direction[i] = -normal[axis] / normal[i];
        direction
    };
    let (p, q) = (base(j), base(k));
    let (a, b, c) = (p.dot(&(form * p)), p.dot(&(form * q)), q.dot(&(form * q)));
    // a u² + 2 b u v + c v² = 0. Two views of one solution differ by rounding.
    let discriminant = b * b - a * c;
    if discriminant.is_nan() || discriminant < -1e-12 * (b * b + (a * c).abs()) {
        return [None, None];
    }
    let w = -(b + discriminant.max(0.0).sqrt().copysign(b));
    let along = |u: f64, v: f64| (p * u + q * v).try_normalize(0.0);
    [along(w, a), along(c, w)]
}

/// Gauss-Newton steps on the three equations.
fn refined(start: Vector3<f64>, cosines: &[f64; 3], squared: &[f64; 3]) -> Vector3<f64> {
    let mut distances = start;
    for _ in 0..REFINEMENTS {
        let mut jacobian = Matrix3::zeros();
        let mut residual = Vector3::zeros();
        for (row, (i, j)) in [(0, 1), (0, 2), (1, 2)].into_iter().enumerate() {
            let (a, b, cosine) = (distances[i], distances[j], cosines[row]);
            residual[row] = a * a + b * b - 2.0 * a * b * cosine - squared[row];
            jacobian[(row, i)] = 2.0 * (a - b * cosine);
            jacobian[(row, j)] = 2.0 * (b - a * cosine);
        }
        let Some(inverse) = jacobian.try_inverse() else { break };
        distances -= inverse * residual;
    }
    distances
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::random::{element, normal_vector, seeded, uniform_vector};

    #[test]
    fn the_true_pose_is_among_the_solutions() {
        let mut rng = seeded(1);
        let (mut solutions, mut worst) = (0, 0.0_f64);
        for _ in 0..10_000 {
            let world_from_camera: Se3 = element(&mut rng, 1.0);
            let in_camera = [(); 3].map(|()| {
                let spread: Vector3<f64> = uniform_vector(&mut rng, 1.0);
                Vector3::new(2.0 * spread.x, 1.5 * spread.y, 2.5 + 2.0 * spread.z)
            });
            let points = in_camera.map(|p| world_from_camera.transform(&p));
            let poses = p3p(&in_camera, &points);
            assert!(poses.len() <= 4);
            let error = |pose: &Se3| pose.minus(&world_from_camera).norm();
            worst = worst.max(poses.iter().map(error).fold(f64::INFINITY, f64::min));
            solutions += poses.len();
            for pose in &poses {
                for (ray, point) in in_camera.iter().zip(&points) {
                    let seen = pose.inverse_transform(point);
                    assert!(seen.normalize().dot(&ray.normalize()) > 1.0 - 1e-6);
                }
            }
        }
        // Among random triangles some are nearly on the danger cylinder, where solutions meet.
        assert!(worst < 1e-3, "{worst}");
        assert!(solutions > 10_000 && solutions < 30_000, "{solutions}");
    }

    #[test]
    fn a_symmetric_pyramid_has_all_its_solutions() {
        // Fischler and Bolles (1981): four solutions for an equilateral triangle under equal angles.
        let cosine: f64 = 20.0 / 32.0;
        let squared_side = (1.0 - cosine) * 2.0;
        let radius = (squared_side / 3.0_f64).sqrt();
        let ring = |angle: f64| Vector3::new(angle.cos(), angle.sin(), 0.0) * radius;
        let turn = std::f64::consts::TAU / 3.0;
        let points = [ring(0.0), ring(turn), ring(2.0 * turn)];
        let height = Vector3::new(0.0, 0.0, (1.0 - radius * radius).sqrt());
        let rays = points.map(|p| p + height);
        let poses = p3p(&rays, &points);
        let mut distances: Vec<f64> =
            poses.iter().map(|pose| pose.inverse_transform(&points[0]).norm()).collect();
        distances.sort_unstable_by(f64::total_cmp);
        distances.dedup_by(|a, b| (*a - *b).abs() < 1e-4);
        assert!(distances.len() >= 2, "{distances:?}");
        assert!(distances.iter().any(|d| (d - 1.0).abs() < 1e-6), "{distances:?}");
    }

    #[test]
    fn what_is_not_determined_has_no_solution() {
        let points = [Vector3::x(), Vector3::x() * 2.0, Vector3::x() * 5.0];
        let rays = [Vector3::new(0.1, 0.0, 1.0), Vector3::new(0.2, 0.0, 1.0), Vector3::z()];
        assert!(p3p(&rays, &points).is_empty(), "one line");
        let same = [Vector3::z(), Vector3::z(), Vector3::new(0.2, 0.1, 1.0)];
        let triangle = [Vector3::x(), Vector3::y(), Vector3::z()];
        assert!(p3p(&same, &triangle).is_empty(), "one ray twice");
        assert!(p3p(&[Vector3::zeros(), Vector3::z(), Vector3::x()], &triangle).is_empty());
        let not_finite = [Vector3::x(), Vector3::y(), Vector3::repeat(f64::NAN)];
        assert!(p3p(&[Vector3::z(), Vector3::x(), Vector3::y()], &not_finite).is_empty());
        let noise: [Vector3<f64>; 3] = [(); 3].map(|()| normal_vector(&mut seeded(2), 1.0));
        assert!(p3p(&noise, &triangle).is_empty(), "three times the same ray");
    }
}
