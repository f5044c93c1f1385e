// The environment variables that policy.json may set for its policy.
#pragma once

#include <map>
#include <string>

#include "protocol/base/config_reader.h"

namespace myograde::server {

// Reads a manifest's object "env", which must be present: names that the policy or one of its
// libraries reads, and values that fit into any process' environment. Errors are reported through
// `reader`.
std::map<std::string, std::string> ReadEnvironment(ConfigReader& reader);

}  // namespace myograde::server
