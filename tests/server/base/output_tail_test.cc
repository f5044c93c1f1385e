#include "server/base/child_process.h"
#include "server/base/plain_text.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace myograde::server {
namespace {

constexpr char kMark[] = "\xEF\xBF\xBD";  // U+FFFD

bool IsSafe(const std::string& text) {
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if ((byte < 0x20 && c != '\n' && c != '\t') || byte == 0x7F) return false;
  }
  // C1 control characters in their two-byte form.
  for (size_t i = 0; i + 1 < text.size(); ++i) {
    if (text[i] == '\xC2' && static_cast<unsigned char>(text[i + 1]) < 0xA0) return false;
  }
  // Throws at anything that is not UTF-8.
  return nlohmann::json::parse(nlohmann::json(text).dump()) == text;
}

TEST(PrintableUtf8, KeepsTextAndReplacesTheRest) {
  const std::string text = "Gr\u00fc\u00dfe,\t\u4e16\u754c \U0001F600\n";
  EXPECT_EQ(PrintableUtf8(text), text);
  EXPECT_EQ(PrintableUtf8(std::string("a\0b", 3)), std::string("a") + kMark + "b");
  EXPECT_EQ(PrintableUtf8("\x1b[2J\r\x07"), std::string(kMark) + "[2J" + kMark + kMark);
  EXPECT_EQ(PrintableUtf8("\xC2\x9B"), kMark);                        // CSI from C1
  EXPECT_EQ(PrintableUtf8("\xC0\xAF"), std::string(kMark) + kMark);   // overlong
  EXPECT_EQ(PrintableUtf8("\xED\xA0\x80"), std::string(kMark) + kMark + kMark);  // surrogate
  EXPECT_EQ(PrintableUtf8("\xF5\x80"), std::string(kMark) + kMark);   // above U+10FFFF
  EXPECT_EQ(PrintableUtf8("x\xE4\xB8"), std::string("x") + kMark + kMark);  // truncated
}

TEST(OutputTail, KeepsTheEndAndCountsAll) {
  OutputTail tail(10);
  tail.Append("0123456789");
  EXPECT_FALSE(tail.truncated());
  EXPECT_EQ(tail.tail(), "0123456789");
  tail.Append("x");
  EXPECT_TRUE(tail.truncated());
  EXPECT_EQ(tail.total(), 11);
  tail.Append(std::string(OutputTail::kTailBytes, 'y'));
  EXPECT_EQ(tail.tail(), std::string(OutputTail::kTailBytes, 'y'));
  EXPECT_EQ(tail.total(), 11 + static_cast<int64_t>(OutputTail::kTailBytes));
}

TEST(OutputTail, TellsOfThePartSinceAMark) {
  OutputTail tail(1 << 20);
  tail.Append("first run\n");
  const int64_t mark = tail.total();
  EXPECT_EQ(tail.tail(mark), "");
  tail.Append("second run\n");
  EXPECT_EQ(tail.tail(mark), "second run\n");
  EXPECT_EQ(tail.tail(), "first run\nsecond run\n");
  tail.Append(std::string(2 * OutputTail::kTailBytes, 'z'));
  EXPECT_EQ(tail.tail(mark), std::string(OutputTail::kTailBytes, 'z'));
}

RC_GTEST_PROP(OutputTail, IsHarmlessAndBoundedWhateverComes,
              (const std::vector<std::string>& pieces)) {
  OutputTail tail(64);
  size_t total = 0;
  for (const std::string& piece : pieces) {
    // Long enough in total to be cut, even within sequences.
    for (int i = 0; i < 40; ++i) tail.Append(piece + "\xE4\xB8\x96");
    total += 40 * (piece.size() + 3);
  }
  RC_ASSERT(tail.total() == static_cast<int64_t>(total));
  RC_ASSERT(tail.truncated() == (total > 64));
  RC_ASSERT(tail.tail().size() <= OutputTail::kTailBytes);
  RC_ASSERT(IsSafe(tail.tail()));
}

}  // namespace
}  // namespace myograde::server
