// A file read at once and its numbers one after the other.

#include "text.h"

#include <cctype>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <stdexcept>

std::string ReadFile(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw std::runtime_error("cannot be read");
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

double Numbers::Real() {
  char* end = nullptr;
  const double x = std::strtod(next_, &end);
  AdvanceTo(end);
  return x;
}

long Numbers::Integer() {
  char* end = nullptr;
  const long k = std::strtol(next_, &end, 10);
  AdvanceTo(end);
  return k;
}

int Numbers::Index(std::size_t bound) {
  const long k = Integer();
  if (k < 0 || static_cast<std::size_t>(k) >= bound) throw std::runtime_error("index out of range");
  return static_cast<int>(k);
}

std::string Numbers::Word() {
  const auto is_space = [](char c) { return std::isspace(static_cast<unsigned char>(c)) != 0; };
  while (is_space(*next_)) ++next_;
  const char* begin = next_;
  while (*next_ != '\0' && !is_space(*next_)) ++next_;
  return {begin, next_};
}

void Numbers::AdvanceTo(const char* end) {
  if (end == next_) throw std::runtime_error("a number is missing or malformed");
  next_ = end;
}
