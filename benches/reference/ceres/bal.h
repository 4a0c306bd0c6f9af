// A BAL file: what it holds, read and written with 17 digits.
#ifndef COVIS_REFERENCE_BAL_H_
#define COVIS_REFERENCE_BAL_H_

#include <array>
#include <string>
#include <vector>

// Axis-angle and translation of camera_from_world, focal, k1, k2; the camera looks down -z.
using Camera = std::array<double, 9>;
using Point = std::array<double, 3>;

struct Observation {
  int camera, point;
  double u, v;
};

struct BalFile {
  std::vector<Camera> cameras;
  std::vector<Point> points;
  std::vector<Observation> observations;
};

// Both throw std::runtime_error.
BalFile ReadBal(const std::string& path);
void WriteBal(const BalFile& file, const std::string& path);

#endif  // COVIS_REFERENCE_BAL_H_
