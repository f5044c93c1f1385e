#include "server/api/router.h"

#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

namespace myograde::server {

void Router::Add(Address address) {
  paths_.emplace_back(address.pattern);
  addresses_.push_back(std::move(address));
}

const Address* Router::Find(const Request& request) const {
  const std::string& method = request.method == "HEAD" ? "GET" : request.method;
  for (size_t i = 0; i < addresses_.size(); ++i) {
    if (addresses_[i].method == method && std::regex_match(request.path, paths_[i])) {
      return &addresses_[i];
    }
  }
  return nullptr;
}

std::set<std::string> Router::MethodsAt(const std::string& path) const {
  std::set<std::string> methods;
  for (size_t i = 0; i < addresses_.size(); ++i) {
    if (!std::regex_match(path, paths_[i])) continue;
    methods.insert({addresses_[i].method, "OPTIONS"});
    if (addresses_[i].method == "GET") methods.insert("HEAD");
  }
  return methods;
}

ApiError Router::WhyNone(const Request& request) const {
  const std::string methods = absl::StrJoin(MethodsAt(request.path), ", ");
  if (methods.empty()) {
    return {404, "not_found", absl::StrCat("there is no ", request.path, "; see the API's description")};
  }
  return {405, "method_not_allowed",
          absl::StrCat(request.path, " has no ", request.method, "; it has ", methods), 1, methods};
}

void Router::Serve(Request& request, Response& response) const {
  const Address* address = Find(request);
  if (address == nullptr) {
    if (unknown_ != nullptr) return unknown_(request, response);
    return response.SetError(WhyNone(request));
  }
  std::smatch match;
  std::regex_match(request.path, match, paths_[static_cast<size_t>(address - addresses_.data())]);
  request.matches.assign(match.begin(), match.end());
  address->serve(request, response);
}

}  // namespace myograde::server
