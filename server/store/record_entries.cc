#include "server/store/record_entries.h"

#include <utility>

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>
#include <absl/time/time.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "server/store/rows.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;
using MaybeEntry = std::optional<RecordEntry>;

std::string TimeText(int64_t ms) {
  return absl::FormatTime("%Y-%m-%dT%H:%M:%E3SZ", absl::FromUnixMillis(ms), absl::UTCTimeZone());
}

Json OrNull(const std::string& text) { return text.empty() ? Json() : Json(text); }
Json OrNull(int64_t id) { return id == 0 ? Json() : Json(id); }

// What stands in place of a row that can't be read.
MaybeEntry UnreadableEntry(int64_t at, int64_t row) {
  return RecordEntry{at, 0, {{"unreadable", true}, {"row", row}}};
}

MaybeEntry FinishedEntry(const StoredRow& row, int64_t id, RecordEntry entry) {
  return row.ok() ? MaybeEntry(std::move(entry)) : UnreadableEntry(entry.at, id);
}

MaybeEntry AcceptedEntry(SQLite::Database& db, int64_t id) {
  SQLite::Statement select(
      db, "SELECT s.accepted_at, s.ranked, s.team_id, t.name, s.artefact, s.track, s.profile, "
          "s.phase, s.config, (SELECT min(id) FROM evaluation WHERE submission = s.id AND "
          "kind = 'original') FROM submission AS s LEFT JOIN team AS t ON t.id = s.team_id "
          "WHERE s.id = ?");
  select.bind(1, id);
  if (!select.executeStep()) return std::nullopt;
  StoredRow row(select, "submission", absl::StrCat(id));
  RecordEntry entry{.at = row.Time(0), .evaluation = 0, .content = {}};
  if (!row.Flag(1) && row.ok()) return std::nullopt;
  entry.content = {{"submission", id},
                   {"team_id", row.Number(2, 1, INT64_MAX)},
                   {"team", row.Text(3)},
                   {"artefact", ArtefactCommitment(id, row.Hash(4))},
                   {"track", row.Text(5)},
                   {"profile", row.Text(6)},
                   {"phase", OrNull(row.Text(7))},
                   {"config", row.Hash(8)},
                   {"evaluation", row.Number(9, 1, INT64_MAX)}};
  return FinishedEntry(row, id, std::move(entry));
}

// The hash of the build as a receipt shows it.
std::string GraderHash(const std::string& grader_json) {
  return Sha256Hex(CanonicalJson(Json::parse(grader_json, nullptr, /*allow_exceptions=*/false)));
}

MaybeEntry GradedEntry(SQLite::Database& db, int64_t id) {
  SQLite::Statement select(
      db, "SELECT e.finished_at, e.kind, s.ranked, e.submission, e.state, e.results_hash, "
          "ifnull(e.config, s.config), ifnull(e.seeds, s.seeds), e.grader_json, "
          "i.rejudge, i.repetition "
          "FROM evaluation AS e LEFT JOIN submission AS s ON s.id = e.submission "
          "LEFT JOIN rejudge_item AS i ON i.evaluation = e.id WHERE e.id = ?");
  select.bind(1, id);
  if (!select.executeStep() || select.isColumnNull(0)) return std::nullopt;
  StoredRow row(select, "evaluation", absl::StrCat(id));
  RecordEntry entry{.at = row.Time(0), .evaluation = id, .content = {}};
  const EvaluationKind kind = row.Named(1, ParseEvaluationKind);
  const bool ranked = row.Flag(2);
  if (row.ok() && (!ranked || kind == EvaluationKind::kRerun)) return std::nullopt;
  const EvaluationState state = row.Named(4, ParseEvaluationState);
  const bool result = state == EvaluationState::kDone || state == EvaluationState::kFailed;
  entry.content = {
      {"evaluation", id},
      {"submission", row.Number(3, 1, INT64_MAX)},
      {"state", result ? "graded" : std::string(EvaluationStateName(state))},
      {"results", result ? Json(row.Hash(5)) : Json()},
      {"config", row.Hash(6)},
      {"seeds", row.Hash(7)},
      {"grader", row.ok() ? GraderHash(row.Object(8)) : ""},
      {"rejudge", OrNull(row.NumberOr(9, 1, INT64_MAX, 0))},
      {"repetition", OrNull(row.NumberOr(10, 1, INT64_MAX, 0))}};
  return FinishedEntry(row, id, std::move(entry));
}

MaybeEntry MarkedEntry(SQLite::Database& db, int64_t id) {
  SQLite::Statement select(db, "SELECT m.at, m.submission, m.mark, m.set_to, m.why, s.ranked "
                               "FROM mark AS m LEFT JOIN submission AS s ON s.id = m.submission "
                               "WHERE m.id = ?");
  select.bind(1, id);
  if (!select.executeStep()) return std::nullopt;
  StoredRow row(select, "mark", absl::StrCat(id));
  RecordEntry entry{.at = row.Time(0), .evaluation = 0, .content = {}};
  if (!row.Flag(5) && row.ok()) return std::nullopt;
  const std::string mark = row.OneOf(2, {"hidden", "disqualified", "baseline"});
  entry.content = {{"submission", row.Number(1, 1, INT64_MAX)},
                   {"mark", mark},
                   {"set", row.Flag(3)}};
  // Boards tell why somebody was disqualified, and nothing of the others.
  if (mark == "disqualified") entry.content["reason"] = row.Text(4);
  return FinishedEntry(row, id, std::move(entry));
}

MaybeEntry ChosenEntry(SQLite::Database& db, int64_t id) {
  SQLite::Statement select(db, "SELECT at, submission FROM choice WHERE id = ?");
  select.bind(1, id);
  if (!select.executeStep()) return std::nullopt;
  StoredRow row(select, "choice", absl::StrCat(id));
  RecordEntry entry{.at = row.Time(0), .evaluation = 0, .content = {}};
  entry.content = {{"submission", row.Number(1, 1, INT64_MAX)}};
  return FinishedEntry(row, id, std::move(entry));
}

// The name that the team had after the event is the one that its next renaming took away.
MaybeEntry TeamEventEntry(SQLite::Database& db, int64_t id) {
  SQLite::Statement select(
      db, "SELECT e.at, e.event, e.team_id, ifnull((SELECT detail FROM team_event WHERE "
          "team_id = e.team_id AND event = 'renamed' AND id > e.id ORDER BY id LIMIT 1), t.name), "
          "t.merged_into FROM team_event AS e LEFT JOIN team AS t ON t.id = e.team_id "
          "WHERE e.id = ?");
  select.bind(1, id);
  if (!select.executeStep()) return std::nullopt;
  StoredRow row(select, "team_event", absl::StrCat(id));
  RecordEntry entry{.at = row.Time(0), .evaluation = 0, .content = {}};
  const std::string event =
      row.OneOf(1, {"created", "renamed", "merged", "banned", "unbanned"});
  entry.content = {{"event", event},
                   {"team_id", row.Number(2, 1, INT64_MAX)},
                   {"team", row.Text(3)}};
  if (event == "merged") entry.content["into"] = row.Number(4, 1, INT64_MAX);
  return FinishedEntry(row, id, std::move(entry));
}

// A phase's secret opens its seeds and is published with them.
MaybeEntry PhaseEventEntry(SQLite::Database& db, int64_t id) {
  SQLite::Statement select(
      db, "SELECT p.at, p.phase, p.event, s.secret FROM phase_event AS p "
          "LEFT JOIN phase_secret AS s ON s.phase = p.phase WHERE p.id = ?");
  select.bind(1, id);
  if (!select.executeStep()) return std::nullopt;
  StoredRow row(select, "phase_event", absl::StrCat(id));
  RecordEntry entry{.at = row.Time(0), .evaluation = 0, .content = {}};
  const std::string event =
      row.OneOf(2, {kPausedEvent, kResumedEvent, kPublishedEvent, kRevealedEvent});
  entry.content = {{"phase", OrNull(row.Text(1))}, {"event", event}};
  if (event == kRevealedEvent) {
    // An import never had it: whoever reveals the phase publishes it elsewhere.
    entry.content["secret"] =
        select.isColumnNull(3) ? Json() : Json(absl::BytesToHexString(row.Blob(3)));
  }
  return FinishedEntry(row, id, std::move(entry));
}

// The commitment is that of server/proof/seed_list.h: over the secret's hexadecimal digits.
MaybeEntry PhaseCommitmentEntry(SQLite::Database& db, int64_t rowid) {
  SQLite::Statement select(
      db, "SELECT created_at, phase, secret, EXISTS (SELECT 1 FROM submission AS s WHERE "
          "s.phase = p.phase AND s.ranked = 1 AND s.accepted_at < p.created_at) "
          "FROM phase_secret AS p WHERE p.rowid = ?");
  select.bind(1, rowid);
  if (!select.executeStep()) return std::nullopt;
  StoredRow row(select, "phase_secret", absl::StrCat(rowid));
  RecordEntry entry{.at = row.Time(0), .evaluation = 0, .content = {}};
  entry.content = {{"phase", row.Text(1)},
                   {"commitment", Sha256Hex(absl::BytesToHexString(row.Blob(2)))}};
  // A phase's own secret is drawn before it takes anything (Writer::PhaseSecret).
  if (row.Flag(3)) entry.content["further"] = true;
  return FinishedEntry(row, rowid, std::move(entry));
}

MaybeEntry BoardConfigEntry(SQLite::Database& db, int64_t id) {
  SQLite::Statement select(
      db, "SELECT at, phase, track, profile, config, rejudge FROM board_config WHERE id = ?");
  select.bind(1, id);
  if (!select.executeStep()) return std::nullopt;
  StoredRow row(select, "board_config", absl::StrCat(id));
  RecordEntry entry{.at = row.Time(0), .evaluation = 0, .content = {}};
  entry.content = {{"phase", OrNull(row.Text(1))},
                   {"track", row.Text(2)},
                   {"profile", row.Text(3)},
                   {"config", row.Hash(4)},
                   {"rejudge", OrNull(row.NumberOr(5, 1, INT64_MAX, 0))}};
  return FinishedEntry(row, id, std::move(entry));
}

// Until a rejudge is applied, participants see nothing of it: its document is committed to, and told
// when it is applied.
MaybeEntry RejudgeEventEntry(SQLite::Database& db, int64_t id) {
  SQLite::Statement select(
      db, "SELECT e.at, e.event, e.rejudge, e.document_json, e.signature, r.purpose, r.from_config, "
          "r.to_config, r.phase, r.track, r.profile FROM rejudge_event AS e "
          "LEFT JOIN rejudge AS r ON r.id = e.rejudge WHERE e.id = ?");
  select.bind(1, id);
  if (!select.executeStep()) return std::nullopt;
  StoredRow row(select, "rejudge_event", absl::StrCat(id));
  RecordEntry entry{.at = row.Time(0), .evaluation = 0, .content = {}};
  const std::string event = row.OneOf(1, {"created", "applied", "dropped"});
  const std::string document = row.Object(3);
  entry.content = {{"event", event},
                   {"rejudge", row.Number(2, 1, INT64_MAX)},
                   {"document_sha256", Sha256Hex(document)},
                   {"signature", row.Text(4)}};
  if (event == "applied" && row.ok()) {
    entry.content["document"] = Json::parse(document, nullptr, /*allow_exceptions=*/false);
    entry.content["purpose"] = row.Text(5);
    entry.content["from_config"] = row.Hash(6);
    entry.content["to_config"] = row.Hash(7);
    entry.content["phase"] = OrNull(row.Text(8));
    entry.content["track"] = row.Text(9);
    entry.content["profile"] = row.Text(10);
  }
  return FinishedEntry(row, id, std::move(entry));
}

constexpr EntrySource kEntrySources[] = {
    {kTeamEntry, "SELECT at, id FROM team_event", TeamEventEntry},
    {kCommitmentEntry, "SELECT created_at, rowid FROM phase_secret", PhaseCommitmentEntry},
    {kAcceptedEntry, "SELECT accepted_at, id FROM submission", AcceptedEntry},
    {kGradedEntry, "SELECT finished_at, id FROM evaluation WHERE finished_at IS NOT NULL", GradedEntry},
    {kMarkedEntry, "SELECT at, id FROM mark", MarkedEntry},
    {kChosenEntry, "SELECT at, id FROM choice", ChosenEntry},
    {kRejudgeEntry, "SELECT at, id FROM rejudge_event", RejudgeEventEntry},
    {kConfigEntry, "SELECT at, id FROM board_config", BoardConfigEntry},
    {kPhaseEntry, "SELECT at, id FROM phase_event", PhaseEventEntry},
};

}  // namespace

std::span<const EntrySource> EntrySources() { return kEntrySources; }

std::optional<RecordEntry> MakeEntry(SQLite::Database& db, const EntrySource& source,
                                     int64_t row) {
  std::optional<RecordEntry> entry = source.make(db, row);
  if (!entry.has_value()) return entry;
  entry->content["kind"] = source.kind;
  entry->content["at"] = TimeText(entry->at);
  return entry;
}

RecordEntry MakeKeyEntry(int64_t at, const std::string& public_pem) {
  return {at, 0, {{"kind", kKeyEntry}, {"at", TimeText(at)}, {"key", public_pem}}};
}

}  // namespace myograde::server
