//! Rigid transforms and what their measurements carry, without a library of matrices.
//! `covis/eigen.hpp` converts to and from Eigen.

#pragma once

#include <array>
#include <vector>

#include "covis/v1/geometry.pb.h"

namespace covis {

/// A point or a translation: x, y, z, m.
using Vector3 = std::array<double, 3>;

/// A 4×4 matrix, row by row.
using Matrix4 = std::array<double, 16>;

/// An element of SE(3), named `target_from_source` where it stands.
struct Pose {
    /// Origin of the source frame in the target frame, m.
    Vector3 translation{0.0, 0.0, 0.0};
    /// Unit quaternion, Hamilton's: x, y, z, w.
    std::array<double, 4> rotation{0.0, 0.0, 0.0, 1.0};

    /// The pose of a rigid 4×4 matrix. Throws `kArgument` where its rotation is none.
    static Pose from_matrix(const Matrix4& matrix);
    /// The pose of a message. A part that is missing is that of the identity.
    static Pose from_message(const v1::RigidTransform& message);

    Matrix4 matrix() const;
    v1::RigidTransform message() const;
    Pose inverse() const;
    /// The point, given in the source frame, in the target frame.
    Vector3 operator*(const Vector3& point_in_source) const;
};

/// a_from_c = a_from_b · b_from_c.
Pose operator*(const Pose& a_from_b, const Pose& b_from_c);

/// The upper triangle of a symmetric 6×6 matrix, row by row, translation first: the order of messages
/// and of g2o.
using Information6 = std::array<double, 21>;

/// The same of a 3×3 matrix.
using Information3 = std::array<double, 6>;

/// The information of a relative pose with independent errors: diag(1/σ²), m and rad.
Information6 closure_information(double sigma_m, double sigma_rad);

/// The information of a position with independent errors along x, y and z of the world, m.
Information3 position_information(double sigma_m);

/// Standard deviation of depths of a structured-light sensor like the first Kinect, m: 1.425e-3 z² / m,
/// for depths from 0.5 m to 5 m (Khoshelham and Elberink 2012).
double kinect_sigma_m(double depth_m);

/// Standard deviation of depths from stereo, m: z² σ_d / (f b), to first order. The disparity's σ_d is
/// 0.2 to 1 px for most matchers.
double stereo_sigma_m(double depth_m, double sigma_disparity_px, double focal_px, double baseline_m);

}  // namespace covis
