#include "server/store/rejudges.h"

#include <algorithm>
#include <array>
#include <map>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/store/connection.h"
#include "server/store/differences.h"
#include "server/store/name_table.h"
#include "server/store/reader.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

constexpr std::array<std::pair<RejudgePurpose, std::string_view>, 2> kPurposes = {{
    {RejudgePurpose::kRules, "rules"},
    {RejudgePurpose::kSeeds, "seeds"},
}};
constexpr std::array<std::pair<RejudgeMethod, std::string_view>, 3> kMethods = {{
    {RejudgeMethod::kAuto, "auto"},
    {RejudgeMethod::kFacts, "facts"},
    {RejudgeMethod::kPlay, "play"},
}};
constexpr std::array<std::pair<RejudgeEvent, std::string_view>, 3> kEvents = {{
    {RejudgeEvent::kCreated, "created"},
    {RejudgeEvent::kApplied, "applied"},
    {RejudgeEvent::kDropped, "dropped"},
}};

constexpr char kRejudgeColumns[] =
    "SELECT id, at, purpose, phase, track, profile, from_config, to_config, seeds, method, repeats, "
    "who, why FROM rejudge ";

StoredRow RejudgeRowOf(SQLite::Statement& select, RejudgeRow& rejudge) {
  StoredRow row(select, "rejudge", Shown(select.getColumn(0)));
  rejudge.id = row.Number(0, 1, INT64_MAX);
  rejudge.at = row.Time(1);
  rejudge.purpose = row.Named(2, ParseRejudgePurpose);
  rejudge.phase = row.Text(3);
  rejudge.track = row.Text(4);
  rejudge.profile = row.Text(5);
  rejudge.from_config = row.Hash(6);
  rejudge.to_config = row.Hash(7);
  rejudge.seeds = row.Hash(8);
  rejudge.method = row.Named(9, ParseRejudgeMethod);
  rejudge.repeats = row.Number(10, 1, kMostRepeats);
  rejudge.who = row.Text(11);
  rejudge.why = row.Text(12);
  return row;
}

StoredRow EventOf(SQLite::Statement& select, RejudgeEventRow& event) {
  StoredRow row(select, "rejudge_event", Shown(select.getColumn(0)));
  event.id = row.Number(0, 1, INT64_MAX);
  event.at = row.Time(1);
  event.rejudge = row.Number(2, 1, INT64_MAX);
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
  item.rejudge = row.Number(0, 1, INT64_MAX);
  item.submission = row.Number(1, 1, INT64_MAX);
  item.repetition = row.Number(2, 1, kMostRepeats);
  item.source = row.Number(3, 1, INT64_MAX);
  item.method = row.Named(4, ParseRejudgeMethod);
  item.evaluation = row.Number(5, 1, INT64_MAX);
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

std::vector<RejudgeCandidate> Candidates(SQLite::Statement& select) {
  std::vector<RejudgeCandidate> candidates;
  while (select.executeStep()) {
    candidates.push_back({.submission = select.getColumn(0).getInt64(),
                          .source = select.getColumn(1).getInt64(),
                          .repetition = select.getColumn(2).getInt64()});
  }
  return candidates;
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

std::string_view RejudgeStateName(RejudgeProgress::State state) {
  switch (state) {
    case RejudgeProgress::State::kComputing: return "computing";
    case RejudgeProgress::State::kReady: return "ready";
    case RejudgeProgress::State::kApplied: return "applied";
    case RejudgeProgress::State::kDropped: return "dropped";
  }
  return "";
}

absl::StatusOr<RejudgeRow> Reader::Rejudge(int64_t id) {
  SQLite::Statement select(db_, absl::StrCat(kRejudgeColumns, "WHERE id = ?"));
  select.bind(1, id);
  if (!select.executeStep()) {
    return absl::NotFoundError(absl::StrCat("there is no rejudge ", id));
  }
  RejudgeRow rejudge;
  if (const StoredRow row = RejudgeRowOf(select, rejudge); !row.ok()) return row.status();
  return rejudge;
}

Listed<RejudgeRow> Reader::Rejudges(int64_t before, int64_t limit) {
  SQLite::Statement select(
      db_, absl::StrCat(kRejudgeColumns, "WHERE id < ? ORDER BY id DESC LIMIT ?"));
  SQLite::bind(select, before, limit);
  return ListOf<RejudgeRow>(select, {}, RejudgeRowOf);
}

absl::StatusOr<std::vector<RejudgeEventRow>> Reader::RejudgeEvents(int64_t rejudge) {
  SQLite::Statement select(db_, "SELECT id, at, rejudge, event, who, why, document_json, signature "
                                "FROM rejudge_event WHERE rejudge = ? ORDER BY id");
  select.bind(1, rejudge);
  absl::StatusOr<std::vector<RejudgeEventRow>> events = AllOf<RejudgeEventRow>(select, {}, EventOf);
  if (events.ok() && events->empty()) {
    return DamagedRow({"rejudge", absl::StrCat(rejudge), "it has no event"});
  }
  return events;
}

absl::StatusOr<std::vector<RejudgeItemRow>> Reader::RejudgeItems(int64_t rejudge) {
  SQLite::Statement select(
      db_, absl::StrCat(kItemColumns, "WHERE i.rejudge = ? ORDER BY i.submission, i.repetition"));
  select.bind(1, rejudge);
  return AllOf<RejudgeItemRow>(select, {}, ItemOf);
}

absl::StatusOr<std::optional<RejudgeItemRow>> Reader::RejudgeItemOf(int64_t evaluation) {
  SQLite::Statement select(db_, absl::StrCat(kItemColumns, "WHERE i.evaluation = ?"));
  select.bind(1, evaluation);
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
  SQLite::Statement episodes(
      db_, "SELECT ifnull(sum(e.last - e.first + 1), 0), ifnull(sum(CASE WHEN e.state = 'done' THEN "
           "e.last - e.first + 1 ELSE (SELECT count(*) FROM episode WHERE evaluation = e.id) END), 0)"
           " FROM rejudge_item AS i JOIN evaluation AS e ON e.id = i.evaluation WHERE i.rejudge = ?");
  episodes.bind(1, rejudge.id);
  episodes.executeStep();
  progress.episodes = episodes.getColumn(0).getInt64();
  progress.episodes_done = episodes.getColumn(1).getInt64();
  const bool dropped = events.back().event == RejudgeEvent::kDropped;
  progress.complete = progress.missing == 0 && progress.ended == progress.items &&
                      !(dropped && progress.cancelled > 0);
  switch (events.back().event) {
    case RejudgeEvent::kApplied: progress.state = RejudgeProgress::State::kApplied; break;
    case RejudgeEvent::kDropped: progress.state = RejudgeProgress::State::kDropped; break;
    case RejudgeEvent::kCreated:
      progress.state = progress.complete ? RejudgeProgress::State::kReady
                                         : RejudgeProgress::State::kComputing;
  }
  return progress;
}

std::vector<RejudgeCandidate> Reader::MissingItems(const RejudgeRow& rejudge, int64_t limit) {
  if (rejudge.purpose != RejudgePurpose::kRules) return {};
  // Where the config stays, what was accepted after it was applied has its result under it.
  SQLite::Statement applied(db_, "SELECT ifnull(min(at), ?2) FROM rejudge_event WHERE rejudge = ?1 "
                                 "AND event = 'applied'");
  SQLite::bind(applied, rejudge.id, INT64_MAX);
  applied.executeStep();
  const int64_t latest =
      rejudge.from_config == rejudge.to_config ? applied.getColumn(0).getInt64() : INT64_MAX;
  SQLite::Statement select(db_, MissingSql());
  SQLite::bind(select, rejudge.from_config, rejudge.id, rejudge.phase, rejudge.track,
               rejudge.profile, rejudge.repeats, latest, limit);
  return Candidates(select);
}

std::vector<RejudgeCandidate> Reader::CandidatesFor(const NewRejudge& rejudge) {
  SQLite::Statement select(db_, MissingSql());
  SQLite::bind(select, rejudge.from_config, 0, rejudge.phase, rejudge.track, rejudge.profile,
               rejudge.repeats, INT64_MAX, INT64_MAX);
  std::vector<RejudgeCandidate> candidates = Candidates(select);
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
    for (const int64_t evaluation : {first->evaluation, item.evaluation}) {
      if (evaluation == first->evaluation && !episodes.empty()) continue;
      ASSIGN_OR_RETURN(std::vector<EpisodeRow> read, Episodes(evaluation));
      if (evaluation == first->evaluation) {
        episodes = std::move(read);
        continue;
      }
      for (size_t i = 0; i < std::min(episodes.size(), read.size()); ++i) {
        std::vector<std::string> differs = DifferencesBetween(episodes[i], read[i]);
        if (differs.empty()) continue;
        add(item.submission, {read[i].index, item.repetition, std::move(differs)});
      }
    }
  }
  std::vector<Unrepeatable> listed;
  for (auto& [submission, entry] : found) listed.push_back(std::move(entry));
  return listed;
}

int64_t Reader::RejudgeWork() {
  // Both only grow.
  SQLite::Statement select(db_, "SELECT ifnull((SELECT max(id) FROM transition), 0) + "
                                "ifnull((SELECT max(id) FROM rejudge_event), 0)");
  select.executeStep();
  return select.getColumn(0).getInt64();
}

}  // namespace myograde::server
