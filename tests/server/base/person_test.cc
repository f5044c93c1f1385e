// Users of this host as people write them.
#include "server/base/peer_key.h"

#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace myograde::server {
namespace {

TEST(PersonTest, ANameANumberAndAKeyNameTheSameUser) {
  for (const char* text : {"root", "0", "uid 0"}) {
    const absl::StatusOr<std::string> person = PersonNamed(text);
    ASSERT_TRUE(person.ok()) << text << ": " << person.status();
    EXPECT_EQ(*person, "uid 0");
  }
  EXPECT_EQ(*PersonNamed("uid 4294967294"), "uid 4294967294") << "needs no entry of a user";
  EXPECT_EQ(*PersonNamed("007"), "uid 7");
}

TEST(PersonTest, WhatIsNoUserIsRefusedInOneSentence) {
  for (const std::string& text :
       {std::string(), std::string("no such user"), std::string("uid "), std::string("uid -1"),
        std::string("-1"), std::string("uid 4294967295"), std::string("99999999999999999999"),
        std::string("uid 1 2"), std::string("uid  1"), std::string("ro\0ot", 5),
        std::string("token 7"), std::string(100'000, 'x')}) {
    const absl::Status status = PersonNamed(text).status();
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << text.substr(0, 50);
    EXPECT_THAT(std::string(status.message()), testing::HasSubstr("has no user"));
    EXPECT_LT(status.message().size(), 500u);
  }
}

}  // namespace
}  // namespace myograde::server
