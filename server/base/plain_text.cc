#include "server/base/plain_text.h"

#include <cstdio>

namespace myograde::server {

bool IsHarmful(char32_t c) {
  return c < 0x20 || (c >= 0x7f && c < 0xa0) || c == 0xad || c == 0x61c || c == 0x2028 ||
         c == 0x2029 || (c >= 0x200b && c <= 0x200f) || (c >= 0x202a && c <= 0x202e) ||
         (c >= 0x2060 && c <= 0x206f) || c == 0xfeff || (c >= 0xfff9 && c <= 0xfffb) ||
         (c >= 0xe0000 && c <= 0xe007f);
}

char32_t TakeCodePoint(std::string_view text, size_t& at) {
  const auto first = static_cast<unsigned char>(text[at++]);
  if (first < 0x80) return first;
  const size_t more = first >= 0xf0 ? 3 : first >= 0xe0 ? 2 : 1;
  if (first < 0xc2 || first > 0xf4 || more > text.size() - at) return kBroken;
  char32_t c = first & (0x3fu >> more);
  for (size_t k = 0; k < more; ++k) {
    const auto next = static_cast<unsigned char>(text[at + k]);
    if ((next & 0xc0) != 0x80) return kBroken;
    c = c << 6 | (next & 0x3fu);
  }
  constexpr char32_t kFirst[] = {0, 0x80, 0x800, 0x10000};  // with that many bytes more
  if (c < kFirst[more] || c > 0x10ffff || (c >= 0xd800 && c < 0xe000)) return kBroken;
  at += more;
  return c;
}

std::string FirstHarm(std::string_view text) {
  for (size_t at = 0; at < text.size();) {
    const char32_t c = TakeCodePoint(text, at);
    if (c == kBroken || !IsHarmful(c)) continue;
    char name[16];
    std::snprintf(name, sizeof(name), "U+%04X", static_cast<unsigned>(c));
    return name;
  }
  return "";
}

bool IsPlainText(std::string_view text, size_t max) {
  if (text.empty() || text.size() > max || text.front() == ' ' || text.back() == ' ') return false;
  for (size_t at = 0; at < text.size();) {
    const char32_t c = TakeCodePoint(text, at);
    if (c == kBroken || IsHarmful(c)) return false;
  }
  return true;
}

}  // namespace myograde::server
