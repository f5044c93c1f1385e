#include "server/runner/lease_order.h"

#include <utility>

namespace myograde::server {
namespace {

LeaseOrder OrderAt(std::string id, const TrackConfig& track, std::vector<EpisodeOrder> episodes,
                   const LeasePlace& place) {
  LeaseOrder order;
  order.lease = std::move(id);
  order.track = track;
  order.episodes = std::move(episodes);
  static_cast<LeasePlace&>(order) = place;
  return order;
}

}  // namespace

std::vector<EpisodeOrder> EpisodesOf(const TrackConfig& track, const std::vector<uint64_t>& seeds,
                                     int64_t first, int64_t last) {
  std::vector<EpisodeOrder> episodes;
  for (int64_t index = first; index <= last; ++index) {
    episodes.push_back({index, seeds.at(static_cast<size_t>(index)),
                        PolicySeed(track.policy_seed_secret, index)});
  }
  return episodes;
}

LeaseOrder MakeLeaseOrder(std::string id, const TrackConfig& track,
                          std::vector<EpisodeOrder> episodes, const LeaseProgram& program,
                          const LeasePlace& place) {
  LeaseOrder order = OrderAt(std::move(id), track, std::move(episodes), place);
  static_cast<LeaseProgram&>(order) = program;
  return order;
}

LeaseOrder MakeReplayOrder(std::string id, const TrackConfig& track,
                           std::vector<EpisodeOrder> episodes, std::vector<std::string> logs,
                           const LeasePlace& place) {
  LeaseOrder order = OrderAt(std::move(id), track, std::move(episodes), place);
  order.replay = std::move(logs);
  return order;
}

}  // namespace myograde::server
