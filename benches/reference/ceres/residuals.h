// The residual of one observation as a Ceres cost function: a camera of 9 or 6 unknowns, a point of 3.
// Each kind is compiled in a file of its own: together in one, the compiler inlines less of either,
// and automatic differentiation loses a fifth of its speed.
#ifndef COVIS_REFERENCE_RESIDUALS_H_
#define COVIS_REFERENCE_RESIDUALS_H_

#include <ceres/cost_function.h>

#include "bal.h"

// Focal length, k1 and k2: the last three unknowns, or constants that Ceres never sees. (A constant
// parameter block would do too and costs Ceres more.)
template <int kUnknowns>
struct Intrinsics;

template <>
struct Intrinsics<9> {
  explicit Intrinsics(const Camera&) {}
  template <typename T>
  const T* Of(const T* camera) const { return camera + 6; }
};

template <>
struct Intrinsics<6> {
  explicit Intrinsics(const Camera& camera) : values{camera[6], camera[7], camera[8]} {}
  template <typename T>
  const double* Of(const T*) const { return values.data(); }
  std::array<double, 3> values;
};

// By Ceres' automatic differentiation, which is what most users take.
ceres::CostFunction* MakeAutomatic(const Observation& o, const Camera& camera, bool fix_intrinsics);

// With derivatives written by hand, for what Ceres can do at its best.
ceres::CostFunction* MakeAnalytic(const Observation& o, const Camera& camera, bool fix_intrinsics);

#endif  // COVIS_REFERENCE_RESIDUALS_H_
