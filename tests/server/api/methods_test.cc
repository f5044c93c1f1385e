#include "server/api/methods.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace myograde::server {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

Address AddressOf(const std::string& method, const std::string& pattern) {
  return {method, pattern, Action::kReadApi, std::regex(pattern)};
}

const std::vector<Address> kAddresses = {
    AddressOf("GET", "/v1/things"), AddressOf("POST", "/v1/things"),
    AddressOf("POST", R"(/v1/things/(\d{1,18})/end)"),
    AddressOf("DELETE", R"(/v1/things/(\d{1,18}))")};

TEST(MethodsAt, AreThoseOfTheAddressWithThoseThatFollow) {
  EXPECT_THAT(MethodsAt(kAddresses, "/v1/things"), ElementsAre("GET", "HEAD", "OPTIONS", "POST"));
  EXPECT_THAT(MethodsAt(kAddresses, "/v1/things/7/end"), ElementsAre("OPTIONS", "POST"));
  EXPECT_THAT(MethodsAt(kAddresses, "/v1/things/7"), ElementsAre("DELETE", "OPTIONS"));
}

TEST(MethodsAt, AreNoneWhereThereIsNoAddress) {
  for (const char* path : {"", "/", "/v1/thing", "/v1/things/", "/v1/things/7/", "/v1/things/x",
                           "/v1/things/1234567890123456789", "x/v1/things/7"}) {
    EXPECT_THAT(MethodsAt(kAddresses, path), IsEmpty()) << path;
  }
}

}  // namespace
}  // namespace myograde::server
