// What the entries of a public record (server/store/record.h) say, taken together.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <nlohmann/json.hpp>

#include "server/grading/leaderboard.h"

namespace myograde::server {

struct RecordedSubmission {
  int64_t entry = 0;  // its index
  int64_t team = 0;   // id
  std::string track;
  std::string profile;
  std::string phase;  // "": none
  std::string config;
  std::string artefact;  // ArtefactCommitment
};

struct RecordedResult {
  int64_t entry = 0;  // its index
  int64_t submission = 0;
  bool graded = false;  // it has a result: done, or failed
  int64_t rejudge = 0;  // 0: it is the submission's original
  int64_t repetition = 1;
  std::string config;
};

struct RecordedTeam {
  std::string name;
  bool banned = false;
  int64_t into = 0;  // the team that it was merged into; 0: none
};

struct RecordedPhase {
  std::string commitment;  // "": its seeds are public
  int64_t commitment_entry = 0;  // its index
  bool further = false;    // committed to for further episodes, of a phase with public seeds
  std::string secret;      // digits; "": it was not revealed here
  bool published = false;
  bool revealed = false;
};

class RecordState {
 public:
  // Adds an entry, in the record's order. InvalidArgumentError says what is wrong with it.
  absl::Status Add(int64_t index, const nlohmann::json& entry);

  const std::map<int64_t, RecordedSubmission>& submissions() const { return submissions_; }
  const std::map<int64_t, RecordedResult>& results() const { return results_; }  // by evaluation
  const std::map<std::string, RecordedPhase>& phases() const { return phases_; }
  const Marks& marks() const { return marks_; }
  // The newest key; "": none is named.
  const std::string& key() const { return key_; }
  // The entry of the newest rejudge that was created; -1: none was.
  int64_t newest_rejudge() const { return newest_rejudge_; }
  // Entries that stand for rows which could not be read.
  int64_t unreadable() const { return unreadable_; }

  // The team that a submission stands for now, or nullptr.
  const RecordedTeam* TeamOf(int64_t submission) const;
  // The evaluation that counts under a config of each of its ranked submissions.
  std::map<int64_t, int64_t> InForce(const std::string& config) const;
  // The submissions that teams stand with under a config, where they choose.
  std::set<int64_t> Chosen(const std::string& config) const;
  bool WasApplied(int64_t rejudge) const { return ever_applied_.contains(rejudge); }

 private:
  struct Applied {
    int64_t entry = 0;
    std::string to_config;
  };

  absl::Status AddAccepted(int64_t index, const nlohmann::json& entry);
  absl::Status AddGraded(int64_t index, const nlohmann::json& entry);
  absl::Status AddCommitment(int64_t index, const nlohmann::json& entry);
  void AddMark(const nlohmann::json& entry);
  void AddTeam(const nlohmann::json& entry);
  void AddPhase(const nlohmann::json& entry);
  void AddRejudge(int64_t index, const nlohmann::json& entry);
  int64_t TeamInForce(int64_t team) const;
  // Ids of the rejudges that count under a config, in the order in which they were applied.
  std::vector<int64_t> AppliedTo(const std::string& config) const;

  std::map<int64_t, RecordedSubmission> submissions_;
  std::map<int64_t, RecordedResult> results_;
  std::map<int64_t, RecordedTeam> teams_;
  std::map<std::string, RecordedPhase> phases_;
  std::map<int64_t, Applied> applied_;  // by rejudge
  std::set<int64_t> ever_applied_;
  int64_t newest_rejudge_ = -1;
  std::vector<int64_t> choices_;        // submissions, oldest first
  Marks marks_;
  std::string key_;
  int64_t unreadable_ = 0;
};

}  // namespace myograde::server
