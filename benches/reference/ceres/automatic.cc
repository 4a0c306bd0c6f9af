// The residual as a template over the scalar: Ceres evaluates it with dual numbers.

#include <ceres/autodiff_cost_function.h>
#include <ceres/rotation.h>

#include "residuals.h"

namespace {

template <int kUnknowns>
struct Residual : Intrinsics<kUnknowns> {
  Residual(const Observation& o, const Camera& camera) : Intrinsics<kUnknowns>(camera), u(o.u), v(o.v) {}

  template <typename T>
  bool operator()(const T* camera, const T* point, T* residual) const {
    T p[3];
    ceres::AngleAxisRotatePoint(camera, point, p);
    for (int i = 0; i < 3; ++i) p[i] += camera[3 + i];
    const T a = -p[0] / p[2];
    const T b = -p[1] / p[2];
    const T r2 = a * a + b * b;
    const auto* k = this->Of(camera);
    const T scale = k[0] * (1.0 + r2 * (k[1] + r2 * k[2]));
    residual[0] = scale * a - u;
    residual[1] = scale * b - v;
    return true;
  }

  double u, v;
};

template <int kUnknowns>
ceres::CostFunction* Make(const Observation& o, const Camera& camera) {
  using Function = ceres::AutoDiffCostFunction<Residual<kUnknowns>, 2, kUnknowns, 3>;
  return new Function(new Residual<kUnknowns>(o, camera));
}

}  // namespace

ceres::CostFunction* MakeAutomatic(const Observation& o, const Camera& camera, bool fix_intrinsics) {
  return fix_intrinsics ? Make<6>(o, camera) : Make<9>(o, camera);
}
