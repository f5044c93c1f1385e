#include "server/api/methods.h"

#include <algorithm>

namespace myograde::server {

void Methods::Add(const std::string& method, const std::string& pattern) {
  auto address = std::find_if(addresses_.begin(), addresses_.end(),
                              [&](const Address& known) { return known.pattern == pattern; });
  if (address == addresses_.end()) {
    address = addresses_.insert(address, {pattern, std::regex(pattern), {"OPTIONS"}});
  }
  address->methods.insert(method);
  if (method == "GET") address->methods.insert("HEAD");
}

std::set<std::string> Methods::At(const std::string& path) const {
  std::set<std::string> methods;
  for (const Address& address : addresses_) {
    if (!std::regex_match(path, address.regex)) continue;
    methods.insert(address.methods.begin(), address.methods.end());
  }
  return methods;
}

}  // namespace myograde::server
