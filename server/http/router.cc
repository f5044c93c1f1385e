#include "server/http/router.h"

#include <set>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

namespace myograde::server {

void Router::Add(Address address) {
  const bool is_path = address.pattern.find_first_of("([?*+\\") == std::string::npos;
  paths_.push_back(is_path ? std::nullopt : std::optional<std::regex>(address.pattern));
  addresses_.push_back(std::move(address));
}

bool Router::IsAt(size_t address, const std::string& path, std::smatch& match) const {
  const std::optional<std::regex>& pattern = paths_[address];
  return pattern.has_value() ? std::regex_match(path, match, *pattern) : path == addresses_[address].pattern;
}

const Address* Router::Find(const Request& request, std::vector<std::string>* matches) const {
  const std::string& method = request.method == "HEAD" ? "GET" : request.method;
  std::smatch match;
  for (size_t i = 0; i < addresses_.size(); ++i) {
    if (addresses_[i].method != method || !IsAt(i, request.path, match)) continue;
    if (matches != nullptr) matches->assign(match.begin(), match.end());
    return &addresses_[i];
  }
  return nullptr;
}

ApiError Router::WhyNone(const Request& request) const {
  std::set<std::string> there;
  std::smatch match;
  for (size_t i = 0; i < addresses_.size(); ++i) {
    if (!IsAt(i, request.path, match)) continue;
    there.insert({addresses_[i].method, "OPTIONS"});
    if (addresses_[i].method == "GET") there.insert("HEAD");
  }
  if (there.empty()) {
    return {404, "not_found", absl::StrCat("there is no ", request.path, "; see the API's description")};
  }
  const std::string methods = absl::StrJoin(there, ", ");
  return {405, "method_not_allowed",
          absl::StrCat(request.path, " has no ", request.method, "; it has ", methods), 1, methods};
}

void Router::Serve(Request& request, Response& response) const {
  const Address* address = Find(request, &request.matches);
  if (address != nullptr) return address->serve(request, response);
  if (unknown_ != nullptr) return unknown_(request, response);
  response.SetError(WhyNone(request));
}

}  // namespace myograde::server
