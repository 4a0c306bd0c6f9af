// BAL files: three counts, the observations, then the numbers of cameras and points.

#include "bal.h"

#include <cstddef>
#include <cstdio>
#include <stdexcept>

#include "text.h"

BalFile ReadBal(const std::string& path) {
  const std::string text = ReadFile(path);
  Numbers numbers(text);
  constexpr std::size_t kMost = 1u << 30;
  BalFile file;
  file.cameras.resize(numbers.Index(kMost));
  file.points.resize(numbers.Index(kMost));
  file.observations.resize(numbers.Index(kMost));
  for (Observation& o : file.observations) {
    o.camera = numbers.Index(file.cameras.size());
    o.point = numbers.Index(file.points.size());
    o.u = numbers.Real();
    o.v = numbers.Real();
  }
  for (Camera& camera : file.cameras)
    for (double& x : camera) x = numbers.Real();
  for (Point& point : file.points)
    for (double& x : point) x = numbers.Real();
  return file;
}

void WriteBal(const BalFile& file, const std::string& path) {
  std::FILE* out = std::fopen(path.c_str(), "w");
  if (out == nullptr) throw std::runtime_error(path + " cannot be written");
  std::fprintf(out, "%zu %zu %zu\n", file.cameras.size(), file.points.size(), file.observations.size());
  for (const Observation& o : file.observations)
    std::fprintf(out, "%d %d %.16e %.16e\n", o.camera, o.point, o.u, o.v);
  for (const Camera& camera : file.cameras)
    for (double x : camera) std::fprintf(out, "%.16e\n", x);
  for (const Point& point : file.points)
    for (double x : point) std::fprintf(out, "%.16e\n", x);
  if (std::fclose(out) != 0) throw std::runtime_error(path + " cannot be written");
}
