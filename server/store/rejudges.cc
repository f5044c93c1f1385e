#include "server/store/rejudges.h"

#include <algorithm>
#include <map>
#include <set>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/base/enum_names.h"
#include "server/store/differences.h"
#include "server/store/reader_pool.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

constexpr std::string_view kStates[] = {"computing", "ready", "applied", "dropped"};

// What a board's submissions have as their results under from_config, and which of them a rejudge
// has no evaluation of; first repetitions first. `latest`: the latest acceptance that counts.
std::vector<RejudgeCandidate> Candidates(SQLite::Database& db, const BoardState& board,
                                         const RejudgeRow& rejudge, int64_t latest) {
  std::set<std::pair<int64_t, int64_t>> there;
  Statement select(db, "SELECT submission, repetition FROM evaluation WHERE rejudge = ?",
                   rejudge.id);
  while (select.executeStep()) {
    there.emplace(select.getColumn(0).getInt64(), select.getColumn(1).getInt64());
  }
  const auto in_force = board.InForce(rejudge.from_config, {.ignored_rejudge = rejudge.id});
  std::vector<RejudgeCandidate> candidates;
  for (int64_t repetition = 1; repetition <= rejudge.repeats; ++repetition) {
    for (const auto& [submission, result] : in_force) {
      const AcceptedSubmission& accepted = board.submissions().at(submission);
      if (accepted.board != rejudge.board() || accepted.at > latest) continue;
      if (there.contains({submission, repetition})) continue;
      candidates.push_back({rejudge.id, submission, result->evaluation, repetition});
    }
  }
  return candidates;
}

}  // namespace

std::string_view RejudgeStateName(RejudgeProgress::State state) { return NameIn(kStates, state); }

absl::StatusOr<RejudgeRow> Rejudges::Find(int64_t id) const {
  const RejudgeRow* rejudge = Board().Rejudge(id);
  if (rejudge != nullptr) return *rejudge;
  return absl::NotFoundError(absl::StrCat("there is no rejudge ", id));
}

absl::StatusOr<RejudgeProgress> Rejudges::CountProgress(const RejudgeRow& rejudge) const {
  ASSIGN_OR_RETURN(std::vector<EvaluationRow> items, Evaluations(context_).OfRejudge(rejudge.id));
  RejudgeProgress progress;
  std::set<int64_t> submissions;
  for (const EvaluationRow& item : items) {
    submissions.insert(item.submission);
    ++progress.items;
    ++(item.method == RejudgeMethod::kFacts ? progress.facts : progress.play);
    progress.ended += IsFinal(item.state);
    progress.cancelled += item.state == EvaluationState::kCancelled;
    const bool has_result = item.state != EvaluationState::kGraderError &&
                            item.state != EvaluationState::kCancelled;
    if (item.repetition == 1 && !has_result) progress.without_result.push_back(item.submission);
  }
  for (const RejudgeCandidate& candidate : MissingItems(rejudge)) {
    submissions.insert(candidate.submission);
    ++progress.missing;
  }
  progress.submissions = std::ssize(submissions);
  Statement episodes(db_, R"(SELECT ifnull(sum(e.last - e.first + 1),
      0), ifnull(sum(CASE WHEN e.state = 'done' THEN e.last - e.first + 1 ELSE
      (SELECT count(*) FROM episode WHERE evaluation = e.id) END), 0)
      FROM evaluation AS e WHERE e.rejudge = ?)",
                     rejudge.id);
  episodes.executeStep();
  progress.episodes = episodes.getColumn(0).getInt64();
  progress.episodes_done = episodes.getColumn(1).getInt64();
  const bool dropped = rejudge.last() == RejudgeEvent::kDropped;
  progress.complete = progress.missing == 0 && progress.ended == progress.items &&
                      !(dropped && progress.cancelled > 0);
  using State = RejudgeProgress::State;
  progress.state = rejudge.last() == RejudgeEvent::kApplied ? State::kApplied
                   : dropped                                ? State::kDropped
                   : progress.complete                      ? State::kReady
                                                            : State::kComputing;
  return progress;
}

std::vector<RejudgeCandidate> Rejudges::MissingItems(const RejudgeRow& rejudge) const {
  if (rejudge.purpose != RejudgePurpose::kRules) return {};
  // Where the config stays, what was accepted after it was applied has its result under it.
  int64_t latest = INT64_MAX;
  for (const RejudgeEventRow& event : rejudge.events) {
    const bool applied = event.event == RejudgeEvent::kApplied;
    if (applied && rejudge.from_config == rejudge.to_config) latest = std::min(latest, event.at);
  }
  return Candidates(db_, Board(), rejudge, latest);
}

std::vector<RejudgeCandidate> Rejudges::CandidatesFor(const NewRejudge& rejudge) const {
  std::vector<RejudgeCandidate> candidates = Candidates(db_, Board(), rejudge, INT64_MAX);
  if (rejudge.purpose == RejudgePurpose::kSeeds) {
    const std::set<int64_t> listed(rejudge.submissions.begin(), rejudge.submissions.end());
    std::erase_if(candidates, [&](const RejudgeCandidate& candidate) {
      return !listed.contains(candidate.submission);
    });
  }
  return candidates;
}

absl::StatusOr<std::vector<Unrepeatable>> Rejudges::ListUnrepeatable(int64_t rejudge) const {
  ASSIGN_OR_RETURN(std::vector<EvaluationRow> items, Evaluations(context_).OfRejudge(rejudge));
  std::map<int64_t, Unrepeatable> found;
  const auto add = [&](int64_t submission, Unrepeatable::Episode episode) {
    found[submission].submission = submission;
    found[submission].episodes.push_back(std::move(episode));
  };
  const EvaluationRow* first = nullptr;
  std::vector<EpisodeRow> episodes;  // of `first`, once they are needed
  for (const EvaluationRow& item : items) {
    ASSIGN_OR_RETURN(std::vector<RepeatRow> repeats, Episodes(context_).Repeats(item.id));
    for (const RepeatRow& repeat : repeats) {
      add(item.submission, {repeat.index, item.repetition, repeat.differs});
    }
    if (item.results_hash.empty()) continue;  // it has none, or not yet
    if (first == nullptr || first->submission != item.submission) {
      first = &item;
      episodes.clear();
      continue;
    }
    if (item.results_hash == first->results_hash) continue;
    if (episodes.empty()) {
      ASSIGN_OR_RETURN(episodes, Episodes(context_).Of(first->id));
    }
    ASSIGN_OR_RETURN(const std::vector<EpisodeRow> others, Episodes(context_).Of(item.id));
    for (size_t i = 0; i < std::min(episodes.size(), others.size()); ++i) {
      std::vector<std::string> differs = DifferencesBetween(episodes[i], others[i]);
      if (differs.empty()) continue;
      add(item.submission, {others[i].index, item.repetition, std::move(differs)});
    }
  }
  std::vector<Unrepeatable> listed;
  for (auto& [submission, entry] : found) listed.push_back(std::move(entry));
  return listed;
}

}  // namespace myograde::server
