#include "server/store/record.h"

#include <algorithm>
#include <utility>

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>
#include <absl/time/time.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/store/reader.h"
#include "server/store/store.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr int64_t kEntriesAtATime = 10'000;

std::string TimeText(int64_t ms) {
  return absl::FormatTime("%Y-%m-%dT%H:%M:%E3SZ", absl::FromUnixMillis(ms), absl::UTCTimeZone());
}

Json OrNull(const std::string& text) { return text.empty() ? Json() : Json(text); }
Json OrNull(int64_t id) { return id == 0 ? Json() : Json(id); }

// Where entries of one kind come from: a query for the row of an id, which begins with the row's
// time, and what makes the entry's content of it. nullopt: the row has no entry. What is made of an
// unreadable row does not matter.
struct EntrySource {
  const char* kind;
  const char* table;
  const char* query;
  std::optional<Json> (*make)(StoredRow& row, int64_t id);
};

std::optional<Json> AcceptedEntry(StoredRow& row, int64_t id) {
  if (!row.Flag(1) && row.ok()) return std::nullopt;
  return Json{{"submission", id},
              {"team_id", row.Id(2)},
              {"team", row.Text(3)},
              {"artefact", ArtefactCommitment(id, row.Hash(4))},
              {"track", row.Text(5)},
              {"profile", row.Text(6)},
              {"phase", OrNull(row.Text(7))},
              {"config", row.Hash(8)},
              {"evaluation", row.Id(9)}};
}

// The hash of the build as a receipt shows it.
std::string GraderHash(const std::string& grader_json) {
  return Sha256Hex(CanonicalJson(Json::parse(grader_json, nullptr, /*allow_exceptions=*/false)));
}

std::optional<Json> GradedEntry(StoredRow& row, int64_t id) {
  const EvaluationKind kind = row.Named(1, ParseEvaluationKind);
  const bool ranked = row.Flag(2);
  if (row.ok() && (!ranked || kind == EvaluationKind::kRerun)) return std::nullopt;
  const EvaluationState state = row.Named(4, ParseEvaluationState);
  const bool result = state == EvaluationState::kDone || state == EvaluationState::kFailed;
  return Json{{"evaluation", id},
              {"submission", row.Id(3)},
              {"state", result ? "graded" : std::string(EvaluationStateName(state))},
              {"results", result ? Json(row.Hash(5)) : Json()},
              {"config", row.Hash(6)},
              {"seeds", row.Hash(7)},
              {"grader", row.ok() ? GraderHash(row.Object(8)) : ""},
              {"rejudge", OrNull(row.IdOr0(9))},
              {"repetition", OrNull(row.IdOr0(10))}};
}

std::optional<Json> MarkedEntry(StoredRow& row, int64_t) {
  if (!row.Flag(5) && row.ok()) return std::nullopt;
  const std::string mark = row.OneOf(2, {"hidden", "disqualified", "baseline"});
  Json content = {{"submission", row.Id(1)}, {"mark", mark}, {"set", row.Flag(3)}};
  // Boards tell why somebody was disqualified, and nothing of the others.
  if (mark == "disqualified") content["reason"] = row.Text(4);
  return content;
}

std::optional<Json> ChosenEntry(StoredRow& row, int64_t) { return Json{{"submission", row.Id(1)}}; }

std::optional<Json> TeamEventEntry(StoredRow& row, int64_t) {
  const std::string event = row.OneOf(1, {"created", "renamed", "merged", "banned", "unbanned"});
  Json content = {{"event", event}, {"team_id", row.Id(2)}, {"team", row.Text(3)}};
  if (event == "merged") content["into"] = row.Id(4);
  return content;
}

// A phase's secret opens its seeds and is published with them. An import never had it: whoever
// reveals the phase publishes it elsewhere.
std::optional<Json> PhaseEventEntry(StoredRow& row, int64_t) {
  const std::string event =
      row.OneOf(2, {kPausedEvent, kResumedEvent, kPublishedEvent, kRevealedEvent});
  Json content = {{"phase", OrNull(row.Text(1))}, {"event", event}};
  if (event == kRevealedEvent) {
    content["secret"] = row.IsNull(3) ? Json() : Json(absl::BytesToHexString(row.Blob(3)));
  }
  return content;
}

// The commitment is that of server/proof/seed_list.h: over the secret's hexadecimal digits.
std::optional<Json> PhaseCommitmentEntry(StoredRow& row, int64_t) {
  Json content = {{"phase", row.Text(1)},
                  {"commitment", Sha256Hex(absl::BytesToHexString(row.Blob(2)))}};
  // A phase's own secret is drawn before it takes anything (Writer::PhaseSecret).
  if (row.Flag(3)) content["further"] = true;
  return content;
}

std::optional<Json> BoardConfigEntry(StoredRow& row, int64_t) {
  return Json{{"phase", OrNull(row.Text(1))},
              {"track", row.Text(2)},
              {"profile", row.Text(3)},
              {"config", row.Hash(4)},
              {"rejudge", OrNull(row.IdOr0(5))}};
}

// Until a rejudge is applied, participants see nothing of it: its document is committed to, and
// told when it is applied.
std::optional<Json> RejudgeEventEntry(StoredRow& row, int64_t) {
  const std::string event = row.OneOf(1, {"created", "applied", "dropped"});
  const std::string document = row.Object(3);
  Json content = {{"event", event},
                  {"rejudge", row.Id(2)},
                  {"document_sha256", Sha256Hex(document)},
                  {"signature", row.Text(4)}};
  if (event == "applied" && row.ok()) {
    content["document"] = Json::parse(document, nullptr, /*allow_exceptions=*/false);
    content["purpose"] = row.Text(5);
    content["from_config"] = row.Hash(6);
    content["to_config"] = row.Hash(7);
    content["phase"] = OrNull(row.Text(8));
    content["track"] = row.Text(9);
    content["profile"] = row.Text(10);
  }
  return content;
}

// The name that a team had after an event is the one that its next renaming took away.
constexpr EntrySource kEntrySources[] = {
    {kTeamEntry, "team_event",
     "SELECT e.at, e.event, e.team_id, ifnull((SELECT detail FROM team_event WHERE "
     "team_id = e.team_id AND event = 'renamed' AND id > e.id ORDER BY id LIMIT 1), t.name), "
     "t.merged_into FROM team_event AS e LEFT JOIN team AS t ON t.id = e.team_id WHERE e.id = ?",
     TeamEventEntry},
    {kCommitmentEntry, "phase_secret",
     "SELECT created_at, phase, secret, EXISTS (SELECT 1 FROM submission AS s WHERE "
     "s.phase = p.phase AND s.ranked = 1 AND s.accepted_at < p.created_at) "
     "FROM phase_secret AS p WHERE p.rowid = ?",
     PhaseCommitmentEntry},
    {kAcceptedEntry, "submission",
     "SELECT s.accepted_at, s.ranked, s.team_id, t.name, s.artefact, s.track, s.profile, "
     "s.phase, s.config, (SELECT min(id) FROM evaluation WHERE submission = s.id AND "
     "kind = 'original') FROM submission AS s LEFT JOIN team AS t ON t.id = s.team_id WHERE s.id = "
     "?",
     AcceptedEntry},
    {kGradedEntry, "evaluation",
     "SELECT e.finished_at, e.kind, s.ranked, e.submission, e.state, e.results_hash, "
     "ifnull(e.config, s.config), ifnull(e.seeds, s.seeds), e.grader_json, i.rejudge, i.repetition "
     "FROM evaluation AS e LEFT JOIN submission AS s ON s.id = e.submission "
     "LEFT JOIN rejudge_item AS i ON i.evaluation = e.id "
     "WHERE e.id = ? AND e.finished_at IS NOT NULL",
     GradedEntry},
    {kMarkedEntry, "mark",
     "SELECT m.at, m.submission, m.mark, m.set_to, m.why, s.ranked FROM mark AS m "
     "LEFT JOIN submission AS s ON s.id = m.submission WHERE m.id = ?",
     MarkedEntry},
    {kChosenEntry, "choice", "SELECT at, submission FROM choice WHERE id = ?", ChosenEntry},
    {kRejudgeEntry, "rejudge_event",
     "SELECT e.at, e.event, e.rejudge, e.document_json, e.signature, r.purpose, r.from_config, "
     "r.to_config, r.phase, r.track, r.profile FROM rejudge_event AS e "
     "LEFT JOIN rejudge AS r ON r.id = e.rejudge WHERE e.id = ?",
     RejudgeEventEntry},
    {kConfigEntry, "board_config",
     "SELECT at, phase, track, profile, config, rejudge FROM board_config WHERE id = ?",
     BoardConfigEntry},
    {kPhaseEntry, "phase_event",
     "SELECT p.at, p.phase, p.event, s.secret FROM phase_event AS p "
     "LEFT JOIN phase_secret AS s ON s.phase = p.phase WHERE p.id = ?",
     PhaseEventEntry},
};

// Adds an entry at the end, only inside a transaction. A disk's fault or a stranger's edit of the
// last row does not keep what follows out: the chain goes on from what is there, and a check of the
// chain tells where it broke.
void Append(SQLite::Database& db, const std::string& kind, int64_t at, int64_t evaluation,
            Json content) {
  Statement last(db, "SELECT id + 1, chain FROM record ORDER BY id DESC LIMIT 1");
  const bool any = last.executeStep();
  content["kind"] = kind;
  content["at"] = TimeText(at);
  const std::string text = CanonicalJson(content);
  const std::string chain = ChainOf(any ? last.getColumn(1).getString() : "", text);
  Run(db, R"(INSERT INTO record (id, at, kind, evaluation, entry_json, chain)
      VALUES (?, ?, ?, nullif(?, 0), ?, ?))",
      any ? last.getColumn(0).getInt64() : 0, at, kind, evaluation, text, chain);
}

// Whether the latest key of the record is this one.
bool IsLatestKey(SQLite::Database& db, const std::string& public_pem) {
  const std::string last =
      FirstText(db, "SELECT entry_json FROM record WHERE kind = 'key' ORDER BY id DESC LIMIT 1");
  const Json entry = Json::parse(last, nullptr, /*allow_exceptions=*/false);
  return entry.is_object() && entry.value("key", Json()) == public_pem;
}

constexpr char kColumns[] = "SELECT id, entry_json, chain FROM record ";

StoredRow RecordRowOf(SQLite::Statement& select, RecordRow& record) {
  StoredRow row(select, "record");
  record.index = row.Number(0, 0, kMany);
  record.entry_json = row.Object(1);
  record.chain = row.Hash(2);
  return row;
}

}  // namespace

std::string ChainOf(std::string_view before, std::string_view entry_json) {
  Sha256 hash;
  hash.Update(before);
  hash.Update("\n");
  hash.Update(entry_json);
  return hash.FinishHex();
}

std::string ChainMistake(const std::string& before, const RecordRow* entry) {
  if (entry == nullptr) return "it is gone, or of another type";
  if (entry->chain == ChainOf(before, entry->entry_json)) return "";
  return "its \"chain\" does not follow from the entry before: the record was changed here, behind "
         "the daemon's back";
}

std::string ArtefactCommitment(int64_t submission, const std::string& artefact) {
  return Sha256Hex(absl::StrCat("myograde artefact/", submission, "/", artefact));
}

void AppendEntry(SQLite::Database& db, const std::string& kind, int64_t id) {
  const EntrySource& source =
      *std::find_if(std::begin(kEntrySources), std::end(kEntrySources),
                    [&](const EntrySource& each) { return each.kind == kind; });
  Statement select(db, source.query, id);
  if (!select.executeStep()) return;
  StoredRow row(select, source.table, absl::StrCat(id));
  const int64_t at = row.Time(0);
  std::optional<Json> content = source.make(row, id);
  if (!content.has_value()) return;
  if (!row.ok()) return Append(db, kind, at, 0, {{"unreadable", true}, {"row", id}});
  Append(db, kind, at, kind == kGradedEntry ? id : 0, *std::move(content));
}

absl::Status Writer::AppendKey(const std::string& public_pem) {
  if (!IsLatestKey(db_, public_pem)) Append(db_, kKeyEntry, now_ms_, 0, {{"key", public_pem}});
  return absl::OkStatus();
}

int64_t Reader::RecordSize() { return FirstNumber(db_, "SELECT max(id) + 1 FROM record"); }

Listed<RecordRow> Reader::Record(int64_t from, int64_t limit) {
  return ListOf<RecordRow>(
      Statement(db_, absl::StrCat(kColumns, "WHERE id >= ? ORDER BY id LIMIT ?"), from, limit),
      RecordRowOf);
}

absl::StatusOr<RecordRow> Reader::GradedEntry(int64_t evaluation) {
  return FirstOf<RecordRow>(
      Statement(
          db_,
          absl::StrCat(kColumns, "WHERE evaluation = ? AND kind = 'graded' ORDER BY id LIMIT 1"),
          evaluation),
      RecordRowOf,
      absl::NotFoundError(absl::StrCat("the record has no result of evaluation ", evaluation)));
}

absl::StatusOr<std::vector<Damage>> CheckRecordChain(ReaderPool& readers, size_t most) {
  std::vector<Damage> damaged;
  RETURN_IF_ERROR(readers.Read([&](Reader& reader) {
    const int64_t size = reader.RecordSize();
    std::string chain;
    int64_t next = 0;
    const auto add = [&](const RecordRow* entry) {
      std::string mistake = ChainMistake(chain, entry);
      if (!mistake.empty() && damaged.size() < most) {
        damaged.push_back({"record", absl::StrCat(next), std::move(mistake)});
      }
      chain = entry == nullptr ? "" : entry->chain;
      ++next;
    };
    while (next < size && damaged.size() < most) {
      const int64_t end = std::min(size, next + kEntriesAtATime);
      for (const RecordRow& row : reader.Record(next, end - next).rows) {
        while (next < row.index && next < size) add(nullptr);
        add(&row);
      }
      while (next < end) add(nullptr);
    }
    return absl::OkStatus();
  }));
  return damaged;
}

}  // namespace myograde::server
