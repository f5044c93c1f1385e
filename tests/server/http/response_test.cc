#include "server/http/response.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "protocol/base/file.h"
#include "tests/server/artefact/archives.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

TEST(ResponseTest, ATextHasItsLength) {
  Response response;
  response.SetHeader("Link", "a\r\nX: y");
  response.SetContent("text", "text/plain");
  EXPECT_EQ(response.TakeBytes(false, false),
            "HTTP/1.1 200 OK\r\nLink: a  X: y\r\nContent-Type: text/plain\r\nContent-Length: 4\r\n"
            "\r\ntext");
}

TEST(ResponseTest, ToHeadItIsTheHeadOfTheSame) {
  Response response;
  response.SetContent("text", "text/plain");
  EXPECT_EQ(response.TakeBytes(true, true),
            "HTTP/1.1 200 OK\r\nContent-Type: text/plain\r\nContent-Length: 4\r\n"
            "Connection: close\r\n\r\n");
}

TEST(ResponseTest, WhatIsNotModifiedHasNoLength) {
  Response response;
  response.status = 304;
  EXPECT_EQ(response.TakeBytes(false, false), "HTTP/1.1 304 Not Modified\r\n\r\n");
}

TEST(ResponseTest, AFileFollowsItsHeadUnlessHeadAsks) {
  const TestFolder temp;
  ASSERT_TRUE(WriteFile(temp / "file", "12345").ok());
  for (const bool head : {false, true}) {
    Response response;
    ASSERT_TRUE(response.SetFile(temp / "file", "text/plain").ok());
    EXPECT_THAT(response.TakeBytes(head, false), HasSubstr("Content-Length: 5\r\n"));
    EXPECT_EQ(response.file.left, head ? 0 : 5);
  }
  EXPECT_TRUE(absl::IsNotFound(Response().SetFile(temp / "none", "text/plain")));
}

TEST(ResponseTest, AStreamLastsAsLongAsItsConnection) {
  Response response;
  response.SetStream("text/plain", absl::Seconds(1), absl::Minutes(1), [] { return ""; });
  const std::string bytes = response.TakeBytes(false, false);
  EXPECT_THAT(bytes, HasSubstr("Connection: close\r\n"));
  EXPECT_THAT(bytes, Not(HasSubstr("Content-Length")));
  EXPECT_NE(response.stream, nullptr);
}

TEST(ResponseTest, AnErrorTakesThePlaceOfWhatWasSet) {
  Response response;
  response.SetHeader("Content-Encoding", "gzip");
  response.SetError({405, "method_not_allowed", "no", 1, "GET"});
  const std::string bytes = response.TakeBytes(false, false);
  EXPECT_THAT(bytes, HasSubstr("HTTP/1.1 405 Method Not Allowed\r\nAllow: GET\r\n"));
  EXPECT_THAT(bytes, Not(HasSubstr("gzip")));
}

TEST(RefusalBytes, IsAWholeAnswer) {
  const std::string text = RefusalBytes({429, "too_many", "not \"now\""});
  EXPECT_THAT(text, ::testing::StartsWith("HTTP/1.1 429 Too Many Requests\r\n"));
  EXPECT_THAT(text, HasSubstr("Retry-After: 1\r\n"));
  EXPECT_THAT(text, HasSubstr("Connection: close\r\n"));
  EXPECT_THAT(text, ::testing::EndsWith(
      "\r\n\r\n{\"error\":{\"code\":\"too_many\",\"message\":\"not \\\"now\\\"\"}}\n"));
}

}  // namespace
}  // namespace myograde::server
