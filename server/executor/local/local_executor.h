// Leases run on this host, each a process of its own.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <utility>

#include "server/executor/executor.h"
#include "server/sandbox/slot_processes.h"

namespace myograde::server {

class LocalExecutor : public Executor {
 public:
  explicit LocalExecutor(SlotProcesses slots) : slots_(std::move(slots)) {}
  absl::StatusOr<std::unique_ptr<Runner>> Start(const LeaseOrder& order,
                                                const LeaseSubject& subject) override;
  std::map<int, std::string> ProcessesOf(int first, int count) override;

 private:
  const SlotProcesses slots_;
};

}  // namespace myograde::server
