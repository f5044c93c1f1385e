#include "protocol/base/config_reader.h"

#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace myograde {
namespace {

using nlohmann::json;
using testing::HasSubstr;

// The message of the mistake that `read` finds in `object`; "" if it finds none.
std::string MistakeOf(const json& object, const std::function<void(ConfigReader&)>& read) {
  ConfigReader reader(object, "f.json: part");
  read(reader);
  return std::string(reader.Finish().message());
}

TEST(ConfigReader, ReadsEveryTypeAndKnowsComments) {
  const json object = {{"//", "about"}, {"// n", 1},          {"n", 1.5},         {"i", -3},
                       {"b", true},     {"s", "text"},        {"c", "two"},       {"v", {1, 2}},
                       {"w", {"x"}},    {"o", {{"k", 1}}},    {"a", json::array()}};
  ConfigReader reader(object, "here");
  EXPECT_EQ(reader.Number("n", {0, 2}), 1.5);
  EXPECT_EQ(reader.Integer("i", -3, 3), -3);
  EXPECT_TRUE(reader.Boolean("b"));
  EXPECT_EQ(reader.String("s"), "text");
  EXPECT_EQ(reader.Choice("c", {"one", "two"}), "two");
  EXPECT_EQ(reader.Numbers("v", 2, {1, 2}), (std::vector<double>{1, 2}));
  EXPECT_EQ(reader.Range("v", {1, 2}), (std::array<double, 2>{1, 2}));
  EXPECT_EQ(reader.Strings("w"), std::vector<std::string>{"x"});
  EXPECT_EQ(reader.Object("o"), object["o"]);
  EXPECT_TRUE(reader.Array("a").empty());
  EXPECT_FALSE(reader.Has("none"));
  EXPECT_EQ(reader.where(), "here");
  EXPECT_TRUE(reader.Finish().ok());
}

struct Mistake {
  json value;
  std::function<void(ConfigReader&)> read;
  std::string expected;
};

TEST(ConfigReader, TellsEachMistakeWithItsPlaceAndRange) {
  const auto number = [](ConfigReader& r) { r.Number("k", {1, 2}); };
  const auto integer = [](ConfigReader& r) { r.Integer("k", 1, 5); };
  const auto numbers = [](ConfigReader& r) { r.Numbers("k", 2, {0, 1}); };
  const auto choice = [](ConfigReader& r) { r.Choice("k", {"a", "b"}); };
  const auto range = [](ConfigReader& r) { r.Range("k", {0, 1}); };
  const std::vector<Mistake> mistakes = {
      {{1, 0.5}, range, "must have its smaller number first"},
      {"1", number, "must be a number, is string"},
      {0.5, number, "is 0.5, must be from 1 to 2"},
      {2.5, number, "is 2.5, must be from 1 to 2"},
      {std::numeric_limits<double>::infinity(), number, "must be from 1 to 2"},
      {std::numeric_limits<double>::quiet_NaN(), number, "must be from 1 to 2"},
      {1.0, integer, "must be a whole number, is 1.0"},
      {0, integer, "is 0, must be from 1 to 5"},
      {std::numeric_limits<uint64_t>::max(), integer, "is 18446744073709551615, must be"},
      {1, [](ConfigReader& r) { r.Boolean("k"); }, "must be true or false, is 1"},
      {1, [](ConfigReader& r) { r.String("k"); }, "must be a string, is number"},
      {"c", choice, "is \"c\", must be one of: a, b"},
      {1, choice, "must be a string"},
      {json::array({1}), numbers, "has 1 entries, must have 2"},
      {json::array({1, 2}), numbers, "holds 2, each must be a number from 0 to 1"},
      {json::array({1, "1"}), numbers, "holds \"1\", each must be a number"},
      {1, numbers, "must be an array, is number"},
      {json::array({1}), [](ConfigReader& r) { r.Strings("k"); }, "holds 1, each must be a string"},
      {1, [](ConfigReader& r) { r.Object("k"); }, "must be an object, is number"},
      {json::object(), [](ConfigReader& r) { r.Array("k"); }, "must be an array, is object"},
  };
  for (const Mistake& mistake : mistakes) {
    const std::string got = MistakeOf({{"k", mistake.value}}, mistake.read);
    EXPECT_THAT(got, testing::StartsWith("f.json: part: \"k\" ")) << mistake.value;
    EXPECT_THAT(got, HasSubstr(mistake.expected));
    EXPECT_EQ(MistakeOf(json::object(), mistake.read), "f.json: part: \"k\" is missing");
  }
}

TEST(ConfigReader, RefusesUnknownKeysAndWhatIsNoObject) {
  const auto read = [](ConfigReader& r) { r.Number("known", {0, 1}); };
  EXPECT_THAT(MistakeOf({{"known", 1}, {"knwon", 1}}, read),
              testing::AllOf(HasSubstr("\"knwon\" is not a known key"), HasSubstr(": known")));
  EXPECT_EQ(MistakeOf(json::array(), read), "f.json: part: must be an object, is array");
  EXPECT_EQ(MistakeOf({{"known", 1}, {"other", 1}},
                      [&](ConfigReader& r) { read(r), r.Ignore("other"); }), "");
}

TEST(ConfigReader, KeepsTheFirstMistake) {
  EXPECT_EQ(MistakeOf({{"a", 1}, {"unknown", 1}}, [](ConfigReader& r) {
    r.Fail("a", "is odd");
    r.Boolean("b");
  }), "f.json: part: \"a\" is odd");
}

TEST(ParseJson, TellsLineAndColumnOfBrokenText) {
  const auto broken = ParseJson("{\n  \"a\": 1,\n  \"b\": }\n", "f.json");
  ASSERT_FALSE(broken.ok());
  EXPECT_THAT(std::string(broken.status().message()),
              testing::AllOf(testing::StartsWith("f.json: is not valid JSON"), HasSubstr("line 3"),
                             HasSubstr("column 8")));
  EXPECT_FALSE(ParseJson("", "f.json").ok());
  EXPECT_FALSE(ParseJson("{} {}", "f.json").ok());
}

TEST(ParseJson, RefusesWhatIsNestedTooDeeply) {
  const auto nested = [](int depth) {
    const auto size = static_cast<size_t>(depth);
    return std::string(size, '[') + "1" + std::string(size, ']');
  };
  EXPECT_TRUE(ParseJson(nested(kMaxJsonDepth), "f.json").ok());
  EXPECT_FALSE(ParseJson(nested(kMaxJsonDepth + 1), "f.json").ok());
  // As large as an API body may be; serialising it recursively would overflow the stack.
  const auto deep = ParseJson(nested(1'000'000), "f.json");
  EXPECT_THAT(std::string(deep.status().message()),
              HasSubstr("f.json: is nested more than 64 deep"));
  std::string objects;
  for (int i = 0; i < 100'000; ++i) objects += R"({"k":)";
  EXPECT_FALSE(ParseJson(objects, "f.json").ok());
  EXPECT_FALSE(ParseJson(objects + "1" + std::string(100'000, '}'), "f.json").ok());
}

TEST(ConfigReader, AMessageStaysOneLineOfTextWhateverTheFileHas) {
  const auto message = [](const json& object) {
    ConfigReader reader(object, "f.json");
    (void)reader.Choice("a", {"x"});
    return std::string(reader.Finish().message());
  };
  EXPECT_EQ(message({{"a", "x"}, {"b\n", 1}}),
            "f.json: \"b\\n\" is not a known key; known here: a");
  EXPECT_EQ(message({{"a", "\x1b[2J\n"}}),
            "f.json: \"a\" is \"\\u001b[2J\\n\", must be one of: x");
  std::string umlauts;
  for (int i = 0; i < 3000; ++i) umlauts += "\xc3\xbc";
  for (const json& object : {json{{"a", umlauts}}, json{{"a", {umlauts}}},
                             json{{"a", "x"}, {"_" + umlauts, 1}}}) {
    const std::string text = message(object);
    EXPECT_LT(text.size(), 300u);
    EXPECT_NO_THROW((void)json(text).dump()) << "cut within a character";
  }
}

TEST(ParseJson, RefusesAKeyThatIsThereTwiceInOneObject) {
  EXPECT_TRUE(ParseJson(R"({"a": {"k": 1}, "b": {"k": 1}, "k": [{"k": 1}, {"k": 1}]})", "f").ok());
  const auto twice = ParseJson(R"({"a": {"k": 1, "b": [{}], "k": 2}})", "f.json");
  ASSERT_FALSE(twice.ok());
  EXPECT_EQ(twice.status().message(), "f.json: the key \"k\" appears twice");
}

TEST(ReadJsonFile, NamesAMissingAndATooLargeFile) {
  const std::string path = testing::TempDir() + "/config_reader_test.json";
  std::ofstream(path) << R"({"a": 1})";  // 8 bytes
  EXPECT_TRUE(ReadJsonFile(path, 8).ok());
  const auto large = ReadJsonFile(path, 7);
  ASSERT_FALSE(large.ok());
  EXPECT_EQ(large.status().message(), path + ": is larger than 7 bytes");
  std::filesystem::remove(path);
  const auto missing = ReadJsonFile(path);
  EXPECT_EQ(missing.status().code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(missing.status().message()), HasSubstr(path));
}

TEST(CanonicalJson, DependsOnTheValueAlone) {
  EXPECT_EQ(CanonicalJson(json::parse(R"({ "b": 0.10, "a": [1, true] })")),
            R"({"a":[1,true],"b":0.1})");
}

}  // namespace
}  // namespace myograde
