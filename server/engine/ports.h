// What the engine needs from the outside world: processes and a writable store. Time comes from
// Clock. Tests substitute fakes.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/lease/lease.h"
#include "server/metrics/metrics.h"
#include "server/runner/runner.h"
#include "server/sandbox/slot_processes.h"
#include "server/store/store.h"

namespace myograde::server {

class Processes {
 public:
  virtual ~Processes() = default;

  // Creates the order's work folder and starts a runner on it in the order's slot. An error is the
  // grader's fault, and leaves nothing behind.
  virtual absl::StatusOr<std::unique_ptr<Runner>> Start(const LeaseOrder& order) = 0;

  // Removes a dead runner's work folder.
  virtual void CleanUp(const std::string& work_dir) = 0;

  // Living processes in the sandboxes of slots `first` to `first + count - 1`, whoever started
  // them: by slot, described for people.
  virtual std::map<int, std::string> ProcessesOf(int first, int count) {
    (void)first, (void)count;
    return {};
  }
};

// A store change. It owns what it touches, or is outlived by it.
using StoreChange = std::function<absl::Status(Writer&)>;

class Disk {
 public:
  virtual ~Disk() = default;

  // See Store::Write and Store::policy_secret.
  virtual absl::Status Write(const StoreChange& change) = 0;
  virtual const std::string& policy_secret() const = 0;
};

// The production implementations.
class SystemProcesses : public Processes {
 public:
  explicit SystemProcesses(SlotProcesses slots) : slots_(std::move(slots)) {}
  absl::StatusOr<std::unique_ptr<Runner>> Start(const LeaseOrder& order) override;
  void CleanUp(const std::string& work_dir) override;
  std::map<int, std::string> ProcessesOf(int first, int count) override;

 private:
  const SlotProcesses slots_;
};

class StoreDisk : public Disk {
 public:
  // Both must outlive it. `metrics` may be nullptr.
  explicit StoreDisk(Store& store, Metrics* metrics = nullptr)
      : store_(store), metrics_(metrics) {}
  absl::Status Write(const StoreChange& change) override;
  const std::string& policy_secret() const override { return store_.policy_secret(); }

 private:
  Store& store_;
  Metrics* const metrics_;
};

}  // namespace myograde::server
