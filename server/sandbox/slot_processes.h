// How a daemon tells the living processes of its slots' sandboxes from all others, whoever started
// them: another daemon may have, whose runners are dead.
//
// Where root runs the daemon, each slot has users of its own (users.h). An ordinary user's slots
// each have a mark: an empty folder of the host, which every sandbox of the slot shows. Where the
// folder lies on its file system can be read from outside in a process' mountinfo, and who may not
// change mounts, nor make a namespace, nor choose another root, can't take it from there.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include <absl/status/status.h>

#include "protocol/lease/lease.h"

namespace myograde::server {

class SlotProcesses {
 public:
  // `uid_base`: of the slots' users; -1 if they have none. Then their marks lie in `folder`, which
  // is absolute, made on demand and of this daemon's data folder alone.
  SlotProcesses(int64_t uid_base, std::string folder);

  // Makes an order's processes known as its slot's. An error: the mark can't be made.
  absl::Status Claim(LeaseOrder& order) const;

  // Living processes of `count` slots from `first` on, by slot: in words, for people. Of the
  // processes that this one may not look into, none is found. Costs a few microseconds for each
  // process of the host, and reads one table for each mount namespace of the own user.
  std::map<int, std::string> Find(int first, int count) const;

 private:
  std::map<int, std::string> FindUsers(int first, int count) const;
  std::map<int, std::string> FindMarks(int first, int count) const;

  const int64_t uid_base_;
  const std::string folder_;
};

}  // namespace myograde::server
