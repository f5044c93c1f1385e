#include "server/access/denials.h"

#include <utility>

namespace myograde::server {

Denial DenialCounter::Others() { return {"others", "", "any", "too many different ones"}; }

DenialCounter::Kind& DenialCounter::KindOf(const Denial& denial) {
  const auto it = kinds_.find(denial);
  if (it != kinds_.end()) return it->second;
  return kinds_[kinds_.size() < most_ ? denial : Others()];
}

void DenialCounter::Add(const Denial& denial) { ++KindOf(denial).count; }

void DenialCounter::Return(const std::vector<CountedDenial>& denials) {
  for (const CountedDenial& counted : denials) KindOf(counted.denial).count += counted.count;
}

std::vector<CountedDenial> DenialCounter::TakeDue(absl::Duration now) {
  std::vector<CountedDenial> due;
  for (auto it = kinds_.begin(); it != kinds_.end();) {
    Kind& kind = it->second;
    const bool recent = now - kind.written < kEvery;
    if (kind.count > 0 && !recent) {
      due.push_back({it->first, std::exchange(kind.count, 0)});
      kind.written = now;
    }
    // One that is written and does not come again needs no place.
    it = kind.count == 0 && now - kind.written >= kEvery ? kinds_.erase(it) : std::next(it);
  }
  return due;
}

}  // namespace myograde::server
