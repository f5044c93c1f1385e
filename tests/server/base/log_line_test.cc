#include "server/base/log_line.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <thread>

#include <nlohmann/json.hpp>

namespace myograde::server {
namespace {

using Json = nlohmann::json;

const absl::Time kTime = absl::FromUnixMillis(1'764'590'400'123);

Json JsonOf(const std::string& message, const LogFields& fields = {}) {
  return Json::parse(LogLine(LogFormat::kJson, kTime, "info", message, fields));
}

TEST(LogLineTest, HasTimeLevelMessageAndTheFieldsThatAreKnown) {
  EXPECT_EQ(LogLine(LogFormat::kJson, kTime, "info", "done", {.evaluation = 9, .team = "a"}),
            "{\"time\":\"2025-12-01T12:00:00.123Z\",\"level\":\"info\",\"message\":\"done\","
            "\"evaluation\":9,\"team\":\"a\"}\n");
  const std::string text = LogLine(LogFormat::kText, kTime, "warning", "a \\ b", {.lease = 4});
  EXPECT_TRUE(text.starts_with("2025-12-01T")) << text;
  EXPECT_TRUE(text.ends_with(" warning a \\ b\n")) << text;
}

TEST(LogLineTest, WhatCouldForgeALineIsEscaped) {
  const std::string hostile = "a\nb\r\t\x1b[2J\x7f\xff \u2028\u202e\u0085\"}";
  const std::string text = LogLine(LogFormat::kText, kTime, "info", hostile);
  EXPECT_TRUE(text.ends_with(
      " info a\\nb\\u{d}\\t\\u{1b}[2J\\u{7f}\\xff \\u{2028}\\u{202e}\\u{85}\"}\n"))
      << text;
  EXPECT_EQ(JsonOf(hostile)["message"], "a\nb\r\t\x1b[2J\x7f\ufffd \u2028\u202e\u0085\"}");
  EXPECT_EQ(JsonOf("x", {.team = "a\"}\nb"})["team"], "a\"}\nb");
}

TEST(LogLineTest, AMessageInAnyLanguageStaysReadableAsText) {
  EXPECT_TRUE(LogLine(LogFormat::kText, kTime, "info", "Mannschaft Blåbær 青 ☃")
                  .ends_with(" info Mannschaft Blåbær 青 ☃\n"));
}

RC_GTEST_PROP(LogLineProperty, AnyBytesAreOneLine, (const std::string& message)) {
  for (const LogFormat format : {LogFormat::kText, LogFormat::kJson}) {
    const std::string line = LogLine(format, kTime, "info", message, {.team = message});
    RC_ASSERT(line.find('\n') == line.size() - 1);
    for (const char c : line.substr(0, line.size() - 1)) {
      RC_ASSERT(static_cast<unsigned char>(c) >= 0x20 && c != 0x7f);
      RC_ASSERT(format == LogFormat::kText || static_cast<unsigned char>(c) < 0x80);
    }
  }
}

TEST(LogScopeTest, ScopesNestAndAreOfAThread) {
  EXPECT_EQ(CurrentLogFields().evaluation, 0);
  const LogScope outer({.evaluation = 1});
  {
    const LogScope inner({.lease = 2});
    EXPECT_EQ(CurrentLogFields().lease, 2);
    EXPECT_EQ(CurrentLogFields().evaluation, 0);
    std::thread([] { EXPECT_EQ(CurrentLogFields().lease, 0); }).join();
  }
  EXPECT_EQ(CurrentLogFields().evaluation, 1);
}

}  // namespace
}  // namespace myograde::server
