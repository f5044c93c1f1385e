// The end of an output stream, small enough for a record.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "protocol/base/fd.h"

namespace myograde::server {

// `bytes` as valid UTF-8 without control characters other than newline and tab: anything else
// becomes U+FFFD, so that it can't break JSON or a terminal.
std::string PrintableUtf8(std::string_view bytes);

// Counts a stream's output and keeps its end. Memory stays bounded for any amount of output.
class OutputTail {
 public:
  static constexpr size_t kTailBytes = 4096;

  // `limit`: output beyond this many bytes counts as truncated.
  explicit OutputTail(int64_t limit) : limit_(limit) {}

  void Append(std::string_view bytes);

  // The last kTailBytes of the output at most, printable. `since`: a value of total(); omits output
  // before it.
  std::string tail(int64_t since = 0) const;
  bool truncated() const { return total_ > limit_; }
  int64_t total() const { return total_; }

 private:
  int64_t limit_;
  int64_t total_ = 0;
  std::string kept_;
};

// Appends what a non-blocking descriptor has, in at most `reads` reads of 16 KiB, and closes it at
// its end.
void DrainInto(Fd& fd, int reads, OutputTail& tail);

}  // namespace myograde::server
