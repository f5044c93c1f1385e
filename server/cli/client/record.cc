// myograde record: head, show, prove, export; myograde receipt; myograde proof key
#include <absl/strings/str_cat.h>

#include <algorithm>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <set>
#include <string>

#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/track_config.h"
#include "server/base/counted.h"
#include "server/base/http_client.h"
#include "server/cli/base/files.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/client.h"
#include "server/cli/terminal/terminal.h"
#include "server/proof/merkle_tree.h"
#include "server/proof/record_head.h"

namespace myograde::server {
namespace {

struct ReceiptOptions : SubmissionOptions {
  std::string file;
  int64_t evaluation = 0;  // 0: the original
};

absl::StatusOr<int> Receipt(const ReceiptOptions& options) {
  const std::string part = options.evaluation == 0
                               ? "/receipt"
                               : absl::StrCat("/receipt?evaluation=", options.evaluation);
  ASSIGN_OR_RETURN(const Json receipt, options.client().Get(options.Resource(part)));
  // The file is canonical JSON whichever way the daemon had sent it.
  RETURN_IF_ERROR(WriteFile(options.file, CanonicalJson(receipt) + "\n"));
  const Json& body = receipt["receipt"];
  return PrintAnswer(Json{{"submission", options.id},
                          {"evaluation", body["evaluation"]},
                          {"file", options.file},
                          {"merkle_root", body["merkle_root"]},
                          {"signature", receipt["signature"]["value"]}},
                     options.json,
                     Sentence("{file}: receipt of submission {submission}, Merkle root "
                              "{merkle_root}"));
}

struct RecordOptions : DaemonOptions {
  std::string file;      // for the key or a head ("": none), or the folder of an export
  int64_t from = 0;
  int64_t limit = 20;
  int64_t entry = -1;
  std::string since;     // file of an earlier head; "": none
};

absl::StatusOr<int> Key(const RecordOptions& options) {
  ASSIGN_OR_RETURN(const Json key, options.client().Get("/v1/key"));
  const std::string pem = key.value("key", "");
  if (!options.file.empty()) {
    RETURN_IF_ERROR(WriteFile(options.file, pem));
  }
  if (options.json) {
    PrintJson({{"algorithm", key["algorithm"]}, {"key", pem}, {"file", TextOrNull(options.file)}});
  } else if (options.file.empty()) {
    PlainOutput() << pem << std::flush;
  } else {
    std::cout << Sanitized(options.file) << ": the key to publish" << std::endl;
  }
  return kDone;
}

absl::StatusOr<int> ShowHead(const RecordOptions& options) {
  ASSIGN_OR_RETURN(const Json head, options.client().Get("/v1/record/head"));
  if (!options.file.empty()) {
    RETURN_IF_ERROR(WriteFile(options.file, CanonicalJson(head) + "\n"));
  }
  return PrintAnswer(head, options.json, Sentence("{head.size:entry}, root {head.root}"));
}

// The keys that tell most of an entry, on one line.
std::string EntryText(const Json& entry) {
  std::string text = Cell(entry, "kind");
  for (const char* key : {"event", "submission", "evaluation", "team", "phase", "track", "profile",
                          "state", "mark", "config", "results"}) {
    const Json value = entry.value(key, Json());
    if (value.is_null()) continue;
    const std::string text_of = value.is_string() ? value.get<std::string>() : value.dump();
    absl::StrAppend(&text, ", ", key, " ", text_of.size() == 64 ? text_of.substr(0, 12) : text_of);
  }
  return Sanitized(text);
}

void PrintEntries(const Json& answer) {
  for (const Json& row : answer["entries"]) {
    const Json& entry = row["entry"];
    std::cout << row["index"] << "  " << Cell(entry, "at") << "  " << EntryText(entry) << '\n';
  }
  std::cout << "of " << CountCell(answer, "size", "entry") << std::endl;
}

absl::StatusOr<int> ShowEntries(const RecordOptions& options) {
  return options.GetAndPrint(
      absl::StrCat("/v1/record?from=", options.from, "&limit=", options.limit), PrintEntries);
}

int ReportProof(const RecordOptions& options, const Json& proof, bool valid,
                const std::string& what) {
  if (options.json) {
    PrintJson({{"valid", valid}, {"what", what}, {"proof", proof}});
  } else {
    std::cout << what << (valid ? "." : ": the daemon's proof does NOT show it.") << std::endl;
  }
  return valid ? kDone : kNoScore;
}

absl::Status Strange(const std::string& what) {
  return absl::InternalError(absl::StrCat("the daemon's ", what,
                                          " has an unknown format; use the program of the "
                                          "daemon's version"));
}

// The head that the daemon signs now, to which a proof must lead. `file`: where to put its text.
absl::StatusOr<RecordHead> PresentHead(const Client& client, std::string* file = nullptr) {
  ASSIGN_OR_RETURN(const Json answer, client.Get("/v1/record/head"));
  const std::string text = CanonicalJson(answer) + "\n";
  if (file != nullptr) *file = text;
  absl::StatusOr<RecordHead> head = ParseHead(text);
  return head.ok() ? head : Strange("head");
}

absl::StatusOr<int> ProveEntry(const RecordOptions& options) {
  ASSIGN_OR_RETURN(const RecordHead head, PresentHead(options.client()));
  ASSIGN_OR_RETURN(const Json json,
                   options.client().Get(absl::StrCat("/v1/record/proof?entry=", options.entry,
                                                     "&size=", std::max<int64_t>(1, head.size))));
  const absl::StatusOr<EntryProof> proof = CheckEntryProof(json);
  const bool valid = proof.ok() && proof->index == options.entry && proof->root == head.root;
  return ReportProof(
      options, json, valid,
      absl::StrCat("Entry ", options.entry, " is in the record of ",
                   Counted(head.size, "entry", "entries"), " with the root ", ToHex(head.root)));
}

absl::StatusOr<int> ProveSince(const RecordOptions& options) {
  ASSIGN_OR_RETURN(const std::string text, ReadFile(options.since, kMaxHeadBytes));
  const absl::StatusOr<RecordHead> earlier = ParseHead(text);
  if (!earlier.ok()) {
    return absl::InvalidArgumentError(
        absl::StrCat(options.since, ": ", earlier.status().message()));
  }
  ASSIGN_OR_RETURN(const RecordHead head, PresentHead(options.client()));
  const std::string what = absl::StrCat("The record of ", Counted(head.size, "entry", "entries"),
                                        " begins with the ", earlier->size, " of ", options.since);
  if (earlier->size > head.size) return ReportProof(options, nullptr, false, what);
  ASSIGN_OR_RETURN(const Json json,
                   options.client().Get(absl::StrCat("/v1/record/consistency?from=", earlier->size,
                                                     "&to=", head.size)));
  const absl::StatusOr<MerkleProof> proof = ProofOfJson(json.value("proof", Json()));
  const bool valid =
      proof.ok() && ProvesConsistency(earlier->size, earlier->root, head.size, head.root, *proof);
  return ReportProof(options, json, valid, what);
}

absl::StatusOr<int> Prove(const RecordOptions& options) {
  if ((options.entry < 0) == options.since.empty()) {
    return absl::InvalidArgumentError(
        "give the index of an entry, or --since with the file of an earlier head");
  }
  return options.since.empty() ? ProveEntry(options) : ProveSince(options);
}

constexpr int kMostRounds = 5;
constexpr int64_t kEntriesAtOnce = 1000;

// Writes the public record and all that it is checked with to a folder
// (server/cli/offline/record_folder.h says what is in it).
class RecordExporter {
 public:
  RecordExporter(const Client& client, std::string folder,
                 std::function<void(int64_t done, int64_t total)> progress)
      : client_(client), folder_(std::move(folder)), progress_(std::move(progress)) {}

  // What was written. While results keep ending, it begins again a few times; UnavailableError if
  // they still do. InvalidArgumentError: the folder has files already, or can't be written.
  absl::StatusOr<Json> Run() {
    ASSIGN_OR_RETURN(const Json key, client_.Get("/v1/key"));
    RETURN_IF_ERROR(MakeFolder());
    for (int round = 0; round < kMostRounds; ++round) {
      std::string text;
      ASSIGN_OR_RETURN(const RecordHead head, PresentHead(client_, &text));
      RETURN_IF_ERROR(ReadEntries(head.size));
      RETURN_IF_ERROR(WriteReceipts());
      RETURN_IF_ERROR(WriteBoards());
      // The boards are those of the record only if nothing happened meanwhile.
      std::string after;
      RETURN_IF_ERROR(PresentHead(client_, &after).status());
      if (after != text) continue;
      RETURN_IF_ERROR(Write("record.jsonl", lines_));
      RETURN_IF_ERROR(Write("key.pem", TextAt(key, "key")));
      RETURN_IF_ERROR(Write("head.json", text));
      return Json{{"folder", folder_},
                  {"size", head.size},
                  {"root", ToHex(head.root)},
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
  absl::Status MakeFolder() const {
    constexpr char kTodo[] = "; name a new folder";
    RETURN_IF_ERROR(MakeEmptyFolder(folder_, kTodo));
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
    receipts_.insert(evaluation);
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

  absl::Status WriteBoard(const std::string& hash, const Json& config, const std::string& board) {
    const std::string phase = TextAt(config, "phase");
    const std::string which = phase.empty()
                                  ? absl::StrCat("track=", QueryValue(TextAt(config, "id")),
                                                 "&profile=", QueryValue(TextAt(config, "profile")))
                                  : absl::StrCat("phase=", QueryValue(phase));
    ASSIGN_OR_RETURN(const Json answer,
                     client_.Get(absl::StrCat("/v1/leaderboard?", which,
                                              "&board=", QueryValue(board), "&config=", hash)));
    ++boards_;
    return Write(absl::StrCat("boards/", hash, ".", board, ".json"),
                 CanonicalJson(RecordedBoard(answer)) + "\n");
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
  std::set<int64_t> receipts_;                  // evaluations that have one here
  Json withheld_ = Json::array();
  int64_t boards_ = 0;
};

absl::StatusOr<int> WriteRecord(const RecordOptions& options) {
  const Client client = options.client();
  ASSIGN_OR_RETURN(
      const Json written,
      RecordExporter(client, options.file, Progress("receipts").Listener()).Run());
  return PrintAnswer(written, options.json,
                     Sentence("{folder}: {size:entry}, {receipts:receipt} ({withheld} withheld), "
                              "{boards:board}, root {root}"));
}

}  // namespace

Command AddReceipt(CLI::App& verb) {
  auto options = std::make_shared<ReceiptOptions>();
  AddSubmissionId(verb, *options);
  verb.add_option("-o,--output", options->file, "The file to write")->required();
  verb.add_option("--evaluation", options->evaluation,
                  "Number of an evaluation by a rejudge, as \"myograde show\" lists them "
                  "(default: the original evaluation)")
      ->check(WholeNumber(1, "not an evaluation's number"));
  AddDaemonOptions(verb, "receipt", *options);
  return [options] { return Receipt(*options); };
}

Command AddKey(CLI::App& verb) {
  auto options = std::make_shared<RecordOptions>();
  verb.add_option("-o,--output", options->file, "File for the key (default: print it)");
  AddDaemonOptions(verb, "key", *options);
  return [options] { return Key(*options); };
}

Command AddRecord(CLI::App& verb) {
  DaemonParts<RecordOptions> parts(verb);
  RecordOptions& options = parts.options();
  parts
      .Add("head", "Print the record's signed head; keep it to check later records "
                   "against", "head -o head.json",
           "record-head", ShowHead)
      ->add_option("-o,--output", options.file, "File for the head");
  CLI::App* show = parts.Add("show", "List entries, oldest first", "show --from 100", "record-show",
                             ShowEntries);
  show->add_option("--from", options.from, "Index of the first entry (default: 0)")
      ->check(WholeNumber(0, "not the index of an entry"));
  show->add_option("--limit", options.limit, "Entries to list, 1 to 1000 (default: 20)")
      ->check(CLI::Range(1, 1000));
  CLI::App* prove = parts.Add(
      "prove", "Check that an entry is in the record, or that an earlier head is its beginning",
      "prove --since head.json", "record-prove", Prove);
  prove->add_option("ENTRY", options.entry, "The index of an entry")
      ->check(WholeNumber(0, "not the index of an entry"));
  prove->add_option("--since", options.since, "File of an earlier head");
  parts
      .Add("export",
           "Write the record with receipts, configs and boards to a folder, to be "
           "checked by \"myograde verify --all\"",
           "export ./record", "record-export", WriteRecord)
      ->add_option("FOLDER", options.file, "A new folder")
      ->required();
  return {};
}

}  // namespace myograde::server
