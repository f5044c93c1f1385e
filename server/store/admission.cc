// Accepts submissions: their rows, their quota, and one ranked evaluation per artefact.
#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/store/connection.h"
#include "server/store/content.h"
#include "server/store/reader.h"
#include "server/store/store.h"
#include "server/store/teams.h"

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
  SQLite::Statement select(
      db, "SELECT s.id, t.name FROM submission AS s JOIN team AS o ON o.id = s.team_id "
          "JOIN team AS t ON t.id = ifnull(o.merged_into, o.id) "
          "WHERE s.artefact = ? AND t.name != ? ORDER BY s.id LIMIT 1");
  SQLite::bind(select, submission.artefact, submission.team);
  if (!select.executeStep()) return "";
  return absl::StrCat("the same artefact as submission ", select.getColumn(0).getInt64(),
                      " of team \"", select.getColumn(1).getString(), "\"");
}

// Evaluations of an artefact in a row that end by the grader's fault until it is held back. Only those
// by the same build and runtimes count, so an upgrade lets it in again.
constexpr int64_t kFaultsToHold = 3;

bool EndedByFaults(SQLite::Database& db, const std::string& artefact, const std::string& grader_json,
                   int64_t last) {
  SQLite::Statement select(
      db, "SELECT count(*) FROM (SELECT e.state AS state, e.grader_json AS grader FROM submission AS s "
          "JOIN evaluation AS e ON e.submission = s.id WHERE s.artefact = ?1 AND "
          "e.kind != 'rejudge' AND e.finished_at IS NOT NULL AND e.state != 'cancelled' "
          "ORDER BY e.finished_at DESC, e.id DESC LIMIT ?2) "
          "WHERE state = 'grader_error' AND grader = ?3");
  SQLite::bind(select, artefact, last, grader_json);
  select.executeStep();
  return select.getColumn(0).getInt64() == last;
}

absl::Status CheckNotHeldBack(SQLite::Database& db, const std::string& artefact,
                              const std::string& grader_json) {
  if (!EndedByFaults(db, artefact, grader_json, kFaultsToHold)) return absl::OkStatus();
  return WithErrorCode(
      absl::FailedPreconditionError(absl::StrCat(
          "the last ", kFaultsToHold, " evaluations of this artefact ended by the grader's fault, so "
          "it is held back; ask an organiser to look at it: a re-run that ends otherwise lets it in "
          "again")),
      kHeldBackCode);
}

absl::Status AddContent(SQLite::Database& db, const NewSubmission& submission, int64_t now_ms) {
  absl::Status status = AddConfig(db, submission.config, submission.track, submission.profile,
                                  submission.config_json, now_ms);
  status.Update(AddSeedList(db, submission.seeds, submission.seed_count, submission.seeds_json));
  return status;
}

}  // namespace

std::vector<std::string> Reader::HeldBack() {
  SQLite::Statement select(
      db_, "SELECT s.artefact, (SELECT l.grader_json FROM submission AS o JOIN evaluation AS l ON "
           "l.submission = o.id WHERE o.artefact = s.artefact AND l.state = 'grader_error' "
           "ORDER BY l.finished_at DESC, l.id DESC LIMIT 1) FROM evaluation AS e JOIN submission AS s "
           "ON s.id = e.submission WHERE e.kind = 'original' AND e.state = 'grader_error' "
           "GROUP BY s.artefact ORDER BY s.artefact");
  std::vector<std::string> held;
  while (select.executeStep()) {
    const std::string artefact = select.getColumn(0);
    if (EndedByFaults(db_, artefact, select.getColumn(1), kFaultsToHold)) held.push_back(artefact);
  }
  return held;
}

absl::Status Writer::AddUpload(const ArtefactRow& artefact, const NewUpload& upload,
                               const UnsubmittedLimits& limits) {
  RETURN_IF_ERROR(CheckNotBanned(db_, upload.team));
  const std::string team = KnownTeam(db_, upload.team);
  SQLite::Statement holder(db_, "INSERT INTO artefact_holder VALUES (?, ?, ?) ON CONFLICT DO NOTHING");
  SQLite::bind(holder, artefact.hash, upload.uploader, team);
  holder.exec();
  SQLite::Statement submitted(db_, "SELECT 1 FROM submission WHERE artefact = ? LIMIT 1");
  submitted.bind(1, artefact.hash);
  if (submitted.executeStep()) return absl::OkStatus();
  SQLite::Statement known(db_, "UPDATE upload SET at = ? WHERE artefact = ?");
  SQLite::bind(known, now_ms_, artefact.hash);
  if (known.exec() > 0) return absl::OkStatus();
  const auto check = [&](const char* whose, const std::string& name, const std::string& sentence,
                         int64_t most, int64_t most_bytes) -> absl::Status {
    SQLite::Statement sum(
        db_, absl::StrCat("SELECT count(*), ifnull(sum(a.bytes), 0) FROM upload AS u "
                          "JOIN artefact AS a ON a.hash = u.artefact WHERE ", whose, " = ?"));
    sum.bind(1, name);
    sum.executeStep();
    const int64_t count = sum.getColumn(0).getInt64();
    const int64_t bytes = sum.getColumn(1).getInt64();
    if (count < most && artefact.bytes <= most_bytes - bytes) return absl::OkStatus();
    return WithErrorCode(
        absl::FailedPreconditionError(absl::StrCat(
            sentence, " has ", count, " uploads of ", bytes, " bytes together that were never "
            "submitted, and may have ", most, " of ", most_bytes, " bytes; submit them, or try "
            "again later: each goes ", absl::FormatDuration(limits.age), " after it came")),
        "quota");
  };
  absl::Status status = check("''", "", "this server", limits.count, limits.bytes);
  if (status.ok() && !upload.organiser) {
    status = check("u.uploader", upload.uploader, upload.uploader, limits.of_one,
                   limits.bytes_of_one);
  }
  if (status.ok() && !upload.organiser && !team.empty()) {
    status = check("u.team", team, absl::StrCat("team \"", team, "\""),
                   limits.of_one, limits.bytes_of_one);
  }
  if (!status.ok()) return status;
  SQLite::Statement insert(db_, "INSERT INTO upload (artefact, uploader, team, at) "
                                "VALUES (?, ?, ?, ?)");
  SQLite::bind(insert, artefact.hash, upload.uploader, team, now_ms_);
  insert.exec();
  return absl::OkStatus();
}

std::string Writer::WithHold(int64_t evaluation, const std::string& why) {
  SQLite::Statement select(db_, "SELECT s.artefact, e.grader_json FROM evaluation AS e JOIN submission "
                                "AS s ON s.id = e.submission WHERE e.id = ?");
  select.bind(1, evaluation);
  if (!select.executeStep() || !EndedByFaults(db_, select.getColumn(0), select.getColumn(1),
                                              kFaultsToHold - 1)) {
    return why;
  }
  return absl::StrCat(why, "; this artefact has ended so ", kFaultsToHold, " times in a row and is "
                      "held back until an organiser's re-run of it ends otherwise");
}

absl::Status Writer::CheckReruns(int64_t submission, const std::string& who, bool organiser,
                                 const RerunLimits& limits) {
  if (!organiser) {
    SQLite::Statement team(db_, "SELECT t.name FROM submission AS s JOIN team AS t ON "
                                "t.id = s.team_id WHERE s.id = ?");
    team.bind(1, submission);
    const bool there = team.executeStep();
    RETURN_IF_ERROR(there ? CheckNotBanned(db_, team.getColumn(0).getString()) : absl::OkStatus());
    SQLite::Statement last(db_, "SELECT s.artefact, e.grader_json FROM submission AS s JOIN evaluation "
                                "AS e ON e.submission = s.id WHERE s.id = ? ORDER BY e.id DESC LIMIT 1");
    last.bind(1, submission);
    const absl::Status held =
        last.executeStep() ? CheckNotHeldBack(db_, last.getColumn(0), last.getColumn(1))
                           : absl::OkStatus();
    if (!held.ok()) return held;
  }
  // The audit row of a re-run's start says who asked for it.
  SQLite::Statement count(
      db_, "SELECT count(*), ifnull(sum(t.who = ?), 0), ifnull(sum(e.submission = ?), 0) "
           "FROM evaluation AS e JOIN transition AS t ON t.entity = 'evaluation' AND "
           "t.entity_id = e.id AND t.from_state = '' "
           "WHERE e.kind = 'rerun' AND e.finished_at IS NULL");
  SQLite::bind(count, who, submission);
  count.executeStep();
  const int64_t all = count.getColumn(0).getInt64();
  const int64_t own = count.getColumn(1).getInt64();
  const int64_t of_it = count.getColumn(2).getInt64();
  const auto refuse = [](const std::string& what, int64_t number) {
    return WithErrorCode(
        absl::FailedPreconditionError(absl::StrCat(
            what, ", and ", number, " is the most; wait for one to end, or cancel it")),
        "quota");
  };
  if (organiser) {
    if (all < limits.of_organisers) return absl::OkStatus();
    return refuse(absl::StrCat(all, " re-runs have not ended"), limits.of_organisers);
  }
  if (of_it >= limits.of_a_submission) {
    return refuse(absl::StrCat(of_it, " re-runs of submission ", submission, " have not ended"),
                  limits.of_a_submission);
  }
  if (own >= limits.of_one) {
    return refuse(absl::StrCat(own, " re-runs that ", who, " asked for have not ended"),
                  limits.of_one);
  }
  if (all >= limits.unfinished) {
    return refuse(absl::StrCat(all, " re-runs have not ended"), limits.unfinished);
  }
  return absl::OkStatus();
}

absl::StatusOr<std::optional<Accepted>> Writer::FindOfficial(const NewSubmission& submission,
                                                             const AdmissionRules& rules) {
  SQLite::Statement own(
      db_, absl::StrCat(kOfficial, "AND s.team_id IN ", RowsOfTeam(3), " ORDER BY s.id LIMIT 1"));
  SQLite::bind(own, submission.artefact, submission.config, KnownTeamId(db_, submission.team));
  if (own.executeStep()) {
    return std::optional(Accepted{.submission = own.getColumn(0).getInt64(),
                                  .evaluation = own.getColumn(1).getInt64(),
                                  .leases = {},
                                  .linked = true});
  }
  if (!rules.one_for_everyone) return std::optional<Accepted>();
  SQLite::Statement any(db_, absl::StrCat(kOfficial, "LIMIT 1"));
  SQLite::bind(any, submission.artefact, submission.config);
  if (!any.executeStep()) return std::optional<Accepted>();
  return WithErrorCode(
      absl::FailedPreconditionError(absl::StrCat(
          "another team has handed in exactly this artefact for track \"", submission.track,
          "\", profile \"", submission.profile, "\", and an artefact has one ranked evaluation "
          "there; hand in a policy of your own, or practise with fewer episodes")),
      "same_artefact");
}

absl::StatusOr<Accepted> Writer::Accept(const NewSubmission& asked, const AdmissionRules& rules,
                                        const std::string& who) {
  SQLite::Statement artefact(db_, "SELECT 1 FROM artefact WHERE hash = ?");
  artefact.bind(1, asked.artefact);
  if (!artefact.executeStep()) {
    return UnknownArtefact(asked.artefact);
  }
  // In this transaction, so that of two names that look alike the second is rejected.
  absl::StatusOr<std::string> team = TeamNamed(db_, asked.team);
  if (!team.ok()) return team.status();
  RETURN_IF_ERROR(CheckNotBanned(db_, *team));
  NewSubmission submission = asked;
  submission.team = *std::move(team);
  if (submission.ranked) {
    ASSIGN_OR_RETURN(std::optional<Accepted> first, FindOfficial(submission, rules));
    if (first.has_value()) return *first;
  }
  // A submission that was accepted before is found above, however late its answer is asked for.
  if (!submission.closed.ok()) return submission.closed;
  RETURN_IF_ERROR(CheckTakesSubmissions(submission.phase));
  RETURN_IF_ERROR(CheckNotHeldBack(db_, submission.artefact, submission.grader_json));
  const Budget budget = submission.ranked ? Budget::kRanked : Budget::kPractice;
  const QuotaUse use = ReadQuotaUse(db_, submission.team, submission.track, submission.phase, now_ms_);
  RETURN_IF_ERROR(
      CheckQuota(use, rules.quota, budget, submission.team, submission.track, submission.phase));
  const int64_t team_id = AddTeam(db_, submission.team, now_ms_, who);
  RETURN_IF_ERROR(AddContent(db_, submission, now_ms_));
  SQLite::Statement insert(
      db_,
      "INSERT INTO submission (team_id, artefact, track, profile, config, seeds, ranked, "
      "accepted_by, accepted_at, phase, extra_observations) "
      "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  SQLite::bind(insert, team_id, submission.artefact, submission.track, submission.profile,
               submission.config, submission.seeds, submission.ranked ? 1 : 0, who, now_ms_,
               submission.phase, submission.extra_observations ? 1 : 0);
  insert.exec();
  const int64_t id = db_.getLastInsertRowid();
  SQLite::Statement upload(db_, "DELETE FROM upload WHERE artefact = ?");
  upload.bind(1, submission.artefact);
  upload.exec();
  SQLite::Statement admission(
      db_, "INSERT INTO admission (submission, team_id, track, phase, budget, day) "
           "SELECT id, team_id, track, phase, ?, ? FROM submission WHERE id = ?");
  SQLite::bind(admission, std::string(BudgetName(budget)), use.day, id);
  admission.exec();
  RETURN_IF_ERROR(Audit("submission", id, "", "accepted", who, SameAs(db_, submission)));
  absl::StatusOr<Accepted> accepted = AddEvaluation({.submission = id,
                                                     .kind = EvaluationKind::kOriginal,
                                                     .grader_json = submission.grader_json,
                                                     .blocks = submission.blocks},
                                                    who);
  if (!accepted.ok()) return accepted;
  RETURN_IF_ERROR(AppendRecord(kAcceptedEntry, id));
  return accepted;
}

}  // namespace myograde::server
