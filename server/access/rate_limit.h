// How many requests a caller may make, and how long one has to wait who shows wrong tokens. Times
// are monotonic and given by the caller of these functions. Each remembers a bounded number of
// keys.
#pragma once

#include <algorithm>
#include <cstddef>
#include <list>
#include <map>
#include <string>
#include <utility>

#include <absl/time/time.h>

namespace myograde::server {

// Values by key, of which the one that was used least recently is forgotten when there are too
// many.
template <typename Value>
class RecentKeys {
 public:
  // REQUIRES: most > 0.
  explicit RecentKeys(size_t most) : most_(most) {}
  RecentKeys(const RecentKeys&) = delete;
  RecentKeys& operator=(const RecentKeys&) = delete;

  // The key's value, which becomes the most recent; nullptr: it is not known.
  Value* Find(const std::string& key) {
    const auto it = places_.find(key);
    if (it == places_.end()) return nullptr;
    order_.splice(order_.begin(), order_, it->second);
    return &it->second->second;
  }
  Value& FindOr(const std::string& key, const Value& fallback) {
    if (Value* value = Find(key)) return *value;
    if (places_.size() >= most_) Forget(oldest());
    order_.emplace_front(key, fallback);
    places_.emplace(key, order_.begin());
    return order_.front().second;
  }
  void Forget(const std::string& key) {
    const auto it = places_.find(key);
    if (it == places_.end()) return;
    const auto place = it->second;
    places_.erase(it);
    order_.erase(place);
  }
  size_t size() const { return places_.size(); }
  // REQUIRES: size() > 0.
  const std::string& oldest() const { return order_.back().first; }

 private:
  using Order = std::list<std::pair<std::string, Value>>;

  const size_t most_;
  Order order_;  // the most recent first
  std::map<std::string, typename Order::iterator> places_;
};

// A token bucket for each key: `per_s` requests a second on average, and up to `burst` at once.
class RateLimit {
 public:
  // REQUIRES: per_s > 0, burst >= 1, most_keys > 0.
  RateLimit(double per_s, double burst, size_t most_keys)
      : per_s_(per_s), burst_(burst), buckets_(most_keys) {}

  // Counts one request, unless `count` is false. Zero: it may be served; else it was not counted,
  // and may be tried again after so long.
  absl::Duration Take(const std::string& key, absl::Duration now, bool count = true) {
    Bucket& bucket = buckets_.FindOr(key, {burst_, now});
    const double passed = std::max(absl::ToDoubleSeconds(now - bucket.at), 0.0);
    bucket.left = std::min(bucket.left + passed * per_s_, burst_);
    bucket.at = now;
    // A wait that rounds to zero means that the request is served, so it has to be counted.
    const absl::Duration wait = absl::Seconds(std::max(1 - bucket.left, 0.0) / per_s_);
    if (count && wait == absl::ZeroDuration()) bucket.left -= 1;
    return wait;
  }
  size_t keys() const { return buckets_.size(); }

 private:
  struct Bucket {
    double left = 0;
    absl::Duration at;
  };

  const double per_s_;
  const double burst_;
  RecentKeys<Bucket> buckets_;
};

// Makes a key wait after failures: not after the first few, then twice as long after each. Failures
// are forgotten after an hour without one.
class BackOff {
 public:
  static constexpr int kFree = 3;
  static constexpr absl::Duration kFirst = absl::Seconds(1);
  static constexpr absl::Duration kLongest = absl::Minutes(5);
  static constexpr absl::Duration kForget = absl::Hours(1);

  // REQUIRES: most_keys > 0.
  explicit BackOff(size_t most_keys) : failures_(most_keys) {}

  void Fail(const std::string& key, absl::Duration now) {
    Failures& failures = failures_.FindOr(key, {0, now, now});
    if (now - failures.last >= kForget) failures.count = 0;
    ++failures.count;
    failures.last = now;
    if (failures.count <= kFree) return;
    absl::Duration wait = kFirst;
    for (int i = kFree + 1; i < failures.count && wait < kLongest; ++i) wait *= 2;
    failures.until = now + std::min(wait, kLongest);
  }
  // How long the key still has to wait; zero: not at all.
  absl::Duration Wait(const std::string& key, absl::Duration now) {
    const Failures* failures = failures_.Find(key);
    if (failures == nullptr) return absl::ZeroDuration();
    return std::max(failures->until - now, absl::ZeroDuration());
  }
  size_t keys() const { return failures_.size(); }

 private:
  struct Failures {
    int count = 0;
    absl::Duration last;
    absl::Duration until;
  };

  RecentKeys<Failures> failures_;
};

}  // namespace myograde::server
