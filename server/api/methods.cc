#include "server/api/methods.h"

namespace myograde::server {

std::set<std::string> MethodsAt(const std::vector<Address>& addresses, const std::string& path) {
  std::set<std::string> methods;
  for (const Address& address : addresses) {
    if (!std::regex_match(path, address.path)) continue;
    methods.insert({address.method, "OPTIONS"});
    if (address.method == "GET") methods.insert("HEAD");
  }
  return methods;
}

}  // namespace myograde::server
