//! Geodetic coordinates of WGS 84 and the local frame of an anchor, its axes east, north and up.
//!
//! Closed formulas from latitude and longitude to the Earth's frame (EPSG method 9602, geographic to
//! geocentric) and from there to the plane that touches the ellipsoid's normal at the anchor (EPSG
//! method 9837, topocentric). The frame is Cartesian: up is up at the anchor alone, and 10 km away the
//! ellipsoid lies 8 m below the plane. Knows nothing of maps.

use nalgebra::{Matrix3, Vector3};

/// Half of the equator's diameter in meters.
const SEMI_MAJOR_M: f64 = 6_378_137.0;

/// 1 / 298.257223563.
const FLATTENING: f64 = 1.0 / 298.257_223_563;

/// A point on or above the ellipsoid of WGS 84.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Geodetic {
    /// Latitude in degrees, north positive, −90 to 90.
    pub latitude_deg: f64,
    /// Longitude in degrees, east positive, −180 to 180.
    pub longitude_deg: f64,
    /// Height above the ellipsoid in meters.
    pub height_m: f64,
}

impl Geodetic {
    /// Whether each number is finite and the angles are in their ranges.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.latitude_deg.abs() <= 90.0
            && self.longitude_deg.abs() <= 180.0
            && self.height_m.is_finite()
    }

    /// Coordinates in the frame that turns with the Earth, in meters: x through the equator at
    /// longitude 0, z through the north pole.
    #[must_use]
    pub fn point_in_earth(&self) -> Vector3<f64> {
        let (sin_latitude, cos_latitude) = self.latitude_deg.to_radians().sin_cos();
        let (sin_longitude, cos_longitude) = self.longitude_deg.to_radians().sin_cos();
        let squared_eccentricity = FLATTENING * (2.0 - FLATTENING);
        let root = (1.0 - squared_eccentricity * sin_latitude * sin_latitude).sqrt();
        // The radius of curvature across the meridian.
        let radius = SEMI_MAJOR_M / root;
        let from_axis = (radius + self.height_m) * cos_latitude;
        let z = (radius * (1.0 - squared_eccentricity) + self.height_m) * sin_latitude;
        Vector3::new(from_axis * cos_longitude, from_axis * sin_longitude, z)
    }
}

/// The frame of an anchor: x east, y north, z up, its origin the anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalFrame {
    anchor_in_earth: Vector3<f64>,
    local_from_earth: Matrix3<f64>,
}

impl LocalFrame {
    /// The frame at `anchor`.
    #[must_use]
    pub fn new(anchor: &Geodetic) -> Self {
        let (sin_latitude, cos_latitude) = anchor.latitude_deg.to_radians().sin_cos();
        let (sin_longitude, cos_longitude) = anchor.longitude_deg.to_radians().sin_cos();
        let east = [-sin_longitude, cos_longitude, 0.0];
        let north = [-sin_latitude * cos_longitude, -sin_latitude * sin_longitude, cos_latitude];
        let up = [cos_latitude * cos_longitude, cos_latitude * sin_longitude, sin_latitude];
        Self {
            anchor_in_earth: anchor.point_in_earth(),
            local_from_earth: Matrix3::from_row_slice(&[east, north, up].concat()),
        }
    }

    /// A point in this frame, in meters.
    #[must_use]
    pub fn point_in_local(&self, point: &Geodetic) -> Vector3<f64> {
        self.local_from_earth * (point.point_in_earth() - self.anchor_in_earth)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::{Geodetic, LocalFrame};

    /// The point of the examples in IOGP Publication 373-7-2 (EPSG guidance note 7, part 2).
    fn north_sea() -> Geodetic {
        let degrees = |d: f64, m: f64, s: f64| d + m / 60.0 + s / 3600.0;
        Geodetic {
            latitude_deg: degrees(53.0, 48.0, 33.82),
            longitude_deg: degrees(2.0, 7.0, 46.38),
            height_m: 73.0,
        }
    }

    #[test]
    fn the_published_point_has_its_published_coordinates() {
        let expected = Vector3::new(3_771_793.968, 140_253.342, 5_124_304.349);
        assert!((north_sea().point_in_earth() - expected).amax() < 6e-4);
        let anchor = Geodetic { latitude_deg: 55.0, longitude_deg: 5.0, height_m: 200.0 };
        let local = LocalFrame::new(&anchor).point_in_local(&north_sea());
        let expected = Vector3::new(-189_013.869, -128_642.040, -4_220.171);
        assert!((local - expected).amax() < 6e-4, "{local}");
    }

    #[test]
    fn the_axes_of_the_ellipsoid_are_those_of_wgs_84() {
        let geodetic =
            |latitude_deg, longitude_deg| Geodetic { latitude_deg, longitude_deg, height_m: 0.0 };
        let near = |a: Vector3<f64>, b: Vector3<f64>| (a - b).amax() < 1e-6;
        assert!(near(geodetic(0.0, 0.0).point_in_earth(), Vector3::new(6_378_137.0, 0.0, 0.0)));
        assert!(near(geodetic(0.0, 90.0).point_in_earth(), Vector3::new(0.0, 6_378_137.0, 0.0)));
        let pole = Vector3::new(0.0, 0.0, 6_356_752.314_245_179);
        assert!(near(geodetic(90.0, 17.0).point_in_earth(), pole));
    }

    #[test]
    fn east_north_and_up_are_what_they_say() {
        let anchor = Geodetic { latitude_deg: 40.1, longitude_deg: -105.1, height_m: 1600.0 };
        let frame = LocalFrame::new(&anchor);
        assert!(frame.point_in_local(&anchor).norm() < 1e-9);
        let moved = |d_latitude, d_longitude, d_height| {
            frame.point_in_local(&Geodetic {
                latitude_deg: anchor.latitude_deg + d_latitude,
                longitude_deg: anchor.longitude_deg + d_longitude,
                height_m: anchor.height_m + d_height,
            })
        };
        let (north, east, up) =
            (moved(1e-5, 0.0, 0.0), moved(0.0, 1e-5, 0.0), moved(0.0, 0.0, 1.0));
        assert!((north.y - 1.11).abs() < 0.01 && north.x.abs() < 1e-6);
        assert!((east.x - 0.853).abs() < 0.01 && east.y.abs() < 1e-6);
        assert!((up - Vector3::z()).norm() < 1e-8);
    }
}
