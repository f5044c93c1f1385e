// The phases of challenges: what happened to them, their secrets, and the choices of teams.
#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/base/secret.h"
#include "server/store/connection.h"
#include "server/store/reader.h"
#include "server/store/store.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

constexpr int kPhaseSecretBytes = 32;

constexpr char kEventColumns[] = "SELECT id, at, phase, event, who, why FROM phase_event ";

StoredRow PhaseEventOf(SQLite::Statement& select, PhaseEventRow& event) {
  StoredRow row(select, "phase_event");
  event.id = row.Id(0);
  event.at = row.Time(1);
  event.phase = row.Text(2);
  event.event = row.OneOf(3, {kPausedEvent, kResumedEvent, kPublishedEvent, kRevealedEvent});
  event.who = row.Text(4);
  event.why = row.Text(5);
  return row;
}

// The newest event of a phase with one of two names; nullopt: there is none.
absl::StatusOr<std::optional<PhaseEventRow>> Newest(SQLite::Database& db, const std::string& phase,
                                                    const char* one, const char* other) {
  Statement select(db,
                   absl::StrCat(kEventColumns,
                                "WHERE phase = ? AND "
                                "(event NOT IN ('paused', 'resumed', 'published', 'revealed') OR "
                                "event IN (?, ?)) ORDER BY id DESC LIMIT 1"),
                   phase, one, other);
  if (!select.executeStep()) return std::optional<PhaseEventRow>();
  PhaseEventRow event;
  if (const StoredRow row = PhaseEventOf(select, event); !row.ok()) return row.status();
  return std::optional(std::move(event));
}

struct SecretRow {
  std::string secret;
  std::string challenge;  // whose phase it is; "": not known yet
};

// nullopt: none was drawn.
absl::StatusOr<std::optional<SecretRow>> FindSecret(SQLite::Database& db,
                                                    const std::string& phase) {
  Statement select(db, "SELECT secret, challenge FROM phase_secret WHERE phase = ?", phase);
  if (!select.executeStep()) return std::optional<SecretRow>();
  StoredRow row(select, "phase_secret", phase);
  SecretRow found{row.Blob(0), row.Text(1)};
  // A secret that can't be read is not shown either.
  if (!row.ok() || std::ssize(found.secret) != kPhaseSecretBytes) {
    return DamagedRow({"phase_secret", phase, absl::StrCat("its \"secret\" is not ",
                                                           kPhaseSecretBytes, " bytes")});
  }
  return std::optional(std::move(found));
}

// What the record has committed to for a phase, the oldest first; `own`: without secrets that are for
// further episodes alone.
std::vector<std::string> CommitmentsOf(SQLite::Database& db, const std::string& phase,
                                       bool own = false) {
  return AllTexts(db, R"(SELECT json_extract(entry_json, '$.commitment') FROM record
      WHERE kind = 'commitment' AND CASE WHEN json_valid(entry_json) THEN json_extract(entry_json,
      '$.phase') = ?1 AND json_type(entry_json, '$.commitment') = 'text'
      AND NOT (?2 AND json_type(entry_json, '$.further') IS NOT NULL) END ORDER BY id)",
                  phase, own);
}

bool IsRevealed(SQLite::Database& db, const std::string& phase) {
  return AnyRow(db, "SELECT 1 FROM phase_event WHERE phase = ? AND event = 'revealed' LIMIT 1",
                phase);
}

absl::Status RevealedError(const std::string& phase) {
  return CodedRefusal("phase_revealed",
                      absl::StrCat("the seeds of phase \"", phase,
                                   "\" were revealed, so it takes no submission any more; "
                                   "give a new phase a name that no phase of this server had"));
}

// Why a phase without a secret must not draw one: what was played or published followed from another.
// `further`: the secret is for further episodes of a phase with public seeds.
absl::Status CheckNeverUsed(SQLite::Database& db, const std::string& phase, bool further) {
  const bool committed = !CommitmentsOf(db, phase).empty();
  const bool used = AnyRow(db, "SELECT 1 FROM submission WHERE phase = ? LIMIT 1", phase) ||
                    AnyRow(db, "SELECT 1 FROM phase_event WHERE phase = ? LIMIT 1", phase);
  if (!committed && (further || !used)) return absl::OkStatus();
  return CodedRefusal(
      "no_secret",
      absl::StrCat(
          "this store has ",
          committed ? "the commitment to the secret of" : "submissions to or events of",
          " phase \"", phase,
          "\" and not its secret, as after an import, and another secret would be another "
          "phase; ",
          committed ? "bring it over with \"myograde seeds export\" and \"myograde seeds import\""
                    : "give a phase with hidden seeds a name that no phase of this server had"));
}

absl::Status CheckBelongs(SQLite::Database& db, const std::string& phase, const SecretRow& secret,
                          const std::string& challenge) {
  if (secret.challenge.empty() || challenge.empty() || secret.challenge == challenge) {
    return absl::OkStatus();
  }
  if (IsRevealed(db, phase)) return RevealedError(phase);
  return CodedRefusal("no_secret",
                      absl::StrCat("the secret of phase \"", phase, "\" belongs to challenge \"",
                                   secret.challenge, "\", so challenge \"", challenge,
                                   "\" can't use it; give the phase another name"));
}

}  // namespace

absl::StatusOr<bool> Writer::AddPhaseEvent(const std::string& phase, const std::string& event,
                                           const std::string& who, const std::string& why) {
  const bool pauses = event == kPausedEvent || event == kResumedEvent;
  if (phase.empty() && !pauses) {
    return absl::InvalidArgumentError(absl::StrCat("only a phase can be ", event));
  }
  ASSIGN_OR_RETURN(const std::optional<PhaseEventRow> newest,
                   pauses ? Newest(db_, phase, kPausedEvent, kResumedEvent) : Newest(
                       db_, phase, event.c_str(), event.c_str()));
  const bool there = newest.has_value() && newest->event == event;
  const bool same = event != kPausedEvent || (there && newest->why == why);
  if (there && same) return false;
  if (event == kResumedEvent && !newest.has_value()) return false;
  MendBoardState();
  Run(db_, "INSERT INTO phase_event (at, phase, event, who, why) VALUES (?, ?, ?, ?, ?)", now_ms_,
      phase, event, who, why);
  AppendEntry(db_, kPhaseEntry, db_.getLastInsertRowid());
  if (!pauses) return true;
  const nlohmann::json named = phase.empty() ? nlohmann::json() : nlohmann::json(phase);
  RETURN_IF_ERROR(Tell(event == kPausedEvent ? kPauseEvent : kResumeEvent,
                                 CanonicalJson({{"phase", named}, {"reason", why}})));
  return true;
}

absl::Status Writer::CheckTakesSubmissions(const std::string& phase) {
  if (!phase.empty() && IsRevealed(db_, phase)) return RevealedError(phase);
  for (const std::string& scope : {std::string(), phase}) {
    ASSIGN_OR_RETURN(const std::optional<PhaseEventRow> newest,
                     Newest(db_, scope, kPausedEvent, kResumedEvent));
    if (!newest.has_value() || newest->event == kResumedEvent) continue;
    const std::string what =
        scope.empty() ? "submissions are" : absl::StrCat("phase \"", scope, "\" is");
    std::string why = newest->why;
    while (why.ends_with('.')) why.pop_back();
    return CodedRefusal("paused",
                        absl::StrCat(what, " paused by the organiser: ", why, "; try again later"));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::string> Writer::PhaseSecret(const std::string& phase,
                                                const std::string& challenge) {
  ASSIGN_OR_RETURN(std::optional<SecretRow> there, FindSecret(db_, phase));
  if (!there.has_value()) return DrawSecret(phase, challenge, /*further=*/false);
  RETURN_IF_ERROR(CheckBelongs(db_, phase, *there, challenge));
  if (there->challenge.empty() && !challenge.empty()) {
    Run(db_, "UPDATE phase_secret SET challenge = ? WHERE phase = ?", challenge, phase);
  }
  return (*std::move(there)).secret;
}

absl::StatusOr<std::string> Writer::FurtherSecret(const std::string& phase) {
  ASSIGN_OR_RETURN(std::optional<SecretRow> there, FindSecret(db_, phase));
  if (there.has_value()) return (*std::move(there)).secret;
  return DrawSecret(phase, "", /*further=*/true);
}

absl::StatusOr<std::string> Writer::DrawSecret(const std::string& phase,
                                               const std::string& challenge, bool further) {
  RETURN_IF_ERROR(CheckNeverUsed(db_, phase, further));
  ASSIGN_OR_RETURN(std::string secret, RandomBytes(kPhaseSecretBytes));
  AppendEntry(db_, kCommitmentEntry, AddSecret(phase, challenge, secret));
  return secret;
}

int64_t Writer::AddSecret(const std::string& phase, const std::string& challenge,
                          const std::string& secret) {
  Run(db_, R"(INSERT INTO phase_secret (phase, secret, created_at, challenge)
      VALUES (?, CAST(? AS BLOB), ?, ?))",
      phase, secret, now_ms_, challenge);
  return db_.getLastInsertRowid();
}

absl::StatusOr<bool> Writer::TakeSecret(const std::string& phase, const std::string& secret) {
  ASSIGN_OR_RETURN(const std::optional<SecretRow> there, FindSecret(db_, phase));
  const std::vector<std::string> commitments = CommitmentsOf(db_, phase);
  if (commitments.empty()) {
    return absl::FailedPreconditionError(absl::StrCat(
        "the record of this store has no commitment for phase \"", phase,
        "\", so nothing shows that this is its secret; import the store's export first"));
  }
  const std::string commitment = Sha256Hex(absl::BytesToHexString(secret));
  if (std::ssize(secret) != kPhaseSecretBytes || commitment != commitments.front()) {
    return absl::FailedPreconditionError(absl::StrCat(
        "this is not the secret of phase \"", phase, "\": its commitment is ", commitment,
        ", and the record has ", commitments.front(), "; give the file that \"myograde seeds "
        "export\" wrote where the phase was held"));
  }
  if (there.has_value() && there->secret == secret) return false;
  if (there.has_value()) {
    return absl::FailedPreconditionError(absl::StrCat(
        "phase \"", phase, "\" has another secret here, and a secret is never changed"));
  }
  AddSecret(phase, "", secret);
  return true;
}

absl::StatusOr<bool> Writer::Choose(int64_t submission, const std::string& who) {
  Statement select(db_, R"(SELECT s.team_id, s.phase, s.track, s.ranked = 1
      AND e.state = 'done', s.profile FROM submission AS s
      LEFT JOIN evaluation AS e ON e.submission = s.id AND e.kind = 'original' WHERE s.id = ?)",
                   submission);
  if (!select.executeStep()) {
    return absl::NotFoundError(absl::StrCat("there is no submission ", submission));
  }
  if (select.getColumn(3).getInt() != 1) {
    return absl::FailedPreconditionError(absl::StrCat(
        "submission ", submission, " can't be chosen: it is practice, or its evaluation is not "
        "done; choose a ranked one that is"));
  }
  const int64_t team = select.getColumn(0).getInt64();
  const int64_t newest =
      FirstNumber(db_, R"(SELECT c.submission FROM choice AS c
      JOIN submission AS s ON s.id = c.submission JOIN team AS t ON t.id = c.team_id
      WHERE c.phase = ? AND ifnull(t.merged_into, t.id) = (SELECT ifnull(merged_into, id)
      FROM team WHERE id = ?) AND s.track = ? AND s.profile = ? ORDER BY c.id DESC LIMIT 1)",
                  select.getColumn(1).getString(), team, select.getColumn(2).getString(),
                  select.getColumn(4).getString());
  if (newest == submission) return false;
  MendBoardState();
  Run(db_, "INSERT INTO choice (at, team_id, phase, submission, who) VALUES (?, ?, ?, ?, ?)",
      now_ms_, team, select.getColumn(1).getString(), submission, who);
  AppendEntry(db_, kChosenEntry, db_.getLastInsertRowid());
  return true;
}

absl::StatusOr<std::vector<PhaseEventRow>> Reader::PhaseEvents(
    const std::optional<std::string>& phase) {
  return AllOf<PhaseEventRow>(
      Statement(db_, absl::StrCat(kEventColumns, "WHERE ?1 OR phase IN (?2, '') ORDER BY id"),
                !phase.has_value(), phase.value_or("")),
      PhaseEventOf);
}

absl::StatusOr<std::string> Reader::PhaseSecret(const std::string& phase) {
  ASSIGN_OR_RETURN(std::optional<SecretRow> secret, FindSecret(db_, phase));
  if (secret.has_value()) return (*std::move(secret)).secret;
  return absl::NotFoundError(absl::StrCat("phase \"", phase, "\" has no committed seeds"));
}

absl::Status Reader::CheckPhaseSecret(const std::string& phase, const std::string& challenge) {
  ASSIGN_OR_RETURN(const std::optional<SecretRow> secret, FindSecret(db_, phase));
  if (secret.has_value()) return CheckBelongs(db_, phase, *secret, challenge);
  return CheckNeverUsed(db_, phase, /*further=*/false);
}

bool Reader::HasCommitted(const std::string& phase) {
  return !CommitmentsOf(db_, phase, /*own=*/true).empty();
}

absl::StatusOr<std::vector<PhaseUse>> Reader::PhasesInUse() {
  const auto parse = [](SQLite::Statement& select, PhaseUse& use) {
    StoredRow row(select, "submission");
    row.TextsInto(1, {&use.phase, &use.track, &use.profile});
    use.config = row.Hash(4);
    use.submissions = row.Number(5, 1, kMany);
    use.waiting = row.Number(6, 0, kMany);
    return row;
  };
  return AllOf<PhaseUse>(Statement(db_, R"(SELECT max(s.id), s.phase,
      s.track, s.profile, s.config, count(*), sum(e.finished_at IS NULL AND e.id IS NOT NULL)
      FROM submission AS s LEFT JOIN evaluation AS e ON e.submission = s.id AND e.kind = 'original'
      WHERE s.phase != '' GROUP BY s.phase ORDER BY s.phase)"),
                         parse);
}

std::string Reader::ConfigOfPhase(const std::string& phase) {
  return FirstText(db_, R"(SELECT config FROM (SELECT *
      FROM (SELECT 1 AS place, config FROM board_config WHERE phase = ?1 AND phase != ''
      ORDER BY id DESC LIMIT 1) UNION ALL SELECT * FROM (SELECT 2, config FROM submission
      WHERE phase = ?1 AND phase != '' ORDER BY id DESC LIMIT 1)) ORDER BY place LIMIT 1)",
                   phase);
}

}  // namespace myograde::server
