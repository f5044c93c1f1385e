// Time of the scheduler's decisions in long queues: one JSON object on standard output.
//
//   scheduler_bench [--quick]
//
// For each number of queued leases and of teams it plays grading: a lease starts, is asked about,
// ends, and each evaluation that ends is followed by a new one, so that the queue keeps its length.
// Every call is timed by itself.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "server/scheduler/scheduler.h"

namespace myograde::server {
namespace {

using Clock = std::chrono::steady_clock;
using Calls = std::map<std::string, std::vector<double>>;  // s of each call, by the call's name

constexpr int64_t kLeases = 10;  // of an evaluation
constexpr int kSlots = 2;

[[noreturn]] void Fail(const std::string& sentence) {
  std::fprintf(stderr, "error: %s\n", sentence.c_str());
  std::exit(2);
}

template <typename Call>
auto Timed(std::vector<double>& seconds, Call call) {
  const auto start = Clock::now();
  auto result = call();
  seconds.push_back(std::chrono::duration<double>(Clock::now() - start).count());
  return result;
}

// A queue that is filled when it is made.
class Queue {
 public:
  Queue(int64_t leases, int64_t teams) : teams_(teams) {
    for (int64_t i = 0; i < leases / kLeases; ++i) Add();
    for (auto& [name, seconds] : calls_) seconds.clear();
  }

  void Play(int64_t ends) {
    for (int64_t i = 0; i < ends; ++i) RunOnce();
  }

  const Calls& calls() const { return calls_; }

 private:
  void Add() {
    EvaluationSpec spec;
    spec.id = ++evaluations_;
    spec.team = absl::StrCat("team ", evaluations_ % teams_);
    spec.lease_wall = absl::Hours(1);
    for (int64_t i = 0; i < kLeases; ++i) spec.blocks.push_back({spec.id * kLeases + i, 0, 0});
    Timed(calls_["add"], [&] { return scheduler_.Add(spec, now_), true; });
  }

  void RunOnce() {
    now_ += absl::Milliseconds(1);
    Timed(calls_["escalate"], [&] { return scheduler_.Escalate(now_); });
    const auto start = Timed(calls_["next"], [&] { return scheduler_.Next(now_); });
    if (!start) Fail("the queue ran dry");
    // The one that has waited for longest, and the one that came last.
    Timed(calls_["place_of"], [&] { return scheduler_.PlaceOf(start->evaluation); });
    Timed(calls_["place_of"], [&] { return scheduler_.PlaceOf(evaluations_); });
    Timed(calls_["deadline"], [&] { return scheduler_.NextDeadline(now_); });
    const Decision verdict = Timed(calls_["finished"], [&] {
      return scheduler_.Finished(start->lease, start->attempt, now_);
    });
    scheduler_.Free(start->slot);
    if (verdict.kind == Decision::Kind::kEvaluationEnds) Add();
  }

  const int64_t teams_;
  Scheduler scheduler_{{.slots = kSlots}};
  absl::Duration now_ = absl::ZeroDuration();
  int64_t evaluations_ = 0;
  Calls calls_;
};

nlohmann::json Summary(std::vector<double> seconds) {
  std::sort(seconds.begin(), seconds.end());
  const auto at = [&](double q) {
    return seconds[static_cast<size_t>(q * static_cast<double>(seconds.size() - 1))];
  };
  return {{"median", at(0.5)}, {"min", at(0)}, {"p99", at(0.99)}, {"max", at(1)}};
}

nlohmann::json Measure(int64_t leases, int64_t teams, int64_t ends) {
  Queue queue(leases, teams);
  queue.Play(ends);
  nlohmann::json row = {{"leases", leases}, {"teams", teams}};
  for (const auto& [name, seconds] : queue.calls()) {
    if (!seconds.empty()) row[absl::StrCat(name, "_s")] = Summary(seconds);
  }
  return row;
}

int Main(int argc, char** argv) {
  const bool quick = argc == 2 && std::string(argv[1]) == "--quick";
  if (argc > 1 && !quick) Fail("usage: scheduler_bench [--quick]");
  const int64_t ends = quick ? 2'000 : 20'000;
  const std::vector<int64_t> lengths =
      quick ? std::vector<int64_t>{100, 10'000} : std::vector<int64_t>{100, 1'000, 10'000, 100'000};
  const std::vector<int64_t> teams =
      quick ? std::vector<int64_t>{1, 200} : std::vector<int64_t>{1, 2, 5, 10, 20, 50, 100, 200};
  nlohmann::json by_leases = nlohmann::json::array();
  nlohmann::json by_teams = nlohmann::json::array();
  for (const int64_t leases : lengths) by_leases.push_back(Measure(leases, 200, ends));
  for (const int64_t count : teams) by_teams.push_back(Measure(lengths.back(), count, ends));
  const nlohmann::json result = {{"by_leases", by_leases}, {"by_teams", by_teams}};
  std::printf("%s\n", result.dump(2).c_str());
  return 0;
}

}  // namespace
}  // namespace myograde::server

int main(int argc, char** argv) { return myograde::server::Main(argc, argv); }
