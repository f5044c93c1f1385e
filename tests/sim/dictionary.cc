#include "tests/sim/dictionary.h"

#include <algorithm>

#include <gtest/gtest.h>

#include "sim/tracks.h"

namespace myograde::sim {

using nlohmann::json;

namespace {

bool HasWholeDictionary(const json& file, const std::vector<std::string>& keys) {
  if (!file.contains("resets")) return false;
  for (const json& reset : file["resets"]) {
    for (const json& step : reset.at("steps")) {
      const json dictionary = step.value("obs_extra", json::object());
      if (std::ranges::all_of(keys, [&](const auto& key) { return dictionary.contains(key); })) {
        return true;
      }
    }
  }
  return false;
}

}  // namespace

std::map<std::string, std::vector<double>> ShownByName(const Environment& environment,
                                                       const TrackKind& kind) {
  std::map<std::string, std::vector<double>> shown;
  const auto split = [&](const VectorLayout& layout, const std::vector<double>& values) {
    for (const Part& part : layout.parts()) {
      const auto first = values.begin() + part.offset;
      const bool added = shown.try_emplace(std::string(part.name), first, first + part.size).second;
      EXPECT_TRUE(added) << part.name << " appears twice";
    }
  };
  std::vector<double> graded(ObservationOf(kind).size());
  environment.Observe(graded);
  split(ObservationOf(kind), graded);
  std::vector<double> extra(ExtraOf(kind).size());
  environment.ObserveExtra(extra);
  split(ExtraOf(kind), extra);
  return shown;
}

void CompareShown(GoldenTable& table, const std::map<std::string, std::vector<double>>& shown,
                  const json& obs_dict, const ToleranceOf& tolerance, const std::string& prefix,
                  const std::string& where) {
  for (const auto& [key, want] : obs_dict.items()) {
    const auto found = shown.find(key);
    if (found == shown.end()) {
      ADD_FAILURE() << where << ": nothing shows \"" << key << "\" of the official dictionary";
    } else if (tolerance(key) >= 0) {
      table.CompareRelative(prefix + "shown " + key, found->second, Doubles(want), tolerance(key),
                            where);
    }
  }
}

void CompareRewardTerms(GoldenTable& table, const Environment& environment, const TrackKind& kind,
                        const json& rwd_dict, const ToleranceOf& tolerance,
                        const std::string& prefix, const std::string& where) {
  const std::span<const RewardTerm> terms = FindSimulatedTrack(kind).reward_terms;
  std::vector<double> values(terms.size());
  environment.RewardTerms(values);
  EXPECT_EQ(rwd_dict.size(), terms.size() + 1) << where << ": " << rwd_dict;
  for (size_t i = 0; i < terms.size(); ++i) {
    const std::string name(terms[i].name);
    ASSERT_TRUE(rwd_dict.contains(name)) << where << ": " << name;
    if (tolerance(name) < 0) continue;
    table.CompareRelative(prefix + "term " + name, values[i], Number(rwd_dict[name]),
                          tolerance(name), where);
  }
  table.CompareRelative(prefix + "term dense", DenseReward(terms, values),
                        Number(rwd_dict.at("dense")), tolerance("dense"), where);
}

void ExpectWholeDictionary(const std::vector<GoldenFile>& files,
                           const std::vector<std::string>& keys) {
  if (files.empty()) GTEST_SKIP() << "no golden file of the track in the folder";
  EXPECT_TRUE(std::ranges::any_of(files, [&](const GoldenFile& file) {
    return HasWholeDictionary(file.json, keys);
  })) << "no recording has every key; tests/differential/record.py records them all";
}

}  // namespace myograde::sim
