#include "protocol/bridge/datagram.h"

#include <algorithm>
#include <cstring>

namespace myograde {
namespace {

constexpr uint32_t kShortMagic = 0x4c433032;  // "LC02"

uint32_t ReadBigEndian(const std::byte* bytes) {
  uint32_t value = 0;
  for (int i = 0; i < 4; ++i) value = value << 8 | std::to_integer<uint32_t>(bytes[i]);
  return value;
}

void WriteBigEndian(uint32_t value, std::byte* out) {
  for (int i = 0; i < 4; ++i) out[i] = static_cast<std::byte>(value >> (24 - 8 * i) & 0xffu);
}

}  // namespace

std::optional<Datagram> ParseDatagram(std::span<const std::byte> bytes) {
  if (bytes.size() < kDatagramHeader || ReadBigEndian(bytes.data()) != kShortMagic) return {};
  const std::span<const std::byte> rest = bytes.subspan(kDatagramHeader);
  const auto limit = rest.begin() + static_cast<std::ptrdiff_t>(
                                        std::min(rest.size(), kMaxChannelLength + 1));
  const auto end = std::find(rest.begin(), limit, std::byte{0});
  if (end == limit || end == rest.begin()) return {};
  const auto length = static_cast<size_t>(end - rest.begin());
  return Datagram{ReadBigEndian(bytes.data() + 4),
                  {reinterpret_cast<const char*>(rest.data()), length},
                  rest.subspan(length + 1)};
}

size_t WriteDatagramHead(uint32_t sequence, std::string_view channel,
                         std::span<std::byte, kDatagramHeader + kMaxChannelLength + 1> out) {
  WriteBigEndian(kShortMagic, out.data());
  WriteBigEndian(sequence, out.data() + 4);
  std::memcpy(out.data() + kDatagramHeader, channel.data(), channel.size());
  out[kDatagramHeader + channel.size()] = std::byte{0};
  return kDatagramHeader + channel.size() + 1;
}

}  // namespace myograde
