#include "server/api/resources.h"

#include <unistd.h>

#include <string>
#include <vector>

#include <absl/strings/str_cat.h>

#include "server/api/readiness.h"
#include "server/base/error_code.h"
#include "server/base/ip_address.h"
#include "server/proof/grader_build.h"
#include "server/runtime/runtimes.h"
#include "server/store/store.h"

namespace myograde::server {
namespace {

// Names that Slurm and DNS have for hosts.
constexpr char kNode[] = R"(/v1/nodes/([A-Za-z0-9][A-Za-z0-9._-]{0,254}))";

// What organisers see beside.
Json HostToJson(const ApiContext& context, const LiveHealth& health) {
  Json running = Json::array();
  for (const auto& [lease, live] : context.engine.Running()) {
    running.push_back({{"lease", lease},
                       {"evaluation", live.evaluation},
                       {"submission", live.submission},
                       {"slot", live.slot},
                       {"process", live.process},
                       {"episode", live.episode},
                       {"step", live.step},
                       {"running_wall_s", absl::ToDoubleSeconds(live.running)},
                       {"silent_wall_s", absl::ToDoubleSeconds(live.silent)},
                       {"node", TextOrNull(live.site.node)},
                       {"job", TextOrNull(live.site.job)},
                       {"begun", live.begun},
                       {"cpu_s", live.site.cpu_s}});
  }
  Json unreadable = Json::array();
  for (const auto& [evaluation, why] : health.unreadable) {
    unreadable.push_back({{"evaluation", evaluation}, {"message", why}});
  }
  Json closed = Json::array();
  for (const auto& [slot, left] : health.closed_slots) {
    closed.push_back({{"slot", slot}, {"left", left}});
  }
  const auto held_back = ReadStore(
      context, [](const Transaction& reader) { return reader.submissions.HeldBack(); });
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
          // A store that can't be read is told of elsewhere.
          {"held_back", held_back.value_or(std::vector<std::string>())},
          {"schema", SchemaVersion()},
          {"pid", getpid()},
          {"data", context.data_dir},
          {"started_at", TimeToJson(absl::ToUnixMillis(context.started_at))},
          {"uptime_wall_s", absl::ToDoubleSeconds(context.clock.Monotonic() - context.began)}};
}

// Everybody sees that it works, participants how busy it is, and organisers the host.
ApiResult GetHealth(const ApiContext& context, const Request&) {
  const LiveHealth health = context.engine.Health();
  Json body = {{"status", StatusText(health)}, {"version", GraderVersion()}, {"api", 1}};
  if (Caller().role >= Role::kParticipant) {
    body["slots"] = context.config.scheduler.slots;
    body["running"] = health.running;
    body["pending_blocks"] = health.pending;
  }
  if (CallerMay(Action::kReadHost)) body.update(HostToJson(context, health));
  return ApiAnswer{200, std::move(body)};
}

// Whether the process serves requests, and whether it can do its work.
ApiResult GetLive(const Request&) { return ApiAnswer{200, {{"live", true}}}; }

ApiResult GetReady(const ApiContext& context, const Request&) {
  Json reasons = Json::array();
  for (const Obstacle& obstacle : FindObstacles(context, context.engine.Health())) {
    if (obstacle.message.empty()) continue;
    reasons.push_back({{"code", obstacle.code}, {"message", obstacle.message}});
  }
  const bool ready = reasons.empty();
  Json body = {{"ready", ready}};
  if (CallerMay(Action::kReadHost)) body["reasons"] = std::move(reasons);
  return ApiAnswer{ready ? 200 : 503, std::move(body)};
}

ApiResult ListTracks(const ApiContext& context, const Request&) {
  Json list = Json::array();
  for (const auto& [name, offer] : context.tracks.entries()) {
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

ApiResult ListNodes(const ApiContext& context, const Transaction& reader, const Request& request) {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  const Listed<DrainedNodeRow> drained = reader.blocks.DrainedNodes();
  const bool cluster = context.config.on_cluster;
  return ApiAnswer{200,
                   {{"cluster", cluster},
                    {"message", TextOrNull(context.engine.Health().executor_trouble)},
                    {"nodes", NodesToJson(context.engine.Nodes(), drained.rows, cluster)}}};
}

ApiResult SetNode(const ApiContext& context, const Request& request, const Json& body) {
  ConfigReader reader(body, "request");
  const bool drain = reader.Choice("state", {"drained", "admitted"}) == "drained";
  const std::string why = drain ? ReadReason(reader) : "";
  RETURN_IF_ERROR(reader.Finish());
  if (!context.config.on_cluster) {
    return WithErrorCode(absl::FailedPreconditionError(
                             "leases run on this host, so there are no nodes; see \"executor\" of "
                             "server.json"),
                         "no_cluster");
  }
  const std::string node = request.matches[1];
  RETURN_IF_ERROR(
      context.engine.SetNode(node, drain, why, CallerKey(), context.config.http.request));
  NoteAct(absl::StrCat("node ", node), drain ? absl::StrCat("drained: ", why) : "admitted");
  return ApiAnswer{200, {{"node", node}, {"state", drain ? "drained" : "admitted"}}};
}

ApiResult ListRuntimes(const ApiContext& context, const Request& request) {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  Json runtimes = Json::array();
  for (const Runtime& runtime :
       Runtimes(context.config.runtimes, context.config.runtimes_dir).List()) {
    runtimes.push_back(RuntimeToJson(runtime));
  }
  return ApiAnswer{.body = {{"runtimes", std::move(runtimes)}}, .tagged = true};
}

}  // namespace

void AddHost(Routes& routes, const ApiContext& context) {
  routes.Get("/v1/health", Action::kReadHealth, Bind(context, GetHealth));
  routes.Get("/v1/live", Action::kReadHealth, GetLive);
  routes.Get("/v1/ready", Action::kReadHealth, Bind(context, GetReady));
  routes.Get("/v1/tracks", Action::kReadTracks, Bind(context, ListTracks));
  routes.Get("/v1/nodes", Action::kReadHost, Bind(context, ListNodes));
  routes.Post(kNode, Action::kManageNodes, Bind(context, SetNode));
  routes.Get("/v1/runtimes", Action::kReadTracks, Bind(context, ListRuntimes));
}

}  // namespace myograde::server
