#include "protocol/base/episode_facts.h"

#include <array>
#include <utility>

namespace myograde {
namespace {

constexpr std::array<std::pair<EpisodeEnd, std::string_view>, 9> kEnds = {{
    {EpisodeEnd::kTime, "time"},
    {EpisodeEnd::kPlaced, "placed"},
    {EpisodeEnd::kDropped, "dropped"},
    {EpisodeEnd::kFinished, "finished"},
    {EpisodeEnd::kFell, "fell"},
    {EpisodeEnd::kOffTrack, "off-track"},
    {EpisodeEnd::kPhantom, "phantom"},
    {EpisodeEnd::kGivenUp, "given-up"},
    {EpisodeEnd::kFault, "fault"},
}};

}  // namespace

std::string_view EpisodeEndName(EpisodeEnd end) {
  for (const auto& [value, name] : kEnds) {
    if (value == end) return name;
  }
  return "fault";
}

std::optional<EpisodeEnd> ParseEpisodeEnd(std::string_view name) {
  for (const auto& [value, known] : kEnds) {
    if (known == name) return value;
  }
  return std::nullopt;
}

}  // namespace myograde
