// The name of this host.
#pragma once

#include <string>

namespace myograde::server {

// "unknown" if it has none.
std::string HostName();

}  // namespace myograde::server
