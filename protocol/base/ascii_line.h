// Messages of programs that know nothing of Unicode.
#pragma once

#include <algorithm>
#include <string>

#include <absl/strings/ascii.h>

namespace myograde {

// A message for a terminal, as one line: whatever is not printable ASCII becomes '?', as names of
// files in it may hold what a terminal obeys. server/base/plain_text.h leaves other letters as they
// are.
inline std::string AsciiLine(std::string line) {
  std::replace_if(
      line.begin(), line.end(),
      [](char c) { return !absl::ascii_isprint(static_cast<unsigned char>(c)); }, '?');
  return line;
}

}  // namespace myograde
