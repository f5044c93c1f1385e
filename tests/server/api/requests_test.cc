// Request bodies: every mistake is reported with its key, and nothing odd is accepted.
#include "server/api/requests.h"

#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include "protocol/lease/track_config.h"
#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

using nlohmann::json;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

json GoodSubmit() {
  return {{"artefact", std::string(64, 'a')}, {"team", "alpha"}, {"track", "manipulation"}};
}

std::string SubmitProblem(const std::string& key, const json& value) {
  json body = GoodSubmit();
  body[key] = value;
  return std::string(ParseSubmit(body).status().message());
}

TEST(ParseSubmit, TakesWhatIsNeededAndWhatMayBe) {
  const auto least = ParseSubmit(GoodSubmit());
  ASSERT_TRUE(least.ok()) << least.status();
  EXPECT_EQ(least->team, "alpha");
  EXPECT_EQ(least->profile, "");
  EXPECT_FALSE(least->seeds || least->episodes);
  json body = GoodSubmit();
  body.update({{"profile", "paper"}, {"phase", "final"}, {"seeds", {5, 3, 9}}, {"episodes", 2}});
  const auto most = ParseSubmit(body);
  ASSERT_TRUE(most.ok()) << most.status();
  EXPECT_EQ(most->profile, "paper");
  EXPECT_EQ(most->phase, "final");
  EXPECT_THAT(*most->seeds, ElementsAre(5, 3, 9));
  EXPECT_EQ(*most->episodes, 2);
}

TEST(ParseSubmit, NamesTheKeyThatIsWrong) {
  for (const char* key : {"artefact", "team", "track"}) {
    json body = GoodSubmit();
    body.erase(key);
    EXPECT_THAT(std::string(ParseSubmit(body).status().message()),
                HasSubstr("\"" + std::string(key) + "\" is missing"));
    EXPECT_THAT(SubmitProblem(key, 7), HasSubstr(key));
  }
  EXPECT_THAT(SubmitProblem("speed", 1), HasSubstr("\"speed\" is not a known key"));
  for (const json& phase : {json(""), json("Final"), json("a/b"), json(5)}) {
    EXPECT_THAT(SubmitProblem("phase", phase), HasSubstr("\"phase\" must be"));
  }
  for (const json& artefact : {json(std::string(64, 'A')), json(std::string(63, 'a')), json("../x")}) {
    EXPECT_THAT(SubmitProblem("artefact", artefact), HasSubstr("64 lower-case hexadecimal digits"));
  }
  for (const json& count : {json(0), json(-1), json(1e18), json(2.5), json("3"), json(kMaxEpisodes + 1)}) {
    EXPECT_THAT(SubmitProblem("episodes", count), HasSubstr("\"episodes\""));
  }
  for (const json& seeds : {json::array(), json({1, 1}), json({-1}), json({0.5}), json("1"),
                            json({uint64_t{1} << 63}), json(std::vector<int>(10'001, 1))}) {
    EXPECT_THAT(SubmitProblem("seeds", seeds), HasSubstr("\"seeds\""));
  }
  for (const json& body : {json(), json::array(), json(3), json("text")}) {
    EXPECT_TRUE(absl::IsInvalidArgument(ParseSubmit(body).status()));
  }
}

TEST(IsPlainText, RefusesWhatWouldPlayTricksOnABoard) {
  for (const char* good : {"a", "Team Ä 7", "\xe2\x82\xac", "\xf0\x9f\x98\x80", "a  b"}) {
    EXPECT_TRUE(IsPlainText(good, 64)) << good;
  }
  for (const char* bad :
       {"", " a", "a ", "a\n", "\x1b[2J", "a\x7f", "a\xc2\x9b" "b", "a\xe2\x80\xae" "b",
        "a\xe2\x80\x8b" "b", "\xef\xbb\xbf" "a", "a\xe2\x80\xa8" "b", "\xe2\x82",
        "\xc2\xad", "a\xf3\xa0\x81\x81" "b", "\xed\xa0\x80", "\xe0\x80\x80", "\xf4\x90\x80\x80", "\xff"}) {
    EXPECT_FALSE(IsPlainText(bad, 64)) << bad;
  }
  EXPECT_TRUE(IsPlainText(std::string(64, 'x'), 64));
  EXPECT_FALSE(IsPlainText(std::string(65, 'x'), 64));
}

TEST(IsPlainText, TakesAnyBytesWithoutHarm) {
  EXPECT_TRUE(rc::check([](const std::string& text) {
    if (!IsPlainText(text, 64)) return;
    for (const char c : text) RC_ASSERT(static_cast<unsigned char>(c) >= 0x20 && c != 0x7f);
  }));
}

TEST(ParseRerun, WantsBothEndsOrNone) {
  const auto all = ParseRerun(json::object());
  ASSERT_TRUE(all.ok()) << all.status();
  EXPECT_FALSE(all->first || all->last);
  const auto some = ParseRerun({{"first", 3}, {"last", 3}});
  ASSERT_TRUE(some.ok()) << some.status();
  EXPECT_EQ(*some->first, 3);
  const auto problem = [](const json& body) { return std::string(ParseRerun(body).status().message()); };
  EXPECT_THAT(problem({{"first", 3}}), HasSubstr("\"last\" is missing"));
  EXPECT_THAT(problem({{"last", 3}}), HasSubstr("\"first\" is missing"));
  EXPECT_THAT(problem({{"first", 3}, {"last", 2}}), HasSubstr("before first"));
  EXPECT_THAT(problem({{"first", -1}, {"last", 2}}), HasSubstr("\"first\""));
  EXPECT_THAT(problem({{"first", 0}, {"last", kMaxEpisodes}}), HasSubstr("\"last\""));
}

TEST(ParseCancel, HasAReasonOfItsOwn) {
  EXPECT_EQ(*ParseCancel(json::object()), "cancelled by request");
  EXPECT_EQ(*ParseCancel({{"reason", "wrong file"}}), "wrong file");
  EXPECT_FALSE(ParseCancel({{"reason", ""}}).ok());
  EXPECT_FALSE(ParseCancel({{"reason", std::string(201, 'x')}}).ok());
  EXPECT_FALSE(ParseCancel({{"why", "x"}}).ok());
}

std::string FilterProblem(const std::vector<std::pair<std::string, std::string>>& parameters) {
  Request request;
  for (const auto& [key, value] : parameters) request.params.emplace(key, value);
  return std::string(ParseFilter(request).status().message());
}

TEST(ParseReason, IsThereAndNothingElse) {
  EXPECT_EQ(*ParseReason({{"reason", "a broken host"}}), "a broken host");
  for (const json& body : {json::object(), json({{"reason", ""}}), json({{"reason", "a\nb"}}),
                           json({{"reason", std::string(201, 'a')}}),
                           json({{"reason", "r"}, {"phase", "final"}})}) {
    EXPECT_TRUE(absl::IsInvalidArgument(ParseReason(body).status())) << body;
  }
  EXPECT_TRUE(ParseNothing(json::object()).ok());
  EXPECT_FALSE(ParseNothing({{"reason", "r"}}).ok());
}

TEST(ParseFilter, ChecksEveryParameter) {
  EXPECT_EQ(FilterProblem({}), "");
  EXPECT_EQ(FilterProblem({{"team", "a"}, {"state", "done"}, {"limit", "1000"}, {"before", "1"}}), "");
  for (const char* number : {"0", "-1", "1001", "1e3", "", " ", "99999999999999999999"}) {
    EXPECT_THAT(FilterProblem({{"limit", number}}), HasSubstr("from 1 to 1000")) << number;
  }
  EXPECT_THAT(FilterProblem({{"before", "0"}}), HasSubstr("\"before\""));
  EXPECT_THAT(FilterProblem({{"state", "asleep"}}), HasSubstr("\"state\" must be queued"));
  EXPECT_THAT(FilterProblem({{"order", "team"}}), HasSubstr("\"order\" is not a parameter"));
  EXPECT_THAT(FilterProblem({{"team", "a"}, {"team", "b"}}), HasSubstr("\"team\" appears twice"));
}

absl::StatusOr<RequestKey> KeyOf(const std::vector<std::string>& values, const json& body = json(),
                                 const std::string& path = "/v1/submissions") {
  Request request;
  request.path = path;
  for (const std::string& value : values) request.headers.emplace("idempotency-key", value);
  return ReadRequestKey(request, body);
}

TEST(ReadRequestKey, IsOfTheAddressAndTheBody) {
  EXPECT_EQ(KeyOf({})->key, "");
  const auto key = KeyOf({"k"}, {{"a", 1}, {"b", 2}});
  EXPECT_EQ(key->key, "k");
  EXPECT_EQ(key->request, KeyOf({"other"}, json::parse(R"({"b": 2, "a": 1})"))->request);
  EXPECT_NE(key->request, KeyOf({"k"}, {{"a", 1}, {"b", 3}})->request);
  EXPECT_NE(key->request, KeyOf({"k"}, {{"a", 1}, {"b", 2}}, "/v1/submissions/1/rerun")->request);
}

TEST(ReadRequestKey, IsVisibleAscii) {
  EXPECT_TRUE(KeyOf({"!\"#~"}).ok());
  EXPECT_TRUE(KeyOf({std::string(255, 'k')}).ok());
  const std::vector<std::vector<std::string>> wrong = {
      {""}, {"a b"}, {"\t"}, {"\x7f"}, {"k\u00e4"}, {std::string(256, 'k')}, {"a", "b"}};
  for (const std::vector<std::string>& values : wrong) {
    EXPECT_THAT(std::string(KeyOf(values).status().message()), HasSubstr("Idempotency-Key"))
        << values.front();
  }
}

}  // namespace
}  // namespace myograde::server
