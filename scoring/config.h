// Keys that the `scoring` sections of several tracks have.
#pragma once

#include "protocol/base/config_reader.h"
#include "scoring/board.h"
#include "scoring/verdict.h"

namespace myograde::scoring {

TimeSource ReadTime(ConfigReader& reader);  // "time"
TeamRule ReadTeam(ConfigReader& reader, const char* key = "team");

// Reads "boards" of a track whose only board has tiers, and with it finishes `reader`, from which
// all else has been read. `time` and `effort` are the places of the numbers that the board ranks by.
absl::StatusOr<TieredBoard> FinishWithTieredBoard(ConfigReader& reader, size_t time, size_t effort);

}  // namespace myograde::scoring
