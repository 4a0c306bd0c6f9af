// SE(2) and SE(3), and the derivatives of their logarithms.
//
// The translation of Log(R, t) is J_l^-1(w) t, w = Log R. Its derivative for T Exp(d) is therefore
// J_l^-1 R = J_r^-1 for the translation of d, and for its rotation the derivative of J_l^-1(w) t for w
// times J_r^-1: no more than the coefficient c below and its derivative is needed.

#include "groups.h"

#include <cmath>

#include <Eigen/Geometry>

namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector2d;
using Eigen::Vector3d;
using ConstQuaternion = Eigen::Map<const Quaterniond>;
using ConstVector2 = Eigen::Map<const Vector2d>;
using ConstVector3 = Eigen::Map<const Vector3d>;

Matrix3d Hat(const Vector3d& v) {
  Matrix3d m;
  m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return m;
}

Vector2d Turn(double angle, const Vector2d& v) {
  const double c = std::cos(angle), s = std::sin(angle);
  return {c * v.x() - s * v.y(), s * v.x() + c * v.y()};
}

// J_l^-1(w) = I - Hat(w) / 2 + c Hat(w)^2, c a function of s = |w|^2, and its derivative for s.
struct Coefficient {
  explicit Coefficient(double s) {
    if (s < 1e-2) {
      c = 1.0 / 12.0 + s * (1.0 / 720.0 + s * (1.0 / 30240.0 + s / 1209600.0));
      dc = 1.0 / 720.0 + s * (1.0 / 15120.0 + s / 403200.0);
    } else {
      const double half = 0.5 * std::sqrt(s);
      const double cotangent = half / std::tan(half);
      const double cosecant = half / std::sin(half);
      c = (1.0 - cotangent) / s;
      dc = (cotangent + cosecant * cosecant - 2.0) / (2.0 * s * s);
    }
  }
  double c, dc;
};

}  // namespace

void Se2::Identity(double* out) { Eigen::Map<Vector3d>(out).setZero(); }

void Se2::Inverse(const double* a, double* out) {
  const Vector2d t = -Turn(-a[2], ConstVector2(a));
  out[0] = t.x();
  out[1] = t.y();
  out[2] = -a[2];
}

void Se2::Compose(const double* a, const double* b, double* out) {
  const Vector2d t = ConstVector2(a) + Turn(a[2], ConstVector2(b));
  out[0] = t.x();
  out[1] = t.y();
  out[2] = a[2] + b[2];
}

void Se2::Exp(const double* d, double* out) {
  const double angle = d[2];
  const bool is_small = std::abs(angle) < 1e-4;
  const double along = is_small ? 1.0 - angle * angle / 6.0 : std::sin(angle) / angle;
  const double across = is_small ? angle / 2.0 : (1.0 - std::cos(angle)) / angle;
  out[0] = along * d[0] - across * d[1];
  out[1] = across * d[0] + along * d[1];
  out[2] = angle;
}

Se2::Tangent Se2::Log(const double* a, Square* jacobian) {
  const double angle = std::remainder(a[2], 2.0 * M_PI);
  const double half = 0.5 * angle;
  // h cot h and its derivative for the angle.
  double diagonal = 1.0 - half * half / 3.0, slope = -half / 3.0;
  if (std::abs(half) > 1e-3) {
    const double cotangent = 1.0 / std::tan(half), sine = std::sin(half);
    diagonal = half * cotangent;
    slope = 0.5 * (cotangent - half / (sine * sine));
  }
  Eigen::Matrix2d inverse;
  inverse << diagonal, half, -half, diagonal;
  Tangent r;
  r << inverse * ConstVector2(a), angle;
  if (jacobian != nullptr) {
    Eigen::Matrix2d rotation, derivative;
    rotation << std::cos(angle), -std::sin(angle), std::sin(angle), std::cos(angle);
    derivative << slope, 0.5, -0.5, slope;
    jacobian->setIdentity();
    jacobian->topLeftCorner<2, 2>() = inverse * rotation;
    jacobian->topRightCorner<2, 1>() = derivative * ConstVector2(a);
  }
  return r;
}

Se2::Square Se2::Adjoint(const double* a) {
  const double c = std::cos(a[2]), s = std::sin(a[2]);
  Square adjoint;
  adjoint << c, -s, a[1], s, c, -a[0], 0.0, 0.0, 1.0;
  return adjoint;
}

void Se3::Identity(double* out) {
  Eigen::Map<Vector3d>{out}.setZero();
  Eigen::Map<Quaterniond>{out + 3}.setIdentity();
}

void Se3::Inverse(const double* a, double* out) {
  const Quaterniond conjugate = ConstQuaternion(a + 3).conjugate();
  Eigen::Map<Vector3d>{out} = -(conjugate * ConstVector3(a));
  Eigen::Map<Quaterniond>{out + 3} = conjugate;
}

void Se3::Compose(const double* a, const double* b, double* out) {
  const ConstQuaternion q(a + 3);
  const Vector3d t = ConstVector3(a) + q * ConstVector3(b);
  const Quaterniond product = (q * ConstQuaternion(b + 3)).normalized();
  Eigen::Map<Vector3d> translation(out);
  translation = t;
  Eigen::Map<Quaterniond> rotation(out + 3);
  rotation = product;
}

void Se3::Exp(const double* d, double* out) {
  const ConstVector3 rho(d), phi(d + 3);
  const double s = phi.squaredNorm();
  const bool is_small = s < 1e-6;
  const double angle = std::sqrt(s);
  const double half_sine = is_small ? 0.5 - s / 48.0 : std::sin(0.5 * angle) / angle;
  const double versine = is_small ? 0.5 - s / 24.0 : (1.0 - std::cos(angle)) / s;
  const double rest = is_small ? 1.0 / 6.0 - s / 120.0 : (angle - std::sin(angle)) / (s * angle);
  const Vector3d once = phi.cross(rho);
  Eigen::Map<Vector3d> translation(out);
  translation = rho + versine * once + rest * phi.cross(once);
  Eigen::Map<Quaterniond> rotation(out + 3);
  rotation.vec() = half_sine * phi;
  rotation.w() = std::cos(0.5 * angle);
}

Se3::Tangent Se3::Log(const double* a, Square* jacobian) {
  const ConstVector3 t(a);
  Quaterniond q(ConstQuaternion(a + 3));
  if (q.w() < 0.0) q.coeffs() = -q.coeffs();
  const double sine = q.vec().norm();
  const Vector3d phi = q.vec() * (sine < 1e-6 ? 2.0 / q.w() : 2.0 * std::atan2(sine, q.w()) / sine);
  const double s = phi.squaredNorm();
  const Coefficient k(s);
  const Vector3d once = phi.cross(t);
  const Vector3d twice = phi.cross(once);
  Tangent r;
  r << t - 0.5 * once + k.c * twice, phi;
  if (jacobian != nullptr) {
    const Matrix3d hat = Hat(phi);
    const Matrix3d right = Matrix3d::Identity() + 0.5 * hat + k.c * (phi * phi.transpose() - s * Matrix3d::Identity());
    Matrix3d derivative = 0.5 * Hat(t) + k.c * (phi * t.transpose() - 2.0 * t * phi.transpose());
    derivative.diagonal().array() += k.c * phi.dot(t);
    derivative += 2.0 * k.dc * twice * phi.transpose();
    jacobian->topLeftCorner<3, 3>() = right;
    jacobian->topRightCorner<3, 3>().noalias() = derivative * right;
    jacobian->bottomLeftCorner<3, 3>().setZero();
    jacobian->bottomRightCorner<3, 3>() = right;
  }
  return r;
}

Se3::Square Se3::Adjoint(const double* a) {
  const Matrix3d rotation = ConstQuaternion(a + 3).toRotationMatrix();
  Square adjoint;
  adjoint.topLeftCorner<3, 3>() = rotation;
  adjoint.topRightCorner<3, 3>().noalias() = Hat(ConstVector3(a)) * rotation;
  adjoint.bottomLeftCorner<3, 3>().setZero();
  adjoint.bottomRightCorner<3, 3>() = rotation;
  return adjoint;
}
