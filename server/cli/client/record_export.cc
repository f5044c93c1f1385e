#include "server/cli/client/record_export.h"

#include <absl/status/status.h>
#include <absl/strings/str_cat.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <system_error>
#include <utility>

#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/track_config.h"
#include "server/base/http_client.h"
#include "server/cli/base/files.h"
#include "server/proof/record_head.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
constexpr int kMostRounds = 5;
constexpr int64_t kEntriesAtOnce = 1000;

absl::Status Strange(const std::string& what) {
  return absl::InternalError(absl::StrCat("the daemon's ", what,
                                          " has an unknown format; use the program of the "
                                          "daemon's version"));
}

// The keys of `object` that are listed.
Json Only(const Json& object, std::initializer_list<const char*> keys) {
  Json some = Json::object();
  for (const char* key : keys) some[key] = object.value(key, Json());
  return some;
}

Json RowsOf(const Json& board, const char* list, std::initializer_list<const char*> keys) {
  Json rows = Json::array();
  for (const Json& row : board.value(list, Json::array())) rows.push_back(Only(row, keys));
  return rows;
}

class RecordExporter {
 public:
  RecordExporter(const Client& client, std::string folder,
                 std::function<void(int64_t done, int64_t total)> progress)
      : client_(client), folder_(std::move(folder)), progress_(std::move(progress)) {}

  absl::StatusOr<Json> Run() {
    ASSIGN_OR_RETURN(const Json key, client_.Get("/v1/key"));
    RETURN_IF_ERROR(MakeEmptyFolder());
    for (int round = 0; round < kMostRounds; ++round) {
      ASSIGN_OR_RETURN(const Json signed_head, client_.Get("/v1/record/head"));
      const std::string text = CanonicalJson(signed_head) + "\n";
      const absl::StatusOr<RecordHead> head = ParseHead(text);
      if (!head.ok()) return Strange("head");
      RETURN_IF_ERROR(ReadEntries(head->size));
      RETURN_IF_ERROR(WriteReceipts());
      RETURN_IF_ERROR(WriteBoards());
      // The boards are those of the record only if nothing happened meanwhile.
      ASSIGN_OR_RETURN(const Json after, client_.Get("/v1/record/head"));
      if (after != signed_head) continue;
      RETURN_IF_ERROR(Write("record.jsonl", lines_));
      RETURN_IF_ERROR(Write("key.pem", TextAt(key, "key")));
      RETURN_IF_ERROR(Write("head.json", text));
      return Json{{"folder", folder_},
                  {"size", head->size},
                  {"root", ToHex(head->root)},
                  {"receipts", receipts_.size()},
                  {"withheld", withheld_.size()},
                  {"boards", boards_}};
    }
    return absl::UnavailableError(
        "results keep ending while the record is exported; pause submissions (\"myograde phase "
        "pause "
        "--all\"), wait until they have ended, and export again");
  }

 private:
  absl::Status MakeEmptyFolder() const {
    constexpr char kTodo[] = "; name another folder";
    RETURN_IF_ERROR(MakeFolders(folder_, kTodo));
    std::error_code error;
    const bool empty = fs::is_empty(folder_, error);
    if (error || !empty) {
      return absl::InvalidArgumentError(
          absl::StrCat(folder_, ": is not empty", error ? ", or can't be read" : "",
                       "; name a new folder"));
    }
    for (const char* part : {"/receipts", "/configs", "/boards", "/secrets"}) {
      RETURN_IF_ERROR(MakeFolders(folder_ + part, kTodo));
    }
    return absl::OkStatus();
  }

  absl::Status Write(const std::string& name, const std::string& text) const {
    return WriteFile(absl::StrCat(folder_, "/", name), text);
  }

  absl::Status ReadEntries(int64_t size) {
    lines_.clear();
    graded_.clear();
    for (int64_t from = 0; from < size;) {
      ASSIGN_OR_RETURN(const Json page,
                       client_.Get(absl::StrCat("/v1/record?from=", from,
                                                "&limit=", std::min(size - from, kEntriesAtOnce))));
      const Json entries = page.value("entries", Json());
      if (!entries.is_array() || entries.empty()) return Strange("record");
      for (const Json& row : entries) {
        const Json entry = row.value("entry", Json());
        if (row.value("index", Json()) != from) {
          return absl::InternalError(absl::StrCat("the daemon can't read entry ", from,
                                                  " of its record; restore its store from a backup"));
        }
        if (!entry.is_object()) return Strange("record");
        absl::StrAppend(&lines_, CanonicalJson(entry), "\n");
        ++from;
        if (TextAt(entry, "kind") == "graded" && TextAt(entry, "state") == "graded") {
          graded_[entry.value("evaluation", int64_t{0})] = entry;
        }
        const std::string secret = TextAt(entry, "secret");
        const std::string phase = TextAt(entry, "phase");
        if (!secret.empty() && IsTrackName(phase)) {
          RETURN_IF_ERROR(Write(absl::StrCat("secrets/", phase, ".txt"), secret + "\n"));
        }
      }
    }
    return absl::OkStatus();
  }

  absl::Status WriteReceipt(const Json& entry) {
    const int64_t evaluation = entry.value("evaluation", int64_t{0});
    ASSIGN_OR_RETURN(
        const Json receipt,
        client_.Get(absl::StrCat("/v1/submissions/", entry.value("submission", int64_t{0}),
                                 "/receipt?evaluation=", evaluation, "&public=true&reason=true")));
    if (receipt.contains("withheld")) {
      withheld_.push_back(receipt);
      return absl::OkStatus();
    }
    const Json body = receipt.value("receipt", Json::object());
    const std::string config = TextAt(body, "config");
    if (!IsSha256Hex(config)) return Strange("receipt");
    configs_[config] = body.value("track_config", Json());
    receipts_[evaluation] = true;
    return Write(absl::StrCat("receipts/", evaluation, ".json"), CanonicalJson(receipt) + "\n");
  }

  absl::Status WriteReceipts() {
    int64_t done = 0;
    withheld_ = Json::array();
    for (const auto& [evaluation, entry] : graded_) {
      if (!receipts_.contains(evaluation)) {
        RETURN_IF_ERROR(WriteReceipt(entry));
      }
      progress_(++done, std::ssize(graded_));
    }
    for (const auto& [hash, config] : configs_) {
      RETURN_IF_ERROR(Write(absl::StrCat("configs/", hash, ".json"), CanonicalJson(config) + "\n"));
    }
    return Write("withheld.json", CanonicalJson({{"receipts", withheld_}}) + "\n");
  }

  // What follows from the record is kept, and nothing else, so that every byte can be checked.
  absl::Status WriteBoard(const std::string& hash, const Json& config, const std::string& board) {
    const std::string phase = TextAt(config, "phase");
    const std::string which = phase.empty()
                                  ? absl::StrCat("track=", QueryValue(TextAt(config, "id")),
                                                 "&profile=", QueryValue(TextAt(config, "profile")))
                                  : absl::StrCat("phase=", QueryValue(phase));
    ASSIGN_OR_RETURN(const Json answer,
                     client_.Get(absl::StrCat("/v1/leaderboard?", which,
                                              "&board=", QueryValue(board), "&config=", hash)));
    Json kept =
        Only(answer, {"board", "config", "phase", "track", "profile", "rules", "official_figures"});
    kept["rows"] = RowsOf(
        answer, "rows",
        {"rank", "baseline", "team", "submission", "evaluation", "name", "qualified", "aggregate"});
    kept["disqualified"] =
        RowsOf(answer, "disqualified",
               {"team", "submission", "evaluation", "name", "reason", "at", "aggregate"});
    ++boards_;
    return Write(absl::StrCat("boards/", hash, ".", board, ".json"), CanonicalJson(kept) + "\n");
  }

  absl::Status WriteBoards() {
    boards_ = 0;
    for (const auto& [hash, config] : configs_) {
      if (!config.is_object() || !config.value("scoring", Json()).is_object()) {
        return Strange("config");
      }
      // A track whose boards have no settings has one.
      const Json boards = config["scoring"].value("boards", Json{{"main", Json::object()}});
      for (const auto& [board, rules] : boards.items()) {
        if (!IsTrackName(board)) return Strange("config");
        RETURN_IF_ERROR(WriteBoard(hash, config, board));
      }
    }
    return absl::OkStatus();
  }

  const Client& client_;
  const std::string folder_;
  const std::function<void(int64_t, int64_t)> progress_;
  std::string lines_;                           // of record.jsonl
  std::map<int64_t, Json> graded_;              // entries with results, by evaluation
  std::map<std::string, Json> configs_;         // as receipts show them, by hash
  std::map<int64_t, bool> receipts_;            // evaluations that have one here
  Json withheld_ = Json::array();
  int64_t boards_ = 0;
};

}  // namespace

absl::StatusOr<Json> ExportRecord(
    const Client& client, const std::string& folder,
    const std::function<void(int64_t done, int64_t total)>& progress) {
  return RecordExporter(client, folder, progress).Run();
}

}  // namespace myograde::server
