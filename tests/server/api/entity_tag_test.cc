#include "server/api/negotiation.h"

#include <gtest/gtest.h>

#include <string>

namespace myograde::server {
namespace {

TEST(EntityTag, FollowsFromTheBodyAlone) {
  const std::string tag = ComputeEntityTag("{}\n");
  EXPECT_EQ(tag, "\"ca3d163bab055381827226140568f3bef7eaac187cebd76878e0b63e9e442356\"");
  EXPECT_EQ(ComputeEntityTag("{}\n"), tag);
  EXPECT_NE(ComputeEntityTag("{} "), tag);
}

TEST(EntityTag, IsFoundInAListOfTags) {
  EXPECT_TRUE(NamesEntityTag(R"("a")", R"("a")"));
  EXPECT_TRUE(NamesEntityTag(R"("b", "a")", R"("a")"));
  EXPECT_TRUE(NamesEntityTag(R"(W/"b", W/"a" )", R"("a")"));
  EXPECT_TRUE(NamesEntityTag(R"("with, comma", "a")", R"("a")"));
  EXPECT_TRUE(NamesEntityTag("*", R"("a")"));
}

TEST(EntityTag, IsNotFoundInAnythingElse) {
  for (const char* header : {"", " ", ",", R"("b")", "a", R"("a)", R"(a")", R"("a b")", R"(w/"a")",
                             R"(W/a)", R"("b" x "a")", R"("A")", "**", R"("b", *)"}) {
    EXPECT_FALSE(NamesEntityTag(header, R"("a")")) << header;
  }
}

}  // namespace
}  // namespace myograde::server
