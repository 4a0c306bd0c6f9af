// g2o files: records in any order, quaternions made unit, ids replaced by rows.

#include "g2o.h"

#include <cmath>
#include <cstdio>
#include <map>
#include <stdexcept>
#include <utility>

#include "text.h"

namespace {

PoseNumbers ReadPose(Numbers& numbers, bool is_se3) {
  PoseNumbers pose{};
  const int size = is_se3 ? 7 : 3;
  for (int k = 0; k < size; ++k) pose[k] = numbers.Real();
  if (is_se3) {
    const double norm = std::hypot(std::hypot(pose[3], pose[4]), std::hypot(pose[5], pose[6]));
    for (int k = 3; k < 7; ++k) pose[k] /= norm;
  }
  return pose;
}

}  // namespace

G2oFile ReadG2o(const std::string& path) {
  const std::string text = ReadFile(path);
  Numbers numbers(text);
  G2oFile file;
  std::map<long, PoseNumbers> vertices;
  std::vector<std::pair<long, long>> ends;
  bool has_se2 = false;
  for (std::string tag = numbers.Word(); !tag.empty(); tag = numbers.Word()) {
    const bool is_se3 = tag == "VERTEX_SE3:QUAT" || tag == "EDGE_SE3:QUAT";
    (is_se3 ? file.is_se3 : has_se2) = true;
    if (tag == "VERTEX_SE2" || tag == "VERTEX_SE3:QUAT") {
      const long id = numbers.Integer();
      vertices[id] = ReadPose(numbers, is_se3);
    } else if (tag == "EDGE_SE2" || tag == "EDGE_SE3:QUAT") {
      G2oEdge edge{};
      const long i = numbers.Integer();
      ends.emplace_back(i, numbers.Integer());
      edge.measured = ReadPose(numbers, is_se3);
      const int size = is_se3 ? 21 : 6;
      for (int k = 0; k < size; ++k) edge.information[k] = numbers.Real();
      file.edges.push_back(edge);
    } else {
      throw std::runtime_error("no record is called " + tag);
    }
  }
  if (has_se2 && file.is_se3) throw std::runtime_error("records of SE2 and of SE3");
  file.has_vertices = !vertices.empty();
  if (!file.has_vertices) {
    for (const auto& [i, j] : ends) vertices[i] = vertices[j] = PoseNumbers{};
  }
  std::map<long, int> row_of;
  for (const auto& [id, pose] : vertices) {
    row_of[id] = static_cast<int>(file.ids.size());
    file.ids.push_back(id);
    file.poses.push_back(pose);
  }
  for (std::size_t k = 0; k < ends.size(); ++k) {
    const auto i = row_of.find(ends[k].first), j = row_of.find(ends[k].second);
    if (i == row_of.end() || j == row_of.end()) throw std::runtime_error("an edge names a vertex that is not there");
    file.edges[k].i = i->second;
    file.edges[k].j = j->second;
  }
  return file;
}

void WriteVertices(const G2oFile& file, const std::string& path) {
  std::FILE* out = std::fopen(path.c_str(), "w");
  if (out == nullptr) throw std::runtime_error(path + " cannot be written");
  for (std::size_t k = 0; k < file.ids.size(); ++k) {
    std::fprintf(out, "%s %ld", file.is_se3 ? "VERTEX_SE3:QUAT" : "VERTEX_SE2", file.ids[k]);
    const int size = file.is_se3 ? 7 : 3;
    for (int n = 0; n < size; ++n) std::fprintf(out, " %.16e", file.poses[k][n]);
    std::fputc('\n', out);
  }
  if (std::fclose(out) != 0) throw std::runtime_error(path + " cannot be written");
}
