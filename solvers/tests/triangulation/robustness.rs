//! No finite numbers make triangulation panic or answer with something that is not a number.

use covis_solvers::geometry::{
    Camera, KannalaBrandt, LieGroup, PinholeRadialTangential, Se3, Snavely, So3,
};
use covis_solvers::initialization::{TriangulationOptions, View, least_worst_error, triangulate};
use nalgebra::{Vector2, Vector3};
use proptest::prelude::*;

/// Mostly plain numbers, some at the ends of what a float holds.
fn number() -> impl Strategy<Value = f64> {
    let any = prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL | prop::num::f64::ZERO;
    let odd = vec![0.0, -0.0, 1.0, 1e-300, 5e-324, 1e150, -1e150, f64::MAX, f64::MIN];
    prop_oneof![30 => -2.0..2.0, 1 => any, 1 => prop::sample::select(odd)]
}

fn camera() -> impl Strategy<Value = Camera> {
    let coefficients = || (number(), number(), number());
    prop_oneof![
        Just(PinholeRadialTangential::undistorted(500.0, 400.0, 0.0, 0.0).into()),
        coefficients().prop_map(|(a, b, c)| {
            let plain = PinholeRadialTangential::undistorted(500.0, 400.0, 0.0, 0.0);
            PinholeRadialTangential { k1: 0.1 * a, k2: 0.1 * b, p1: 0.01 * c, ..plain }.into()
        }),
        coefficients().prop_map(|(a, b, c)| {
            Snavely { focal: 400.0 + 100.0 * a, k1: 0.1 * b, k2: 0.01 * c }.into()
        }),
        coefficients().prop_map(|(k1, k2, k3)| {
            let (k1, k2, k3) = (0.02 * k1, 0.01 * k2, 0.001 * k3);
            KannalaBrandt { fx: 250.0, fy: 250.0, cx: 0.0, cy: 0.0, k1, k2, k3, k4: 0.0 }.into()
        }),
    ]
}

fn view() -> impl Strategy<Value = View> {
    let center = [number(), number(), number()].prop_map(Vector3::from);
    let rotation = [number(), number(), number()].prop_map(|[x, y, z]| {
        So3::from_quaternion_xyzw(0.3 * x, 0.3 * y, 0.3 * z, 1.0)
            .unwrap_or(So3::exp(&Vector3::zeros()))
    });
    let pixel = [number(), number()].prop_map(|p| 300.0 * Vector2::from(p));
    let depth_m = prop::option::weighted(0.3, (number(), number()));
    (rotation, center, camera(), pixel, number(), depth_m).prop_map(
        |(rotation, center, camera, pixel, sigma_px, depth_m)| View {
            world_from_camera: Se3::new(rotation, center),
            camera,
            pixel,
            sigma_px,
            depth_m,
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..Default::default() })]

    #[test]
    fn every_finite_input_has_an_answer_in_numbers(
        views in prop::collection::vec(view(), 0..7),
        loose in any::<bool>(),
    ) {
        let strict = TriangulationOptions::default();
        let options = if loose {
            TriangulationOptions { min_parallax_rad: 0.0, max_whitened_rms: 1e9, ..strict }
        } else {
            strict
        };
        match triangulate(&views, &options) {
            Ok(found) => {
                prop_assert!(found.point_in_world.iter().all(|x| x.is_finite()), "{found:?}");
                prop_assert!(found.parallax_rad.is_finite(), "{found:?}");
                prop_assert!(found.whitened_rms <= options.max_whitened_rms, "{found:?}");
            }
            Err(error) => prop_assert!(!error.to_string().contains("NaN"), "{error}"),
        }
        if let Some(found) = least_worst_error(&views) {
            prop_assert!(found.point_in_world.iter().all(|x| x.is_finite()), "{found:?}");
            prop_assert!(found.lower_bound >= 0.0, "{found:?}");
            prop_assert!(found.error >= found.lower_bound, "{found:?}");
        }
    }
}
