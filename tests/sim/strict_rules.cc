#include "tests/sim/strict_rules.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/base/config_reader.h"

namespace myograde::sim {

using nlohmann::json;
using ::testing::AllOf;
using ::testing::HasSubstr;

void ExpectEveryKey(const json& good, const MistakeIn& mistake) {
  for (const auto& [key, value] : good.items()) {
    json rules = good;
    rules.erase(key);
    EXPECT_THAT(mistake(rules), AllOf(HasSubstr(key), HasSubstr("missing")));
  }
  json rules = good;
  rules["gravity"] = 3;
  EXPECT_THAT(mistake(rules), HasSubstr("gravity"));
}

void ExpectSchema(const json& good, const std::string& definition, const MistakeIn& mistake) {
  const json schema = ReadJsonFile(MYOGRADE_SOURCE_DIR "/configs/schema/track.json").value();
  const json& keys = schema.at("$defs").at(definition).at("properties");
  EXPECT_EQ(keys.size(), good.size());
  for (const auto& [key, said] : keys.items()) {
    ASSERT_TRUE(good.contains(key)) << key;
    const bool list = said.contains("items");
    const json& range = list ? said["items"] : said;
    if (!range.contains("minimum")) continue;
    for (const int beyond : {-1, 1}) {
      json rules = good;
      json& value = list ? rules[key][beyond < 0 ? 0 : 1] : rules[key];
      const json& edge = range[beyond < 0 ? "minimum" : "maximum"];
      value = range["type"] == "integer" ? json(edge.get<int64_t>() + beyond)
                                         : json(edge.get<double>() + 1e-6 * beyond);
      EXPECT_THAT(mistake(rules), HasSubstr(key)) << value;
    }
  }
}

}  // namespace myograde::sim
