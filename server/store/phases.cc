#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/base/error_code.h"
#include "server/base/secret.h"
#include "server/store/stored_row.h"
#include "server/store/transaction.h"

namespace myograde::server {
namespace {

constexpr int kPhaseSecretBytes = 32;

struct SecretRow {
  std::string secret;
  std::string challenge;  // whose phase it is; "": not known yet
};

// nullopt: none was drawn.
absl::StatusOr<std::optional<SecretRow>> FindSecret(SQLite::Database& db,
                                                    const std::string& phase) {
  Statement select(db, "SELECT secret, challenge FROM phase_secret WHERE phase = ?", phase);
  if (!select.executeStep()) return std::optional<SecretRow>();
  SecretRow found{select.getColumn(0), select.getColumn(1)};
  // A secret that can't be read is not shown either.
  if (std::ssize(found.secret) != kPhaseSecretBytes) {
    return DamagedRow({"phase_secret", phase, absl::StrCat("its \"secret\" is not ",
                                                           kPhaseSecretBytes, " bytes")});
  }
  return std::optional(std::move(found));
}

void AddSecret(SQLite::Database& db, int64_t now_ms, const std::string& phase,
               const std::string& challenge, const std::string& secret) {
  Run(db, R"(INSERT INTO phase_secret (phase, secret, created_at, challenge)
      VALUES (?, CAST(? AS BLOB), ?, ?))",
      phase, secret, now_ms, challenge);
}

absl::Status RevealedError(const std::string& phase) {
  return CodedRefusal("phase_revealed",
                      absl::StrCat("the seeds of phase \"", phase,
                                   "\" were revealed, so it no longer takes submissions; "
                                   "give a new phase a name that no phase of this server had"));
}

// Why a phase without a secret must not draw one: what was played or published followed from another.
// `further`: the secret is for further episodes of a phase with public seeds.
absl::Status CheckNeverUsed(SQLite::Database& db, const PhaseHistory& history,
                            const std::string& phase, bool further) {
  const bool committed = !history.commitments.empty();
  const bool used = !history.events.empty() ||
                    AnyRow(db, "SELECT 1 FROM submission WHERE phase = ? LIMIT 1", phase);
  if (!committed && (further || !used)) return absl::OkStatus();
  return CodedRefusal(
      "no_secret",
      absl::StrCat(
          "this store has ",
          committed ? "the commitment to the secret of" : "submissions to or events of",
          " phase \"", phase,
          "\" and not its secret, as after an import, and another secret would be another "
          "phase; ",
          committed ? "bring it over with \"myograde phase seeds export\" and \"myograde phase seeds import\""
                    : "give a phase with hidden seeds a name that no phase of this server had"));
}

absl::Status CheckBelongs(const PhaseHistory& history, const std::string& phase,
                          const SecretRow& secret, const std::string& challenge) {
  if (secret.challenge.empty() || challenge.empty() || secret.challenge == challenge) {
    return absl::OkStatus();
  }
  if (history.Has(kRevealedEvent)) return RevealedError(phase);
  return CodedRefusal("no_secret",
                      absl::StrCat("the secret of phase \"", phase, "\" belongs to challenge \"",
                                   secret.challenge, "\", so challenge \"", challenge,
                                   "\" can't use it; give the phase another name"));
}

}  // namespace

absl::StatusOr<bool> PhaseActs::AddEvent(const std::string& phase, const std::string& event,
                                         const std::string& who, const std::string& why) {
  const bool pauses = event == kPausedEvent || event == kResumedEvent;
  if (phase.empty() && !pauses) {
    return absl::InvalidArgumentError(absl::StrCat("only a phase can be ", event));
  }
  const PhaseEventRow* newest = pauses ? Board().Phase(phase).Newest(kPausedEvent, kResumedEvent)
                                       : Board().Phase(phase).Newest(event, event);
  const bool there = newest != nullptr && newest->event == event;
  const bool same = event != kPausedEvent || (there && newest->why == why);
  if (there && same) return false;
  if (event == kResumedEvent && newest == nullptr) return false;
  nlohmann::json content = {{"phase", TextOrNull(phase)}, {"event", event}};
  if (event == kRevealedEvent) {
    // It opens the phase's seeds and is published with them. An import never had it: whoever
    // reveals the phase publishes it elsewhere.
    ASSIGN_OR_RETURN(const std::optional<SecretRow> secret, FindSecret(db_, phase));
    content["secret"] =
        secret.has_value() ? nlohmann::json(absl::BytesToHexString(secret->secret)) : nullptr;
  }
  Append({.kind = kPhaseAct, .who = who, .content = std::move(content), .beside = {{"why", why}}});
  if (!pauses) return true;
  RETURN_IF_ERROR(
      Deliveries(context_).Tell(event == kPausedEvent ? kPauseEvent : kResumeEvent,
                                {{"phase", TextOrNull(phase)}, {"reason", why}}));
  return true;
}

absl::Status PhaseActs::CheckTakesSubmissions(const std::string& phase) {
  if (!phase.empty() && Board().Phase(phase).Has(kRevealedEvent)) return RevealedError(phase);
  for (const std::string& scope : {std::string(), phase}) {
    const PhaseEventRow* pause = Board().Phase(scope).Pause();
    if (pause == nullptr) continue;
    const std::string what =
        scope.empty() ? "submissions are" : absl::StrCat("phase \"", scope, "\" is");
    std::string why = pause->why;
    while (why.ends_with('.')) why.pop_back();
    return CodedRefusal("paused",
                        absl::StrCat(what, " paused by the organiser: ", why, "; try again later"));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::string> PhaseActs::EnsureSecret(const std::string& phase,
                                                    const std::string& challenge, bool further) {
  RETURN_IF_ERROR(CheckSecret(phase, challenge, further));
  ASSIGN_OR_RETURN(std::optional<SecretRow> there, FindSecret(db_, phase));
  if (there.has_value()) {
    if (there->challenge.empty() && !challenge.empty()) {
      Run(db_, "UPDATE phase_secret SET challenge = ? WHERE phase = ?", challenge, phase);
    }
    return (*std::move(there)).secret;
  }
  ASSIGN_OR_RETURN(std::string secret, RandomBytes(kPhaseSecretBytes));
  AddSecret(db_, now_ms_, phase, challenge, secret);
  // The commitment is that of server/proof/seed_list.h: over the secret's hexadecimal digits.
  nlohmann::json content = {{"phase", phase},
                            {"commitment", Sha256Hex(absl::BytesToHexString(secret))}};
  // A phase's own secret is drawn before it takes anything (PhaseActs::EnsureSecret).
  if (AnyRow(db_, "SELECT 1 FROM submission WHERE phase = ? AND ranked = 1 AND accepted_at < ?",
             phase, now_ms_)) {
    content["further"] = true;
  }
  Append({.kind = kCommitmentAct, .who = "daemon", .content = std::move(content)});
  return secret;
}

absl::StatusOr<bool> PhaseActs::ImportSecret(const std::string& phase, const std::string& secret) {
  ASSIGN_OR_RETURN(const std::optional<SecretRow> there, FindSecret(db_, phase));
  const std::vector<PhaseCommitment>& commitments = Board().Phase(phase).commitments;
  if (commitments.empty()) {
    return absl::FailedPreconditionError(absl::StrCat(
        "the record of this store has no commitment for phase \"", phase,
        "\", so nothing shows that this is its secret; import the store's export first"));
  }
  const std::string commitment = Sha256Hex(absl::BytesToHexString(secret));
  if (std::ssize(secret) != kPhaseSecretBytes || commitment != commitments.front().commitment) {
    return absl::FailedPreconditionError(
        absl::StrCat("this is not the secret of phase \"", phase, "\": its commitment is ",
                     commitment, ", and the record has ", commitments.front().commitment,
                     "; give the file that \"myograde phase seeds "
                     "export\" wrote where the phase was held"));
  }
  if (there.has_value() && there->secret == secret) return false;
  if (there.has_value()) {
    return absl::FailedPreconditionError(absl::StrCat(
        "phase \"", phase, "\" has another secret here, and a secret is never changed"));
  }
  AddSecret(db_, now_ms_, phase, "", secret);
  return true;
}

absl::StatusOr<std::string> PhaseActs::Secret(const std::string& phase) const {
  ASSIGN_OR_RETURN(std::optional<SecretRow> secret, FindSecret(db_, phase));
  if (secret.has_value()) return (*std::move(secret)).secret;
  return absl::NotFoundError(absl::StrCat("phase \"", phase, "\" has no committed seeds"));
}

absl::Status PhaseActs::CheckSecret(const std::string& phase, const std::string& challenge,
                                    bool further) const {
  ASSIGN_OR_RETURN(const std::optional<SecretRow> secret, FindSecret(db_, phase));
  const PhaseHistory& history = Board().Phase(phase);
  if (secret.has_value()) return CheckBelongs(history, phase, *secret, challenge);
  return CheckNeverUsed(db_, history, phase, further);
}

std::vector<PhaseUse> PhaseActs::InUse() const {
  constexpr StoredRows<PhaseUse, 5> kUses = {
      .table = "submission",
      .select = R"(SELECT max(s.id), s.phase, s.track, s.profile, count(*),
      sum(e.finished_at IS NULL AND e.id IS NOT NULL) FROM submission AS s
      LEFT JOIN evaluation AS e ON e.submission = s.id AND e.kind = 'original' )",
      .first = 1};
  return kUses.List(db_, "WHERE s.phase != '' GROUP BY s.phase ORDER BY s.phase").rows;
}

}  // namespace myograde::server
