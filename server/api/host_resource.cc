#include "server/api/host_resource.h"

#include <unistd.h>

#include <functional>
#include <utility>

#include "server/api/readiness.h"
#include "server/api/unix_http_server.h"
#include "server/api/views.h"
#include "server/base/host_name.h"
#include "server/proof/grader_build.h"
#include "server/store/schema.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

}  // namespace

void HostResource::Install(Routes& routes) {
  routes.Get("/v1/health", Action::kReadHealth, std::bind_front(&HostResource::Health, this));
  routes.Get("/v1/live", Action::kReadHealth, std::bind_front(&HostResource::Live, this));
  routes.Get("/v1/ready", Action::kReadHealth, std::bind_front(&HostResource::Ready, this));
  routes.Get("/v1/tracks", Action::kReadTracks, std::bind_front(&HostResource::ListTracks, this));
}

// Everybody sees that it works, participants how busy it is, and organisers the host.
ApiResult HostResource::Health(const Request&) const {
  const LiveHealth health = context_.engine.Health();
  Json body = {{"status", StatusOf(health)},
               {"version", GraderVersion()},
               {"api", 1}};
  if (Caller().role >= Role::kParticipant) {
    body["slots"] = context_.config.scheduler.slots;
    body["running"] = health.running;
    body["pending_leases"] = health.pending;
  }
  if (CallerMay(Action::kReadHost)) body.update(HostToJson(health));
  return ApiAnswer{200, std::move(body)};
}

ApiResult HostResource::Live(const Request&) const {
  return ApiAnswer{200, {{"live", true}}};
}

ApiResult HostResource::Ready(const Request&) const {
  const std::vector<Obstacle> obstacles =
      ObstaclesOf(context_.engine.Health(), context_.config, context_.data_dir,
                  UnixHttpServer::Stopping());
  Json body = {{"ready", obstacles.empty()}};
  if (CallerMay(Action::kReadHost)) {
    Json& reasons = body["reasons"] = Json::array();
    for (const Obstacle& obstacle : obstacles) {
      reasons.push_back({{"code", obstacle.code}, {"message", obstacle.message}});
    }
  }
  return ApiAnswer{obstacles.empty() ? 200 : 503, std::move(body)};
}

nlohmann::json HostResource::HostToJson(const LiveHealth& health) const {
  Json running = Json::array();
  for (const auto& [lease, live] : context_.engine.Running()) {
    running.push_back({{"lease", lease},
                       {"evaluation", live.evaluation},
                       {"submission", live.submission},
                       {"slot", live.slot},
                       {"process", live.process},
                       {"episode", live.episode},
                       {"step", live.step},
                       {"running_wall_s", absl::ToDoubleSeconds(live.running)},
                       {"silent_wall_s", absl::ToDoubleSeconds(live.silent)},
                       {"node", TextOrNull(live.node)},
                       {"job", TextOrNull(live.job)},
                       {"begun", live.begun},
                       {"cpu_s", live.cpu_s}});
  }
  Json unreadable = Json::array();
  for (const auto& [evaluation, why] : health.unreadable) {
    unreadable.push_back({{"evaluation", evaluation}, {"message", why}});
  }
  Json closed = Json::array();
  for (const auto& [slot, left] : health.closed_slots) {
    closed.push_back({{"slot", slot}, {"left", left}});
  }
  Json held_back = Json::array();
  // A store that can't be read is told of elsewhere.
  (void)context_.readers.Read([&](Reader& reader) {
    held_back = reader.HeldBack();
    return absl::OkStatus();
  });
  std::string trouble;
  for (const std::string* one : {&health.store_trouble, &health.disk_trouble, &health.host_trouble,
                                 &health.executor_trouble, &health.losses}) {
    if (trouble.empty()) trouble = *one;
  }
  return {{"message", TextOrNull(trouble)},
          {"host",
           {{"name", HostName()},
            {"state", HostStateName(health.host)},
            {"reason", TextOrNull(health.host_trouble)},
            {"paused_wall_s", SecondsOrNull(health.paused_for)},
            {"next_test_wall_s", SecondsOrNull(health.next_test)}}},
          {"leases", std::move(running)},
          {"ending", health.ending},
          {"unreadable", std::move(unreadable)},
          {"closed_slots", std::move(closed)},
          {"held_back", std::move(held_back)},
          {"schema", SchemaMigrations().size()},
          {"pid", getpid()},
          {"data", context_.data_dir},
          {"started_at", TimeToJson(absl::ToUnixMillis(context_.started_at))},
          {"uptime_wall_s", absl::ToDoubleSeconds(context_.clock.Monotonic() - context_.began)}};
}

ApiResult HostResource::ListTracks(const Request&) const {
  Json list = Json::array();
  for (const auto& [name, offer] : context_.tracks.entries()) {
    Json profiles = Json::array();
    for (const auto& [profile, track] : offer.profiles) {
      profiles.push_back({{"profile", profile},
                          {"config", track->config.hash},
                          {"episodes", track->config.seeds.size()},
                          {"episodes_per_lease", track->config.episodes_per_lease}});
    }
    Json boards = Json::array();
    for (const auto& [board, unused] : offer.profiles.begin()->second->scoring.boards) {
      boards.push_back(board);
    }
    list.push_back({{"track", name},
                    {"boards", std::move(boards)},
                    {"kind", offer.profiles.begin()->second->config.kind->name},
                    {"default_profile", offer.default_profile},
                    {"profiles", std::move(profiles)}});
  }
  return ApiAnswer{200, {{"tracks", std::move(list)}}};
}

}  // namespace myograde::server
