// A file read at once and its numbers one after the other; iostreams would take seconds for a large one.
// All throws are std::runtime_error.
#ifndef COVIS_REFERENCE_TEXT_H_
#define COVIS_REFERENCE_TEXT_H_

#include <cstddef>
#include <string>

std::string ReadFile(const std::string& path);

// Walks over the numbers and words of a text, which must outlive it.
class Numbers {
 public:
  explicit Numbers(const std::string& text) : next_(text.c_str()) {}

  double Real();

  // A whole number.
  long Integer();

  // A whole number from 0 to bound, bound excluded.
  int Index(std::size_t bound);

  // What stands before the next white space, or nothing at the end.
  std::string Word();

 private:
  void AdvanceTo(const char* end);

  const char* next_;
};

#endif  // COVIS_REFERENCE_TEXT_H_
