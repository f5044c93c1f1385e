#include "server/api/resources.h"

#include <algorithm>
#include <filesystem>
#include <map>
#include <optional>
#include <vector>

#include <absl/strings/str_cat.h>

#include "server/api/readiness.h"
#include "server/metrics/disk_space.h"
#include "server/metrics/metrics.h"
#include "server/proof/grader_build.h"
#include "server/scheduler/team_line.h"
#include "server/store/store.h"

namespace myograde::server {
namespace {

using Families = std::vector<MetricFamily>;

template <typename Number>
void AddGauge(Families& families, const char* name, const char* help, Number value) {
  AddGauges<Number>(families, name, help, "", {{"", value}});
}

double ToSeconds(const std::optional<absl::Duration>& duration) {
  return absl::ToDoubleSeconds(duration.value_or(absl::ZeroDuration()));
}

// The database with its write-ahead log.
double StoreBytes(const std::string& data_dir) {
  double bytes = 0;
  for (const char* name : {"/store.db", "/store.db-wal", "/store.db-shm"}) {
    std::error_code error;
    const auto size = std::filesystem::file_size(data_dir + name, error);
    if (!error) bytes += static_cast<double>(size);
  }
  return bytes;
}

void AddEngineMetrics(const ApiContext& context, const LiveHealth& health, Families& families) {
  std::map<std::string, int64_t> evaluations;
  std::map<std::string, int64_t> blocks;
  for (int i = 0; i < kPriorities; ++i) {
    const QueueDepth::OfClass& depth = health.queue.classes[static_cast<size_t>(i)];
    const std::string name(PriorityName(Priority(i)));
    evaluations[name] = depth.evaluations;
    blocks[name] = depth.blocks;
  }
  AddGauges(families, "myograde_queue_evaluations", "Evaluations with a waiting block, by class",
            "class", evaluations);
  AddGauges(families, "myograde_queue_blocks", "Waiting blocks of episodes, by class", "class",
            blocks);
  AddGauge(families, "myograde_queue_oldest_wait_seconds",
           "How long the longest waiting evaluation has had no block started, in seconds; 0: none "
           "is waiting",
           ToSeconds(health.queue.oldest));
  AddGauge(families, "myograde_leases_running", "Running leases", health.running);
  AddGauge(families, "myograde_leases_ending",
           "Reclaimed leases whose processes have not ended yet", health.ending);
  AddGauge(families, "myograde_lease_oldest_running_seconds",
           "How long the longest running lease has run, in seconds; 0: none is running",
           ToSeconds(health.oldest_run));
  AddGauge(families, "myograde_slots", "Leases that may run at once",
           context.config.scheduler.slots);
  AddGauge(families, "myograde_slots_busy", "Slots in use by a lease or a self-test",
           health.busy_slots);
  AddGauge(families, "myograde_slots_closed",
           "Slots that are closed until processes on them are gone", health.closed_slots.size());
  AddGauge(families, "myograde_unreadable_evaluations",
           "Evaluations with damaged rows that can't be ended", health.unreadable.size());
  AddGauge(families, "myograde_journal_entries",
           "Events in memory until the store can be written", health.journal);
  AddGauge(families, "myograde_store_writable", "1, or 0 while the store can't be written",
           health.store_trouble.empty() ? 1 : 0);
}

void AddHostMetrics(const ApiContext& context, const LiveHealth& health, Families& families) {
  std::map<std::string, bool> states;
  for (const auto state :
       {HostHealth::State::kWell, HostHealth::State::kSuspected, HostHealth::State::kPaused}) {
    states[std::string(HostStateName(state))] = health.host == state;
  }
  AddGauges(families, "myograde_host_state",
            "1 for the present state of this host, 0 for the others", "state", states);
  std::map<std::string, bool> reasons;
  for (const Obstacle& obstacle : FindObstacles(context, health)) {
    reasons[obstacle.code] = !obstacle.message.empty();
  }
  const bool ready = std::none_of(reasons.begin(), reasons.end(),
                                  [](const auto& reason) { return reason.second; });
  AddGauge(families, "myograde_ready", "1 if GET /v1/ready answers 200, else 0", ready ? 1 : 0);
  AddGauges(families, "myograde_not_ready", "1 for each reason why the daemon is not ready, else 0",
            "reason", reasons);
  AddGauges<int>(families, "myograde_build_info", "1, with the version of the daemon", "version",
                 {{std::string(GraderVersion()), 1}});
  families.back().metric.back().label.push_back(
      {"schema", absl::StrCat(SchemaVersion())});
  AddGauge(families, "myograde_start_time_seconds",
           "When the daemon started, in seconds since 1970",
           absl::ToDoubleSeconds(context.started_at - absl::UnixEpoch()));
}

void AddClusterMetrics(const ApiContext& context, Families& families) {
  const std::map<int64_t, LiveLease> leases = context.engine.Running();
  const auto begun = std::count_if(leases.begin(), leases.end(),
                                   [](const auto& lease) { return lease.second.begun; });
  AddGauges<int64_t>(families, "myograde_jobs", "Jobs of leases on the cluster, by state", "state",
                     {{"queued", std::ssize(leases) - begun}, {"running", begun}});
  std::map<std::string, int64_t> states = {{"new", 0}, {"proved", 0}, {"drained", 0}};
  for (const NodeView& node : context.engine.Nodes()) ++states[node.state];
  AddGauges(families, "myograde_nodes", "Nodes of the cluster, by state", "state", states);
}

void AddDiskMetrics(const ApiContext& context, Families& families) {
  std::map<std::string, int64_t> size;
  std::map<std::string, int64_t> used;
  std::map<std::string, int64_t> free;
  const std::pair<const char*, const std::string*> folders[] = {{"data", &context.data_dir},
                                                                {"cache", &context.cache_dir}};
  for (const auto& [name, folder] : folders) {
    const std::optional<DiskSpace> disk = DiskSpaceAt(*folder);
    if (!disk.has_value()) continue;
    size[name] = disk->size;
    used[name] = disk->used;
    free[name] = disk->free;
  }
  AddGauges(families, "myograde_disk_size_bytes", "Size of the disk of a folder", "folder", size);
  AddGauges(families, "myograde_disk_used_bytes", "Used part of it", "folder", used);
  AddGauges(families, "myograde_disk_free_bytes",
            "Free part of it, without the space reserved for root",
            "folder", free);
  AddGauge(families, "myograde_disk_reserve_bytes",
           "Space that uploads must leave free on the data folder's disk",
           context.config.artefacts.disk_reserve);
  AddGauge(families, "myograde_store_size_bytes", "Size of the store with its write-ahead log",
           StoreBytes(context.data_dir));
}

void AddWebhookMetrics(const ApiContext& context, const Transaction& reader, Families& families) {
  std::map<std::string, DeliveryCounts> counts;
  for (const DeliveryCounts& count : reader.deliveries.Counts()) counts[count.webhook] = count;
  std::map<std::string, int64_t> waiting;
  std::map<std::string, double> oldest;
  for (const Webhook& webhook : context.webhooks.webhooks()) {
    const std::string& name = webhook.config.name;
    const int64_t since = counts[name].oldest_waiting_at;
    const absl::Duration age = context.clock.Now() - absl::FromUnixMillis(since);
    waiting[name] = counts[name].waiting;
    oldest[name] = since == 0 ? 0 : std::max(absl::ToDoubleSeconds(age), 0.0);
  }
  AddGauges(families, "myograde_webhook_waiting", "Events waiting for delivery, by webhook",
            "webhook", waiting);
  AddGauges(families, "myograde_webhook_oldest_waiting_seconds",
            "Age of the oldest of them in seconds; 0: none is waiting", "webhook", oldest);
}

// What only a reading of the store tells; without it where the store can't be read.
void AddStoreMetrics(const ApiContext& context, Families& families) {
  const absl::Status status = context.readers.Read([&](const Transaction& reader) {
    std::map<std::string, int64_t> counts = reader.submissions.CountByState();
    for (const auto state :
         {EvaluationState::kQueued, EvaluationState::kRunning, EvaluationState::kDone,
          EvaluationState::kFailed, EvaluationState::kCancelled, EvaluationState::kGraderError}) {
      counts.try_emplace(std::string(EnumName(state)), 0);
    }
    AddGauges(families, "myograde_submissions", "Submissions, by the state of their own evaluation",
              "state", counts);
    int64_t bytes = 0;
    const std::vector<ArtefactUse> uploads = reader.content.Uploads();
    for (const ArtefactUse& upload : uploads) bytes += upload.bytes;
    AddGauge(families, "myograde_unsubmitted_uploads", "Uploads not submitted yet",
             uploads.size());
    AddGauge(families, "myograde_unsubmitted_upload_bytes", "Their size in bytes, unpacked", bytes);
    AddWebhookMetrics(context, reader, families);
    return absl::OkStatus();
  });
  AddGauge(families, "myograde_store_readable", "1, or 0 if the store can't be read",
           status.ok() ? 1 : 0);
}

absl::Status GetMetrics(const ApiContext& context, const Request&, Response& response) {
  Families families = context.metrics.Collect();
  const LiveHealth health = context.engine.Health();
  AddEngineMetrics(context, health, families);
  AddHostMetrics(context, health, families);
  if (context.config.on_cluster) AddClusterMetrics(context, families);
  AddDiskMetrics(context, families);
  AddStoreMetrics(context, families);
  response.SetHeader("Cache-Control", "no-store");
  response.SetContent(MetricsText(std::move(families)), kMetricsType);
  return absl::OkStatus();
}

}  // namespace

void AddMetrics(Routes& routes, const ApiContext& context) {
  routes.GetFile("/metrics", Action::kReadMetrics, Bind(context, GetMetrics));
}

}  // namespace myograde::server
