#include "server/metrics/metrics.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <absl/strings/str_cat.h>
#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>

namespace myograde::server {
namespace {

using prometheus::Counter;
using prometheus::Gauge;
using prometheus::Histogram;
template <typename Kind>
using Family = prometheus::Family<Kind>;
using Buckets = Histogram::BucketBoundaries;

const Buckets kLeaseSeconds = {1, 5, 15, 30, 60, 120, 300, 600, 1800, 3600};
const Buckets kStoreSeconds = {0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 1, 5};
const Buckets kRequestSeconds = {0.001, 0.005, 0.01, 0.05, 0.1, 0.5, 1, 5, 30};

// Why requests are denied; anything else counts as "other".
constexpr std::array<std::string_view, 6> kDenials = {
    "role", "another team's", "too many requests", "wrong token", "expired token", "revoked token"};

// Why leases are taken back; anything else counts as "other".
constexpr std::array<std::string_view, 6> kReturns = {"lost", "silent", "not begun", "preempted",
                                                      "stop", "disk"};

std::string Text(std::string_view view) { return std::string(view); }

// `why` as a label's value, if it is one of those that are known.
template <size_t kCount>
std::string OneOf(const std::array<std::string_view, kCount>& known, std::string_view why) {
  return std::find(known.begin(), known.end(), why) != known.end() ? Text(why) : "other";
}

}  // namespace

struct Metrics::Families {
  Family<Counter>& Count(const char* name, const char* help) {
    return prometheus::BuildCounter().Name(name).Help(help).Register(registry);
  }
  Family<Histogram>& Durations(const char* name, const char* help) {
    return prometheus::BuildHistogram().Name(name).Help(help).Register(registry);
  }
  Family<Gauge>& Value(const char* name, const char* help) {
    return prometheus::BuildGauge().Name(name).Help(help).Register(registry);
  }

  prometheus::Registry registry;
  Family<Counter>& episodes = Count("myograde_episodes_total",
                                    "Episodes played, by track and outcome");
  Family<Counter>& participant_faults =
      Count("myograde_participant_faults_total",
            "Episodes that ended by a fault of the participant's program, by kind");
  Family<Counter>& grader_faults =
      Count("myograde_grader_faults_total",
            "Leases that failed by the grader's fault: the runner did not start (start), reported "
            "wrongly or died (report), was silent or over its time (overdue)");
  Family<Counter>& returns = Count("myograde_leases_returned_total",
                                   "Leases taken back though nobody failed, by reason");
  Family<Counter>& cpu = Count("myograde_lease_cpu_seconds_total",
                               "CPU time of attempts that have ended, in seconds, by track");
  Family<Counter>& energy =
      Count("myograde_lease_energy_joules_total",
            "Energy of attempts that have ended, in joules, by track, where it is measured");
  Family<Histogram>& leases = Durations("myograde_lease_duration_seconds",
                                        "Wall-clock time of leases that ended well, in seconds");
  Family<Counter>& self_tests = Count("myograde_self_tests_total",
                                      "Self-tests of this host, by result");
  Histogram& store_writes =
      Durations("myograde_store_write_duration_seconds",
                "Time of one change of the store with its wait for the disk, in seconds")
          .Add({}, kStoreSeconds);
  Counter& store_failures = Count("myograde_store_write_failures_total",
                                  "Changes that the store could not take, for a reason that may "
                                  "pass").Add({});
  Histogram& store_reads = Durations("myograde_store_read_duration_seconds",
                                     "Time of one reading of the store, in seconds")
                               .Add({}, kStoreSeconds);
  Family<Counter>& requests = Count("myograde_http_requests_total",
                                    "Requests answered, by the action of their address and status");
  Family<Histogram>& request_times =
      Durations("myograde_http_request_duration_seconds",
                "Time that handlers took, in seconds, by the action of the address");
  Family<Counter>& refusals = Count("myograde_http_refusals_total",
                                    "Requests refused before a handler saw them, by status");
  Family<Counter>& denials = Count("myograde_denials_total", "Requests denied, by reason");
  Family<Counter>& removed_files = Count("myograde_retention_removed_files_total",
                                         "Files and folders that retention removed, by kind");
  Family<Counter>& removed_bytes = Count("myograde_retention_removed_bytes_total",
                                         "Their size in bytes");
  Family<Gauge>& kept = Value("myograde_retention_kept_bytes",
                              "Size in bytes of what the latest sweep left, by kind");
  Gauge& swept = Value("myograde_retention_last_sweep_timestamp_seconds",
                       "When the latest sweep ended, in seconds since 1970; 0: none yet").Add({});
  Family<Counter>& webhooks = Count("myograde_webhook_attempts_total",
                                    "Attempts to deliver an event, by webhook and result");
  Family<Counter>& webhooks_given_up = Count("myograde_webhook_given_up_total",
                                             "Events given up, by webhook");
};

Metrics::Metrics() : families_(std::make_unique<Families>()) {
  // So that a first one is an increase.
  for (const char* kind : {"start", "report", "overdue"}) {
    families_->grader_faults.Add({{"kind", kind}});
  }
  for (const char* result : {"passed", "failed"}) families_->self_tests.Add({{"result", result}});
  for (const std::string_view why : kReturns) families_->returns.Add({{"reason", Text(why)}});
  for (const std::string_view why : kDenials) families_->denials.Add({{"reason", Text(why)}});
}

Metrics::~Metrics() = default;

void Metrics::CountEpisode(const std::string& track, std::string_view outcome,
                           bool participant_fault) {
  families_->episodes.Add({{"track", track}, {"outcome", Text(outcome)}}).Increment();
  if (participant_fault) families_->participant_faults.Add({{"kind", Text(outcome)}}).Increment();
}

void Metrics::ObserveLease(const std::string& track, absl::Duration took) {
  families_->leases.Add({{"track", track}}, kLeaseSeconds).Observe(absl::ToDoubleSeconds(took));
}

void Metrics::CountGraderFault(const std::string& kind) {
  families_->grader_faults.Add({{"kind", kind}}).Increment();
}

void Metrics::CountReturn(std::string_view why) {
  families_->returns.Add({{"reason", OneOf(kReturns, why)}}).Increment();
}

void Metrics::CountUse(const std::string& track, double cpu_s, double energy_j) {
  // Not a number is neither greater nor finite.
  if (cpu_s > 0 && std::isfinite(cpu_s)) families_->cpu.Add({{"track", track}}).Increment(cpu_s);
  if (energy_j > 0 && std::isfinite(energy_j)) {
    families_->energy.Add({{"track", track}}).Increment(energy_j);
  }
}

void Metrics::CountSelfTest(bool passed) {
  families_->self_tests.Add({{"result", passed ? "passed" : "failed"}}).Increment();
}

void Metrics::ObserveStoreWrite(absl::Duration took, bool ok) {
  families_->store_writes.Observe(absl::ToDoubleSeconds(took));
  if (!ok) families_->store_failures.Increment();
}

void Metrics::ObserveStoreRead(absl::Duration took) {
  families_->store_reads.Observe(absl::ToDoubleSeconds(took));
}

void Metrics::ObserveRequest(std::string_view action, int http, absl::Duration took) {
  families_->requests.Add({{"action", Text(action)}, {"code", absl::StrCat(http)}}).Increment();
  families_->request_times.Add({{"action", Text(action)}}, kRequestSeconds)
      .Observe(absl::ToDoubleSeconds(took));
}

void Metrics::CountRefusal(int http) {
  families_->refusals.Add({{"code", absl::StrCat(http)}}).Increment();
}

void Metrics::CountDenial(std::string_view why) {
  families_->denials.Add({{"reason", OneOf(kDenials, why)}}).Increment();
}

void Metrics::CountRemoved(const std::string& kind, int64_t bytes) {
  families_->removed_files.Add({{"kind", kind}}).Increment();
  families_->removed_bytes.Add({{"kind", kind}}).Increment(static_cast<double>(bytes));
}

void Metrics::SetKept(const std::string& kind, int64_t bytes, absl::Time at) {
  families_->kept.Add({{"kind", kind}}).Set(static_cast<double>(bytes));
  families_->swept.Set(static_cast<double>(absl::ToUnixSeconds(at)));
}

void Metrics::CountWebhook(const std::string& webhook, bool delivered) {
  families_->webhooks
      .Add({{"webhook", webhook}, {"result", delivered ? "delivered" : "failed"}})
      .Increment();
}

void Metrics::CountWebhookGivenUp(const std::string& webhook) {
  families_->webhooks_given_up.Add({{"webhook", webhook}}).Increment();
}

std::vector<MetricFamily> Metrics::Collect() const { return families_->registry.Collect(); }

std::string MetricsText(std::vector<MetricFamily> families) {
  std::sort(families.begin(), families.end(),
            [](const MetricFamily& a, const MetricFamily& b) { return a.name < b.name; });
  return prometheus::TextSerializer().Serialize(families);
}

}  // namespace myograde::server
