#include "server/base/output_tail.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>

#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

constexpr std::string_view kReplacement = "\xEF\xBF\xBD";

// C0 except newline and tab, DEL, and C1.
bool IsControl(char32_t c) {
  return (c < 0x20 && c != '\n' && c != '\t') || (c >= 0x7f && c < 0xa0);
}

}  // namespace

std::string PrintableUtf8(std::string_view bytes) {
  std::string text;
  text.reserve(bytes.size());
  for (size_t at = 0; at < bytes.size();) {
    const size_t begin = at;
    const char32_t c = TakeCodePoint(bytes, at);
    if (c == kBroken || IsControl(c)) {
      text += kReplacement;
    } else {
      text += bytes.substr(begin, at - begin);
    }
  }
  return text;
}

void OutputTail::Append(std::string_view bytes) {
  total_ += static_cast<int64_t>(bytes.size());
  if (bytes.size() > kTailBytes) bytes.remove_prefix(bytes.size() - kTailBytes);
  kept_ += bytes;
  if (kept_.size() > kTailBytes) kept_.erase(0, kept_.size() - kTailBytes);
}

std::string OutputTail::tail(int64_t since) const {
  const auto wanted = static_cast<size_t>(std::max<int64_t>(total_ - since, 0));
  std::string_view kept = kept_;
  if (kept.size() > wanted) kept.remove_prefix(kept.size() - wanted);
  std::string text = PrintableUtf8(kept);
  if (text.size() <= kTailBytes) return text;
  // Replacements made it longer: cut at the start of a sequence.
  size_t start = text.size() - kTailBytes;
  while (start < text.size() && (static_cast<unsigned char>(text[start]) & 0xC0) == 0x80) ++start;
  return text.substr(start);
}

void DrainInto(Fd& fd, int reads, OutputTail& tail) {
  char buffer[16 << 10];
  for (int i = 0; fd.valid() && i < reads; ++i) {
    const ssize_t n = ::read(fd.get(), buffer, sizeof(buffer));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 && errno == EAGAIN) return;
    if (n <= 0) return fd.reset();
    tail.Append({buffer, static_cast<size_t>(n)});
  }
}

}  // namespace myograde::server
