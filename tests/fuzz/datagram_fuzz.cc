// UDP datagrams that anybody in the participant's sandbox can send.
#include <array>
#include <cstring>

#include "protocol/bridge/datagram.h"
#include "tests/fuzz/fuzz.h"

using namespace myograde;
using fuzz::Require;

MYOGRADE_FUZZ_TARGET(datagram)(const uint8_t* data, size_t size) {
  const auto bytes = std::as_bytes(std::span<const uint8_t>(data, size));
  const std::optional<Datagram> datagram = ParseDatagram(bytes);
  if (!datagram) return 0;
  const std::string_view channel = datagram->channel;
  Require(!channel.empty() && channel.size() <= kMaxChannelLength, "the name's length is LCM's");
  // The views are inside the datagram, and re-encoding header and name gives its beginning.
  std::array<std::byte, kDatagramHeader + kMaxChannelLength + 1> head;
  const size_t head_size = WriteDatagramHead(datagram->sequence, channel, head);
  Require(head_size + datagram->payload.size() == size, "nothing is lost or made up");
  Require(std::memcmp(head.data(), data, head_size) == 0, "the beginning is read as written");
  Require(datagram->payload.data() == bytes.data() + head_size, "the payload is a view");
  return 0;
}
