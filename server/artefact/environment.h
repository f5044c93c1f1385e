// The variables that policy.json may set for its policy.
#pragma once

#include <map>
#include <string>

#include "protocol/base/config_reader.h"

namespace myograde::server {

// The object "env" of a manifest, which must be there: names that the policy or a library that it
// uses reads, values that fit into any process' environment. Mistakes are `reader`'s.
std::map<std::string, std::string> ReadEnvironment(ConfigReader& reader);

}  // namespace myograde::server
