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
  order.uid = place.uid;
  order.slot = place.slot;
  order.pinned = place.pinned;
  order.work_dir = place.work_dir;
  order.cache_dir = place.cache_dir;
  order.log_dir = place.log_dir;
  return order;
}

}  // namespace

std::vector<EpisodeOrder> EpisodesOf(const TrackConfig& track, const std::vector<uint64_t>& seeds,
                                     const Form1PolicySeeds& form1, int64_t first, int64_t last) {
  std::vector<EpisodeOrder> episodes;
  for (int64_t index = first; index <= last; ++index) {
    episodes.push_back({index, seeds.at(static_cast<size_t>(index)),
                        PolicySeed(track, form1, index)});
  }
  return episodes;
}

LeaseOrder MakeLeaseOrder(std::string id, const TrackConfig& track,
                          std::vector<EpisodeOrder> episodes, const LeaseProgram& program,
                          const LeasePlace& place) {
  LeaseOrder order = OrderAt(std::move(id), track, std::move(episodes), place);
  order.artefact_dir = program.artefact_dir;
  order.command = program.command;
  order.environment = program.environment;
  order.runtimes = program.runtimes;
  order.adapter = program.adapter;
  order.extra_observations = program.extra_observations;
  order.image = program.image;
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
