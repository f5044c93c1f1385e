#include "protocol/lease/policy_seed.h"

#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/lease/track_config.h"

namespace myograde {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

const char kTracks[] = MYOGRADE_SOURCE_DIR "/configs/tracks";

// Values computed by Python's hmac module over the same bytes.
TEST(PolicySeed, IsThePublishedFunctionOfSecretAndIndex) {
  EXPECT_EQ(PolicySeed("MyoGrade's public policy seeds", 0), 8683974859599755511u);
  EXPECT_EQ(PolicySeed("MyoGrade's public policy seeds", 99), 4505263906467807247u);
  EXPECT_EQ(PolicySeed("another", 0), 226077730172020953u);
  std::set<uint64_t> seen;
  for (int64_t episode = 0; episode < 1000; ++episode) seen.insert(PolicySeed("s", episode));
  EXPECT_EQ(seen.size(), 1000u);
  EXPECT_LE(*seen.rbegin(), static_cast<uint64_t>(INT64_MAX));
}

TEST(PolicySeed, NoConfigIsWithoutASecret) {
  const json good = LoadTrackConfig(kTracks, "locomotion", "").value().effective;
  const auto mistake = [](const json& effective) {
    return std::string(ParseTrackConfig(effective, "t").status().message());
  };
  json config = good;
  config.erase("policy_seed_secret");
  EXPECT_THAT(mistake(config), HasSubstr("\"policy_seed_secret\" is missing"));
  for (const json& bad : {json(nullptr), json(""), json(7), json(std::string(201, 's'))}) {
    config = good;
    config["policy_seed_secret"] = bad;
    EXPECT_THAT(mistake(config), HasSubstr("\"policy_seed_secret\" must")) << bad;
  }
  config = good;
  config.erase("form");
  EXPECT_THAT(mistake(config), HasSubstr("\"form\" is missing"));
}

}  // namespace
}  // namespace myograde
