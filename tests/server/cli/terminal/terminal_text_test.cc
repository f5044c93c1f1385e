// Text on terminals: line widths, and shrinking tables.
#include <clocale>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include "server/base/plain_text.h"
#include "server/cli/base/verbs.h"
#include "server/cli/terminal/terminal.h"

namespace myograde::server {
namespace {

using testing::ElementsAre;

class TerminalText : public testing::Test {
 protected:
  TerminalText() { std::setlocale(LC_CTYPE, "C.UTF-8"); }
};

TEST_F(TerminalText, WidthCountsColumnsAndNotBytes) {
  EXPECT_EQ(TextWidth("abc"), 3u);
  EXPECT_EQ(TextWidth("Müßig"), 5u);
  EXPECT_EQ(TextWidth("東京"), 4u);
  EXPECT_EQ(TextWidth("e\u0301"), 1u);
  EXPECT_EQ(TextWidth("\033[1mbold\033[0m"), 4u);
}

TEST_F(TerminalText, LinesBreakAtSpacesAndLongWordsWithin) {
  EXPECT_THAT(BreakLine("", 10), ElementsAre(""));
  EXPECT_THAT(BreakLine("one two three", 13), ElementsAre("one two three"));
  EXPECT_THAT(BreakLine("one two three", 12), ElementsAre("one two", "three"));
  EXPECT_THAT(BreakLine("one two three", 9, "  "), ElementsAre("one two", "  three"));
  EXPECT_THAT(BreakLine("abcdefgh", 3), ElementsAre("abc", "def", "gh"));
  EXPECT_THAT(BreakLine("hash 01234567", 10, "      "), ElementsAre("hash", "  01234567"))
      << "a word that fits on a line is not broken for the indent's sake";
  EXPECT_THAT(BreakLine("hash 0123456789", 10, "    "), ElementsAre("hash 01234", "    56789"));
  EXPECT_THAT(BreakLine("  東京都 a", 6), ElementsAre("  東京", "都 a"));
}

TEST_F(TerminalText, ForeignTextChoosesNoBeginningOfALine) {
  const std::string line = Marked("oops 0123456789abcdef").substr(0, 25);
  EXPECT_THAT(BreakLine(line, 16, kForeignMark),
              ElementsAre("  | oops 0123456", "  | 789abcdef"));
  EXPECT_THAT(BreakLine("  | one 0123456789", 14, kForeignMark),
              ElementsAre("  | one", "  | 0123456789"));
  EXPECT_THAT(BreakLine("  |  0123456789abc", 12, kForeignMark),
              ElementsAre("  |  0123456", "  | 789abc"));
  for (const std::string space : {" ", "\u00a0", "\u2007", "\u202f", "\u2003"}) {
    EXPECT_THAT(BreakLine("a b" + space + "c", 3, "  "), ElementsAre("a b", "  c")) << space;
    EXPECT_THAT(BreakLine("oops Submission" + space + "1", 16, "  "),
                ElementsAre("oops Submission", "  1"));
  }
  EXPECT_THAT(BreakLine("a\tb", 9, "  "), ElementsAre("a", "  b")) << "eight columns at most";
}

TEST_F(TerminalText, NoPieceIsTooWideAndNoWordIsLost) {
  EXPECT_TRUE(rc::check([](const std::vector<std::string>& noise) {
    std::string line, letters;
    for (const std::string& word : noise) {
      for (const char c : word) {
        line += static_cast<char>('a' + static_cast<unsigned char>(c) % 26);
        letters += line.back();
      }
      line += ' ';
    }
    const auto columns = *rc::gen::inRange<size_t>(2, 60);
    const auto indent = *rc::gen::inRange<size_t>(0, columns);
    std::string kept;
    for (const std::string& piece : BreakLine(line, columns, std::string(indent, ' '))) {
      RC_ASSERT(TextWidth(piece) <= columns);
      for (const char c : piece) {
        if (c != ' ') kept += c;
      }
    }
    RC_ASSERT(kept == letters);
  }));
}

TEST_F(TerminalText, WhatIsCutOffIsSeen) {
  EXPECT_EQ(CutText("short", 5), "short");
  EXPECT_EQ(CutText("shorter", 5), "shor…");
  EXPECT_EQ(CutText("東京都", 4), "東…");
  EXPECT_EQ(CutText("x", 0), "");
}

TEST_F(TerminalText, TablesGiveWayBeforeTheyAreTooWide) {
  Table table({"rank", "team", "distance m"});
  table.Add({"1", "The Walking Muscles", "99.1234"});
  table.Add({"2", "B", "3.0000"});
  EXPECT_THAT(table.Lines(0), ElementsAre("rank  team                 distance m",
                                          "   1  The Walking Muscles     99.1234",
                                          "   2  B                        3.0000"));
  EXPECT_THAT(table.Lines(30), ElementsAre("rank  team          distance m",
                                           "   1  The Walking      99.1234",
                                           "      Muscles",
                                           "   2  B                 3.0000"));
  EXPECT_THAT(table.Lines(24), ElementsAre("rank  team      distance",
                                           "                       m",
                                           "   1  The        99.1234",
                                           "      Walking", "      Muscles",
                                           "   2  B           3.0000"));
  EXPECT_THAT(table.Lines(20), ElementsAre("rank        1", "team        The",
                                           "  Walking Muscles", "distance m  99.1234", "",
                                           "rank        2", "team        B",
                                           "distance m  3.0000"));
  for (const size_t columns : {20u, 24u, 30u, 36u, 80u}) {
    for (const std::string& line : table.Lines(columns)) EXPECT_LE(TextWidth(line), columns);
  }
}

// What a terminal would obey, or what would turn or hide the text around it.
const std::string kHarmful[] = {
    "\033[31m", "\033]0;title\a", "\a", "\r", "\b", "\v", "\x7f", "\n", std::string(1, '\0'),
    "\x9b" "31m",                                        // C1 as a byte, which is invalid UTF-8
    "\u0085", "\u009b" "31m",                            // C1
    "\u202a", "\u202d", "\u202e", "\u2066", "\u2069",    // embeddings, overrides, isolates
    "\u061c", "\u200e", "\u200f",                        // marks of direction
    "\u200b", "\u200d", "\u2060", "\ufeff", "\u00ad",    // of no width
    "\u034f", "\u180e", "\u2028", "\u2029", "\U000e0041", "\U0001d173",
    "\xff", "\xc3", "\xed\xa0\x80", "\xf4\x90\x80\x80",  // invalid UTF-8
};

bool HasHarm(const std::string& text) { return !IsUtf8(text) || !FirstUnsafe(text).empty(); }

TEST_F(TerminalText, ForeignTextIsHarmlessOnALine) {
  for (const std::string& harm : kHarmful) {
    const std::string shown = Sanitized("a" + harm + "b");
    EXPECT_FALSE(HasHarm(shown)) << shown;
    EXPECT_TRUE(shown.starts_with("a?") && shown.ends_with("b")) << shown;
  }
  EXPECT_EQ(Sanitized("Müßig 東京 e\u0301 🦾"), "Müßig 東京 e\u0301 🦾");
  EXPECT_EQ(Sanitized("a\tb"), "a?b");
  EXPECT_EQ(Sanitized("a\tb", /*tabs=*/true), "a\tb");
}

TEST_F(TerminalText, ForeignLinesAreMarked) {
  EXPECT_EQ(Marked(""), "");
  EXPECT_EQ(Marked("one"), "  | one\n");
  EXPECT_EQ(Marked("one\nmyograde: error: forged\n\nend\n"),
            "  | one\n  | myograde: error: forged\n  | \n  | end\n");
  for (const std::string& harm : kHarmful) {
    std::string shown = Marked("a" + harm + "b");
    std::erase(shown, '\n');
    EXPECT_FALSE(HasHarm(shown)) << shown;
  }
}

TEST_F(TerminalText, JsonEscapesWhatIsHarmfulAndStaysTheSame) {
  for (const std::string& harm : kHarmful) {
    if (!IsUtf8(harm)) continue;
    const nlohmann::json json = {{"a" + harm, {harm, "é"}}};
    std::string shown = ShownJson(json);
    EXPECT_EQ(nlohmann::json::parse(shown), json);
    std::erase(shown, '\n');
    EXPECT_FALSE(HasHarm(shown)) << shown;
    EXPECT_NE(shown.find("é"), std::string::npos);
  }
}

}  // namespace
}  // namespace myograde::server
