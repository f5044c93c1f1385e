// A simulated world for the engine's core in which everything can go wrong: runners that die,
// stall, lie, duplicate or lose records and refuse to exit; nodes that are lost; a store whose writes fail, and power
// cuts before or after a write. A tape of bytes decides what goes wrong, so that a failing history
// can be shrunk; after the tape's end nothing fails.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "protocol/base/clock.h"
#include "server/engine/engine_core.h"
#include "server/grading/tracks.h"

namespace myograde::server {

class Tape {
 public:
  explicit Tape(std::vector<uint8_t> bytes) : bytes_(std::move(bytes)) {}
  // True with a chance of `of_256`, until the tape ends.
  bool Happens(int of_256) { return Next() >= 256 - of_256; }
  // From 0 to n - 1.
  int Below(int n) { return Next() % n; }
  bool over() const { return at_ >= bytes_.size(); }
  void Stop() { at_ = bytes_.size(); }

 private:
  int Next() { return over() ? 0 : bytes_[at_++]; }
  std::vector<uint8_t> bytes_;
  size_t at_ = 0;
};

// Thrown by the disk on a power cut: whatever the engine was about to do is not done.
struct PowerCut {};

class World;

// The facts of an episode that was played correctly: a function of the order alone.
EpisodeFacts FactsOf(const EpisodeOrder& episode);

class FakeRunner : public Runner {
 public:
  FakeRunner(World& world, const LeaseOrder& order);
  ~FakeRunner() override;
  // Nobody polls them; they only tell the engine that the streams are still open.
  int stdout_fd() const override { return 0; }
  int stderr_fd() const override { return 0; }
  absl::StatusOr<std::vector<LeaseRecord>> Read() override;
  bool finished() override;
  bool dead() override;
  void AskToEnd() override;
  void KillNow() override;
  pid_t pid() const override { return 1; }
  int wait_status() const override { return 9; }
  bool begun() const override;
  std::string lost() const override;
  RunnerSite site() const override;
  std::string stderr_tail() const override { return "last words"; }

 private:
  void WriteScript(const LeaseOrder& order);
  void Say(absl::Duration at, const LeaseRecord& record);

  World& world_;
  const int64_t slot_;
  std::vector<std::pair<absl::Duration, LeaseRecord>> script_;  // records by time
  size_t said_ = 0;
  bool garbage_ = false;
  bool stubborn_ = false;
  absl::Duration kill_takes_;
  absl::Duration begins_at_;                                // of a remote one
  absl::Duration lost_at_ = absl::InfiniteDuration();
  absl::Duration dies_at_ = absl::InfiniteDuration();
};

class FakeProcesses : public Executor {
 public:
  explicit FakeProcesses(World& world) : world_(world) {}
  absl::StatusOr<std::unique_ptr<Runner>> Start(const LeaseOrder& order, const LeaseSubject&) override;
  void CleanUp(const std::string&) override {}
  std::map<int, std::string> FindProcesses(int first, int count) override;
  bool remote() const override;
  std::string CannotStart() const override;
  void NoteEnd(const std::string& node, bool fault) override;
  std::vector<DrainedNode> TakeDrained() override;

 private:
  World& world_;
};

// The real store, with power cuts and rejected writes.
class FakeDisk : public StoreWriter {
 public:
  FakeDisk(World& world, Store& store) : world_(world), store_(store) {}
  absl::Status Write(const StoreChange& change) override;

 private:
  World& world_;
  Store& store_;
  int bad_for_ = 0;
};

class World {
 public:
  // `folder` is created, and removed with this object. Starts with an empty store, or a copy of
  // `store_file`. `remote`: leases run on the nodes of a cluster.
  World(std::string folder, std::vector<uint8_t> tape, int slots,
        const std::string& store_file = "", bool remote = false);
  ~World();

  // Starts a daemon on the existing state; cuts the power of a running one first.
  void Boot();
  // Cuts the power of the running daemon.
  void Cut();
  // One turn of the engine, and some time until the next. A power cut on the way is followed by a
  // restart.
  void RunOnce();
  // As an administrator would.
  void JumpClock(absl::Duration step) { clock.Jump(step); }

  // The id of its evaluation; 0 if it was rejected.
  int64_t Submit(const std::string& team, int episodes);
  void Cancel(int64_t submission);

  // True once every evaluation has a final state.
  bool AllEnded();
  // What has not ended, and why, as text.
  std::string WhatIsOpen();
  // Throws a sentence if the store breaks an invariant.
  void CheckStore();

  std::vector<std::string> needs_runtimes;  // of the artefacts of later submissions
  ManualClock clock{absl::FromUnixSeconds(100'000'000)};  // no jump back gets before 1970
  Tape tape;
  // The next runner sends all its records this much later, and dies this much later when killed.
  absl::Duration next_is_late = absl::ZeroDuration();
  absl::Duration next_dies_late = absl::ZeroDuration();
  // How long the daemon stands still just after it has read from a runner.
  absl::Duration next_look_takes = absl::ZeroDuration();
  // The next runner's process stays this much longer after its end record.
  absl::Duration next_lingers = absl::ZeroDuration();
  // On a cluster: the next lease begins this much later, and is lost this long after that.
  absl::Duration next_begins_late = absl::ZeroDuration();
  absl::Duration next_is_lost_after = absl::InfiniteDuration();
  std::string cannot_start;             // of the executor
  std::vector<DrainedNode> drained;     // not taken yet
  std::vector<std::pair<std::string, bool>> ends;  // that the executor was told: node and fault
  const bool remote;
  std::map<int, std::string> left;  // living processes, by slot
  std::set<int64_t> slots_in_use;
  std::string broken;           // the first invariant that the engine broke, as text
  int cancels_open = 0;
  int power_cuts = 0;
  int submits = 0;  // each with its own artefact
  TrackPtr track;
  std::unique_ptr<EngineCore> core;
  std::unique_ptr<Store> store;
  std::unique_ptr<ReaderPool> readers;
  std::set<int64_t> evaluations;  // all that were accepted

 private:
  void CheckEvaluation(const Transaction& reader, int64_t id);
  void CheckHistory(const Transaction& reader, const std::string& entity, int64_t id,
                    const std::string& state);
  void Promise(bool kept, const std::string& what);

  const std::string folder_;
  const int slots_;
  FakeProcesses processes_{*this};
  std::unique_ptr<FakeDisk> disk_;
  std::map<std::pair<int64_t, int64_t>, std::string> seen_;  // episodes, with their facts
};

}  // namespace myograde::server
