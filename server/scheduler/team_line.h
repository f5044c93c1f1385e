// A team's waiting evaluations by class and age, with the prefix sums that queue places are
// computed from.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string_view>
#include <vector>

namespace myograde::server {

// Highest class first. kOverdue: has waited too long. kRanked: may rank. kPractice: may not.
// kRerun: played a second time. kRejudge: played by an organiser's changed rules, which nobody waits
// for, so it never becomes overdue.
enum class Priority { kOverdue = 0, kRanked = 1, kPractice = 2, kRerun = 3, kRejudge = 4 };
constexpr int kPriorities = 5;
std::string_view PriorityName(Priority priority);  // "overdue", "ranked", ...

class TeamLine {
 public:
  // Sets an evaluation's number of waiting blocks; 0 removes it.
  void Set(Priority priority, int64_t evaluation, int64_t waiting);

  // Evaluations of a class, oldest first: id to number of waiting blocks.
  const std::map<int64_t, int64_t>& In(Priority priority) const { return At(priority).waiting; }
  int64_t size(Priority priority) const {
    return static_cast<int64_t>(In(priority).size());
  }

  // How many evaluations of the class are older than this one.
  int64_t RankOf(Priority priority, int64_t evaluation) const;
  // Waiting blocks of the class's `count` oldest evaluations.
  int64_t BlocksOfFirst(Priority priority, int64_t count) const;

 private:
  struct Class {
    std::map<int64_t, int64_t> waiting;
    // Prefix sums over `waiting`, rebuilt on demand after a change.
    mutable bool stale = true;
    mutable std::vector<int64_t> ids;
    mutable std::vector<int64_t> sums;  // sums[i]: blocks of the first i evaluations
  };
  const Class& At(Priority priority) const { return classes_[static_cast<size_t>(priority)]; }
  static void Refresh(const Class& entry);

  std::array<Class, kPriorities> classes_;
};

}  // namespace myograde::server
