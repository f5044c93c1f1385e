// Tars built byte by byte, with content that no normal program writes.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>

namespace myograde::server {

inline constexpr size_t kTarBlock = 512;

// `type` is the header's type flag, `claimed` the size that the header states.
inline std::string TarHeader(char type, std::string_view name, std::string_view link, uint32_t mode,
                             uint64_t claimed) {
  std::array<char, kTarBlock> head = {};
  const auto put_text = [&](std::string_view text, size_t at) {
    std::copy_n(text.begin(), std::min<size_t>(text.size(), 100), head.begin() + at);
  };
  const auto put_octal = [&](uint64_t number, size_t at, size_t width) {
    for (size_t i = width; i-- > 0; number >>= 3) {
      head[at + i] = static_cast<char>('0' + (number & 7));
    }
  };
  put_text(name, 0);
  put_octal(mode, 100, 7);
  put_octal(0, 108, 7);
  put_octal(0, 116, 7);
  put_octal(claimed, 124, 11);
  put_octal(0, 136, 11);
  std::memset(head.data() + 148, ' ', 8);
  head[156] = type;
  put_text(link, 157);
  std::memcpy(head.data() + 257, "ustar\0" "00", 8);
  uint32_t sum = 0;
  for (const char c : head) sum += static_cast<unsigned char>(c);
  put_octal(sum, 148, 6);
  head[154] = '\0';
  return {head.data(), head.size()};
}

inline std::string TarPadding(size_t size) {
  return std::string((kTarBlock - size % kTarBlock) % kTarBlock, '\0');
}

inline std::string TarEntry(char type, std::string_view name, std::string_view content = {},
                            std::string_view link = {}, uint32_t mode = 0644) {
  std::string entry = TarHeader(type, name, link, mode, content.size());
  entry += content;
  return entry + TarPadding(content.size());
}

// An extended header with `key` and `value` for the next entry.
inline std::string PaxHeader(std::string_view key, std::string_view value) {
  const std::string body = " " + std::string(key) + "=" + std::string(value) + "\n";
  size_t length = body.size() + 1;
  while (std::to_string(length).size() + body.size() != length) ++length;
  return TarEntry('x', "pax", std::to_string(length) + body);
}

}  // namespace myograde::server
