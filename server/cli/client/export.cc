// myograde export, backup
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <set>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
#include "server/base/temp_folder.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/new_file.h"
#include "server/cli/base/print_json.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/export_csv.h"
#include "server/cli/client/export_rows.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/progress.h"
#include "server/cli/terminal/screen.h"
#include "server/cli/terminal/text.h"
#include "server/store/transfer.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

struct ExportOptions : DaemonOptions {
  std::string file;
  std::string format = "json";
  bool mark = false;
};

struct BackupOptions : DaemonOptions {
  std::string file;
};

// Asks for `from` and keeps the answer as `path`; its digest.
absl::StatusOr<std::string> Fetch(const Client& client, const std::string& from,
                                  const std::string& path, const std::string& what,
                                  int64_t& bytes) {
  NewFile file(path);
  if (!file.opened()) return CantWrite(path);
  absl::StatusOr<int64_t> got = absl::InternalError("");
  {
    Progress progress(what, Progress::Unit::kBytes);
    got = client.Download(
        from, [&](const char* data, size_t size) { return file.Write({data, size}); },
        [&](int64_t done, int64_t total) { progress.Show(done, total, ""); });
  }
  if (file.error() != 0) {
    errno = file.error();
    return CantWrite(path);
  }
  if (!got.ok()) return got.status();
  bytes = *got;
  return file.Keep();
}

// Beside FILE its digest, as sha256sum -c reads it.
absl::Status WriteDigest(const std::string& path, const std::string& digest) {
  NewFile file(path + ".sha256");
  if (!file.opened() ||
      !file.Write(absl::StrCat(digest, "  ", fs::path(path).filename().string(), "\n"))) {
    return CantWrite(path + ".sha256");
  }
  return file.Keep().status();
}

int PrintExport(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  PlainOutput() << file.rdbuf();
  return kDone;
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

int Export(const ExportOptions& options) {
  const bool csv = options.format == "csv";
  if (csv && options.file.empty()) {
    return ReportError(absl::InvalidArgumentError(
        "an export as CSV is a folder with a file for each table: name the folder"));
  }
  // It holds what policies printed, unchanged.
  if (options.file.empty() && TerminalColumns(STDOUT_FILENO) > 0) {
    return ReportError(absl::InvalidArgumentError(
        "an export is not for a terminal, which might obey what policies printed: name a FILE, or "
        "redirect standard output"));
  }
  absl::StatusOr<TempFolder> temp = TempFolder::Make("export");
  if (!temp.ok()) return ReportError(temp.status());
  const bool plain = !csv && !options.file.empty();
  const std::string document = plain ? options.file : temp->path() + "/export.json";
  int64_t bytes = 0;
  const absl::StatusOr<std::string> digest =
      Fetch(options.client(), "/v1/export", document, "export", bytes);
  if (!digest.ok()) return ReportError(digest.status());
  const absl::StatusOr<ExportInfo> info = CheckExport(document);
  if (!info.ok()) return ReportError(HostStatus("the daemon's export", info.status()));
  if (absl::Status warned = WarnOfHiddenSeeds(document); !warned.ok()) return ReportError(warned);
  if (options.file.empty()) return PrintExport(document);
  const absl::Status written =
      csv ? WriteCsv(document, options.file, options.mark) : WriteDigest(options.file, *digest);
  if (!written.ok()) return ReportError(written);
  if (options.json) {
    PrintJson({{"file", options.file}, {"format", options.format}, {"sha256", info->sha256},
               {"schema", info->schema}, {"rows", info->rows}});
  } else {
    std::cout << "Exported to " << Harmless(options.file) << ": " << RowsText(*info) << ", checksum "
              << info->sha256 << std::endl;
  }
  return kDone;
}

int Backup(const BackupOptions& options) {
  int64_t bytes = 0;
  const absl::StatusOr<std::string> digest =
      Fetch(options.client(), "/v1/backup", options.file, "backup", bytes);
  if (!digest.ok()) return ReportError(digest.status());
  if (options.json) {
    PrintJson({{"file", options.file}, {"bytes", bytes}, {"sha256", *digest}});
  } else {
    std::cout << "The store as it is now, " << Counted(bytes, "byte") << ", is in " << Harmless(options.file)
              << ". It holds the store's secret: keep it as safe as the data folder." << std::endl;
  }
  return kDone;
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
