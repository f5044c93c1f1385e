// The addresses of the API and of the web pages: what each takes, and who answers it.
#pragma once

#include <functional>
#include <optional>
#include <regex>
#include <string>
#include <vector>

#include "server/access/access.h"
#include "server/http/connection.h"
#include "server/http/request.h"
#include "server/http/response.h"

namespace myograde::server {

struct Address {
  std::string method;
  std::string pattern;  // a regular expression that must match the whole path
  Action action;
  // The request has its body and its matches.
  std::function<void(const Request&, Response&)> serve = nullptr;
  BodyRule body = {};  // of no type: JSON, as large as at any address without a rule of its own
  bool page = false;   // of the web pages, no address of the API
};

// Safe from any thread, once all addresses are there.
class Router {
 public:
  void Add(Address address);
  // Answers requests to all other addresses.
  void SetUnknown(std::function<void(const Request&, Response&)> serve) { unknown_ = std::move(serve); }

  const std::vector<Address>& addresses() const { return addresses_; }
  // What GET asks for, HEAD does too. nullptr: there is no such address. `matches`: is set to those
  // of its pattern, of which a path has none.
  const Address* Find(const Request& request, std::vector<std::string>* matches = nullptr) const;
  // Why Find found nothing: 404, or 405 with the methods that the path has, HEAD and OPTIONS too.
  ApiError WhyNone(const Request& request) const;

  void Serve(Request& request, Response& response) const;

 private:
  bool IsAt(size_t address, const std::string& path, std::smatch& match) const;

  std::vector<Address> addresses_;
  std::vector<std::optional<std::regex>> paths_;  // of each; nullopt: the pattern is a path
  std::function<void(const Request&, Response&)> unknown_;
};

}  // namespace myograde::server
