// What the daemon counts while it works, for Prometheus: counters and histograms that only grow,
// and start at zero with the daemon. Counting is an atomic addition and a look-up among a few dozen
// labels; it never waits for a disk or a scrape. What can be read off the daemon's state instead is
// read when somebody asks (server/api/metrics_resource.cc).
//
// Every label has few values: names of tracks, actions, webhooks and kinds, never of teams or
// submissions. Where a value comes from outside, all but the known ones count as "other".
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <absl/time/time.h>
#include <prometheus/metric_family.h>

namespace myograde::server {

using MetricFamily = prometheus::MetricFamily;

// Safe from any thread.
class Metrics {
 public:
  Metrics();
  ~Metrics();
  Metrics(const Metrics&) = delete;
  Metrics& operator=(const Metrics&) = delete;

  // --- the engine ---
  // An episode ended; `participant_fault`: by a fault of the participant's program.
  void CountEpisode(const std::string& track, std::string_view outcome, bool participant_fault);
  // A lease ended with all of its episodes.
  void ObserveLease(const std::string& track, absl::Duration took);
  // A lease failed by the grader's fault: "start", "report" or "overdue".
  void CountGraderFault(const std::string& kind);
  // A lease was taken back though nobody failed, and is played again. `why`: "lost" (its node, its
  // job or the way back), "silent", "not begun" (the same before it had a processor),
  // "preempted", "stop" (of the daemon), "disk" (a fault while it lacks room).
  void CountReturn(std::string_view why);
  // What an attempt used, once it has ended: CPU time in s and energy in J; not positive: not known.
  void CountUse(const std::string& track, double cpu_s, double energy_j);
  void CountSelfTest(bool passed);

  // --- the store ---
  // `ok`: false if the store could not be written, for whatever may pass.
  void ObserveStoreWrite(absl::Duration took, bool ok);
  void ObserveStoreRead(absl::Duration took);

  // --- the API ---
  // `action`: of the address (server/access); "none" where there is no such address.
  void ObserveRequest(std::string_view action, int http, absl::Duration took);
  // A request that was refused before a handler saw it.
  void CountRefusal(int http);
  // `why`: as AccessLog::Deny has it.
  void CountDenial(std::string_view why);

  // --- the rest ---
  // Files of a kind ("artefact", "log", "upload") that retention removed.
  void CountRemoved(const std::string& kind, int64_t bytes);
  // What a sweep that ended at `at` (by the calendar) left of a kind.
  void SetKept(const std::string& kind, int64_t bytes, absl::Time at);
  void CountWebhook(const std::string& webhook, bool delivered);
  void CountWebhookGivenUp(const std::string& webhook);

  // All of the above.
  std::vector<MetricFamily> Collect() const;

 private:
  struct Families;
  const std::unique_ptr<Families> families_;
};

// Adds a family of gauges: a value for each of the label's, or one without a label if that is "".
template <typename Number>
void AddGauges(std::vector<MetricFamily>& families, const char* name, const char* help,
               const std::string& label, const std::map<std::string, Number>& values) {
  MetricFamily& family = families.emplace_back();
  family.name = name;
  family.help = help;
  family.type = prometheus::MetricType::Gauge;
  for (const auto& [key, value] : values) {
    prometheus::ClientMetric& metric = family.metric.emplace_back();
    if (!label.empty()) metric.label.push_back({label, key});
    metric.gauge.value = static_cast<double>(value);
  }
}

// The families as Prometheus' text format, version 0.0.4, in the order of their names.
std::string MetricsText(std::vector<MetricFamily> families);
inline constexpr char kMetricsType[] = "text/plain; version=0.0.4; charset=utf-8";

}  // namespace myograde::server
