// myograde export, backup
#include <absl/strings/str_cat.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <string_view>

#include "protocol/base/status_macros.h"
#include "server/base/temp_folder.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/new_file.h"
#include "server/cli/base/print_json.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/progress.h"
#include "server/cli/terminal/screen.h"
#include "server/cli/terminal/text.h"
#include "server/store/transfer.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
// Spreadsheets take the wide forms of the signs for the signs, and ignore a line break before them.
bool BeginsAsFormula(std::string_view text) {
  for (const std::string_view sign :
       {"=", "+", "-", "@", "\t", "\r", "\n", "＝", "＋", "－", "＠"}) {
    if (text.starts_with(sign)) return true;
  }
  return false;
}

// A cell by RFC 4180. Participants choose some of the texts, and spreadsheets run what looks like
// a formula: those get the apostrophe that makes it text there.
std::string CsvCell(const Json& value) {
  if (value.is_null()) return "";
  if (value.is_number()) return value.dump();
  std::string text = value.is_string() ? value.get<std::string>() : value.dump();
  if (BeginsAsFormula(text)) text.insert(0, "'");
  if (!text.empty() && text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string cell = "\"";  // empty text is quoted, so that it is not taken for nothing
  for (const char c : text) cell += c == '"' ? "\"\"" : std::string(1, c);
  return cell + "\"";
}

// Writes the JSON export in the file `from` to `folder`, which is made if missing: a file for each
// table, and SHA256SUMS. `mark`: each file begins with the byte order mark of UTF-8.
// InvalidArgumentError if a file can't be written.
absl::Status WriteCsv(const std::string& from, const std::string& folder, bool mark) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) {
    return absl::InvalidArgumentError(absl::StrCat(folder, ": can't be made: ", error.message()));
  }
  std::map<std::string, std::unique_ptr<NewFile>> files;
  RETURN_IF_ERROR(ForEachRow(from, [&](const std::string& table, const Json& row) -> absl::Status {
    auto& file = files[table];
    std::string text;
    const auto line = [&](const auto& cell_of) {
      bool first = true;
      for (const auto& [key, value] : row.items()) {
        absl::StrAppend(&text, first ? "" : ",", cell_of(key, value));
        first = false;
      }
      text += "\r\n";
    };
    if (file == nullptr) {
      file = std::make_unique<NewFile>(absl::StrCat(folder, "/", table, ".csv"));
      if (!file->opened()) return CantWrite(folder);
      if (mark) text += "\xef\xbb\xbf";
      line([](const std::string& key, const Json&) { return key; });
    }
    line([](const std::string&, const Json& value) { return CsvCell(value); });
    return file->Write(text) ? absl::OkStatus() : CantWrite(folder);
  }));
  std::string sums;
  for (const auto& [table, file] : files) {
    ASSIGN_OR_RETURN(const std::string digest, file->Keep());
    absl::StrAppend(&sums, digest, "  ", table, ".csv\n");
  }
  return WriteNewFile(folder + "/SHA256SUMS", sums).status();
}

// The phases whose seeds a checked export holds and its store had not revealed, by name.
absl::StatusOr<std::set<std::string>> HiddenPhasesOf(const std::string& path) {
  std::set<std::string> hidden;
  std::set<std::string> revealed;
  RETURN_IF_ERROR(ForEachRow(path, [&](const std::string& table, const Json& row) {
    if (table == "phase_event" && TextAt(row, "event") == "revealed") {
      revealed.insert(TextAt(row, "phase"));
    }
    if (table != "config") return absl::OkStatus();
    const Json config =
        Json::parse(TextAt(row, "effective_json"), nullptr, /*allow_exceptions=*/false);
    if (!config.is_object() || !config.contains("seed_salt")) return absl::OkStatus();
    if (const Json phase = config.value("phase", Json()); phase.is_string()) hidden.insert(phase);
    return absl::OkStatus();
  }));
  for (const std::string& phase : revealed) hidden.erase(phase);
  return hidden;
}

struct ExportOptions : DaemonOptions {
  std::string file;
  std::string format = "json";
  bool mark = false;
};

struct BackupOptions : DaemonOptions {
  std::string file;
};

// Asks for `from` and keeps the answer as `path`; its digest. `what`: for the progress.
absl::StatusOr<std::string> Fetch(const Client& client, const std::string& from,
                                  const std::string& path, const std::string& what,
                                  int64_t& bytes) {
  NewFile file(path);
  if (!file.opened()) return CantWrite(path);
  const absl::StatusOr<int64_t> got = client.Download(
      from,
      [&](const char* data, size_t size) {
        return file.Write({data, size});
      },
      Progress(what, Progress::Unit::kBytes).Listener());
  if (file.error() != 0) {
    errno = file.error();
    return CantWrite(path);
  }
  ASSIGN_OR_RETURN(bytes, got);
  return file.Keep();
}

// Whoever reads the export knows the seeds.
absl::Status WarnOfHiddenSeeds(const std::string& document) {
  ASSIGN_OR_RETURN(const std::set<std::string> hidden, HiddenPhasesOf(document));
  for (const std::string& phase : hidden) {
    PrintToErrors(absl::StrCat("myograde: warning: the export holds the seeds of phase ", phase,
                               ", which are not revealed yet: keep it to yourself"));
  }
  return absl::OkStatus();
}

// A whole export in the file `document`, whose digest this is, becomes what the options ask for.
absl::Status WriteExport(const ExportOptions& options, const std::string& document,
                         const std::string& digest) {
  if (options.format == "csv") return WriteCsv(document, options.file, options.mark);
  // As sha256sum -c reads it.
  return WriteNewFile(options.file + ".sha256",
                      absl::StrCat(digest, "  ", fs::path(document).filename().string(), "\n"))
      .status();
}

absl::StatusOr<int> Export(const ExportOptions& options) {
  const bool csv = options.format == "csv";
  if (csv && options.file.empty()) {
    return absl::InvalidArgumentError(
        "an export as CSV is a folder with a file for each table: name the folder");
  }
  // It holds what policies printed, unchanged.
  if (options.file.empty() && TerminalColumns(STDOUT_FILENO) > 0) {
    return absl::InvalidArgumentError(
        "an export is not for a terminal, which might obey what policies printed: name a FILE, or "
        "redirect standard output");
  }
  ASSIGN_OR_RETURN(const TempFolder temp, TempFolder::Make("export"));
  const bool plain = !csv && !options.file.empty();
  const std::string document = plain ? options.file : temp.path() + "/export.json";
  int64_t bytes = 0;
  ASSIGN_OR_RETURN(const std::string digest,
                   Fetch(options.client(), "/v1/export", document, "export", bytes));
  ASSIGN_OR_RETURN(const ExportInfo info, HostStatus("the daemon's export", CheckExport(document)));
  RETURN_IF_ERROR(WarnOfHiddenSeeds(document));
  if (options.file.empty()) {
    PlainOutput() << std::ifstream(document, std::ios::binary).rdbuf();
    return kDone;
  }
  RETURN_IF_ERROR(WriteExport(options, document, digest));
  return PrintAnswer(Json{{"file", options.file},
                          {"format", options.format},
                          {"sha256", info.sha256},
                          {"schema", info.schema},
                          {"rows", info.rows}},
                     options.json, [](const Json& written) {
                       std::cout << "Exported to " << Cell(written, "file") << ": "
                                 << CountCell(written["rows"], "submission", "submission")
                                 << " and " << CountCell(written["rows"], "episode", "episode")
                                 << ", checksum " << Cell(written, "sha256") << std::endl;
                     });
}

absl::StatusOr<int> Backup(const BackupOptions& options) {
  int64_t bytes = 0;
  ASSIGN_OR_RETURN(const std::string digest,
                   Fetch(options.client(), "/v1/backup", options.file, "backup", bytes));
  return PrintAnswer(
      Json{{"file", options.file}, {"bytes", bytes}, {"sha256", digest}}, options.json,
      [](const Json& written) {
        std::cout << "The store as it is now, " << CountCell(written, "bytes", "byte") << ", is in "
                  << Cell(written, "file")
                  << ". It holds the store's secret: keep it as safe as the data folder."
                  << std::endl;
      });
}

}  // namespace

Action AddExport(CLI::App& verb) {
  auto options = std::make_shared<ExportOptions>();
  verb.add_option("FILE", options->file,
                  "The file to write, with FILE.sha256 beside it; for CSV a folder "
                  "(default: JSON to standard output, unless that is a terminal)");
  verb.add_option("--format", options->format, "json or csv (default: json)")
      ->check(CLI::IsMember({"json", "csv"}));
  verb.add_flag("--bom", options->mark,
                "With --format csv: begin each file with the byte order mark of UTF-8, as Excel needs");
  AddDaemonOptions(verb, "export", *options, "Print what was written as JSON");
  return [options] { return Export(*options); };
}

Action AddBackup(CLI::App& verb) {
  auto options = std::make_shared<BackupOptions>();
  verb.add_option("FILE", options->file, "The file to write")->required();
  AddDaemonOptions(verb, "backup", *options);
  return [options] { return Backup(*options); };
}

}  // namespace myograde::server
