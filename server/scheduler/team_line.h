// The evaluations of one team that wait for a slot, by class and age, with the sums
// that places in the queue are made of.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <vector>

namespace myograde::server {

// What goes first. kOverdue: whatever has waited for too long. kRanked: it may rank.
// kPractice: it may not. kRerun: a playing again.
enum class Priority { kOverdue = 0, kRanked = 1, kPractice = 2, kRerun = 3 };
constexpr int kPriorities = 4;

class TeamLine {
 public:
  // The evaluation has so many leases waiting; 0 takes it out of the line.
  void Set(Priority priority, int64_t evaluation, int64_t waiting);

  // Evaluations in a class, from the oldest: id and number of waiting leases.
  const std::map<int64_t, int64_t>& In(Priority priority) const { return At(priority).waiting; }
  int64_t size(Priority priority) const {
    return static_cast<int64_t>(In(priority).size());
  }

  // How many evaluations of the class are older than this one.
  int64_t RankOf(Priority priority, int64_t evaluation) const;
  // Waiting leases of the `count` oldest evaluations of the class.
  int64_t LeasesOfFirst(Priority priority, int64_t count) const;

 private:
  struct Class {
    std::map<int64_t, int64_t> waiting;
    // Of `waiting`, made anew when asked for after a change.
    mutable bool stale = true;
    mutable std::vector<int64_t> ids;
    mutable std::vector<int64_t> sums;  // sums[i]: leases of the first i evaluations
  };
  const Class& At(Priority priority) const { return classes_[static_cast<size_t>(priority)]; }
  static void Refresh(const Class& entry);

  std::array<Class, kPriorities> classes_;
};

}  // namespace myograde::server
