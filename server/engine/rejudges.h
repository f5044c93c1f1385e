// Carries out rejudges: a thread that finds the items that open ones lack (at their creation, when an
// evaluation under from_config ends, and after a restart), computes those that follow from facts, and
// has the others queued. It writes a few items at a time through the engine, so that grading never
// waits long; stopping it at any moment loses nothing.
#pragma once

#include <functional>
#include <string>
#include <stop_token>
#include <thread>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>
#include <nlohmann/json.hpp>

#include "server/engine/engine.h"
#include "server/engine/stored.h"

namespace myograde::server {

struct RejudgerOptions {
  std::string data_dir;
  std::function<nlohmann::json()> grader;          // this host's build (GraderBuild)
  absl::Duration every = absl::Milliseconds(250);  // between checks for something new
};

class Rejudger {
 public:
  // Everything but `options` must outlive it. The engine's loop must run, as it writes the items.
  Rejudger(RejudgerOptions options, Engine& engine, ReaderPool& readers);

 private:
  // What an open rejudge lacks, and what its items need.
  struct Work {
    RejudgeRow rejudge;
    std::vector<NewEvaluation> missing;
    TrackPtr track;  // of to_config
    SeedsPtr seeds;
    bool same_facts = false;
  };
  using Items = std::vector<NewRejudgeItem>;

  void Loop();
  // An error: something has to be tried again.
  absl::Status LookForWork();
  absl::StatusOr<std::vector<Work>> OpenWork();
  absl::StatusOr<Work> FindWork(const Transaction& reader, RejudgeRow rejudge);
  absl::Status Carry(const Work& work);
  absl::StatusOr<NewRejudgeItem> ItemOf(const Transaction& reader, const Work& work,
                                        const NewEvaluation& candidate,
                                        const nlohmann::json& today);
  absl::Status Write(Items items);

  const RejudgerOptions options_;
  Engine& engine_;
  ReaderPool& readers_;
  StoredContent content_;
  int64_t seen_ = -1;  // BoardState::last() before the last check that left nothing to do
  std::stop_token stop_;  // only of the thread
  std::jthread thread_;
};

}  // namespace myograde::server
