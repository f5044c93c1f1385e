// LCM's short message as one UDP datagram: magic number "LC02" and sequence number, both 32 bits
// big-endian, the channel's name ending in NUL, and the encoded message to the datagram's end.
//
// Parsed here rather than by liblcm, whose receiver trusts the headers of fragments. Fragments
// (magic "LC03") are rejected here, so no byte of a datagram ever determines how much memory to
// allocate.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

namespace myograde {

inline constexpr size_t kMaxChannelLength = 63;  // LCM's own limit, without the NUL
inline constexpr size_t kDatagramHeader = 8;
inline constexpr size_t kMaxDatagram = 65507;  // of UDP over IPv4

// A view of the datagram's bytes, valid as long as they are.
struct Datagram {
  uint32_t sequence;
  std::string_view channel;  // 1 to 63 bytes, any but NUL
  std::span<const std::byte> payload;
};

// nullopt for anything but a complete short message.
std::optional<Datagram> ParseDatagram(std::span<const std::byte> bytes);

// Writes header and channel of a short message; the payload follows in the same datagram. Returns
// the bytes written. REQUIRES: channel.size() <= kMaxChannelLength.
size_t WriteDatagramHead(uint32_t sequence, std::string_view channel,
                         std::span<std::byte, kDatagramHeader + kMaxChannelLength + 1> out);

}  // namespace myograde
