// Exports as `import` accepts them. The input is a file as it is, or changes to a real export with
// a corrected checksum, so that the code behind the checksum is reached too: rows that do not fit,
// and rows that fit but hold nonsense, which everything that reads a store then reads.
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <absl/strings/str_split.h>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "server/engine/stored.h"
#include "server/grading/results.h"
#include "server/store/connection.h"
#include "server/store/store.h"
#include "server/store/transfer.h"
#include "tests/fuzz/fuzz.h"

using namespace myograde;
using namespace myograde::server;
using fuzz::Require;

namespace {

constexpr char kFacts[] =
    R"({"clipped":0,"digest":"aa","sim_time":10.0,"steps":1000,"wall_s":1.5})";

const fuzz::Folder& TempFolder() {
  static const fuzz::Folder folder;
  return folder;
}

std::string ExportOf(SQLite::Database& db) {
  std::string text;
  const absl::Status status = ExportRows(db, [&](std::string_view part) {
    text.append(part);
    return true;
  });
  Require(status.ok(), "a store can be exported");
  return text;
}

// One submission, played to its end, marked, with a ledger.
absl::Status Fill(Transaction& writer) {
  const std::string hash(64, 'a');
  absl::Status status =
      writer.content.AddArtefact({{"walker", {"./policy"}, {"python"}}, hash, 10, 2}).status();
  NewSubmission submission;
  submission.team = "alpha";
  submission.artefact = hash;
  submission.track = "manipulation";
  submission.profile = "paper";
  submission.config = std::string(64, 'c');
  submission.config_json = submission.grader_json = "{}";
  submission.seeds = std::string(64, 'd');
  submission.seeds_json = "[1,2]";
  submission.ranked = true;
  submission.blocks = {{0, 1}};
  const AdmissionRules rules = {
      .quota = {.ranked = {9, 9}, .practice = {9, 9}, .failed = {9, 9}, .waiting = 9}};
  const absl::StatusOr<Accepted> accepted = writer.submissions.Accept(submission, rules, "uid 0");
  if (!accepted.ok()) return accepted.status();
  const int64_t block = accepted->blocks[0];
  status.Update(writer.blocks.Start(block, 1, 0, 99, "daemon"));
  for (const int64_t index : {0, 1}) {
    status.Update(writer.episodes.Record({accepted->evaluation, index, block, 1,
                                        static_cast<uint64_t>(index + 1), Outcome::kFailure,
                                        FailureReason::kTime, kFacts, R"({"time_s":10.0})"})
                      .status());
  }
  status.Update(writer.blocks.Finish(block, 1, "{}", "daemon"));
  status.Update(writer.evaluations.End(accepted->evaluation, EvaluationState::kDone, "", "x", "d"));
  status.Update(
      writer.journal.Mark(accepted->submission, "baseline", true, "uid 0", "ours").status());
  return status;
}

// The lines of a real export.
const std::vector<std::string>& TrueLines() {
  static const std::vector<std::string> lines = [] {
    const std::string path = TempFolder() / "full.db";
    ManualClock clock(absl::FromUnixSeconds(1700000000));
    auto store = Store::Open(path, clock);
    Require(store.ok() && (*store)->Write(Fill).ok(), "a store can be filled");
    auto db = OpenForReading(path);
    Require(db.ok(), "a store can be read");
    std::string text = ExportOf(**db);
    text.pop_back();
    return std::vector<std::string>(absl::StrSplit(text, '\n'));
  }();
  return lines;
}

// An empty store, filled in transactions that are never committed.
SQLite::Database& Empty() {
  static const std::unique_ptr<SQLite::Database> db = [] {
    auto opened = OpenForWriting(TempFolder() / "empty.db");
    Require(opened.ok(), "a store can be made");
    return *std::move(opened);
  }();
  return *db;
}

// Changes lines: other text, a patched row, a line removed or duplicated.
std::string Changed(fuzz::Input& input) {
  std::vector<std::string> lines = TrueLines();
  const uint8_t seal = input.Byte();
  while (!input.empty()) {
    const uint8_t what = input.Byte();
    std::string& line = lines[input.Byte() % lines.size()];
    if (what % 4 == 0) {
      line = input.Text(input.Byte());
    } else if (what % 4 == 1) {
      const bool more = line.ends_with(',');
      nlohmann::json row = nlohmann::json::parse(more ? line.substr(0, line.size() - 1) : line,
                                                 nullptr, /*allow_exceptions=*/false);
      const auto patch = nlohmann::json::parse(input.Text(input.Byte()), nullptr, false);
      if (!row.is_object() || patch.is_discarded()) continue;
      row.merge_patch(patch);
      line = CanonicalJson(row) + (more ? "," : "");
    } else if (what % 4 == 2) {
      lines.erase(lines.begin() + (&line - lines.data()));
      if (lines.empty()) lines.emplace_back();
    } else {
      lines.insert(lines.begin() + (&line - lines.data()), std::string(line));
    }
  }
  std::string text = absl::StrJoin(lines, "\n");
  const size_t end = text.rfind(",\"sha256\"");
  if (seal % 8 == 7 || end == std::string::npos) return text + (seal % 16 == 15 ? "" : "\n");
  text.resize(end);
  return absl::StrCat(text, ",\"sha256\":\"", Sha256Hex(text), "\"}\n");
}

// Everything that the daemon reads to show and rank results.
void ReadAll(SQLite::Database& db) {
  BoardFold fold;
  const Transaction reader({.db = db, .fold = &fold});
  for (const SubmissionRow& submission : reader.submissions.List({}).rows) {
    const auto evaluations = reader.evaluations.Of(submission.id);
    for (const EvaluationRow& evaluation : evaluations.value_or(std::vector<EvaluationRow>())) {
      const auto read = reader.episodes.Of(evaluation.id);
      const std::vector<EpisodeRow> rows = read.value_or(std::vector<EpisodeRow>());
      (void)ReadStanding(reader, evaluation.id);
      for (const std::string& salt : {std::string(), std::string(64, 'a')}) {
        (void)ResultsHash(rows, salt);
        (void)ComputeMerkleRoot(rows, salt);
        for (const EpisodeRow& row : rows) (void)ReceiptEntry(row, salt);
      }
      (void)reader.blocks.Of(evaluation.id).status();
      (void)reader.episodes.Repeats(evaluation.id).status();
    }
    (void)reader.quotas.Ledger(submission.team, submission.track, INT64_MAX, 100);
    (void)reader.quotas.CountQuotaUse(submission.team, submission.track, 1700000000000);
    (void)reader.content.Text(kConfigs, submission.config).status();
    (void)reader.content.Text(kSeedLists, submission.seeds).status();
    (void)reader.Board().InForce(submission.config);
  }
  (void)reader.Board().MarksAt();
  (void)reader.episodes.NeededLogs();
  (void)reader.content.ArtefactUses();
}

// The export of what was imported, or nothing if it was rejected.
std::string Import(const std::string& path, const ExportInfo& info) {
  SQLite::Database& db = Empty();
  std::string text;
  const auto body = [&]() -> absl::Status {
    SQLite::Transaction transaction(db);  // rolled back at the end of this block
    if (absl::Status status = ImportRows(db, path, info); !status.ok()) {
      Require(!status.message().empty(), "a refusal says why");
      return status;
    }
    SQLite::Statement dangling(db, "PRAGMA foreign_key_check");
    if (dangling.executeStep()) return absl::FailedPreconditionError("a commit would be refused");
    dangling.reset();
    text = ExportOf(db);
    (void)GuardSqlite(path, [&] { return ReadAll(db), absl::OkStatus(); });
    return absl::OkStatus();
  };
  (void)GuardSqlite(path, body);
  return text;
}

}  // namespace

// The first byte: whether the rest is a file or changes to one.
MYOGRADE_FUZZ_TARGET(import)(const uint8_t* data, size_t size) {
  fuzz::Input input(data, size);
  const bool changes = (input.Byte() & 1) != 0;
  const std::string path = TempFolder() / "import.json";
  fuzz::WriteFile(path, changes ? Changed(input) : input.RestText());
  const absl::StatusOr<ExportInfo> info = CheckExport(path);
  if (!info.ok()) {
    Require(absl::IsInvalidArgument(info.status()), "a bad file is its sender's mistake");
    return 0;
  }
  const std::string text = Import(path, *info);
  if (text.empty()) return 0;
  // What a store imported, it exports, and another store imports and exports the same.
  fuzz::WriteFile(path, text);
  const absl::StatusOr<ExportInfo> again = CheckExport(path);
  Require(again.ok() && again->rows == info->rows, "no row is lost");
  Require(Import(path, *again) == text, "an export of an import is the same export");
  return 0;
}
