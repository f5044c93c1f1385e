// Which methods an address has, so that a request with another one is told so (405) rather than that
// there is no such address.
#pragma once

#include <regex>
#include <set>
#include <string>
#include <vector>

namespace myograde::server {

class Methods {
 public:
  // `pattern` as in Routes.
  void Add(const std::string& method, const std::string& pattern);

  // The methods of an address, with HEAD and OPTIONS; none if there is no such address.
  std::set<std::string> At(const std::string& path) const;

 private:
  struct Address {
    std::string pattern;
    std::regex regex;
    std::set<std::string> methods;
  };
  std::vector<Address> addresses_;
};

}  // namespace myograde::server
