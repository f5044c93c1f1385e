// What others see of the queue, and the sums that places in it are computed from (team_line.h).
#include <algorithm>
#include <tuple>

#include <absl/strings/str_cat.h>

#include "server/base/counted.h"
#include "server/scheduler/scheduler.h"

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

int64_t TeamLine::BlocksOfFirst(Priority priority, int64_t count) const {
  const Class& entry = At(priority);
  Refresh(entry);
  return entry.sums[std::min(static_cast<size_t>(count), entry.ids.size())];
}

int64_t Scheduler::CountWaitingBlocks(int64_t id) const {
  const auto it = evaluations_.find(id);
  return it == evaluations_.end() ? 0 : static_cast<int64_t>(it->second.waiting.size());
}

QueueDepth Scheduler::DepthAt(absl::Duration now) const {
  QueueDepth depth;
  for (const auto& [id, evaluation] : evaluations_) {
    if (evaluation.waiting.empty()) continue;
    QueueDepth::OfClass& own = depth.classes[static_cast<size_t>(evaluation.priority)];
    own.evaluations += 1;
    own.blocks += static_cast<int64_t>(evaluation.waiting.size());
    const absl::Duration age = std::max(now - evaluation.waits_since, absl::ZeroDuration());
    depth.oldest = std::max(depth.oldest.value_or(age), age);
  }
  return depth;
}

// The order in which waiting evaluations would get their first slot if each turn were one
// evaluation long: class by class, within a class round by round, in each round every team with its
// next evaluation. A team that comes before this one in a round has one more ahead.
std::optional<QueuePlace> Scheduler::PlaceOf(int64_t id) const {
  const auto it = evaluations_.find(id);
  if (it == evaluations_.end() || it->second.waiting.empty()) return std::nullopt;
  const Evaluation& evaluation = it->second;
  const Team& own = teams_.at(evaluation.spec.team);
  const int64_t rank = own.line.RankOf(evaluation.priority, id);
  const Precedence turn = ComputePrecedence(own, evaluation);
  QueuePlace place{.position = 1};
  for (const auto& [name, team] : teams_) {
    for (int i = 0; i < static_cast<int>(evaluation.priority); ++i) {
      const int64_t all = team.line.size(Priority(i));
      place.position += all;
      place.blocks_ahead += team.line.BlocksOfFirst(Priority(i), all);
    }
    const auto line = team.line.In(evaluation.priority).begin();
    bool earlier = false;
    if (&team != &own && line != team.line.In(evaluation.priority).end()) {
      const Precedence other = ComputePrecedence(team, evaluations_.at(line->first));
      // Teams that have had rejudges only are equal, and come in the order of their names.
      earlier = std::tie(other, name) < std::tie(turn, evaluation.spec.team);
    }
    const int64_t before = rank + (earlier ? 1 : 0);
    place.position += std::min(before, team.line.size(evaluation.priority));
    place.blocks_ahead += team.line.BlocksOfFirst(evaluation.priority, before);
  }
  return place;
}

std::vector<int64_t> Scheduler::QueueOf(const std::set<std::string>* teams) const {
  const auto listed = [&](const Evaluation& evaluation) {
    return evaluation.spec.priority < Priority::kRerun &&
           (teams == nullptr || teams->contains(evaluation.spec.team));
  };
  std::set<int64_t> order;
  for (const int64_t lease : running_) {
    const Evaluation& evaluation = evaluations_.at(blocks_.at(lease).evaluation);
    if (listed(evaluation)) order.insert(evaluation.spec.id);
  }
  // Class, round and the team's turn in it: what PlaceOf counts.
  std::vector<std::tuple<int, int64_t, Precedence, int64_t>> waiting;
  const auto add = [&](const Team& team) {
    for (int i = 0; i < kPriorities; ++i) {
      const std::map<int64_t, int64_t>& line = team.line.In(Priority(i));
      if (line.empty()) continue;
      const Precedence turn = ComputePrecedence(team, evaluations_.at(line.begin()->first));
      int64_t round = 0;
      for (const auto& [id, blocks] : line) {
        const bool shown = listed(evaluations_.at(id)) && !order.contains(id);
        if (shown) waiting.emplace_back(i, round, turn, id);
        ++round;
      }
    }
  };
  for (const auto& [name, team] : teams_) {
    if (teams == nullptr || teams->contains(name)) add(team);
  }
  std::sort(waiting.begin(), waiting.end());
  std::vector<int64_t> queue(order.begin(), order.end());
  for (const auto& entry : waiting) queue.push_back(std::get<3>(entry));
  return queue;
}

std::string Scheduler::WhyWaiting(int64_t id, absl::Duration now) const {
  const auto it = evaluations_.find(id);
  if (it == evaluations_.end() || it->second.waiting.empty()) return "";
  const Evaluation& evaluation = it->second;
  absl::Duration delay = absl::InfiniteDuration();
  bool faulty = false;
  for (const int64_t waiting : evaluation.waiting) {
    const Block& block = blocks_.at(waiting);
    delay = std::min(delay, block.not_before - now);
    faulty = faulty || block.faults > 0;
  }
  const auto count = static_cast<int64_t>(evaluation.waiting.size());
  const std::string blocks = absl::StrCat(CountedBlocks(count), count == 1 ? " waits" : " wait");
  if (delay > absl::ZeroDuration()) {
    return absl::StrCat(blocks, " to be played again after ",
                        faulty ? "a fault of the grader" : "their place was lost", ", in ",
                        absl::FormatDuration(absl::Ceil(delay, absl::Seconds(1))));
  }
  const Team& team = teams_.at(evaluation.spec.team);
  if (!MayStart(team, evaluation.priority)) {
    return absl::StrCat(blocks, " until another of the team ends: ", team.running,
                        team.running == 1 ? " runs" : " run",
                        ", which is as many as one team may have");
  }
  const int64_t taken = int64_t{taken_slots()};
  if (taken < limits_.slots) return absl::StrCat(blocks, " and will start in a moment");
  std::string why = absl::StrCat(blocks, " for a slot: ", taken, " of ", limits_.slots,
                                 taken == 1 ? " is" : " are", " taken, and ",
                                 CountedBlocks(PlaceOf(id)->blocks_ahead),
                                 " of others or of earlier submissions ahead");
  if (evaluation.priority == Priority::kOverdue) {
    absl::StrAppend(&why, "; it has waited for more than ",
                    absl::FormatDuration(limits_.queue_wait),
                    " and goes ahead of all that has not");
  }
  return why;
}

std::optional<absl::Duration> Scheduler::DeadlineOf(int64_t id) const {
  const auto it = evaluations_.find(id);
  if (it == evaluations_.end()) return std::nullopt;
  absl::Duration deadline = it->second.wait_over;
  for (const int64_t running : it->second.running) {
    const Block& block = blocks_.at(running);
    deadline = std::min({deadline, block.silent_after, block.over_at});
  }
  return deadline;
}

}  // namespace myograde::server
