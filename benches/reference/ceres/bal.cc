// Reads a file at once and walks over its numbers; iostreams would take seconds for a large one.

#include "bal.h"

#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <stdexcept>

namespace {

// Walks over the numbers of a text.
class Numbers {
 public:
  explicit Numbers(const std::string& text) : next_(text.c_str()) {}

  double Real() {
    char* end = nullptr;
    const double x = std::strtod(next_, &end);
    AdvanceTo(end);
    return x;
  }

  // A whole number from 0 to bound, bound excluded.
  int Index(std::size_t bound) {
    char* end = nullptr;
    const long k = std::strtol(next_, &end, 10);
    AdvanceTo(end);
    if (k < 0 || static_cast<std::size_t>(k) >= bound) throw std::runtime_error("index out of range");
    return static_cast<int>(k);
  }

 private:
  void AdvanceTo(const char* end) {
    if (end == next_) throw std::runtime_error("a number is missing or malformed");
    next_ = end;
  }

  const char* next_;
};

}  // namespace

BalFile ReadBal(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw std::runtime_error("cannot be read");
  const std::string text((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
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
