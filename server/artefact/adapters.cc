#include "server/artefact/adapters.h"

#include <algorithm>

#include <absl/strings/str_cat.h>

#include "protocol/tracks/track_kind.h"

namespace myograde::server {
namespace {

constexpr Adapter kAdapters[] = {
    {"template-2024", "template-2024", &TrackKind::in_template_2024}};

}  // namespace

const Adapter* FindAdapter(std::string_view name) {
  const auto found = std::ranges::find(kAdapters, name, &Adapter::name);
  return found == std::end(kAdapters) ? nullptr : found;
}

std::vector<std::string> AdapterNames() {
  std::vector<std::string> names;
  for (const Adapter& adapter : kAdapters) names.emplace_back(adapter.name);
  return names;
}

absl::Status CheckAdapter(std::string_view name, const TrackKind& kind) {
  const Adapter* adapter = FindAdapter(name);
  if (adapter == nullptr || kind.*(adapter->plays_track)) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(
      "policy.json: \"adapter\" is \"", std::string(name), "\", which can't play tracks of the kind \"",
      std::string(kind.name), "\"; submit to another track, or leave it out and speak LCM"));
}

}  // namespace myograde::server
