// A refusal, as every client gets it.
#pragma once

#include <string>

namespace myograde::server {

struct ApiError {
  int http = 500;
  std::string code;     // a word of README.md's table
  std::string message;  // one sentence: what, where, and what to do
};

}  // namespace myograde::server
