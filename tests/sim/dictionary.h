// What a policy is shown, and the terms of the reward, against the dictionaries that the official
// environment returned.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

#include "protocol/tracks/track_kind.h"
#include "sim/environment.h"
#include "tests/sim/golden.h"

namespace myograde::sim {

// How far a key may be off, relative to its size or absolute below 1; negative: not compared.
using ToleranceOf = std::function<double(std::string_view key)>;

// The parts of the observation and of the extra one by their names.
std::map<std::string, std::vector<double>> ShownByName(const Environment& environment,
                                                       const TrackKind& kind);

// Every recorded key must be among `shown`.
void CompareShown(GoldenTable& table, const std::map<std::string, std::vector<double>>& shown,
                  const nlohmann::json& obs_dict, const ToleranceOf& tolerance,
                  const std::string& prefix, const std::string& where);

// Every recorded term must be one of the track's, and the reverse; `dense` is compared with
// DenseReward.
void CompareRewardTerms(GoldenTable& table, const Environment& environment, const TrackKind& kind,
                        const nlohmann::json& rwd_dict, const ToleranceOf& tolerance,
                        const std::string& prefix, const std::string& where);

// Fails unless a step of one of the files has all these keys of the official dictionary. A folder
// without a file of the track skips the test.
void ExpectWholeDictionary(const std::vector<GoldenFile>& files,
                           const std::vector<std::string>& keys);

}  // namespace myograde::sim
