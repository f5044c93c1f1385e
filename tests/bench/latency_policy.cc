// A policy of zeros that tells, at the beginning of each episode and on its standard error, when
// its process began and how long the steps so far took as a policy sees them, from one observation
// to the next:
//
//   {"started_at": s since 1970, "steps": N, "p50": s, "p99": s, "max": s}
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <vector>

#include "policies/cpp/kit.h"

namespace {

using Clock = std::chrono::steady_clock;

double Now() {
  const auto since = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration<double>(since).count();
}

class Latency : public myograde::Policy {
 public:
  explicit Latency(double started_at) : started_at_(started_at) {}

  std::string Name() const override { return "latency"; }

  void Reset(const myograde::EpisodeInfo&) override {
    std::sort(steps_.begin(), steps_.end());
    std::fprintf(stderr, "{\"started_at\": %.6f, \"steps\": %zu, \"p50\": %.7f, \"p99\": %.7f, "
                 "\"max\": %.7f}\n", started_at_, steps_.size(), Quantile(0.5), Quantile(0.99),
                 Quantile(1));
    first_ = true;
  }

  void Act(std::span<const double>, std::span<double>) override {
    const auto now = Clock::now();
    if (!first_) steps_.push_back(std::chrono::duration<double>(now - before_).count());
    first_ = false;
    before_ = now;
  }

 private:
  // REQUIRES: steps_ are sorted.
  double Quantile(double q) const {
    if (steps_.empty()) return 0;
    return steps_[static_cast<size_t>(q * static_cast<double>(steps_.size() - 1))];
  }

  double started_at_;
  std::vector<double> steps_;  // s
  Clock::time_point before_;
  bool first_ = true;
};

}  // namespace

int main() {
  Latency policy(Now());
  return myograde::RunPolicy(policy);
}
