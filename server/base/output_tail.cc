#include "server/base/output_tail.h"

#include <algorithm>

namespace myograde::server {
namespace {

constexpr std::string_view kReplacement = "\xEF\xBF\xBD";

// Length of the well-formed UTF-8 sequence at the start of `bytes`, 0 if there
// is none (overlong forms, surrogates and values above U+10FFFF are none).
size_t SequenceLength(std::string_view bytes) {
  const auto at = [&](size_t i) { return static_cast<unsigned char>(bytes[i]); };
  const unsigned char first = at(0);
  if (first < 0x80) return 1;
  size_t length = 0;
  unsigned char low = 0x80;
  unsigned char high = 0xBF;
  if (first >= 0xC2 && first <= 0xDF) {
    length = 2;
  } else if (first >= 0xE0 && first <= 0xEF) {
    length = 3;
    if (first == 0xE0) low = 0xA0;
    if (first == 0xED) high = 0x9F;
  } else if (first >= 0xF0 && first <= 0xF4) {
    length = 4;
    if (first == 0xF0) low = 0x90;
    if (first == 0xF4) high = 0x8F;
  } else {
    return 0;
  }
  if (bytes.size() < length || at(1) < low || at(1) > high) return 0;
  for (size_t i = 2; i < length; ++i) {
    if (at(i) < 0x80 || at(i) > 0xBF) return 0;
  }
  return length;
}

// Control characters: C0 but newline and tab, DEL, and C1 in their two-byte form.
bool IsControl(std::string_view sequence) {
  const auto first = static_cast<unsigned char>(sequence[0]);
  if (sequence.size() == 1) {
    return (first < 0x20 && first != '\n' && first != '\t') || first == 0x7F;
  }
  return sequence.size() == 2 && first == 0xC2 && static_cast<unsigned char>(sequence[1]) < 0xA0;
}

}  // namespace

std::string PrintableUtf8(std::string_view bytes) {
  std::string text;
  text.reserve(bytes.size());
  while (!bytes.empty()) {
    const size_t length = SequenceLength(bytes);
    if (length == 0 || IsControl(bytes.substr(0, length))) {
      text += kReplacement;
    } else {
      text += bytes.substr(0, length);
    }
    bytes.remove_prefix(std::max<size_t>(length, 1));
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
  // Replacements made it longer; cut at the start of a sequence.
  size_t start = text.size() - kTailBytes;
  while (start < text.size() && (static_cast<unsigned char>(text[start]) & 0xC0) == 0x80) ++start;
  return text.substr(start);
}

}  // namespace myograde::server
