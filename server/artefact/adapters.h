// Programs of the grader that stand between a participant's program and the bus, for programs that
// were written for another protocol than LCM's. The programs themselves are in policies/adapters.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <absl/status/status.h>

namespace myograde {
struct TrackKind;
}  // namespace myograde

namespace myograde::server {

struct Adapter {
  std::string_view name;         // in policy.json, and of its folder
  std::string_view runtime;      // the server's runtime that it needs
  bool TrackKind::*plays_track;  // of the kinds of track that it can play
};

// nullptr: there is none of that name. The result is never freed.
const Adapter* FindAdapter(std::string_view name);

// The names of all of them.
std::vector<std::string> AdapterNames();

// InvalidArgumentError if the adapter of a policy.json can't play a kind of track. OK for "".
absl::Status CheckAdapter(std::string_view name, const TrackKind& kind);

}  // namespace myograde::server
