// The daemon's log on standard error.
#pragma once

#include <string>

#include "server/base/log_line.h"

namespace myograde::server {

// From now on spdlog writes lines of `format` (log_line.h) of this level ("debug", "info", "warn",
// "error") and above.
void StartLog(const std::string& level, LogFormat format);

}  // namespace myograde::server
