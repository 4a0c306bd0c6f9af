// A g2o file of a pose graph: what it holds, and its vertices written with 17 digits.
#ifndef COVIS_REFERENCE_G2O_H_
#define COVIS_REFERENCE_G2O_H_

#include <array>
#include <string>
#include <vector>

// x, y, angle in SE(2); x, y, z, qx, qy, qz, qw in SE(3).
using PoseNumbers = std::array<double, 7>;

struct G2oEdge {
  int i, j;  // rows of the vertices
  PoseNumbers measured;  // i_from_j
  std::array<double, 21> information;  // upper triangle, row by row, translation first
};

struct G2oFile {
  bool is_se3 = false;
  bool has_vertices = false;  // where there are none, the poses are all zero
  std::vector<long> ids;  // ascending
  std::vector<PoseNumbers> poses;  // world_from_pose
  std::vector<G2oEdge> edges;
};

// Both throw std::runtime_error.
G2oFile ReadG2o(const std::string& path);
void WriteVertices(const G2oFile& file, const std::string& path);

#endif  // COVIS_REFERENCE_G2O_H_
