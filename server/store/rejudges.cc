#include "server/store/rejudges.h"

#include <algorithm>
#include <map>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/store/differences.h"
#include "server/store/reader.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

constexpr std::string_view kPurposes[] = {"rules", "seeds"};
constexpr std::string_view kMethods[] = {"auto", "facts", "play"};
constexpr std::string_view kEvents[] = {"created", "applied", "dropped"};
constexpr std::string_view kStates[] = {"computing", "ready", "applied", "dropped"};

constexpr char kRejudgeColumns[] =
    "SELECT id, at, purpose, phase, track, profile, from_config, to_config, seeds, method, repeats, "
    "who, why FROM rejudge ";

StoredRow RejudgeRowOf(SQLite::Statement& select, RejudgeRow& rejudge) {
  StoredRow row(select, "rejudge");
  rejudge.id = row.Id(0);
  rejudge.at = row.Time(1);
  rejudge.purpose = row.Named(2, ParseRejudgePurpose);
  row.TextsInto(3, {&rejudge.phase, &rejudge.track, &rejudge.profile});
  rejudge.from_config = row.Hash(6);
  rejudge.to_config = row.Hash(7);
  rejudge.seeds = row.Hash(8);
  rejudge.method = row.Named(9, ParseRejudgeMethod);
  rejudge.repeats = row.Number(10, 1, kMostRepeats);
  rejudge.who = row.Text(11);
  rejudge.why = row.Text(12);
  return row;
}

StoredRow RejudgeEventOf(SQLite::Statement& select, RejudgeEventRow& event) {
  StoredRow row(select, "rejudge_event");
  event.id = row.Id(0);
  event.at = row.Time(1);
  event.rejudge = row.Id(2);
  event.event = row.Named(3, ParseRejudgeEvent);
  event.who = row.Text(4);
  event.why = row.Text(5);
  event.document_json = row.Object(6);
  event.signature = row.Text(7);
  return row;
}

constexpr char kItemColumns[] =
    "SELECT i.rejudge, i.submission, i.repetition, i.source, i.method, i.evaluation, e.state, "
    "e.reason, e.results_hash, e.id FROM rejudge_item AS i "
    "LEFT JOIN evaluation AS e ON e.id = i.evaluation ";

StoredRow ItemOf(SQLite::Statement& select, RejudgeItemRow& item) {
  StoredRow row(select, "rejudge_item",
                absl::StrCat(Shown(select.getColumn(0)), "/", Shown(select.getColumn(1)), "/",
                             Shown(select.getColumn(2))));
  item.rejudge = row.Id(0);
  item.submission = row.Id(1);
  item.repetition = row.Number(2, 1, kMostRepeats);
  item.source = row.Id(3);
  item.method = row.Named(4, ParseRejudgeMethod);
  item.evaluation = row.Id(5);
  row.Joined("evaluation", 9);
  item.state = row.Named(6, ParseEvaluationState);
  item.reason = row.Text(7);
  item.results_hash = row.TextOr(8);
  return row;
}

// The event in force of a rejudge `q`.
constexpr char kInForce[] =
    "(SELECT event FROM rejudge_event WHERE rejudge = q.id ORDER BY id DESC LIMIT 1)";

// What a board's submissions have as their results under a config, and which of them a rejudge has no
// item of: ?1 the config, ?2 the rejudge (0: none yet), ?3 to ?5 the board, ?6 repetitions, ?7 the
// latest acceptance, ?8 the most rows. In force is the evaluation of the rejudge to this config that
// was applied last, or else the original one under it.
std::string MissingSql() {
  const std::string applied =
      absl::StrCat("q.purpose = 'rules' AND q.to_config = ?1 AND q.id != ?2 AND ", kInForce,
                   " = 'applied'");
  return absl::StrCat(
      "WITH RECURSIVE "
      "applied(id, place) AS MATERIALIZED (SELECT q.id, (SELECT max(id) FROM rejudge_event "
      "  WHERE rejudge = q.id) FROM rejudge AS q WHERE ", applied, "), "
      "candidate(id) AS MATERIALIZED ("
      "  SELECT id FROM submission WHERE config = ?1 AND ranked = 1 UNION "
      "  SELECT submission FROM rejudge_item WHERE rejudge IN (SELECT id FROM applied)), "
      "repetition(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM repetition WHERE n < ?6) "
      "SELECT s.id, e.id, n FROM candidate AS c "
      "JOIN submission AS s ON s.id = c.id AND s.ranked = 1 AND s.phase = ?3 AND s.track = ?4 AND "
      "  s.profile = ?5 AND s.accepted_at <= ?7 "
      "JOIN evaluation AS e ON e.id = ifnull("
      "  (SELECT i.evaluation FROM rejudge_item AS i JOIN applied AS a ON a.id = i.rejudge "
      "     WHERE i.submission = s.id AND i.repetition = 1 ORDER BY a.place DESC LIMIT 1), "
      "  (SELECT id FROM evaluation WHERE submission = s.id AND kind = 'original')) "
      "  AND e.state IN ('done', 'failed') "
      "JOIN repetition WHERE NOT EXISTS (SELECT 1 FROM rejudge_item WHERE rejudge = ?2 AND "
      "  submission = s.id AND repetition = n) ORDER BY n, s.id LIMIT ?8");
}

// Of a RejudgeRow or a NewRejudge, whose `id` is 0.
template <typename Rejudge>
std::vector<RejudgeCandidate> Candidates(SQLite::Database& db, const Rejudge& rejudge, int64_t id,
                                         int64_t latest, int64_t limit) {
  return AllRows<RejudgeCandidate, 3>(Statement(db, MissingSql(), rejudge.from_config, id,
                                                rejudge.phase, rejudge.track, rejudge.profile,
                                                rejudge.repeats, latest, limit));
}

}  // namespace

std::string_view RejudgePurposeName(RejudgePurpose purpose) { return NameIn(kPurposes, purpose); }
std::optional<RejudgePurpose> ParseRejudgePurpose(std::string_view name) {
  return ParseIn<RejudgePurpose>(kPurposes, name);
}
std::string_view RejudgeMethodName(RejudgeMethod method) { return NameIn(kMethods, method); }
std::optional<RejudgeMethod> ParseRejudgeMethod(std::string_view name) {
  return ParseIn<RejudgeMethod>(kMethods, name);
}
std::string_view RejudgeEventName(RejudgeEvent event) { return NameIn(kEvents, event); }
std::optional<RejudgeEvent> ParseRejudgeEvent(std::string_view name) {
  return ParseIn<RejudgeEvent>(kEvents, name);
}

std::string_view RejudgeStateName(RejudgeProgress::State state) { return NameIn(kStates, state); }

absl::StatusOr<RejudgeRow> Reader::Rejudge(int64_t id) {
  return FirstOf<RejudgeRow>(Statement(db_, absl::StrCat(kRejudgeColumns, "WHERE id = ?"), id),
                             RejudgeRowOf,
                             absl::NotFoundError(absl::StrCat("there is no rejudge ", id)));
}

Listed<RejudgeRow> Reader::Rejudges(int64_t before, int64_t limit) {
  return ListOf<RejudgeRow>(
      Statement(db_, absl::StrCat(kRejudgeColumns, "WHERE id < ? ORDER BY id DESC LIMIT ?"), before,
                limit),
      RejudgeRowOf);
}

absl::StatusOr<std::vector<RejudgeEventRow>> Reader::RejudgeEvents(int64_t rejudge) {
  absl::StatusOr<std::vector<RejudgeEventRow>> events = AllOf<RejudgeEventRow>(
      Statement(db_, R"(SELECT id, at, rejudge, event, who, why, document_json, signature
          FROM rejudge_event WHERE rejudge = ? ORDER BY id)",
                rejudge),
      RejudgeEventOf);
  if (events.ok() && events->empty()) {
    return DamagedRow({"rejudge", absl::StrCat(rejudge), "it has no event"});
  }
  return events;
}

absl::StatusOr<std::vector<RejudgeItemRow>> Reader::RejudgeItems(int64_t rejudge) {
  return AllOf<RejudgeItemRow>(
      Statement(
          db_,
          absl::StrCat(kItemColumns, "WHERE i.rejudge = ? ORDER BY i.submission, i.repetition"),
          rejudge),
      ItemOf);
}

absl::StatusOr<std::optional<RejudgeItemRow>> Reader::RejudgeItemOf(int64_t evaluation) {
  Statement select(db_, absl::StrCat(kItemColumns, "WHERE i.evaluation = ?"), evaluation);
  if (!select.executeStep()) return std::optional<RejudgeItemRow>();
  RejudgeItemRow item;
  if (const StoredRow row = ItemOf(select, item); !row.ok()) return row.status();
  return std::optional(item);
}

absl::StatusOr<RejudgeProgress> Reader::ProgressOf(const RejudgeRow& rejudge) {
  ASSIGN_OR_RETURN(std::vector<RejudgeEventRow> events, RejudgeEvents(rejudge.id));
  ASSIGN_OR_RETURN(std::vector<RejudgeItemRow> items, RejudgeItems(rejudge.id));
  RejudgeProgress progress;
  std::set<int64_t> submissions;
  for (const RejudgeItemRow& item : items) {
    submissions.insert(item.submission);
    ++progress.items;
    ++(item.method == RejudgeMethod::kFacts ? progress.facts : progress.play);
    progress.waiting += item.state == EvaluationState::kQueued;
    progress.running += item.state == EvaluationState::kRunning;
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
      FROM rejudge_item AS i JOIN evaluation AS e ON e.id = i.evaluation WHERE i.rejudge = ?)",
                     rejudge.id);
  episodes.executeStep();
  progress.episodes = episodes.getColumn(0).getInt64();
  progress.episodes_done = episodes.getColumn(1).getInt64();
  const bool dropped = events.back().event == RejudgeEvent::kDropped;
  progress.complete = progress.missing == 0 && progress.ended == progress.items &&
                      !(dropped && progress.cancelled > 0);
  using State = RejudgeProgress::State;
  progress.state = events.back().event == RejudgeEvent::kApplied ? State::kApplied
                   : dropped                                     ? State::kDropped
                   : progress.complete                           ? State::kReady
                                                                 : State::kComputing;
  return progress;
}

std::vector<RejudgeCandidate> Reader::MissingItems(const RejudgeRow& rejudge, int64_t limit) {
  if (rejudge.purpose != RejudgePurpose::kRules) return {};
  // Where the config stays, what was accepted after it was applied has its result under it.
  const int64_t latest = rejudge.from_config != rejudge.to_config
                             ? INT64_MAX
                             : FirstNumber(db_, R"(SELECT ifnull(min(at), ?2)
                                 FROM rejudge_event WHERE rejudge = ?1 AND event = 'applied')",
                                           rejudge.id, INT64_MAX);
  return Candidates(db_, rejudge, rejudge.id, latest, limit);
}

std::vector<RejudgeCandidate> Reader::CandidatesFor(const NewRejudge& rejudge) {
  std::vector<RejudgeCandidate> candidates =
      Candidates(db_, rejudge, /*id=*/0, INT64_MAX, INT64_MAX);
  if (rejudge.purpose == RejudgePurpose::kSeeds) {
    std::erase_if(candidates, [&](const RejudgeCandidate& candidate) {
      return std::find(rejudge.submissions.begin(), rejudge.submissions.end(),
                       candidate.submission) == rejudge.submissions.end();
    });
  }
  return candidates;
}

absl::StatusOr<std::vector<Unrepeatable>> Reader::UnrepeatableOf(int64_t rejudge) {
  ASSIGN_OR_RETURN(std::vector<RejudgeItemRow> items, RejudgeItems(rejudge));
  std::map<int64_t, Unrepeatable> found;
  const auto add = [&](int64_t submission, Unrepeatable::Episode episode) {
    found[submission].submission = submission;
    found[submission].episodes.push_back(std::move(episode));
  };
  const RejudgeItemRow* first = nullptr;
  std::vector<EpisodeRow> episodes;  // of `first`, once they are needed
  for (const RejudgeItemRow& item : items) {
    ASSIGN_OR_RETURN(std::vector<RepeatRow> repeats, Repeats(item.evaluation));
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
      ASSIGN_OR_RETURN(episodes, Episodes(first->evaluation));
    }
    ASSIGN_OR_RETURN(const std::vector<EpisodeRow> others, Episodes(item.evaluation));
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

int64_t Reader::RejudgeWork() {
  // Both only grow.
  return FirstNumber(db_, R"(SELECT ifnull((SELECT max(id)
      FROM transition), 0) + ifnull((SELECT max(id) FROM rejudge_event), 0))");
}

}  // namespace myograde::server
