// A daemon's store, engine and rejudger with runners that play at once, and a disk that can fail at a
// chosen commit.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "server/engine/rejudges.h"

namespace myograde::server {

// How runners behave. Shared with the engine's thread.
struct Playing {
  std::atomic<bool> hold = false;       // runners of `held` wait until this is false
  std::atomic<int> ended_early = 0;     // runners that were asked to end
  std::atomic<int> starts = 0;
  std::string held;                     // a lease's artefact folder ends with this; "": all
  std::string unsteady;                 // the artefact that plays otherwise each time
};

// The disk of a daemon whose power goes at commit number `cut`: before it is written or after.
class CutDisk : public StoreWriter {
 public:
  explicit CutDisk(Store& store) : store_(store) {}
  absl::Status Write(const StoreChange& change) override;

  int64_t cut = INT64_MAX;
  bool after = false;
  std::atomic<int64_t> commits = 0;
  std::atomic<bool> off = false;

 private:
  Store& store_;
};

class RejudgeWorld : public testing::Test {
 protected:
  void SetUp() override;
  void TearDown() override;

  // Opens the store; the engine and the rejudger run until Halt().
  void Open();
  void Close();
  void Run();
  void Halt();

  // Config `base_` with `change` made to its effective form.
  TrackPtr Changed(const std::function<void(nlohmann::json&)>& change) const;
  // A ranked submission under `base_` that was played by `grader`, done; its artefact's files are
  // there. `crashes`: it failed, as each of its episodes was ended by its own fault. Only while
  // nothing runs.
  int64_t Played(const std::string& team, const nlohmann::json& grader, bool crashes = false);
  // The same as a live one, through the engine. Returns its evaluation.
  Accepted Submit(const std::string& team);

  NewRejudge To(const TrackPtr& track) const;
  absl::StatusOr<RejudgePlan> Create(const NewRejudge& rejudge);
  absl::StatusOr<RejudgeDone> Apply(int64_t rejudge, std::set<int64_t> without = {});
  absl::StatusOr<RejudgeDone> Drop(int64_t rejudge);
  RejudgeProgress Progress(int64_t rejudge);
  std::vector<EvaluationRow> Items(int64_t rejudge);
  // Whether one of them is running.
  bool Plays(int64_t rejudge);
  std::string StateOf(int64_t evaluation);
  // Waits until `holds`; fails the test after 30 s.
  void Await(const std::function<bool()>& holds, const std::string& what);
  void AwaitComplete(int64_t rejudge);
  template <typename Body>
  void Read(Body body) {
    const absl::Status status = readers_->Read([&](const Transaction& reader) {
      body(reader);
      return absl::OkStatus();
    });
    EXPECT_TRUE(status.ok()) << status;
  }

  const nlohmann::json today_ = {
      {"simulator", "a"}, {"mujoco", "b"}, {"models", {{"arm.mjb", "c"}}}};
  std::string dir_;
  int slots_ = 2;
  Playing playing_;
  TrackPtr base_;
  int artefacts_ = 0;
  std::unique_ptr<Executor> processes_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<ReaderPool> readers_;
  std::unique_ptr<CutDisk> disk_;
  std::unique_ptr<Engine> engine_;
  std::unique_ptr<Rejudger> rejudger_;
  std::thread loop_;
};

}  // namespace myograde::server
