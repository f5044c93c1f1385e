// What every track's parser of rules has to refuse.
#pragma once

#include <functional>
#include <nlohmann/json.hpp>
#include <string>

namespace myograde::sim {

// What the parser says of rules that are wrong.
using MistakeIn = std::function<std::string(const nlohmann::json& rules)>;

// Each key of `good` is required, and no other is taken.
void ExpectEveryKey(const nlohmann::json& good, const MistakeIn& mistake);

// configs/schema/track.json has the same keys under `definition`, and no wider ranges.
void ExpectSchema(const nlohmann::json& good, const std::string& definition,
                  const MistakeIn& mistake);

}  // namespace myograde::sim
