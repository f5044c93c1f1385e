#include "server/artefact/adapters.h"

#include <algorithm>

namespace myograde::server {
namespace {

constexpr Adapter kAdapters[] = {{"template-2024", "template-2024"}};

}  // namespace

std::span<const Adapter> Adapters() { return kAdapters; }

const Adapter* FindAdapter(std::string_view name) {
  const auto found = std::ranges::find(kAdapters, name, &Adapter::name);
  return found == std::end(kAdapters) ? nullptr : found;
}

}  // namespace myograde::server
