// Tells the living processes of a daemon's slots from all others, whoever started them: possibly
// another daemon, whose runners are dead.
//
// If root runs the daemon, each slot has its own users (users.h). An ordinary user's slots each
// have a mark: an empty host folder that every sandbox of the slot mounts. Its place in its file
// system can be read from outside in a process' mountinfo, and a process that can't change mounts,
// create a namespace or choose another root can't remove it.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include <absl/status/status.h>

#include "protocol/lease/lease.h"

namespace myograde::server {

class SlotProcesses {
 public:
  // `uid_base`: first of the slots' users; -1 if they have none. Then their marks lie in `folder`,
  // which is absolute, created on demand and used by this daemon's data folder alone.
  SlotProcesses(int64_t uid_base, std::string folder);

  // Marks an order's processes as its slot's. An error: the mark can't be created.
  absl::Status Claim(LeaseOrder& order) const;

  // Living processes of `count` slots from `first` on: by slot, described for people. Processes
  // that this one may not inspect are not found. Costs a few microseconds per process of the host,
  // and reads one mount table per mount namespace of the own user.
  std::map<int, std::string> Find(int first, int count) const;

 private:
  std::map<int, std::string> FindUsers(int first, int count) const;
  std::map<int, std::string> FindMarks(int first, int count) const;

  const int64_t uid_base_;
  const std::string folder_;
};

}  // namespace myograde::server
