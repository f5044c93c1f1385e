// The end of a stream of output that a record can hold.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace myograde::server {

// `bytes` as valid UTF-8 without control characters other than newline and tab:
// what is neither becomes U+FFFD, so that it can spoil no JSON and no terminal.
std::string PrintableUtf8(std::string_view bytes);

// Counts all output of a stream and keeps its end. A stream may give any number
// of bytes; memory stays bounded.
class OutputTail {
 public:
  static constexpr size_t kTailBytes = 4096;

  // `limit`: output beyond this many bytes counts as truncated.
  explicit OutputTail(int64_t limit) : limit_(limit) {}

  void Append(std::string_view bytes);

  // The end of all that came, printable, at most kTailBytes.
  // `since`: a value of total(); what came before it is left out.
  std::string tail(int64_t since = 0) const;
  bool truncated() const { return total_ > limit_; }
  int64_t total() const { return total_; }

 private:
  int64_t limit_;
  int64_t total_ = 0;
  std::string kept_;
};

}  // namespace myograde::server
