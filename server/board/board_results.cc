// What counts on which board at a moment: results, choices, marks and configs.
#include <algorithm>
#include <tuple>
#include <utility>

#include "server/board/board_state.h"

namespace myograde::server {
namespace {

// The newest of some rows before a moment; nullptr: none.
template <typename Row>
const Row* NewestBefore(const std::vector<Row>& rows, int64_t before_ms) {
  for (auto row = rows.rbegin(); row != rows.rend(); ++row) {
    if (row->at < before_ms) return &*row;
  }
  return nullptr;
}

}  // namespace

// --- what counts ---

std::map<int64_t, const BoardResult*> BoardState::Deciding(const std::string& config,
                                                           const BoardMoment& moment,
                                                           int64_t before_ms) const {
  std::map<int64_t, int64_t> applied;  // rejudges, by the acts that applied them
  for (const auto& [id, rejudge] : rejudges_) {
    if (rejudge.to_config != config || rejudge.purpose != RejudgePurpose::kRules ||
        id == moment.assumed_rejudge || id == moment.ignored_rejudge) {
      continue;
    }
    const RejudgeEventRow* last = NewestBefore(rejudge.events, moment.results_before_ms());
    if (last != nullptr && last->event == RejudgeEvent::kApplied) applied[last->id] = id;
  }
  const RejudgeRow* assumed = Rejudge(moment.assumed_rejudge);
  if (assumed != nullptr && assumed->to_config == config) applied[INT64_MAX] = assumed->id;
  std::map<int64_t, const BoardResult*> deciding;
  const auto add = [&](const std::vector<int64_t>& evaluations) {
    for (const int64_t evaluation : evaluations) {
      const BoardResult& result = results_.at(evaluation);
      if (result.at >= before_ms || !submissions_.contains(result.submission)) continue;
      deciding[result.submission] = &result;
    }
  };
  add(FindOrNone(originals_, config));
  for (const auto& [act, rejudge] : applied) add(FindOrNone(rejudged_, rejudge));
  return deciding;
}

std::map<int64_t, const BoardResult*> BoardState::InForce(const std::string& config,
                                                          const BoardMoment& moment) const {
  auto in_force = Deciding(config, moment, moment.results_before_ms());
  std::erase_if(in_force, [](const auto& entry) { return !entry.second->graded; });
  return in_force;
}

std::vector<StandingRow> BoardState::Candidates(const std::string& config,
                                                const BoardMoment& moment) const {
  std::vector<StandingRow> rows;
  const std::set<int64_t> chosen = Chosen(config, moment);
  for (const auto& [submission, result] : InForce(config, moment)) {
    const TeamState* team = TeamOf(submission);
    if (result->failed || team == nullptr || team->banned) continue;
    rows.push_back({.submission = submission,
                    .evaluation = result->evaluation,
                    .team = team->name,
                    .chosen = chosen.contains(submission),
                    .rejudge = result->rejudge});
  }
  return rows;
}

bool BoardState::Withholds(const std::string& config, const BoardMoment& moment) const {
  if (moment.freeze_ms >= moment.before_ms) return false;
  return std::ranges::any_of(Deciding(config, moment, moment.before_ms), [&](const auto& entry) {
    const auto& [submission, result] = entry;
    const TeamState* team = TeamOf(submission);
    return result->at >= moment.freeze_ms && (result->rejudge != 0 || result->stands()) &&
           team != nullptr && !team->banned;
  });
}

// More than what stands under from_config now, as a rejudge that was dropped may be applied again.
std::set<int64_t> BoardState::NeededByRejudges() const {
  std::set<int64_t> needed;
  for (const auto& [id, rejudge] : rejudges_) {
    if (rejudge.purpose != RejudgePurpose::kRules || rejudge.last() != RejudgeEvent::kCreated) {
      continue;
    }
    for (const auto& [evaluation, result] : results_) {
      if (result.config == rejudge.from_config) needed.insert(result.submission);
    }
  }
  return needed;
}

std::set<int64_t> BoardState::Chosen(const std::string& config, const BoardMoment& moment) const {
  if (choices_.empty()) return {};
  const auto deciding = Deciding(config, moment, moment.results_before_ms());
  std::map<int64_t, int64_t> by_team;
  for (const Choice& choice : choices_) {
    const auto found = submissions_.find(choice.submission);
    if (choice.at >= moment.results_before_ms() || found == submissions_.end()) continue;
    if (found->second.config != config && !deciding.contains(choice.submission)) continue;
    by_team[TeamInForce(found->second.team)] = choice.submission;
  }
  std::set<int64_t> chosen;
  for (const auto& [team, submission] : by_team) chosen.insert(submission);
  return chosen;
}

Marks BoardState::MarksAt(int64_t before_ms) const {
  Marks marks;
  for (const auto& [submission, history] : marks_) {
    for (const MarkRow& mark : history) {
      if (mark.at >= before_ms) continue;
      if (mark.set) {
        marks[{submission, mark.mark}] = mark;
      } else {
        marks.erase({submission, mark.mark});
      }
    }
  }
  return marks;
}

int64_t BoardState::ChangedAt(const std::string& config, const std::string& phase,
                              const BoardMoment& moment) const {
  const int64_t before = moment.results_before_ms();
  int64_t changed = 0;
  const auto note = [&](int64_t at, int64_t limit) {
    if (at < limit) changed = std::max(changed, at);
  };
  std::set<int64_t> own;
  std::set<int64_t> teams;
  for (const auto& [id, submission] : submissions_) {
    if (submission.config == config) own.insert(id);
  }
  for (const auto& [id, rejudge] : rejudges_) {
    for (const RejudgeEventRow& event : rejudge.events) {
      const bool created = event.event == RejudgeEvent::kCreated;
      if (!created && (rejudge.from_config == config || rejudge.to_config == config)) {
        note(event.at, before);
      }
    }
  }
  for (const auto& [evaluation, result] : results_) {
    if (result.config != config || !submissions_.contains(result.submission)) continue;
    own.insert(result.submission);
    if (result.stands()) note(result.at, before);
  }
  for (const int64_t id : own) teams.insert(TeamInForce(submissions_.at(id).team));
  for (const auto& [submission, history] : marks_) {
    if (!own.contains(submission)) continue;
    for (const MarkRow& mark : history) note(mark.at, moment.before_ms);
  }
  for (const Choice& choice : choices_) {
    if (own.contains(choice.submission)) note(choice.at, before);
  }
  for (const auto& [id, team] : teams_) {
    if (!teams.contains(TeamInForce(id))) continue;
    for (const TeamEventRow& event : team.events) {
      if (event.event != "created") note(event.at, moment.before_ms);
    }
  }
  for (const auto& [board, rows] : configs_) {
    for (const BoardConfigRow& row : rows) {
      if (row.config == config) note(row.at, before);
    }
  }
  if (phase.empty()) return changed;
  for (const PhaseEventRow& event : Phase(phase).events) {
    if (event.event == kPublishedEvent || event.event == kRevealedEvent) {
      note(event.at, moment.before_ms);
    }
  }
  return changed;
}

// --- configs ---

std::string BoardState::ConfigAt(const BoardName& board, int64_t before_ms) const {
  if (const BoardConfigRow* row = NewestBefore(ConfigsOf(board), before_ms)) return row->config;
  const AcceptedSubmission* found = nullptr;
  for (const auto& [id, submission] : submissions_) {
    if (submission.board != board) continue;
    if (found == nullptr || submission.at < before_ms) found = &submission;
  }
  return found == nullptr ? "" : found->config;
}

const std::vector<BoardConfigRow>& BoardState::ConfigsOf(const BoardName& board) const {
  return FindOrNone(configs_, board);
}

std::string BoardState::ConfigOfPhase(const std::string& phase) const {
  if (phase.empty()) return "";
  const BoardConfigRow* newest = nullptr;
  for (const auto& [board, rows] : configs_) {
    if (board.phase != phase || rows.empty()) continue;
    if (newest == nullptr || newest->id < rows.back().id) newest = &rows.back();
  }
  if (newest != nullptr) return newest->config;
  for (auto submission = submissions_.rbegin(); submission != submissions_.rend(); ++submission) {
    if (submission->second.board.phase == phase) return submission->second.config;
  }
  return "";
}

std::vector<OtherConfig> BoardState::OtherConfigs(const BoardName& board, const std::string& config,
                                                  const BoardMoment& moment) const {
  std::set<std::string> hashes;
  for (const auto& [hash, evaluations] : originals_) hashes.insert(hash);
  for (const auto& [id, rejudge] : rejudges_) hashes.insert(rejudge.to_config);
  hashes.erase(config);
  const auto here = Deciding(config, moment, moment.results_before_ms());
  std::vector<OtherConfig> others;
  for (const std::string& hash : hashes) {
    OtherConfig other{.config = hash};
    std::set<int64_t> teams;
    for (const auto& [id, result] : InForce(hash, {.before_ms = moment.results_before_ms()})) {
      const AcceptedSubmission& submission = submissions_.at(id);
      if (submission.board != board || !result->stands()) continue;
      teams.insert(TeamInForce(submission.team));
      other.left += submission.config == hash && !here.contains(id);
      other.first_at =
          ++other.submissions == 1 ? submission.at : std::min(other.first_at, submission.at);
      other.last_at = std::max(other.last_at, submission.at);
    }
    other.teams = std::ssize(teams);
    if (other.submissions > 0) others.push_back(std::move(other));
  }
  std::ranges::sort(others, {}, [](const OtherConfig& other) {
    return std::tie(other.first_at, other.config);
  });
  return others;
}

std::set<std::string> BoardState::ConfigsLike(const std::string& prefix,
                                              bool of_open_rejudges) const {
  std::set<std::string> configs;
  for (const auto& [id, submission] : submissions_) configs.insert(submission.config);
  for (const auto& [board, rows] : configs_) {
    for (const BoardConfigRow& row : rows) configs.insert(row.config);
  }
  for (const auto& [id, rejudge] : rejudges_) {
    if (of_open_rejudges) configs.insert(rejudge.to_config);
  }
  std::erase_if(configs, [&](const std::string& hash) { return !hash.starts_with(prefix); });
  return configs;
}

}  // namespace myograde::server
