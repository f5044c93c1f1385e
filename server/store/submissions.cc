#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/base/error_code.h"
#include "server/store/stored_row.h"
#include "server/store/transaction.h"

namespace myograde::server {
namespace {

// Ranked evaluations of an artefact in a config. Those that ended by the grader's fault, or were
// cancelled before an episode had ended, told their team nothing and don't count.
constexpr char kOfficial[] =
    "SELECT s.id, e.id FROM submission AS s "
    "JOIN evaluation AS e ON e.submission = s.id AND e.kind = 'original' "
    "WHERE s.artefact = ? AND s.config = ? AND s.ranked = 1 AND e.state != 'grader_error' AND "
    "(e.state != 'cancelled' OR EXISTS (SELECT 1 FROM episode WHERE evaluation = e.id)) ";

// If another team has submitted the same bytes, the audit row says so, for the organiser.
std::string SameAs(SQLite::Database& db, const NewSubmission& submission) {
  const auto [id, team] =
      FirstRow<int64_t, std::string>(db, R"(SELECT s.id, t.name FROM submission AS s
      JOIN team AS o ON o.id = s.team_id JOIN team AS t ON t.id = ifnull(o.merged_into, o.id)
      WHERE s.artefact = ? AND t.name != ? ORDER BY s.id LIMIT 1)",
                                     submission.artefact, submission.team);
  if (id == 0) return "";
  return absl::StrCat("the same artefact as submission ", id, " of team \"", team, "\"");
}

// The ranked evaluation that rules out another one; nullopt: none.
absl::StatusOr<std::optional<Accepted>> FindOfficial(SQLite::Database& db,
                                                     const NewSubmission& submission, int64_t team,
                                                     const AdmissionRules& rules) {
  const auto [id, evaluation] = FirstRow<int64_t, int64_t>(
      db, absl::StrCat(kOfficial, "AND s.team_id IN ", RowsOfTeam(3), " ORDER BY s.id LIMIT 1"),
      submission.artefact, submission.config, team);
  if (id != 0) {
    return std::optional(Accepted{.submission = id, .evaluation = evaluation, .linked = true});
  }
  if (!rules.one_for_everyone) return std::optional<Accepted>();
  const bool taken =
      AnyRow(db, absl::StrCat(kOfficial, "LIMIT 1"), submission.artefact, submission.config);
  if (!taken) return std::optional<Accepted>();
  return CodedRefusal(
      "same_artefact",
      absl::StrCat("another team has submitted exactly this artefact for track \"",
                   submission.track, "\", profile \"", submission.profile,
                   "\", and an artefact has one ranked evaluation there; submit a policy of your "
                   "own, or practise with fewer episodes"));
}

// Evaluations of an artefact in a row that end by the grader's fault until it is held back. Only
// those by the same build and runtimes count, so an upgrade lets it in again.
constexpr int64_t kFaultsToHold = 3;

bool EndedByFaults(SQLite::Database& db, const std::string& artefact,
                   const std::string& grader_json, int64_t last) {
  return FirstValue<int64_t>(db, R"(SELECT count(*)
      FROM (SELECT e.state AS state, e.grader_json AS grader
      FROM submission AS s JOIN evaluation AS e ON e.submission = s.id WHERE s.artefact = ?1
      AND e.kind != 'rejudge' AND e.finished_at IS NOT NULL AND e.state != 'cancelled' ORDER BY
      e.finished_at DESC, e.id DESC LIMIT ?2) WHERE state = 'grader_error' AND grader = ?3)",
                             artefact, last, grader_json) == last;
}

absl::Status CheckNotHeldBack(SQLite::Database& db, const std::string& artefact,
                              const std::string& grader_json) {
  if (!EndedByFaults(db, artefact, grader_json, kFaultsToHold)) return absl::OkStatus();
  return CodedRefusal(kHeldBackCode,
                      absl::StrCat("the last ", kFaultsToHold,
                                   " evaluations of this artefact ended by the grader's fault, so "
                                   "it is held back; ask an organiser to examine it: a rerun "
                                   "that ends differently readmits it"));
}

constexpr StoredRows<SubmissionRow, 13> kSubmissions = {
    "submission",
    "SELECT s.id, t.name AS team, s.artefact, a.name AS artefact_name, s.track, s.profile, "
    "s.config, s.seeds, s.ranked, s.accepted_at, s.accepted_by, s.phase, s.extra_observations "
    "FROM submission AS s LEFT JOIN team AS o ON o.id = s.team_id "
    "LEFT JOIN team AS t ON t.id = ifnull(o.merged_into, o.id) "
    "LEFT JOIN artefact AS a ON a.hash = s.artefact "};

// What a request was accepted as.
struct RequestRow {
  std::string request;
  int64_t submission = 0;
  int64_t evaluation = 0;
  bool linked = false;
};
constexpr StoredRows<RequestRow, 4> kRequests = {
    "request_key", "SELECT who, key, request, submission, evaluation, linked FROM request_key ",
    /*key_columns=*/2, /*first=*/2};

// Makes room for one more key of a caller.
void DropOldKeys(SQLite::Database& db, const std::string& who, int64_t now_ms) {
  Run(db, "DELETE FROM request_key WHERE at < ?", now_ms - absl::ToInt64Milliseconds(kKeyAge));
  Run(db, R"(DELETE FROM request_key WHERE who = ?1 AND key IN (SELECT key
      FROM request_key WHERE who = ?1 ORDER BY at DESC, key LIMIT -1 OFFSET ?2))",
      who, kKeysOfOne - 1);
}

}  // namespace

absl::StatusOr<SubmissionRow> Submissions::Find(int64_t id) const {
  return kSubmissions.First(db_, NoSuch("submission", id), "WHERE s.id = ?", id);
}

Listed<SubmissionRow> Submissions::List(const SubmissionFilter& filter) const {
  return kSubmissions.List(
      db_, R"(WHERE s.id < ?1 AND (?2 = '' OR t.name = ?2) AND (?3 = '' OR s.track = ?3)
      AND (?4 = '' OR s.profile = ?4) AND (?5 = '' OR EXISTS (SELECT 1 FROM evaluation AS e
      WHERE e.submission = s.id AND e.kind = 'original' AND e.state = ?5))
      AND (?7 = '' OR t.name IN (SELECT value FROM json_each(?7)))
      AND (?8 = '' OR s.phase = ?8) ORDER BY s.id DESC LIMIT ?6)",
      filter.before, filter.team, filter.track, filter.profile,
      filter.state ? EnumName(*filter.state) : "", filter.limit,
      filter.teams ? CanonicalJson(nlohmann::json(*filter.teams)) : "", filter.phase);
}

std::vector<std::string> Submissions::HeldBack() const {
  Statement select(db_, R"(SELECT s.artefact, (SELECT l.grader_json
      FROM submission AS o JOIN evaluation AS l ON l.submission = o.id WHERE o.artefact = s.artefact
      AND l.state = 'grader_error' ORDER BY l.finished_at DESC, l.id DESC LIMIT 1)
      FROM evaluation AS e JOIN submission AS s ON s.id = e.submission WHERE e.kind = 'original'
      AND e.state = 'grader_error' GROUP BY s.artefact ORDER BY s.artefact)");
  std::vector<std::string> held;
  while (select.executeStep()) {
    const std::string artefact = select.getColumn(0);
    if (EndedByFaults(db_, artefact, select.getColumn(1), kFaultsToHold)) held.push_back(artefact);
  }
  return held;
}

std::string Submissions::WithHold(int64_t evaluation, const std::string& why) {
  const auto [artefact, grader_json] =
      FirstRow<std::string, std::string>(db_, R"(SELECT s.artefact, e.grader_json
      FROM evaluation AS e JOIN submission AS s ON s.id = e.submission WHERE e.id = ?)",
                                         evaluation);
  if (!EndedByFaults(db_, artefact, grader_json, kFaultsToHold - 1)) return why;
  return absl::StrCat(why, "; this artefact has ended so ", kFaultsToHold,
                      " times in a row and is held back until an organiser's rerun of it ends "
                      "otherwise");
}

absl::Status Submissions::CheckReruns(int64_t submission, const std::string& who, bool organiser,
                                      const RerunLimits& limits) {
  if (!organiser) {
    ASSIGN_OR_RETURN(const std::string name, TeamOf(submission));
    RETURN_IF_ERROR(Teams(context_).Check(name));
    const auto [artefact, grader_json] =
        FirstRow<std::string, std::string>(db_, R"(SELECT s.artefact, e.grader_json
        FROM submission AS s JOIN evaluation AS e ON e.submission = s.id WHERE s.id = ?
        ORDER BY e.id DESC LIMIT 1)",
                                           submission);
    RETURN_IF_ERROR(CheckNotHeldBack(db_, artefact, grader_json));
  }
  // The audit row of a rerun's start says who asked for it.
  const auto [all, own, of_it] = FirstRow<int64_t, int64_t, int64_t>(
      db_, R"(SELECT count(*), ifnull(sum(t.who = ?), 0), ifnull(sum(e.submission = ?),
      0) FROM evaluation AS e JOIN transition AS t ON t.entity = 'evaluation' AND t.entity_id = e.id
      AND t.from_state = '' WHERE e.kind = 'rerun' AND e.finished_at IS NULL)",
      who, submission);
  const auto check = [](int64_t count, int64_t most, const std::string& what) {
    if (count < most) return absl::OkStatus();
    return CodedRefusal("quota",
                        absl::StrCat(count, " ", what, " have not ended, and ", most,
                                     " is the most; wait for one to end, or cancel it"));
  };
  if (!organiser) {
    RETURN_IF_ERROR(check(of_it, limits.of_a_submission,
                          absl::StrCat("reruns of submission ", submission)));
    RETURN_IF_ERROR(check(own, limits.of_one, absl::StrCat("reruns that ", who, " asked for")));
  }
  return check(all, organiser ? limits.of_organisers : limits.unfinished, "reruns");
}

absl::StatusOr<Accepted> Submissions::Accept(const NewSubmission& asked,
                                             const AdmissionRules& rules, const std::string& who) {
  if (!AnyRow(db_, "SELECT 1 FROM artefact WHERE hash = ?", asked.artefact)) {
    return UnknownArtefact(asked.artefact);
  }
  // In this transaction, so that of two names that look alike the second is rejected.
  NewSubmission submission = asked;
  ASSIGN_OR_RETURN(const TeamInForce team, Teams(context_).Allowed(asked.team));
  RETURN_IF_ERROR(Teams(context_).CheckNotBanned(team));
  submission.team = team.name;
  if (submission.ranked) {
    ASSIGN_OR_RETURN(std::optional<Accepted> first, FindOfficial(db_, submission, team.id, rules));
    if (first.has_value()) return *first;
  }
  // A submission that was accepted before is found above, however late its answer is asked for.
  if (!submission.closed.ok()) return submission.closed;
  RETURN_IF_ERROR(PhaseActs(context_).CheckTakesSubmissions(submission.phase));
  RETURN_IF_ERROR(CheckNotHeldBack(db_, submission.artefact, submission.grader_json));
  const Budget budget = submission.ranked ? Budget::kRanked : Budget::kPractice;
  const QuotaUse use =
      Quotas(context_).CountQuotaUse(submission.team, submission.track, now_ms_, submission.phase);
  RETURN_IF_ERROR(
      CheckQuota(use, rules.quota, budget, submission.team, submission.track, submission.phase));
  const int64_t team_id = Teams(context_).Ensure(team, who);
  RETURN_IF_ERROR(
      Content(context_).AddText(kConfigs, submission.config, submission.config_json));
  RETURN_IF_ERROR(Content(context_).AddText(kSeedLists, submission.seeds, submission.seeds_json));
  Run(db_, R"(INSERT INTO submission (team_id, artefact,
      track, profile, config, seeds, ranked, accepted_by, accepted_at, day, phase,
      extra_observations) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?))",
      team_id, submission.artefact, submission.track, submission.profile, submission.config,
      submission.seeds, submission.ranked, who, now_ms_, use.day, submission.phase,
      submission.extra_observations);
  const int64_t id = db_.getLastInsertRowid();
  Run(db_, "DELETE FROM upload WHERE artefact = ?", submission.artefact);
  RETURN_IF_ERROR(Audit("submission", id, "", "accepted", who, SameAs(db_, submission)));
  ASSIGN_OR_RETURN(Accepted accepted,
                   Evaluations(context_).Add(
                       {.submission = id, .grader_json = submission.grader_json},
                       submission.blocks, who));
  if (!submission.ranked) return accepted;
  Append({.kind = kAcceptedAct,
          .who = who,
          .content = {{"submission", id},
                      {"team_id", team_id},
                      {"team", submission.team},
                      {"artefact", ArtefactCommitment(id, submission.artefact)},
                      {"track", submission.track},
                      {"profile", submission.profile},
                      {"phase", TextOrNull(submission.phase)},
                      {"config", submission.config},
                      {"evaluation", accepted.evaluation}}});
  return accepted;
}

absl::StatusOr<std::string> Submissions::TeamOf(int64_t id) const {
  const std::string name = FirstValue<std::string>(db_, R"(SELECT t.name FROM submission AS s
      JOIN team AS t ON t.id = s.team_id AND typeof(t.name) = 'text' WHERE s.id = ?)",
                                                   id);
  if (!name.empty()) return Teams(context_).NameOf(name);
  return NoSuch("submission", id);
}

std::map<std::string, int64_t> Submissions::CountByState() const {
  Statement select(db_, R"(SELECT state, count(*)
      FROM evaluation WHERE kind = 'original' GROUP BY state)");
  std::map<std::string, int64_t> counts;
  while (select.executeStep()) {
    const std::string state = select.getColumn(0).getString();
    // A damaged row's state is anybody's text.
    const bool known = ParseEnum<EvaluationState>(state).has_value();
    counts[known ? state : "unreadable"] += select.getColumn(1).getInt64();
  }
  return counts;
}

absl::StatusOr<std::optional<Accepted>> Submissions::FindRequest(const std::string& who,
                                                                 const RequestKey& key) const {
  if (key.key.empty()) return std::optional<Accepted>();
  const absl::StatusOr<RequestRow> earlier = kRequests.First(
      db_, absl::NotFoundError("a new key"), "WHERE who = ? AND key = ?", who, key.key);
  if (absl::IsNotFound(earlier.status())) return std::optional<Accepted>();
  if (!earlier.ok()) return earlier.status();
  if (earlier->request == key.request) {
    return std::optional(Accepted{.submission = earlier->submission,
                                  .evaluation = earlier->evaluation,
                                  .linked = earlier->linked,
                                  .repeated = true});
  }
  return CodedRefusal(kKeyReusedCode,
                      absl::StrCat("the Idempotency-Key \"", key.key,
                                   "\" came with another request before, for submission ",
                                   earlier->submission, "; use a new key for each request"));
}

absl::StatusOr<Accepted> Submissions::Once(
    const std::string& who, const RequestKey& key,
    const std::function<absl::StatusOr<Accepted>()>& accept) {
  ASSIGN_OR_RETURN(std::optional<Accepted> earlier, FindRequest(who, key));
  if (earlier.has_value()) return *earlier;
  absl::StatusOr<Accepted> accepted = accept();
  if (accepted.ok() && !key.key.empty()) {
    DropOldKeys(db_, who, now_ms_);
    Run(db_, "INSERT INTO request_key VALUES (?, ?, ?, ?, ?, ?, ?)", who, key.key, key.request,
        accepted->submission, accepted->evaluation, accepted->linked, now_ms_);
  }
  return accepted;
}

}  // namespace myograde::server
