//! Rigid transforms by quaternions, and the formulas of standard deviations.

#include "covis/pose.hpp"

#include <cmath>

#include "covis/error.hpp"

namespace covis {
namespace {

constexpr double kKinectPerM = 1.425e-3;
/// How far a matrix may be from a rotation, as the server allows it of a quaternion's norm.
constexpr double kTolerance = 1e-3;

Vector3 cross(const Vector3& a, const Vector3& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

Vector3 rotate(const std::array<double, 4>& q, const Vector3& p) {
    // p + 2 (w v + n × v) with v = n × p, n the vector part.
    const Vector3 n{q[0], q[1], q[2]};
    const Vector3 v = cross(n, p);
    const Vector3 u = cross(n, v);
    return {p[0] + 2.0 * (q[3] * v[0] + u[0]), p[1] + 2.0 * (q[3] * v[1] + u[1]),
            p[2] + 2.0 * (q[3] * v[2] + u[2])};
}

}  // namespace

Pose Pose::from_matrix(const Matrix4& m) {
    const auto at = [&m](int row, int column) { return m[static_cast<std::size_t>(4 * row + column)]; };
    for (int i = 0; i < 3; ++i) {
        for (int j = i; j < 3; ++j) {
            double dot = 0.0;
            for (int k = 0; k < 3; ++k) {
                dot += at(k, i) * at(k, j);
            }
            if (!(std::abs(dot - (i == j ? 1.0 : 0.0)) <= kTolerance)) {
                throw Error(ErrorKind::kArgument, "the matrix has no rotation: its columns are not orthonormal");
            }
        }
    }
    const Vector3 third = cross({at(0, 0), at(1, 0), at(2, 0)}, {at(0, 1), at(1, 1), at(2, 1)});
    if (third[0] * at(0, 2) + third[1] * at(1, 2) + third[2] * at(2, 2) < 0.0) {
        throw Error(ErrorKind::kArgument, "the matrix mirrors: its determinant is negative");
    }
    // Shepperd's method: the largest of the four squares is divided by, so that nothing cancels.
    const double trace = at(0, 0) + at(1, 1) + at(2, 2);
    std::array<double, 4> q{};
    if (trace > 0.0) {
        const double s = 2.0 * std::sqrt(1.0 + trace);
        q = {(at(2, 1) - at(1, 2)) / s, (at(0, 2) - at(2, 0)) / s, (at(1, 0) - at(0, 1)) / s, s / 4.0};
    } else {
        int i = at(1, 1) > at(0, 0) ? 1 : 0;
        i = at(2, 2) > at(i, i) ? 2 : i;
        const int j = (i + 1) % 3;
        const int k = (i + 2) % 3;
        const double s = 2.0 * std::sqrt(1.0 + at(i, i) - at(j, j) - at(k, k));
        q[static_cast<std::size_t>(i)] = s / 4.0;
        q[static_cast<std::size_t>(j)] = (at(j, i) + at(i, j)) / s;
        q[static_cast<std::size_t>(k)] = (at(k, i) + at(i, k)) / s;
        q[3] = (at(k, j) - at(j, k)) / s;
    }
    const double norm = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (double& part : q) {
        part /= norm;
    }
    return {{at(0, 3), at(1, 3), at(2, 3)}, q};
}

Pose Pose::from_message(const v1::RigidTransform& message) {
    Pose pose;
    const auto& t = message.translation();
    pose.translation = {t.x(), t.y(), t.z()};
    if (message.has_rotation()) {
        const auto& q = message.rotation();
        pose.rotation = {q.x(), q.y(), q.z(), q.w()};
    }
    return pose;
}

v1::RigidTransform Pose::message() const {
    v1::RigidTransform out;
    auto& t = *out.mutable_translation();
    t.set_x(translation[0]);
    t.set_y(translation[1]);
    t.set_z(translation[2]);
    auto& q = *out.mutable_rotation();
    q.set_x(rotation[0]);
    q.set_y(rotation[1]);
    q.set_z(rotation[2]);
    q.set_w(rotation[3]);
    return out;
}

Matrix4 Pose::matrix() const {
    const Vector3 x = rotate(rotation, {1.0, 0.0, 0.0});
    const Vector3 y = rotate(rotation, {0.0, 1.0, 0.0});
    const Vector3 z = rotate(rotation, {0.0, 0.0, 1.0});
    const Vector3& t = translation;
    return {x[0], y[0], z[0], t[0], x[1], y[1], z[1], t[1], x[2], y[2], z[2], t[2], 0.0, 0.0, 0.0, 1.0};
}

Pose Pose::inverse() const {
    Pose out;
    out.rotation = {-rotation[0], -rotation[1], -rotation[2], rotation[3]};
    out.translation = rotate(out.rotation, {-translation[0], -translation[1], -translation[2]});
    return out;
}

Vector3 Pose::operator*(const Vector3& point) const {
    const Vector3 p = rotate(rotation, point);
    return {p[0] + translation[0], p[1] + translation[1], p[2] + translation[2]};
}

Pose operator*(const Pose& a, const Pose& b) {
    const auto& p = a.rotation;
    const auto& q = b.rotation;
    Pose out;
    out.translation = a * b.translation;
    out.rotation = {p[3] * q[0] + p[0] * q[3] + p[1] * q[2] - p[2] * q[1],
                    p[3] * q[1] - p[0] * q[2] + p[1] * q[3] + p[2] * q[0],
                    p[3] * q[2] + p[0] * q[1] - p[1] * q[0] + p[2] * q[3],
                    p[3] * q[3] - p[0] * q[0] - p[1] * q[1] - p[2] * q[2]};
    return out;
}

Information6 closure_information(double sigma_m, double sigma_rad) {
    if (!(sigma_m > 0.0) || !(sigma_rad > 0.0)) {
        throw Error(ErrorKind::kArgument, "sigma_m and sigma_rad must be greater than 0");
    }
    Information6 packed{};
    std::size_t at = 0;
    for (std::size_t row = 0; row < 6; ++row) {
        packed[at] = std::pow(row < 3 ? sigma_m : sigma_rad, -2.0);
        at += 6 - row;
    }
    return packed;
}

Information3 position_information(double sigma_m) {
    if (!(sigma_m > 0.0)) {
        throw Error(ErrorKind::kArgument, "sigma_m must be greater than 0");
    }
    const double weight = std::pow(sigma_m, -2.0);
    return {weight, 0.0, 0.0, weight, 0.0, weight};
}

double kinect_sigma_m(double depth_m) { return kKinectPerM * (depth_m * depth_m); }

double stereo_sigma_m(double depth_m, double sigma_disparity_px, double focal_px, double baseline_m) {
    return sigma_disparity_px / (focal_px * baseline_m) * (depth_m * depth_m);
}

}  // namespace covis
