// The same residual with its Jacobian by hand: the camera's axis-angle acts from the left.

#include <ceres/rotation.h>
#include <ceres/sized_cost_function.h>

#include <Eigen/Core>
#include <cmath>

#include "residuals.h"

namespace {

using Vector3 = Eigen::Vector3d;
using Matrix3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using Matrix23 = Eigen::Matrix<double, 2, 3, Eigen::RowMajor>;

Matrix3 Hat(const Vector3& v) {
  Matrix3 m;
  m << 0.0, -v[2], v[1], v[2], 0.0, -v[0], -v[1], v[0], 0.0;
  return m;
}

// R = Exp(w), and J with Exp(w + d) = Exp(J d) R to first order.
struct Rotation {
  explicit Rotation(const Vector3& w) {
    const double angle2 = w.squaredNorm();
    double sine = 1.0 - angle2 / 6.0, half = 0.5 - angle2 / 24.0, third = 1.0 / 6.0 - angle2 / 120.0;
    if (angle2 > 1e-8) {
      const double angle = std::sqrt(angle2);
      sine = std::sin(angle) / angle;
      half = (1.0 - std::cos(angle)) / angle2;
      third = (1.0 - sine) / angle2;
    }
    const Matrix3 hat = Hat(w), hat2 = hat * hat;
    matrix = Matrix3::Identity() + sine * hat + half * hat2;
    left_jacobian = Matrix3::Identity() + half * hat + third * hat2;
  }

  Matrix3 matrix, left_jacobian;
};

template <int kUnknowns>
class Residual : public ceres::SizedCostFunction<2, kUnknowns, 3>, Intrinsics<kUnknowns> {
 public:
  Residual(const Observation& o, const Camera& camera) : Intrinsics<kUnknowns>(camera), u_(o.u), v_(o.v) {}

  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override {
    const double* camera = blocks[0];
    const double* k = this->Of(camera);
    Vector3 rotated;
    ceres::AngleAxisRotatePoint(camera, blocks[1], rotated.data());
    const Vector3 p = rotated + Eigen::Map<const Vector3>(camera + 3);
    const double a = -p[0] / p[2], b = -p[1] / p[2], r2 = a * a + b * b;
    const double radial = 1.0 + r2 * (k[1] + r2 * k[2]);
    residuals[0] = k[0] * radial * a - u_;
    residuals[1] = k[0] * radial * b - v_;
    if (jacobians == nullptr) return true;

    const double slope = 2.0 * (k[1] + 2.0 * r2 * k[2]);  // of radial, by r2, twice
    const double aa = radial + slope * a * a, ab = slope * a * b, bb = radial + slope * b * b;
    Matrix23 by_p;
    by_p << -aa, -ab, -(aa * a + ab * b), -ab, -bb, -(ab * a + bb * b);
    by_p *= k[0] / p[2];

    const Rotation rotation(Vector3(camera[0], camera[1], camera[2]));
    if (jacobians[0] != nullptr) {
      Eigen::Map<Eigen::Matrix<double, 2, kUnknowns, Eigen::RowMajor>> by_camera(jacobians[0]);
      by_camera.template leftCols<3>() = -(by_p * Hat(rotated)) * rotation.left_jacobian;
      by_camera.template middleCols<3>(3) = by_p;
      if constexpr (kUnknowns == 9) {
        by_camera.row(0).template tail<3>() << radial * a, k[0] * r2 * a, k[0] * r2 * r2 * a;
        by_camera.row(1).template tail<3>() << radial * b, k[0] * r2 * b, k[0] * r2 * r2 * b;
      }
    }
    if (jacobians[1] != nullptr) {
      Eigen::Map<Matrix23> by_point(jacobians[1]);
      by_point = by_p * rotation.matrix;
    }
    return true;
  }

 private:
  double u_, v_;
};

}  // namespace

ceres::CostFunction* MakeAnalytic(const Observation& o, const Camera& camera, bool fix_intrinsics) {
  if (fix_intrinsics) return new Residual<6>(o, camera);
  return new Residual<9>(o, camera);
}
