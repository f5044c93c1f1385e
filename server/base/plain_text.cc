#include "server/base/plain_text.h"

#include <unicode/utf8.h>

#include <cstdio>

namespace myograde::server {
namespace {

// `text` with `with` in place of invalid bytes and of the code points that are `bad`.
template <typename Bad>
std::string Replaced(std::string_view text, std::string_view with, Bad bad) {
  std::string replaced;
  replaced.reserve(text.size());
  for (size_t at = 0; at < text.size();) {
    const size_t begin = at;
    const char32_t c = TakeCodePoint(text, at);
    replaced += c == kBroken || bad(c) ? with : text.substr(begin, at - begin);
  }
  return replaced;
}

}  // namespace

bool IsUnsafe(char32_t c) {
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

std::string FirstUnsafe(std::string_view text) {
  for (size_t at = 0; at < text.size();) {
    const char32_t c = TakeCodePoint(text, at);
    if (c == kBroken || !IsUnsafe(c)) continue;
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
  return !text.empty() && text.size() <= max && text.front() != ' ' && text.back() != ' ' &&
         IsUtf8(text) && FirstUnsafe(text).empty();
}

std::string PrintableUtf8(std::string_view bytes) {
  return Replaced(bytes, "\xEF\xBF\xBD", [](char32_t c) {
    // C0 except newline and tab, DEL, and C1.
    return (c < 0x20 && c != '\n' && c != '\t') || (c >= 0x7f && c < 0xa0);
  });
}

std::string Sanitized(std::string_view text, bool tabs) {
  // A terminal that is not UTF-8's may obey a byte of 0x80 to 0x9f that stands alone.
  return Replaced(text, "?", [&](char32_t c) { return !(tabs && c == '\t') && IsUnsafe(c); });
}

std::string_view LastOf(std::string_view text, size_t most) {
  if (text.size() <= most) return text;
  text.remove_prefix(text.size() - most);
  while (!text.empty() && (static_cast<unsigned char>(text.front()) & 0xC0) == 0x80) {
    text.remove_prefix(1);
  }
  return text;
}

}  // namespace myograde::server
