// Programs of the grader that stand between a participant's program and the bus, for programs that
// were written for another protocol than LCM's. The programs themselves are in policies/adapters.
#pragma once

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/status.h>
#include <absl/strings/str_cat.h>

#include "protocol/tracks/track_kind.h"

namespace myograde::server {

struct Adapter {
  const char* name;     // in policy.json, and of its folder
  int year;             // the TrackKind::template_year of the kinds of track that it can play
  const char* runtime;  // of the server, which it needs
};

inline constexpr Adapter kAdapters[] = {{"template-2022", 2022, "template-2024"},
                                        {"template-2023", 2023, "template-2024"},
                                        {"template-2024", 2024, "template-2024"}};

// nullptr: there is none of that name. The result is never freed.
inline const Adapter* FindAdapter(std::string_view name) {
  const auto found = std::ranges::find(kAdapters, name, &Adapter::name);
  return found == std::end(kAdapters) ? nullptr : found;
}

inline std::vector<std::string> AdapterNames() {
  std::vector<std::string> names;
  for (const Adapter& adapter : kAdapters) names.emplace_back(adapter.name);
  return names;
}

// InvalidArgumentError if the adapter of a policy.json can't play a kind of track. OK for "".
inline absl::Status CheckAdapter(std::string_view name, const TrackKind& kind) {
  const Adapter* adapter = FindAdapter(name);
  if (adapter == nullptr || kind.template_year == adapter->year) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(
      "policy.json: \"adapter\" is \"", adapter->name,
      "\", which does not support tracks of the kind \"",
      std::string(kind.name), "\"; submit to another track, or leave it out and use LCM"));
}

}  // namespace myograde::server
