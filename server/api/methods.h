// Which methods an address has, so that a request with another one is told so (405) rather than that
// there is no such address.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "server/api/guard.h"

namespace myograde::server {

// The methods of the address at `path`, with HEAD and OPTIONS; none if there is no such address.
std::set<std::string> MethodsAt(const std::vector<Address>& addresses, const std::string& path);

}  // namespace myograde::server
