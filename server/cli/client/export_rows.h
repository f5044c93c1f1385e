// What an export holds.
#pragma once

#include <set>
#include <string>

#include <absl/status/statusor.h>

#include "server/store/transfer.h"

namespace myograde::server {

// The phases whose seeds a checked export holds and its store had not revealed, by name.
absl::StatusOr<std::set<std::string>> HiddenPhasesOf(const std::string& path);

// "3 submissions and 300 episodes".
std::string RowsText(const ExportInfo& info);

}  // namespace myograde::server
