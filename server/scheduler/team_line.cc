#include "server/scheduler/team_line.h"

#include <algorithm>

namespace myograde::server {

std::string_view PriorityName(Priority priority) {
  static constexpr std::array<std::string_view, kPriorities> kNames = {
      "overdue", "ranked", "practice", "rerun", "rejudge"};
  return kNames[static_cast<size_t>(priority)];
}

void TeamLine::Set(Priority priority, int64_t evaluation, int64_t waiting) {
  Class& entry = classes_[static_cast<size_t>(priority)];
  entry.stale = true;
  if (waiting == 0) {
    entry.waiting.erase(evaluation);
  } else {
    entry.waiting[evaluation] = waiting;
  }
}

void TeamLine::Refresh(const Class& entry) {
  if (!entry.stale) return;
  entry.ids.clear();
  entry.sums.assign(1, 0);
  for (const auto& [id, waiting] : entry.waiting) {
    entry.ids.push_back(id);
    entry.sums.push_back(entry.sums.back() + waiting);
  }
  entry.stale = false;
}

int64_t TeamLine::RankOf(Priority priority, int64_t evaluation) const {
  const Class& entry = At(priority);
  Refresh(entry);
  return std::lower_bound(entry.ids.begin(), entry.ids.end(), evaluation) - entry.ids.begin();
}

int64_t TeamLine::LeasesOfFirst(Priority priority, int64_t count) const {
  const Class& entry = At(priority);
  Refresh(entry);
  return entry.sums[std::min(static_cast<size_t>(count), entry.ids.size())];
}

}  // namespace myograde::server
