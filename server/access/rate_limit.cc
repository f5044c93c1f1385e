#include "server/access/rate_limit.h"

#include <algorithm>

namespace myograde::server {

absl::Duration RateLimit::Take(const std::string& key, absl::Duration now, bool count) {
  Bucket& bucket = buckets_.FindOr(key, {burst_, now});
  const double passed = std::max(absl::ToDoubleSeconds(now - bucket.at), 0.0);
  bucket.left = std::min(bucket.left + passed * per_s_, burst_);
  bucket.at = now;
  // A wait that rounds to zero means that the request is served, so it has to be counted.
  const absl::Duration wait = absl::Seconds(std::max(1 - bucket.left, 0.0) / per_s_);
  if (count && wait == absl::ZeroDuration()) bucket.left -= 1;
  return wait;
}

void BackOff::Fail(const std::string& key, absl::Duration now) {
  Failures& failures = failures_.FindOr(key, {0, now, now});
  if (now - failures.last >= kForget) failures.count = 0;
  ++failures.count;
  failures.last = now;
  if (failures.count <= kFree) return;
  absl::Duration wait = kFirst;
  for (int i = kFree + 1; i < failures.count && wait < kLongest; ++i) wait *= 2;
  failures.until = now + std::min(wait, kLongest);
}

absl::Duration BackOff::Wait(const std::string& key, absl::Duration now) {
  const Failures* failures = failures_.Find(key);
  if (failures == nullptr) return absl::ZeroDuration();
  return std::max(failures->until - now, absl::ZeroDuration());
}

}  // namespace myograde::server
