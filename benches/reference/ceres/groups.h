// SE(2) and SE(3) for cost functions with derivatives by hand: motions as arrays of numbers, tangents
// with the translation first, updates T Exp(d) from the right, as docs/conventions.md has them.
#ifndef COVIS_REFERENCE_GROUPS_H_
#define COVIS_REFERENCE_GROUPS_H_

#include <Eigen/Core>

// x, y, angle.
struct Se2 {
  static constexpr int kAmbient = 3;
  static constexpr int kTangent = 3;
  using Tangent = Eigen::Matrix<double, kTangent, 1>;
  using Square = Eigen::Matrix<double, kTangent, kTangent>;

  static void Identity(double* out);
  static void Inverse(const double* a, double* out);
  static void Compose(const double* a, const double* b, double* out);
  static void Exp(const double* d, double* out);

  // Log(T) and J with Log(T Exp(d)) = Log(T) + J d + O(d^2); J may be null.
  static Tangent Log(const double* a, Square* jacobian);

  // Ad with T Exp(d) = Exp(Ad d) T.
  static Square Adjoint(const double* a);
};

// x, y, z and the unit quaternion x, y, z, w.
struct Se3 {
  static constexpr int kAmbient = 7;
  static constexpr int kTangent = 6;
  using Tangent = Eigen::Matrix<double, kTangent, 1>;
  using Square = Eigen::Matrix<double, kTangent, kTangent>;

  static void Identity(double* out);
  static void Inverse(const double* a, double* out);
  static void Compose(const double* a, const double* b, double* out);
  static void Exp(const double* d, double* out);
  static Tangent Log(const double* a, Square* jacobian);
  static Square Adjoint(const double* a);
};

#endif  // COVIS_REFERENCE_GROUPS_H_
