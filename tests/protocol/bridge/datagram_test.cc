#include "protocol/bridge/datagram.h"

#include <array>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <rapidcheck.h>

namespace myograde {
namespace {

std::vector<std::byte> Bytes(const std::string& text) {
  const auto* data = reinterpret_cast<const std::byte*>(text.data());
  return {data, data + text.size()};
}

std::vector<std::byte> Make(const std::string& channel, const std::string& payload) {
  std::array<std::byte, kDatagramHeader + kMaxChannelLength + 1> head;
  const size_t size = WriteDatagramHead(0x01020304, channel, head);
  std::vector<std::byte> bytes(head.begin(), head.begin() + static_cast<std::ptrdiff_t>(size));
  const std::vector<std::byte> rest = Bytes(payload);
  bytes.insert(bytes.end(), rest.begin(), rest.end());
  return bytes;
}

TEST(Datagram, IsLcmsShortMessage) {
  const std::vector<std::byte> bytes = Make("AB", std::string("\0x", 2));
  EXPECT_EQ(bytes, Bytes(std::string("LC02\1\2\3\4AB\0\0x", 13)));
  const auto datagram = ParseDatagram(bytes);
  ASSERT_TRUE(datagram.has_value());
  EXPECT_EQ(datagram->sequence, 0x01020304u);
  EXPECT_EQ(datagram->channel, "AB");
  EXPECT_EQ(datagram->payload.size(), 2u);
}

TEST(Datagram, LongestNameAndEmptyPayload) {
  const std::string name(kMaxChannelLength, 'c');
  const std::vector<std::byte> bytes = Make(name, "");
  const auto datagram = ParseDatagram(bytes);
  ASSERT_TRUE(datagram.has_value());
  EXPECT_EQ(datagram->channel, name);
  EXPECT_TRUE(datagram->payload.empty());
}

bool Refused(const std::string& text) { return !ParseDatagram(Bytes(text)); }

TEST(Datagram, EverythingElseIsRefused) {
  EXPECT_FALSE(Refused(std::string("LC02\0\0\0\0A\0", 10)));
  EXPECT_TRUE(Refused(""));
  EXPECT_TRUE(Refused("LC02\1\2\3"));
  EXPECT_TRUE(Refused(std::string("LC01\0\0\0\0A\0", 10))) << "not LCM's";
  EXPECT_TRUE(Refused(std::string("LC02\0\0\0\0", 8))) << "no name";
  EXPECT_TRUE(Refused(std::string("LC02\0\0\0\0ABC", 11))) << "a name without an end";
  EXPECT_TRUE(Refused(std::string("LC02\0\0\0\0\0payload", 16))) << "an empty name";
  EXPECT_TRUE(Refused(std::string("LC02\0\0\0\0", 8) + std::string(64, 'c') + std::string(1, 0)))
      << "too long a name";
}

TEST(Datagram, FragmentsAreRefusedWhateverTheyClaim) {
  // Fragment 0 of a message of 256 MiB, and one with an offset that wraps.
  EXPECT_TRUE(Refused(std::string("LC03\0\0\0\1\x10\0\0\0\0\0\0\0\0\0\0\1A\0x", 23)));
  EXPECT_TRUE(Refused(std::string("LC03\0\0\0\1\0\0\0\x20\xff\xff\xff\xf0\0\1\0\2xxx", 23)));
}

TEST(Datagram, AnyBytesGiveAViewInsideThemOrAnError) {
  EXPECT_TRUE(rc::check([](std::vector<uint8_t> noise, bool good_magic) {
    if (good_magic) {
      const std::string magic = "LC02";
      noise.insert(noise.begin(), magic.begin(), magic.end());
    }
    const auto bytes = std::as_bytes(std::span<const uint8_t>(noise));
    const auto datagram = ParseDatagram(bytes);
    if (!datagram) return;
    RC_ASSERT(datagram->channel.size() >= 1u);
    RC_ASSERT(datagram->channel.size() <= kMaxChannelLength);
    RC_ASSERT(datagram->channel.find('\0') == std::string_view::npos);
    RC_ASSERT(kDatagramHeader + datagram->channel.size() + 1 + datagram->payload.size() ==
              bytes.size());
  }));
}

}  // namespace
}  // namespace myograde
