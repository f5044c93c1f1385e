// What is checked before a rejudge is created, what it will do, and what carries it out.
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

// How the submissions that a new rejudge finds will get their results.
struct RejudgePlan {
  int64_t rejudge = 0;  // its id, once it is created
  int64_t submissions = 0;
  int64_t facts = 0;  // items
  int64_t play = 0;
  // Submissions that have to be played and can't be, most as their files are no longer on this host,
  // sorted: they will be without a result.
  std::vector<int64_t> without_files;
};

// What it would do now. The artefacts' files are those in `data_dir`. InvalidArgumentError, in one
// sentence: `repeats` out of range, submissions listed for a purpose that takes none, facts asked for
// where more than scoring differs or where repetitions are, a listed submission without a result that
// further episodes could be added to, ...
absl::StatusOr<RejudgePlan> PlanRejudge(const Transaction& reader, const NewRejudge& rejudge,
                                        const std::string& data_dir);

struct RejudgerOptions {
  std::string data_dir;
  std::function<nlohmann::json()> grader;          // this host's build (GraderBuild)
  absl::Duration every = absl::Milliseconds(250);  // between checks for something new
};

// A thread that finds the items that open rejudges lack (at their creation, when an evaluation
// under from_config ends, and after a restart), computes those that follow from facts, and has the
// others queued. It writes a few items at a time through the engine, so that grading never waits
// long; stopping it at any moment loses nothing.
class Rejudger {
 public:
  // Everything but `options` must outlive it. The engine's loop must run, as it writes the items.
  Rejudger(RejudgerOptions options, Engine& engine, ReaderPool& readers);

 private:
  // What an open rejudge lacks, and what its items need.
  struct Work {
    RejudgeRow rejudge;
    std::vector<EvaluationRow> missing;
    TrackPtr track;  // of to_config
    SeedsPtr seeds;
    bool same_facts = false;
  };

  void Loop();
  // An error: something has to be tried again.
  absl::Status LookForWork();
  absl::StatusOr<Work> FindWork(const Transaction& reader, RejudgeRow rejudge);
  absl::Status Carry(const Work& work);
  absl::StatusOr<NewRejudgeItem> Make(const Transaction& reader, const Work& work,
                                      const EvaluationRow& candidate, const nlohmann::json& today);

  const RejudgerOptions options_;
  Engine& engine_;
  ReaderPool& readers_;
  StoredContent content_;
  int64_t seen_ = -1;  // BoardState::last() before the last check that left nothing to do
  std::stop_token stop_;  // only of the thread
  std::jthread thread_;
};

}  // namespace myograde::server
