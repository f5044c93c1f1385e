// Programs of the grader that stand between a participant's program and the bus, for programs that
// were written for another protocol than LCM's. The programs themselves are in policies/adapters.
#pragma once

#include <span>
#include <string_view>

namespace myograde::server {

struct Adapter {
  std::string_view name;     // in policy.json, and of its folder
  std::string_view runtime;  // the server's runtime that it needs
};

// Sorted by name.
std::span<const Adapter> Adapters();

// nullptr: there is none of that name. The result is never freed.
const Adapter* FindAdapter(std::string_view name);

}  // namespace myograde::server
