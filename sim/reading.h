// A measurement of the running episode, for people.
#pragma once

#include <string>
#include <string_view>

namespace myograde::sim {

struct Reading {
  std::string_view name;  // one or two words
  std::string value;      // with its unit
};

}  // namespace myograde::sim
