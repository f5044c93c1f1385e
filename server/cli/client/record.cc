// myograde record: head, show, prove, export
#include <algorithm>
#include <iostream>
#include <memory>
#include <string>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "server/base/counted.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/options.h"
#include "server/cli/base/print_json.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/print_answer.h"
#include "server/cli/client/record_export.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/progress.h"
#include "server/cli/terminal/text.h"
#include "server/proof/merkle_tree.h"
#include "server/proof/record_head.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr size_t kMaxHeadFile = 4096;

struct RecordOptions : DaemonOptions {
  std::string file;      // of a head, or the folder of an export
  int64_t from = 0;
  int64_t limit = 20;
  int64_t entry = -1;
  std::string since;     // file of an earlier head; "": none
};

int ShowHead(const RecordOptions& options) {
  const absl::StatusOr<Json> head = options.client().Get("/v1/record/head");
  if (!head.ok()) return ReportError(head.status());
  if (!options.file.empty()) {
    const absl::Status written = WriteFile(options.file, CanonicalJson(*head) + "\n");
    if (!written.ok()) return ReportError(written);
  }
  if (options.json) {
    PrintJson(*head);
    return kDone;
  }
  const Json& said = (*head)["head"];
  std::cout << CountCell(said, "size", "entry") << ", root " << Cell(said, "root") << std::endl;
  return kDone;
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
  return Harmless(text);
}

void PrintEntries(const Json& answer) {
  for (const Json& row : answer["entries"]) {
    const Json& entry = row["entry"];
    std::cout << row["index"] << "  " << Cell(entry, "at") << "  " << EntryText(entry) << '\n';
  }
  std::cout << "of " << CountCell(answer, "size", "entry") << std::endl;
}

int ShowEntries(const RecordOptions& options) {
  return PrintAnswer(options.client().Get(absl::StrCat("/v1/record?from=", options.from,
                                                       "&limit=", options.limit)),
                     options.json, PrintEntries);
}

int Report(const RecordOptions& options, const Json& proof, bool valid, const std::string& what) {
  if (options.json) {
    PrintJson({{"valid", valid}, {"what", what}, {"proof", proof}});
  } else {
    std::cout << what << (valid ? "." : ": the daemon's proof does NOT show it.") << std::endl;
  }
  return valid ? kDone : kNoScore;
}

// The head that the daemon signs now is what a proof must lead to.
int ProveEntry(const RecordOptions& options) {
  const absl::StatusOr<Json> answer = options.client().Get("/v1/record/head");
  if (!answer.ok()) return ReportError(answer.status());
  const absl::StatusOr<RecordHead> head = ParseHead(CanonicalJson(*answer) + "\n");
  if (!head.ok()) return ReportError(absl::InternalError(head.status().message()));
  const absl::StatusOr<Json> json = options.client().Get(absl::StrCat(
      "/v1/record/proof?entry=", options.entry, "&size=", std::max<int64_t>(1, head->size)));
  if (!json.ok()) return ReportError(json.status());
  const absl::StatusOr<EntryProof> proof = CheckEntryProof(*json);
  const bool valid = proof.ok() && proof->index == options.entry && proof->root == head->root;
  return Report(options, *json, valid,
                absl::StrCat("Entry ", options.entry, " is in the record of ",
                             Counted(head->size, "entry", "entries"), " with the root ",
                             HexOf(head->root)));
}

int ProveSince(const RecordOptions& options) {
  const absl::StatusOr<std::string> text = ReadFile(options.since, kMaxHeadFile);
  if (!text.ok()) return ReportError(text.status());
  const absl::StatusOr<RecordHead> earlier = ParseHead(*text);
  if (!earlier.ok()) {
    return ReportError(absl::InvalidArgumentError(
        absl::StrCat(options.since, ": ", earlier.status().message())));
  }
  const absl::StatusOr<Json> answer = options.client().Get("/v1/record/head");
  if (!answer.ok()) return ReportError(answer.status());
  const absl::StatusOr<RecordHead> head = ParseHead(CanonicalJson(*answer) + "\n");
  if (!head.ok()) return ReportError(absl::InternalError(head.status().message()));
  const std::string what = absl::StrCat("The record of ", Counted(head->size, "entry", "entries"),
                                        " begins with the ", earlier->size, " of ", options.since);
  if (earlier->size > head->size) return Report(options, nullptr, false, what);
  const absl::StatusOr<Json> json = options.client().Get(
      absl::StrCat("/v1/record/consistency?from=", earlier->size, "&to=", head->size));
  if (!json.ok()) return ReportError(json.status());
  const absl::StatusOr<MerkleProof> proof = ProofOfJson(json->value("proof", Json()));
  const bool valid = proof.ok() && ProvesConsistency(earlier->size, earlier->root, head->size,
                                                     head->root, *proof);
  return Report(options, *json, valid, what);
}

int Prove(const RecordOptions& options) {
  if ((options.entry < 0) == options.since.empty()) {
    return ReportError(absl::InvalidArgumentError(
        "name the index of an entry, or with --since the file of an earlier head"));
  }
  return options.since.empty() ? ProveEntry(options) : ProveSince(options);
}

int ExportRecord(const RecordOptions& options) {
  absl::StatusOr<RecordExport> done = absl::InternalError("");
  {
    const Client client = options.client();
    Progress progress("receipts", Progress::Unit::kEpisodes);
    RecordExporter exporter(client, options.file, [&](int64_t count, int64_t total) {
      progress.Show(count, total, "");
    });
    done = exporter.Run();
  }
  if (!done.ok()) return ReportError(done.status());
  if (options.json) {
    PrintJson({{"folder", options.file},
               {"size", done->size},
               {"root", done->root},
               {"receipts", done->receipts},
               {"withheld", done->withheld},
               {"boards", done->boards}});
    return kDone;
  }
  std::cout << Harmless(options.file) << ": " << Counted(done->size, "entry", "entries") << ", "
            << Counted(done->receipts, "receipt") << " (" << done->withheld << " withheld), "
            << Counted(done->boards, "board") << ", root " << done->root << std::endl;
  return kDone;
}

}  // namespace

Action AddRecord(CLI::App& verb) {
  auto options = std::make_shared<RecordOptions>();
  auto chosen = std::make_shared<Action>();
  verb.require_subcommand(1);
  const auto add = [&](const std::string& name, const char* does, const char* example,
                       int (*act)(const RecordOptions&)) {
    CLI::App* part = verb.add_subcommand(name, does);
    part->footer(absl::StrCat("Example:\n  myograde record ", example));
    part->callback([=] { *chosen = [=] { return act(*options); }; });
    AddDaemonOptions(*part, absl::StrCat("record-", name), *options);
    return part;
  };
  add("head", "Print the record's signed head, which is worth keeping", "head -o head.json",
      ShowHead)
      ->add_option("-o,--output", options->file, "File for the head");
  CLI::App* show = add("show", "List entries, oldest first", "show --from 100", ShowEntries);
  show->add_option("--from", options->from, "Index of the first entry (default: 0)")
      ->check(WholeNumber(0, "no index of an entry"));
  show->add_option("--limit", options->limit, "Entries to list, 1 to 1000 (default: 20)")
      ->check(CLI::Range(1, 1000));
  CLI::App* prove = add("prove", "Check that an entry is in the record, or that an earlier head is "
                                 "its beginning",
                        "prove --since head.json", Prove);
  prove->add_option("ENTRY", options->entry, "The index of an entry")
      ->check(WholeNumber(0, "no index of an entry"));
  prove->add_option("--since", options->since, "File of an earlier head");
  add("export", "Write the record with receipts, configs and boards to a folder, to be checked by "
                "\"myograde verify --all\"",
      "export ./record", ExportRecord)
      ->add_option("FOLDER", options->file, "A new folder")
      ->required();
  return [chosen] { return (*chosen)(); };
}

}  // namespace myograde::server
