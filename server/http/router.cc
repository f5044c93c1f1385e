#include "server/http/router.h"

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

const Address* Router::Find(const Request& request) const {
  std::smatch match;
  return Find(request, match);
}

const Address* Router::Find(const Request& request, std::smatch& match) const {
  const std::string& method = request.method == "HEAD" ? "GET" : request.method;
  for (size_t i = 0; i < addresses_.size(); ++i) {
    if (addresses_[i].method == method && IsAt(i, request.path, match)) return &addresses_[i];
  }
  return nullptr;
}

std::set<std::string> Router::MethodsAt(const std::string& path) const {
  std::set<std::string> methods;
  std::smatch match;
  for (size_t i = 0; i < addresses_.size(); ++i) {
    if (!IsAt(i, path, match)) continue;
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
  std::smatch match;
  const Address* address = Find(request, match);
  if (address == nullptr) {
    if (unknown_ != nullptr) return unknown_(request, response);
    return response.SetError(WhyNone(request));
  }
  request.matches.assign(match.begin(), match.end());  // none of a path
  address->serve(request, response);
}

}  // namespace myograde::server
