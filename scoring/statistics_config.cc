#include "scoring/statistics_config.h"

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"

namespace myograde::scoring {

namespace {

using Ranks = StatisticsConfig::Ranks;

constexpr char kPairedPermutation[] = "paired-permutation";

}  // namespace

absl::StatusOr<StatisticsConfig> ParseStatistics(const nlohmann::json& json,
                                                 const std::string& where,
                                                 const StatisticsConfig& fallback) {
  ConfigReader reader(json, where);
  StatisticsConfig config = fallback;
  GroupRules& groups = config.groups;
  if (reader.Has("method")) reader.Choice("method", {kPairedPermutation});
  if (reader.Has("level")) groups.level = reader.Number("level", {1e-4, 0.5});
  if (reader.Has("samples")) groups.samples = reader.Integer("samples", 1, kMostSamples);
  if (reader.Has("places")) groups.places = reader.Integer("places", 2, kMostTestedPlaces);
  if (reader.Has("ranks")) {
    const bool by_rules = reader.Choice("ranks", {"rules", "groups"}) == "rules";
    config.ranks = by_rules ? Ranks::kRules : Ranks::kGroups;
  }
  const int64_t fewest = FewestSamples(groups.level, groups.places);
  if (reader.mistake().ok() && groups.samples < fewest) {
    reader.Fail("samples", absl::StrCat("is ", groups.samples, ", and with ", groups.places,
                                        " places at the level ", groups.level, " no test could "
                                        "decide anything below ", fewest));
  }
  RETURN_IF_ERROR(reader.Finish());
  return config;
}

nlohmann::json StatisticsToJson(const StatisticsConfig& config) {
  return {{"method", kPairedPermutation},
          {"level", config.groups.level},
          {"samples", config.groups.samples},
          {"places", config.groups.places},
          {"ranks", config.ranks == Ranks::kRules ? "rules" : "groups"}};
}

}  // namespace myograde::scoring
