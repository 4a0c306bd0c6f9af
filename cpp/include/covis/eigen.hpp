//! Conversions to and from Eigen, for programs that have it. The library itself does not need it.

#pragma once

#include <Eigen/Geometry>

#include "covis/pose.hpp"

namespace covis {

/// A pose as Eigen's transform.
inline Eigen::Isometry3d to_eigen(const Pose& pose) {
    const auto& q = pose.rotation;
    Eigen::Isometry3d out = Eigen::Isometry3d::Identity();
    out.linear() = Eigen::Quaterniond(q[3], q[0], q[1], q[2]).toRotationMatrix();
    out.translation() = Eigen::Vector3d(pose.translation[0], pose.translation[1], pose.translation[2]);
    return out;
}

/// A pose from Eigen's transform.
inline Pose from_eigen(const Eigen::Isometry3d& transform) {
    const Eigen::Quaterniond q(transform.linear());
    const Eigen::Vector3d t = transform.translation();
    return {{t.x(), t.y(), t.z()}, {q.x(), q.y(), q.z(), q.w()}};
}

/// The packed form of a symmetric 6×6 matrix, translation first.
inline Information6 pack_symmetric(const Eigen::Matrix<double, 6, 6>& matrix) {
    Information6 packed{};
    std::size_t at = 0;
    for (int row = 0; row < 6; ++row) {
        for (int column = row; column < 6; ++column) {
            packed[at++] = matrix(row, column);
        }
    }
    return packed;
}

}  // namespace covis
