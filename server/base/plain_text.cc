#include "server/base/plain_text.h"

#include <unicode/utf8.h>

#include <cstdio>

namespace myograde::server {

bool IsHarmful(char32_t c) {
  return c < 0x20 || (c >= 0x7f && c < 0xa0) || c == 0xad || c == 0x61c ||
         c == 0x34f || c == 0x180e || c == 0x2028 || c == 0x2029 || (c >= 0x200b && c <= 0x200f) || (c >= 0x202a && c <= 0x202e) ||
         (c >= 0x2060 && c <= 0x206f) || c == 0xfeff || (c >= 0xfff9 && c <= 0xfffb) ||
         (c >= 0x1d173 && c <= 0x1d17a) || (c >= 0xe0000 && c <= 0xe007f);
}

char32_t TakeCodePoint(std::string_view text, size_t& at) {
  size_t next = at;
  UChar32 c = 0;
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"  // from the macro
  U8_NEXT(text.data(), next, text.size(), c);
#pragma GCC diagnostic pop
  at = c < 0 ? at + 1 : next;
  return c < 0 ? kBroken : static_cast<char32_t>(c);
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

bool IsUtf8(std::string_view text) {
  for (size_t at = 0; at < text.size();) {
    if (TakeCodePoint(text, at) == kBroken) return false;
  }
  return true;
}

bool IsPlainText(std::string_view text, size_t max) {
  if (text.empty() || text.size() > max || text.front() == ' ' || text.back() == ' ') return false;
  for (size_t at = 0; at < text.size();) {
    const char32_t c = TakeCodePoint(text, at);
    if (c == kBroken || IsHarmful(c)) return false;
  }
  return true;
}

std::string Harmless(std::string_view text, bool tabs) {
  std::string harmless;
  for (size_t at = 0; at < text.size();) {
    const size_t begin = at;
    const char32_t c = TakeCodePoint(text, at);
    // A terminal that is not UTF-8's may obey a byte of 0x80 to 0x9f that stands alone.
    if (!(tabs && c == '\t') && (c == kBroken || IsHarmful(c))) {
      harmless += '?';
    } else {
      harmless.append(text, begin, at - begin);
    }
  }
  return harmless;
}

}  // namespace myograde::server
