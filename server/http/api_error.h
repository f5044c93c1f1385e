// A refusal, as every client gets it.
#pragma once

#include <cstdint>
#include <string>

namespace myograde::server {

struct ApiError {
  int http = 500;
  std::string code;     // a word of README.md's table
  std::string message;  // one sentence: what, where, and what to do
  int64_t retry_after_s = 1;  // told with 429 and 503
  std::string allow = "";     // the methods that the address has; told with 405
};

}  // namespace myograde::server
