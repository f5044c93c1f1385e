// What counts on which board: a fold of the acts of the journal, one at a time. The daemon folds
// its journal once and applies each act as it is written (server/store/journal.h); whoever holds a
// public record folds its entries. Both have the same boards. Pure.
//
// What happened has its time, so one state answers for every moment: a board at a time, a frozen
// one, or one as it would be if a rejudge were applied.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include <absl/status/status.h>

#include "server/board/acts.h"

namespace myograde::server {

struct AcceptedSubmission {  // a ranked one
  int64_t id = 0;
  int64_t entry = 0;  // index in the public record
  int64_t at = 0;
  int64_t team = 0;  // id, as it was then
  BoardName board;
  std::string config;
  std::string artefact;  // ArtefactCommitment
};

// How a ranked evaluation ended that may decide a board: the original, or a rejudge's.
struct BoardResult {
  int64_t evaluation = 0;
  int64_t entry = 0;  // index in the public record
  int64_t at = 0;
  int64_t submission = 0;
  std::string config;
  int64_t rejudge = 0;  // 0: it is the submission's original
  bool graded = false;  // it has a result
  bool failed = false;  // a result that stands on no board; false where that is private

  bool stands() const { return graded && !failed; }
};

// A candidate row of a board.
struct StandingRow {
  int64_t submission = 0;
  int64_t evaluation = 0;
  std::string team;
  bool chosen = false;  // by its team, where teams choose
  int64_t rejudge = 0;  // whose evaluation it is; 0: it is the original
  // Not of the journal:
  std::string artefact_name = {};
  nlohmann::json aggregate = {};  // what it is ranked by (AggregateToJson)
};

struct TeamState {
  std::string name;
  bool banned = false;
  int64_t into = 0;  // the team that it was merged into; 0: none
  std::vector<TeamEventRow> events;
};

struct PhaseCommitment {
  std::string commitment;
  bool further = false;  // committed to for further episodes, of a phase with public seeds
  int64_t entry = 0;     // index in the public record
};

struct PhaseHistory {
  std::vector<PhaseCommitment> commitments;  // oldest first
  std::vector<PhaseEventRow> events;
  std::string secret;  // digits; "": it was not revealed here

  bool Has(const char* event) const;
  // The newest event with one of two names; nullptr: there is none.
  const PhaseEventRow* Newest(const std::string& one, const std::string& other) const;
  // The pause in force; nullptr: there is none.
  const PhaseEventRow* Pause() const;
};

// Ranked submissions of a board that stand under another config than the one asked about.
struct OtherConfig {
  std::string config;       // its hash
  int64_t submissions = 0;  // that have a result under it
  int64_t left = 0;         // of those accepted under it, without one under the config asked about
  int64_t teams = 0;
  int64_t first_at = 0;  // when the earliest and the latest of them were accepted
  int64_t last_at = 0;
};

class BoardState {
 public:
  // Applies an act, in the journal's order. InvalidArgumentError says what is wrong with it;
  // nothing of it is applied then.
  absl::Status Add(const Act& act);

  // The id of the newest act, and of the newest that can touch a board; 0: none.
  int64_t last() const { return last_; }
  int64_t board_changes() const { return board_changes_; }

  const std::map<int64_t, AcceptedSubmission>& submissions() const { return submissions_; }
  const std::map<int64_t, BoardResult>& results() const { return results_; }
  const std::map<std::string, PhaseHistory>& phases() const { return phases_; }
  const std::map<int64_t, RejudgeRow>& rejudges() const { return rejudges_; }
  // The newest key; "": none is named.
  const std::string& key() const { return key_; }
  // What Add refused: the act's id, and why.
  const std::map<int64_t, std::string>& damaged() const { return damaged_; }

  // --- what counts ---

  // By submission, the evaluation by which it stands under a config: its own, in whose place each
  // applied rejudge to the config, the earliest first, puts the one that it ended with. One without
  // a result takes the submission off the board. A banned team's are among them.
  std::map<int64_t, const BoardResult*> InForce(const std::string& config,
                                                const BoardMoment& moment = {}) const;
  // The rows that may stand on the board: those in force, by submission, but for what failed, as far
  // as that is known here, and for banned teams. What the journal does not tell is left empty.
  std::vector<StandingRow> Candidates(const std::string& config,
                                      const BoardMoment& moment = {}) const;
  // Whether a freeze leaves out some of them.
  bool Withholds(const std::string& config, const BoardMoment& moment) const;
  // The submissions that teams stand with where they choose: each team's newest choice of those
  // that belong to the config's board. If that one has no result, the team is not on the board.
  std::set<int64_t> Chosen(const std::string& config, const BoardMoment& moment = {}) const;
  // Those that a rejudge which is neither applied nor dropped may have to play.
  std::set<int64_t> NeededByRejudges() const;
  Marks MarksAt(int64_t before_ms = INT64_MAX) const;
  // When anything last happened that may have changed the board of a config, or 0: a result, a
  // mark, a choice, a rejudge, an act on a team or the phase.
  int64_t ChangedAt(const std::string& config, const std::string& phase,
                    const BoardMoment& moment) const;

  // --- configs ---

  // The config that a board had at a moment: its newest before it, else that of its latest
  // submission before it, else of its first; "": it never had one.
  std::string ConfigAt(const BoardName& board, int64_t before_ms = INT64_MAX) const;
  // What the board was given, oldest first.
  const std::vector<BoardConfigRow>& ConfigsOf(const BoardName& board) const;
  // The config that a phase has, else that of its latest submission; "": it has none.
  std::string ConfigOfPhase(const std::string& phase) const;
  // The other configs of a board that ranked submissions stand under, the earliest first.
  std::vector<OtherConfig> OtherConfigs(const BoardName& board, const std::string& config,
                                        const BoardMoment& moment) const;
  // Hashes that begin with `prefix`, of configs that a board has or had, or has been rejudged to;
  // also by rejudges that were never applied, if asked for.
  std::set<std::string> ConfigsLike(const std::string& prefix, bool of_open_rejudges) const;

  // --- teams, marks, phases, rejudges ---

  // The team that a submission stands for now; nullptr: there is none.
  const TeamState* TeamOf(int64_t submission) const;
  // Of a team and of those that were merged into it, oldest first.
  std::vector<TeamEventRow> TeamEvents(int64_t team) const;
  // Oldest first.
  const std::vector<MarkRow>& MarkHistory(int64_t submission) const;
  // Of a phase, or ("") of all submissions.
  const PhaseHistory& Phase(const std::string& phase) const { return FindOrNone(phases_, phase); }
  // Whether the record has committed to hidden seeds of the phase.
  bool HasCommitted(const std::string& phase) const;
  // nullptr: there is none.
  const RejudgeRow* Rejudge(int64_t id) const;
  bool WasApplied(int64_t rejudge) const;
  // Whether evaluations of a rejudge (0: of none) are not the organisers' alone: it was applied at
  // some time, or it has further episodes and the seeds of its phase are revealed.
  bool IsShown(int64_t rejudge) const;
  // The submission that a team chose last on a board; 0: none.
  int64_t NewestChoice(int64_t team, const BoardName& board) const;

 private:
  struct Choice {
    int64_t at = 0;
    int64_t submission = 0;
  };

  // The value of a key, or an empty one.
  template <typename Map>
  static const typename Map::mapped_type& FindOrNone(const Map& map,
                                                     const typename Map::key_type& key) {
    static const typename Map::mapped_type kNone;
    const auto found = map.find(key);
    return found == map.end() ? kNone : found->second;
  }

  absl::Status Apply(const Act& act);
  absl::Status AddAccepted(const Act& act);
  absl::Status AddGraded(const Act& act);
  absl::Status AddCommitment(const Act& act);
  void AddMark(const Act& act);
  void AddTeam(const Act& act);
  void AddPhase(const Act& act);
  void AddConfig(const Act& act);
  void AddRejudge(const Act& act);
  int64_t TeamInForce(int64_t team) const;
  // By submission, what decides its place on a config's board, of what ended before a moment: the
  // original, or in its place the result of the rejudge that was applied last.
  std::map<int64_t, const BoardResult*> Deciding(const std::string& config,
                                                 const BoardMoment& moment,
                                                 int64_t before_ms) const;

  int64_t last_ = 0;
  int64_t board_changes_ = 0;
  std::map<int64_t, AcceptedSubmission> submissions_;
  std::map<int64_t, BoardResult> results_;                 // by evaluation
  std::map<std::string, std::vector<int64_t>> originals_;  // evaluations, by config
  std::map<int64_t, std::vector<int64_t>> rejudged_;       // first repetitions, by rejudge
  std::map<int64_t, TeamState> teams_;
  std::map<std::string, PhaseHistory> phases_;
  std::map<int64_t, RejudgeRow> rejudges_;
  std::map<BoardName, std::vector<BoardConfigRow>> configs_;
  std::vector<Choice> choices_;
  std::map<int64_t, std::vector<MarkRow>> marks_;
  std::string key_;
  std::map<int64_t, std::string> damaged_;
};

}  // namespace myograde::server
