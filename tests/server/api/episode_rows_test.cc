// Which rows and columns of episodes an answer has, what details add up to, and what of all that a phase
// withholds; and texts of participants in XML.
#include "server/api/episode_rows.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/api/board_feeds.h"
#include "server/api/redaction.h"
#include "server/api/views.h"

namespace myograde::server {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

Request Asking(std::initializer_list<std::pair<const std::string, std::string>> given) {
  Request request;
  request.params = given;
  return request;
}

TEST(ParseEpisodes, TakesWhatIsThereAndNothingElse) {
  auto selection = ParseEpisodes(Asking({}));
  ASSERT_TRUE(selection.ok()) << selection.status();
  EXPECT_FALSE(selection->rows || selection->summary || selection->needs_details());
  selection = ParseEpisodes(Asking({{"episodes", "1"}, {"first", "3"}, {"last", "4"}}));
  ASSERT_TRUE(selection.ok()) << selection.status();
  EXPECT_TRUE(selection->rows && selection->needs_details());
  EXPECT_EQ(selection->first, 3);
  EXPECT_EQ(selection->last, 4);
  selection = ParseEpisodes(Asking({{"episodes", "1"}, {"fields", "outcome,facts.course"}}));
  ASSERT_TRUE(selection.ok()) << selection.status();
  EXPECT_THAT(selection->fields, ElementsAre("outcome", "facts.course"));
  EXPECT_FALSE(selection->needs_details());
  EXPECT_TRUE(ParseEpisodes(Asking({{"episodes", "1"}, {"fields", "details.fall_time"}}))
                  ->needs_details());
  EXPECT_TRUE(ParseEpisodes(Asking({{"summary", "1"}}))->needs_details());
  EXPECT_FALSE(ParseEpisodes(Asking({{"episodes", "1"}, {"details", "0"}}))->needs_details());
  for (const char* key : {"episodes", "summary", "details", "first", "last", "fields"}) {
    for (const char* value : {"2", "-1", "x", "facts/course", "index,,index", "1 "}) {
      const bool number = std::string_view(key) == "first" || std::string_view(key) == "last";
      if (number && std::string_view(value) == "2") continue;
      const absl::Status status = ParseEpisodes(Asking({{key, value}})).status();
      EXPECT_TRUE(absl::IsInvalidArgument(status)) << key << " " << value;
      EXPECT_THAT(std::string(status.message()), HasSubstr(key));
    }
  }
  std::string many = "index";
  for (int i = 0; i < 40; ++i) many += ",index";
  EXPECT_THAT(std::string(ParseEpisodes(Asking({{"fields", many}})).status().message()),
              HasSubstr("41 keys"));
}

TEST(ColumnsOf, HasAValueForEachRow) {
  const Json rows = {{{"index", 3}, {"outcome", "success"}, {"facts", {{"course", 2}}}},
                     {{"index", 4}, {"outcome", nullptr}, {"facts", nullptr}},
                     {{"index", 5}, {"facts", {{"a.b", 1}}}}};
  EXPECT_EQ(ColumnsOf({"outcome", "facts.course", "facts.a.b", "index.x"}, rows),
            Json({{"index", {3, 4, 5}},
                  {"outcome", {"success", nullptr, nullptr}},
                  {"facts.course", {2, nullptr, nullptr}},
                  {"facts.a.b", {nullptr, nullptr, 1}},
                  {"index.x", {nullptr, nullptr, nullptr}}}));
  EXPECT_EQ(ColumnsOf({"outcome"}, Json::array()),
            Json({{"index", Json::array()}, {"outcome", Json::array()}}));
}

TEST(DetailsSummary, AddsUpNumbersWhereverTheyAre) {
  EXPECT_TRUE(SummaryOf({}).is_null());
  EXPECT_TRUE(SummaryOf({{nullptr, 1000}}).is_null()) << "no details, no part in the sums";
  const Json first = {
      {"time", 1.5}, {"joints", {{"knee", {-1, 2}}, {"hip", {0, 1}}}}, {"none", nullptr}};
  const Json second = {
      {"time", 2.5}, {"joints", {{"knee", {-3, 1}}, {"ankle", {5, 6}}}}, {"none", nullptr}};
  const Json result = SummaryOf({{nullptr, 1000}, {first, 10}, {second, 20}});
  EXPECT_EQ(result["episodes"], 2);
  EXPECT_EQ(result["steps"], 30);
  const Json& values = result["values"];
  EXPECT_EQ(values["time"], Json({{"count", 2}, {"min", 1.5}, {"mean", 2.0}, {"max", 2.5}}));
  EXPECT_EQ(values["joints"]["knee"][0],
            Json({{"count", 2}, {"min", -3.0}, {"mean", -2.0}, {"max", -1.0}}));
  EXPECT_EQ(values["joints"]["hip"][1],
            Json({{"count", 1}, {"min", 1.0}, {"mean", 1.0}, {"max", 1.0}}));
  EXPECT_EQ(values["joints"]["ankle"][0]["count"], 1);
  EXPECT_EQ(values["none"],
            Json({{"count", 0}, {"min", nullptr}, {"mean", nullptr}, {"max", nullptr}}));
}

TEST(RedactEvaluation, WithholdsSummaryAndHighlightsAsTheRowsThatTheyAreOf) {
  const Json row = {{"index", 3}, {"outcome", "success"}, {"metrics", {{"time_s", 1}}},
                    {"fault", nullptr}, {"log", {{"sha256", "l"}}}};
  const Json answer = {{"state", "done"}, {"episodes", {{"total", 1}}}, {"comparison", nullptr},
                       {"details_summary", {{"episodes", 1}}}, {"highlights", {{"best", row}}}};
  const auto redacted = [&](const Visibility& visibility) {
    Json copy = answer;
    RedactEvaluation(copy, visibility);
    return copy;
  };
  Json seen = redacted({.logs = false});
  EXPECT_TRUE(seen["details_summary"].is_null());
  EXPECT_EQ(seen["highlights"]["best"]["outcome"], "success");
  EXPECT_TRUE(seen["highlights"]["best"]["log"].is_null());
  EXPECT_EQ(redacted({.outcomes = false})["highlights"], Json::object());
  EXPECT_EQ(redacted({.metrics = false})["highlights"], Json::object());
  EXPECT_FALSE(redacted({.metrics = false})["details_summary"].is_null());
  EXPECT_EQ(redacted({.seeds = false})["details_summary"], answer["details_summary"]);
}

TEST(XmlText, HoldsEveryTextAsATextThatXmlCanHold) {
  EXPECT_EQ(XmlText("a<b>&\"'"), "a&lt;b&gt;&amp;&quot;&#39;");
  EXPECT_EQ(XmlText("größe 🦿 שלום\t\n"), "größe 🦿 שלום\t\n");
  EXPECT_EQ(XmlText("]]>"), "]]&gt;");
  EXPECT_EQ(XmlText(std::string("a\0b\x1b\x7f", 5)), "a⟨U+0000⟩b⟨U+001B⟩⟨U+007F⟩");
  EXPECT_EQ(XmlText("a\u202eb\u200bc"), "a⟨U+202E⟩b⟨U+200B⟩c");
  EXPECT_EQ(XmlText("\ufffe\uffff\U0001ffff"), "⟨U+FFFE⟩⟨U+FFFF⟩⟨U+1FFFF⟩");
  EXPECT_EQ(XmlText("\xff\xc3"), "\ufffd\ufffd");
}

}  // namespace
}  // namespace myograde::server
