//! Solids that a ray can hit, each in axes of its own: boxes, ellipsoids, capsules, and a room.
//!
//! A ray is origin + t · direction with the direction's z along the optical axis 1, so that t is the
//! depth itself. Intersections are closed formulas in `f64`; nothing is sampled or marched.

use covis_solvers::geometry::{LieGroup, Se3, So3};
use nalgebra::{Matrix3, Vector3};

use super::material::Material;

/// Nearer than this a camera sees nothing, m.
pub(super) const NEAR_M: f64 = 0.05;

/// The form of a solid around its origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Shape {
    /// The inside of a box with these half edges, m: floor, ceiling and walls.
    Room(Vector3<f64>),
    /// A box with these half edges, m.
    Box(Vector3<f64>),
    /// An ellipsoid with these half axes, m.
    Ellipsoid(Vector3<f64>),
    /// All that is within `radius` of the z axis between −`half_length` and `half_length`, m.
    Capsule {
        /// Half the length of the axis, m.
        half_length: f64,
        /// m.
        radius: f64,
    },
}

/// A solid at its pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Solid {
    pub(super) shape: Shape,
    pub(super) world_from_solid: Se3,
    pub(super) material: Material,
}

/// Where a ray meets a solid, in the solid's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Hit {
    /// The ray's parameter: depth.
    pub(super) t: f64,
    /// Unit, against the ray.
    pub(super) normal: Vector3<f64>,
    /// The flat face (0 to 5) that was hit; `None` on a round surface.
    pub(super) face: Option<u8>,
}

impl Shape {
    /// The first point of a ray from `NEAR_M` on.
    pub(super) fn hit(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Hit> {
        match *self {
            Self::Room(half) => slabs(&half, origin, direction, false),
            Self::Box(half) => slabs(&half, origin, direction, true),
            Self::Ellipsoid(radii) => ellipsoid(&radii, origin, direction),
            Self::Capsule { half_length, radius } => {
                capsule(half_length, radius, origin, direction)
            }
        }
    }

    /// The radius of a ball around the origin that holds the solid, m.
    pub(super) fn bounding_radius(&self) -> f64 {
        match self {
            Self::Room(half) | Self::Box(half) => half.norm(),
            Self::Ellipsoid(radii) => radii.max(),
            Self::Capsule { half_length, radius } => half_length + radius,
        }
    }

    /// Points whose convex hull holds the solid.
    pub(super) fn corners(&self) -> [Vector3<f64>; 8] {
        let half = match *self {
            Self::Room(half) | Self::Box(half) => half,
            Self::Ellipsoid(radii) => radii,
            Self::Capsule { half_length, radius } => {
                Vector3::new(radius, radius, half_length + radius)
            }
        };
        std::array::from_fn(|i| {
            let sign = |bit: usize| if i >> bit & 1 == 0 { -1.0 } else { 1.0 };
            Vector3::new(sign(0) * half.x, sign(1) * half.y, sign(2) * half.z)
        })
    }
}

/// A box, entered from outside or left from inside.
fn slabs(
    half: &Vector3<f64>,
    origin: &Vector3<f64>,
    direction: &Vector3<f64>,
    outside: bool,
) -> Option<Hit> {
    let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
    let (mut enter_axis, mut leave_axis) = (0, 0);
    for axis in 0..3 {
        // A ray along a slab gives infinities of both signs, or of one where it misses.
        let inverse = 1.0 / direction[axis];
        let a = (-half[axis] - origin[axis]) * inverse;
        let b = (half[axis] - origin[axis]) * inverse;
        let (near, far) = (a.min(b), a.max(b));
        if near > enter {
            (enter, enter_axis) = (near, axis);
        }
        if far < leave {
            (leave, leave_axis) = (far, axis);
        }
    }
    let (t, axis) = if outside { (enter, enter_axis) } else { (leave, leave_axis) };
    if enter > leave || t < NEAR_M || !t.is_finite() {
        return None;
    }
    let mut normal = Vector3::zeros();
    normal[axis] = if direction[axis] > 0.0 { -1.0 } else { 1.0 };
    let face = 2 * axis as u8 + u8::from(normal[axis] > 0.0);
    Some(Hit { t, normal, face: Some(face) })
}

fn ellipsoid(radii: &Vector3<f64>, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Hit> {
    // In units of the half axes it is the unit sphere.
    let (o, d) = (origin.component_div(radii), direction.component_div(radii));
    let t = nearer_root(d.dot(&d), o.dot(&d), o.dot(&o) - 1.0)?;
    let normal = (o + d * t).component_div(radii).normalize();
    Some(Hit { t, normal, face: None })
}

fn capsule(
    half_length: f64,
    radius: f64,
    origin: &Vector3<f64>,
    direction: &Vector3<f64>,
) -> Option<Hit> {
    let squared = radius * radius;
    let (o, d) = (origin.xy(), direction.xy());
    let side = nearer_root(d.dot(&d), o.dot(&d), o.dot(&o) - squared);
    if let Some(t) = side
        && (origin.z + t * direction.z).abs() <= half_length
    {
        let point = o + d * t;
        let normal = Vector3::new(point.x, point.y, 0.0) / radius;
        return Some(Hit { t, normal, face: None });
    }
    let cap = |z: f64| {
        let from_center = origin - Vector3::new(0.0, 0.0, z);
        let b = from_center.dot(direction);
        let t = nearer_root(direction.dot(direction), b, from_center.dot(&from_center) - squared)?;
        Some(Hit { t, normal: (from_center + direction * t) / radius, face: None })
    };
    let nearer = |a: Hit, b: Hit| if a.t <= b.t { a } else { b };
    match (cap(-half_length), cap(half_length)) {
        (Some(a), Some(b)) => Some(nearer(a, b)),
        (a, b) => a.or(b),
    }
}

/// The smaller root of a t² + 2 b t + c, where it is in front of the camera.
fn nearer_root(a: f64, b: f64, c: f64) -> Option<f64> {
    let discriminant = b * b - a * c;
    if discriminant < 0.0 {
        return None;
    }
    let t = (-b - discriminant.sqrt()) / a;
    (t >= NEAR_M).then_some(t)
}

impl Solid {
    /// A box by its center and whole edges, turned about the vertical.
    pub(super) fn upright_box(
        center: [f64; 3],
        edges: [f64; 3],
        turn_rad: f64,
        material: Material,
    ) -> Self {
        let half = Vector3::from(edges) * 0.5;
        let world_from_solid = upright(center.into(), turn_rad);
        Self { shape: Shape::Box(half), world_from_solid, material }
    }

    /// A ball.
    pub(super) fn ball(center: [f64; 3], radius: f64, material: Material) -> Self {
        let shape = Shape::Ellipsoid(Vector3::repeat(radius));
        Self { shape, world_from_solid: upright(center.into(), 0.0), material }
    }

    /// A capsule between two points; `side`, not along it, fixes its turn about its own axis.
    pub(super) fn capsule(
        from: Vector3<f64>,
        to: Vector3<f64>,
        radius: f64,
        side: Vector3<f64>,
        material: Material,
    ) -> Self {
        let axis = to - from;
        let length = axis.norm();
        let z = axis / length;
        let x = side.cross(&z).normalize();
        let rotation = So3::from_matrix(&Matrix3::from_columns(&[x, z.cross(&x), z]));
        let shape = Shape::Capsule { half_length: 0.5 * length, radius };
        let world_from_solid = Se3::new(rotation, 0.5 * (from + to));
        Self { shape, world_from_solid, material }
    }
}

/// A pose at `position`, turned about the vertical (the world's z).
pub(super) fn upright(position: Vector3<f64>, turn_rad: f64) -> Se3 {
    Se3::new(So3::exp(&Vector3::new(0.0, 0.0, turn_rad)), position)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn along_z(shape: Shape, x: f64, y: f64) -> Option<Hit> {
        shape.hit(&Vector3::new(x, y, -5.0), &Vector3::z())
    }

    #[test]
    fn a_box_is_hit_on_its_near_face_and_a_room_on_its_far_one() {
        let half = Vector3::new(1.0, 2.0, 3.0);
        let hit = along_z(Shape::Box(half), 0.9, -1.9).unwrap();
        assert_eq!((hit.t, hit.normal, hit.face), (2.0, -Vector3::z(), Some(4)));
        assert!(along_z(Shape::Box(half), 1.1, 0.0).is_none());
        assert!(Shape::Box(half).hit(&Vector3::zeros(), &Vector3::z()).is_none());
        let hit = Shape::Room(half).hit(&Vector3::zeros(), &Vector3::new(0.4, 0.0, 1.0)).unwrap();
        assert_eq!((hit.t, hit.normal, hit.face), (2.5, -Vector3::x(), Some(0)));
    }

    #[test]
    fn round_solids_are_hit_where_their_equations_hold() {
        let radii = Vector3::new(1.0, 0.5, 2.0);
        let shape = Shape::Ellipsoid(radii);
        let (origin, direction) = (Vector3::new(0.3, -0.2, -6.0), Vector3::new(0.05, 0.03, 1.0));
        let hit = shape.hit(&origin, &direction).unwrap();
        let point = origin + direction * hit.t;
        assert!((point.component_div(&radii).norm() - 1.0).abs() < 1e-12);
        assert!(point.z < 0.0 && hit.normal.dot(&direction) < 0.0);
        assert!(along_z(shape, 1.01, 0.0).is_none());

        let shape = Shape::Capsule { half_length: 1.0, radius: 0.5 };
        assert_eq!(along_z(shape, 0.0, 0.0).unwrap().t, 3.5);
        let hit = shape.hit(&Vector3::new(-4.0, 0.0, 0.9), &Vector3::x()).unwrap();
        assert_eq!((hit.t, hit.normal), (3.5, -Vector3::x()));
        let hit = shape.hit(&Vector3::new(-4.0, 0.0, 1.3), &Vector3::x()).unwrap();
        assert!((hit.t - 3.6).abs() < 1e-12, "{}", hit.t);
        assert!(shape.hit(&Vector3::new(-4.0, 0.0, 1.6), &Vector3::x()).is_none());
    }

    #[test]
    fn a_capsule_lies_between_its_points() {
        let (from, to) = (Vector3::new(1.0, 2.0, 3.0), Vector3::new(2.0, 2.0, 1.0));
        let solid = Solid::capsule(from, to, 0.1, Vector3::y(), Material::SKIN);
        let end = Vector3::new(0.0, 0.0, 0.5 * (to - from).norm());
        assert!((solid.world_from_solid.transform(&end) - to).norm() < 1e-12);
        assert!((solid.world_from_solid.transform(&-end) - from).norm() < 1e-12);
    }
}
