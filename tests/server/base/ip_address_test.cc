// Which addresses are one caller for limits, and which are this host's own.
#include "server/base/ip_address.h"

#include <gtest/gtest.h>
#include <netinet/in.h>

namespace myograde::server {
namespace {

TEST(IpAddressTest, AddressesOfOneOwnerHaveOneKey) {
  const auto key = [](const char* text) { return IpAddress::Parse(text).value().Key(); };
  EXPECT_EQ(key("192.0.2.1"), "address 192.0.2.1");
  EXPECT_EQ(key("::ffff:192.0.2.1"), "address 192.0.2.1");
  EXPECT_EQ(key("2001:db8:1:2:3:4:5:6"), "address 2001:db8:1:2::/64");
  EXPECT_EQ(key("2001:DB8:1:2::"), "address 2001:db8:1:2::/64");
  EXPECT_NE(key("2001:db8:1:3::"), key("2001:db8:1:2::"));
}

TEST(IpAddressTest, OnlyAddressesOfThisHostAreLoopback) {
  for (const char* text : {"127.0.0.1", "127.3.2.1", "::1", "::ffff:127.0.0.1"}) {
    EXPECT_TRUE(IpAddress::Parse(text).value().IsLoopback()) << text;
  }
  for (const char* text : {"0.0.0.0", "128.0.0.1", "::", "::2", "1::1", "::ffff:10.0.0.1"}) {
    EXPECT_FALSE(IpAddress::Parse(text).value().IsLoopback()) << text;
  }
}

TEST(IpAddressTest, OtherTextIsNoAddress) {
  for (const char* text : {"", "localhost", "192.0.2", "192.0.2.1:80", "[::1]", "192.0.2.1 ",
                           "192.0.2.256", ":::", "fe80::1%eth0", "0x7f.1"}) {
    EXPECT_FALSE(IpAddress::Parse(text).has_value()) << text;
  }
}

TEST(IpAddressTest, GoesThroughASocketsForm) {
  for (const char* text : {"192.0.2.1", "2001:db8::7"}) {
    const IpAddress address = IpAddress::Parse(text).value();
    socklen_t size = 0;
    const sockaddr_storage form = address.SocketAddress(8443, size);
    EXPECT_EQ(size, form.ss_family == AF_INET ? sizeof(sockaddr_in) : sizeof(sockaddr_in6));
    EXPECT_EQ(IpAddress::Of(form).value().UrlHost(), address.UrlHost());
  }
  EXPECT_EQ(IpAddress::Parse("::1").value().UrlHost(), "[::1]");
  EXPECT_FALSE(IpAddress::Of({}).has_value());
}

}  // namespace
}  // namespace myograde::server
