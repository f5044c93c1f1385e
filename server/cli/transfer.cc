// myograde export, import, backup
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>

#include <absl/cleanup/cleanup.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "protocol/base/fd.h"
#include "protocol/base/sha256.h"
#include "server/cli/client.h"
#include "server/cli/common.h"
#include "server/cli/new_file.h"
#include "server/cli/progress.h"
#include "server/cli/screen.h"
#include "server/base/counted.h"
#include "server/engine/standings.h"
#include "server/base/peer_key.h"
#include "server/store/lock.h"
#include "server/store/transfer.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

struct TransferOptions {
  ApiOptions daemon;
  std::string file;
  std::string format = "json";
  bool json = false;
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

// A cell by RFC 4180. Participants choose some of the texts, and spreadsheets run what looks like
// a formula: those get the apostrophe that makes it text there.
std::string CsvCell(const Json& value) {
  if (value.is_null()) return "";
  if (value.is_number()) return value.dump();
  std::string text = value.is_string() ? value.get<std::string>() : value.dump();
  if (text.find_first_of("=+-@\t\r") == 0) text.insert(0, "'");
  if (!text.empty() && text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string cell = "\"";  // empty text is quoted, so that it is not taken for nothing
  for (const char c : text) cell += c == '"' ? "\"\"" : std::string(1, c);
  return cell + "\"";
}

// One file for each table of the export, and their checksums.
absl::Status WriteCsv(const std::string& from, const std::string& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) {
    return absl::InvalidArgumentError(absl::StrCat(folder, ": can't be made: ", error.message()));
  }
  std::map<std::string, std::unique_ptr<NewFile>> files;
  const absl::Status status =
      ForEachRow(from, [&](const std::string& table, const Json& row) -> absl::Status {
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
          line([](const std::string& key, const Json&) { return key; });
        }
        line([](const std::string&, const Json& value) { return CsvCell(value); });
        return file->Write(text) ? absl::OkStatus() : CantWrite(folder);
      });
  if (!status.ok()) return status;
  NewFile sums(folder + "/SHA256SUMS");
  if (!sums.opened()) return CantWrite(folder);
  for (const auto& [table, file] : files) {
    const absl::StatusOr<std::string> digest = file->Keep();
    if (!digest.ok()) return digest.status();
    if (!sums.Write(absl::StrCat(*digest, "  ", table, ".csv\n"))) return CantWrite(folder);
  }
  return sums.Keep().status();
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

std::string RowsText(const ExportInfo& info) {
  return absl::StrCat(Counted(info.rows.at("submission"), "submission"), " and ",
                      Counted(info.rows.at("episode"), "episode"));
}

int PrintExport(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostream& out = PlainOutput();
  out << file.rdbuf() << std::flush;
  if (out) return kDone;
  return Complain(absl::InvalidArgumentError("standard output does not take the export"));
}

int Export(const TransferOptions& options) {
  const bool csv = options.format == "csv";
  if (csv && options.file.empty()) {
    return Complain(absl::InvalidArgumentError(
        "an export as CSV is a folder with a file for each table: name the folder"));
  }
  absl::StatusOr<TempFolder> temp = TempFolder::Make("export");
  if (!temp.ok()) return Complain(temp.status());
  const bool plain = !csv && !options.file.empty();
  const std::string document = plain ? options.file : temp->path() + "/export.json";
  int64_t bytes = 0;
  const Client client(options.daemon.path());
  const absl::StatusOr<std::string> digest =
      Fetch(client, "/v1/export", document, "export", bytes);
  if (!digest.ok()) return Complain(digest.status());
  const absl::StatusOr<ExportInfo> info = CheckExport(document);
  if (!info.ok()) return Complain(HostStatus("the daemon's export", info.status()));
  if (options.file.empty()) return PrintExport(document);
  const absl::Status written =
      csv ? WriteCsv(document, options.file) : WriteDigest(options.file, *digest);
  if (!written.ok()) return Complain(written);
  if (options.json) {
    PrintJson({{"file", options.file}, {"format", options.format}, {"sha256", info->sha256},
               {"schema", info->schema}, {"rows", info->rows}});
  } else {
    std::cout << "Exported to " << options.file << ": " << RowsText(*info) << ", checksum "
              << info->sha256 << std::endl;
  }
  return kDone;
}

// Without a daemon the store is made here; the lock keeps one from starting meanwhile.
absl::Status ImportHere(const std::string& data, const std::string& file,
                        const ExportInfo& info) {
  std::error_code error;
  fs::create_directories(data, error);
  if (error) {
    return absl::InvalidArgumentError(absl::StrCat(data, ": can't be made: ", error.message()));
  }
  fs::permissions(data, fs::perms::owner_all, error);
  absl::StatusOr<DataLock> lock = DataLock::Take(data);
  if (!lock.ok()) return HostStatus("import", lock.status());
  const std::string path = data + "/store.db";
  absl::StatusOr<std::unique_ptr<Store>> store = Store::Open(path, SystemClock());
  if (!store.ok()) return HostStatus("import", store.status());
  absl::Status status = (*store)->Write([&](Writer& writer) {
    return writer.Import(file, info, PeerKey(getuid()));
  });
  ReaderPool readers(path);
  // A board makes on the spot what the view lacks.
  if (status.ok()) status = FillStandings(**store, readers).status();
  return HostStatus("import", status);
}

int Import(const TransferOptions& options) {
  // Told here before anything is touched.
  const absl::StatusOr<ExportInfo> info = CheckExport(options.file);
  if (!info.ok()) return Complain(info.status());
  const Client client(options.daemon.path());
  absl::Status status;
  if (client.Get("/v1/health").ok()) {
    Progress progress("import", Progress::Unit::kBytes);
    status = client.Upload("/v1/import", options.file, [&](int64_t done, int64_t total) {
      progress.Show(done, total, done < total ? "" : "the daemon takes it up");
    }, "application/json").status();
  } else if (!options.daemon.socket.empty()) {
    status = absl::UnavailableError(absl::StrCat("no daemon listens on ", options.daemon.socket));
  } else {
    status = ImportHere(DataDir(options.daemon.data), options.file, *info);
  }
  if (!status.ok()) return Complain(status);
  if (options.json) {
    PrintJson({{"file", options.file}, {"sha256", info->sha256}, {"schema", info->schema},
               {"rows", info->rows}});
  } else {
    std::cout << "Imported " << RowsText(*info) << ", checksum " << info->sha256 << std::endl;
  }
  return kDone;
}

int Backup(const TransferOptions& options) {
  int64_t bytes = 0;
  const Client client(options.daemon.path());
  const absl::StatusOr<std::string> digest =
      Fetch(client, "/v1/backup", options.file, "backup", bytes);
  if (!digest.ok()) return Complain(digest.status());
  if (options.json) {
    PrintJson({{"file", options.file}, {"bytes", bytes}, {"sha256", *digest}});
  } else {
    std::cout << "The store as it is now, " << Counted(bytes, "byte") << ", is in " << options.file
              << ". It holds the store's secret: keep it as safe as the data folder." << std::endl;
  }
  return kDone;
}

}  // namespace

Action AddExport(CLI::App& verb) {
  auto options = std::make_shared<TransferOptions>();
  verb.add_option("FILE", options->file,
                  "Where to: a file, beside which FILE.sha256 is put, or for CSV a folder "
                  "(default: JSON to standard output)");
  verb.add_option("--format", options->format, "json or csv (default: json)")
      ->check(CLI::IsMember({"json", "csv"}));
  verb.add_flag("--json", options->json,
                "Print what was written as JSON (configs/schema/export.json)");
  AddDaemonOptions(verb, options->daemon);
  return [options] { return Export(*options); };
}

Action AddImport(CLI::App& verb) {
  auto options = std::make_shared<TransferOptions>();
  verb.add_option("FILE", options->file, "An export as JSON")->required();
  verb.add_flag("--json", options->json, "Print JSON (configs/schema/import.json)");
  AddDaemonOptions(verb, options->daemon);
  return [options] { return Import(*options); };
}

Action AddBackup(CLI::App& verb) {
  auto options = std::make_shared<TransferOptions>();
  verb.add_option("FILE", options->file, "Where to")->required();
  verb.add_flag("--json", options->json, "Print JSON (configs/schema/backup.json)");
  AddDaemonOptions(verb, options->daemon);
  return [options] { return Backup(*options); };
}

}  // namespace myograde::server
