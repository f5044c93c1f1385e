#include "server/api/methods.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace myograde::server {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

TEST(Methods, AreThoseOfTheAddressWithThoseThatFollow) {
  Methods methods;
  methods.Add("GET", "/v1/things");
  methods.Add("POST", "/v1/things");
  methods.Add("POST", R"(/v1/things/(\d{1,18})/end)");
  methods.Add("DELETE", R"(/v1/things/(\d{1,18}))");
  EXPECT_THAT(methods.At("/v1/things"), ElementsAre("GET", "HEAD", "OPTIONS", "POST"));
  EXPECT_THAT(methods.At("/v1/things/7/end"), ElementsAre("OPTIONS", "POST"));
  EXPECT_THAT(methods.At("/v1/things/7"), ElementsAre("DELETE", "OPTIONS"));
}

TEST(Methods, AreNoneWhereThereIsNoAddress) {
  Methods methods;
  methods.Add("GET", R"(/v1/things/(\d{1,18}))");
  for (const char* path : {"", "/", "/v1/things", "/v1/things/", "/v1/things/7/", "/v1/things/x",
                           "/v1/things/1234567890123456789", "x/v1/things/7"}) {
    EXPECT_THAT(methods.At(path), IsEmpty()) << path;
  }
}

}  // namespace
}  // namespace myograde::server
