// Keys that the `scoring` sections of several tracks have.
#pragma once

#include "protocol/base/config_reader.h"
#include "scoring/board.h"
#include "scoring/judgement.h"

namespace myograde::scoring {

TimeSource ReadTime(ConfigReader& reader);  // "time"
TeamRule ReadTeam(ConfigReader& reader);    // "team"

// The main board of a track with tiers; `time` and `effort` are the places of the numbers that it
// ranks by.
absl::StatusOr<TieredBoard> ReadTieredBoard(const nlohmann::json& json, const std::string& where,
                                            size_t time, size_t effort);

}  // namespace myograde::scoring
