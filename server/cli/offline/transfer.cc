// The store as a file: myograde store export, backup, import
#include <absl/strings/str_cat.h>
#include <absl/strings/str_replace.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <set>
#include <string_view>

#include "protocol/base/clock.h"
#include "protocol/base/status_macros.h"
#include "server/base/data_folder.h"
#include "server/base/json_value.h"
#include "server/base/peer_key.h"
#include "server/base/temp_folder.h"
#include "server/cli/base/files.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/client.h"
#include "server/cli/terminal/terminal.h"
#include "server/engine/stored.h"
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
  // Empty text is quoted, so that it is not taken for nothing.
  return absl::StrCat("\"", absl::StrReplaceAll(text, {{"\"", "\"\""}}), "\"");
}

// Writes the JSON export in the file `from` to `folder`, which is made if missing: a file for each
// table, and SHA256SUMS. `mark`: each file begins with the byte order mark of UTF-8.
// InvalidArgumentError if a file can't be written.
absl::Status WriteCsv(const std::string& from, const std::string& folder, bool mark) {
  RETURN_IF_ERROR(MakeFolders(folder));
  std::map<std::string, std::unique_ptr<NewFile>> files;
  const auto write = [&](const std::string& table, const Json& row) -> absl::Status {
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
      if (mark) text += "\xef\xbb\xbf";
      line([](const std::string& key, const Json&) { return key; });
    }
    line([](const std::string&, const Json& value) { return CsvCell(value); });
    return file->Write(text).ok() ? absl::OkStatus() : CantWrite(folder);
  };
  RETURN_IF_ERROR(CheckExport(from, write).status());
  std::string sums;
  for (const auto& [table, file] : files) {
    ASSIGN_OR_RETURN(const std::string digest, file->Keep());
    absl::StrAppend(&sums, digest, "  ", table, ".csv\n");
  }
  return WriteNewFile(folder + "/SHA256SUMS", sums).status();
}

// Whoever reads the checked export knows the seeds of phases that its store had not revealed.
absl::Status WarnOfHiddenSeeds(const std::string& path) {
  std::set<std::string> hidden;
  std::set<std::string> revealed;
  const auto look = [&](const std::string& table, const Json& row) {
    if (table == "journal" && TextAt(row, "kind") == "phase") {
      const Json act = ParsedText(TextAt(row, "entry_json"));
      const bool reveals = act.is_object() && act.value("event", Json()) == "revealed";
      if (reveals) revealed.insert(TextAt(act, "phase"));
    }
    if (table != "config") return absl::OkStatus();
    const Json config = ParsedText(TextAt(row, "content_json"));
    const bool hides = config.is_object() && config.contains("seed_salt");
    if (hides && !TextAt(config, "phase").empty()) hidden.insert(TextAt(config, "phase"));
    return absl::OkStatus();
  };
  RETURN_IF_ERROR(CheckExport(path, look).status());
  for (const std::string& phase : hidden) {
    if (revealed.contains(phase)) continue;
    PrintToErrors(absl::StrCat("myograde: warning: the export holds the seeds of phase ", phase,
                               ", which are not revealed yet; keep it secret"));
  }
  return absl::OkStatus();
}

struct FileOptions : DaemonOptions {
  std::string file;
};

struct ExportOptions : FileOptions {
  std::string format = "json";
  bool mark = false;
};

Json ToJson(const std::string& file, const ExportInfo& info) {
  return {{"file", file}, {"sha256", info.sha256}, {"schema", info.schema}, {"rows", info.rows}};
}

// Asks for `from` and keeps the answer as `path`; its digest. `what`: for the progress.
absl::StatusOr<std::string> Fetch(const Client& client, const std::string& from,
                                  const std::string& path, const std::string& what,
                                  int64_t& bytes) {
  NewFile file(path);
  RETURN_IF_ERROR(file.status());
  ASSIGN_OR_RETURN(bytes,
                   client.Download(from, [&](std::string_view piece) { return file.Write(piece); },
                                   Progress(what, Progress::Unit::kBytes).Listener()));
  return file.Keep();
}

absl::StatusOr<int> Export(const ExportOptions& options) {
  const bool csv = options.format == "csv";
  RETURN_IF_ERROR(RefuseIf(
      {{csv && options.file.empty(),
        "a CSV export is a folder with a file for each table; name the folder"},
       // It holds what policies printed, unchanged.
       {options.file.empty() && TerminalColumns(STDOUT_FILENO) > 0,
        "won't print an export to a terminal, because policies' output in it may contain control "
        "sequences; name a FILE, or redirect standard output"}}));
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
  if (csv) {
    RETURN_IF_ERROR(WriteCsv(document, options.file, options.mark));
  } else {  // as sha256sum -c reads it
    const std::string name = fs::path(document).filename().string();
    RETURN_IF_ERROR(
        WriteNewFile(options.file + ".sha256", absl::StrCat(digest, "  ", name, "\n")).status());
  }
  Json written = ToJson(options.file, info);
  written["format"] = options.format;
  return PrintAnswer(written, options.json,
                     Sentence("Exported to {file}: {rows.submission:submission} and "
                              "{rows.episode:episode}, checksum {sha256}"));
}

absl::StatusOr<int> Backup(const FileOptions& options) {
  int64_t bytes = 0;
  ASSIGN_OR_RETURN(const std::string digest,
                   Fetch(options.client(), "/v1/backup", options.file, "backup", bytes));
  return PrintAnswer(
      Json{{"file", options.file}, {"bytes", bytes}, {"sha256", digest}}, options.json,
      Sentence(
          "Copied the store, {bytes:byte}, to {file}. It contains the store's secret; keep it as "
          "safe as the data folder."));
}

// Without a daemon the store is made here; the lock keeps one from starting meanwhile.
absl::Status ImportHere(const std::string& data, const std::string& file,
                        const ExportInfo& info) {
  RETURN_IF_ERROR(MakeFolders(data));
  std::error_code ignored;
  fs::permissions(data, fs::perms::owner_all, ignored);
  ASSIGN_OR_RETURN(const DataLock lock, HostStatus("import", DataLock::Take(data)));
  const std::string path = data + "/store.db";
  ASSIGN_OR_RETURN(const std::unique_ptr<Store> store,
                   HostStatus("import", Store::Open(path, SystemClock())));
  RETURN_IF_ERROR(HostStatus("import", store->Write([&](Transaction& writer) {
    return writer.Import(file, info, PeerKey(getuid()), CheckReadable);
  })));
  ReaderPool readers(path);
  // Without this, the first board would have to compute what the view lacks.
  return HostStatus("import", FillStandings(*store, readers).status());
}

absl::StatusOr<int> Import(const FileOptions& options) {
  // A bad file is reported before anything is touched.
  ASSIGN_OR_RETURN(const ExportInfo info, CheckExport(options.file));
  ASSIGN_OR_RETURN(const ServerChoice choice, ChooseServer(options));
  const Client client(choice);
  const absl::Status heard = client.Get("/v1/health").status();
  absl::Status status;
  if (heard.ok()) {
    status =
        client
            .Upload("/v1/import", options.file,
                    Progress("import", Progress::Unit::kBytes).Listener(
                        "the daemon is importing it"),
                    "application/json")
            .status();
  } else if (choice.address.network()) {
    status = heard;
  } else if (!options.socket.empty()) {
    status = absl::UnavailableError(absl::StrCat("no daemon listens on ", options.socket));
  } else {
    status = ImportHere(DataDir(options.data), options.file, info);
  }
  RETURN_IF_ERROR(status);
  return PrintAnswer(ToJson(options.file, info), options.json,
                     Sentence("Imported {rows.submission:submission} and {rows.episode:episode}, "
                              "checksum {sha256}"));
}

}  // namespace

Command AddExport(CLI::App& verb) {
  auto options = std::make_shared<ExportOptions>();
  verb.add_option("FILE", options->file,
                  "The file to write, with FILE.sha256 beside it; for CSV a folder "
                  "(default: JSON to standard output, unless that is a terminal)");
  verb.add_option("--format", options->format, "json or csv (default: json)")
      ->check(CLI::IsMember({"json", "csv"}));
  verb.add_flag("--bom", options->mark,
                "With --format csv: begin each file with a UTF-8 byte order mark, for Excel");
  AddDaemonOptions(verb, "export", *options, "Print what was written as JSON");
  return [options] { return Export(*options); };
}

Command AddBackup(CLI::App& verb) {
  auto options = std::make_shared<FileOptions>();
  verb.add_option("FILE", options->file, "The file to write")->required();
  AddDaemonOptions(verb, "backup", *options);
  return [options] { return Backup(*options); };
}

Command AddImport(CLI::App& verb) {
  auto options = std::make_shared<FileOptions>();
  verb.add_option("FILE", options->file, "An export as JSON")->required();
  AddDaemonOptions(verb, "import", *options);
  return [options] { return Import(*options); };
}

}  // namespace myograde::server
