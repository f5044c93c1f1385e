// myograde import
#include <unistd.h>

#include <filesystem>
#include <iostream>
#include <memory>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "server/base/peer_key.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/places.h"
#include "server/cli/base/print_json.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/server_choice.h"
#include "server/cli/client/export_rows.h"
#include "server/cli/offline/verbs.h"
#include "server/cli/terminal/progress.h"
#include "server/engine/stored.h"
#include "server/store/data_folder.h"
#include "server/store/transfer.h"

namespace myograde::server {
namespace {

struct ImportOptions : DaemonOptions {
  std::string file;
};

// Without a daemon the store is made here; the lock keeps one from starting meanwhile.
absl::Status ImportHere(const std::string& data, const std::string& file,
                        const ExportInfo& info) {
  std::error_code error;
  std::filesystem::create_directories(data, error);
  if (error) {
    return absl::InvalidArgumentError(absl::StrCat(data, ": can't be made: ", error.message()));
  }
  std::filesystem::permissions(data, std::filesystem::perms::owner_all, error);
  absl::StatusOr<DataLock> lock = DataLock::Take(data);
  if (!lock.ok()) return HostStatus("import", lock.status());
  const std::string path = data + "/store.db";
  absl::StatusOr<std::unique_ptr<Store>> store = Store::Open(path, SystemClock());
  if (!store.ok()) return HostStatus("import", store.status());
  absl::Status status = (*store)->Write([&](Writer& writer) {
    return writer.Import(file, info, PeerKey(getuid()), CheckReadable);
  });
  ReaderPool readers(path);
  // Without this, the first board would have to compute what the view lacks.
  if (status.ok()) status = FillStandings(**store, readers).status();
  return HostStatus("import", status);
}

int Import(const ImportOptions& options) {
  // A bad file is reported before anything is touched.
  const absl::StatusOr<ExportInfo> info = CheckExport(options.file);
  if (!info.ok()) return ReportError(info.status());
  const absl::StatusOr<ServerChoice> choice = ChooseServer(options);
  if (!choice.ok()) return ReportError(choice.status());
  const Client client(*choice);
  const absl::Status heard = client.Get("/v1/health").status();
  absl::Status status;
  if (heard.ok()) {
    Progress progress("import", Progress::Unit::kBytes);
    status = client.Upload("/v1/import", options.file, [&](int64_t done, int64_t total) {
      progress.Show(done, total, done < total ? "" : "the daemon imports it");
    }, "application/json").status();
  } else if (choice->address.network()) {
    status = heard;
  } else if (!options.socket.empty()) {
    status = absl::UnavailableError(absl::StrCat("no daemon listens on ", options.socket));
  } else {
    status = ImportHere(DataDir(options.data), options.file, *info);
  }
  if (!status.ok()) return ReportError(status);
  if (options.json) {
    PrintJson({{"file", options.file}, {"sha256", info->sha256}, {"schema", info->schema},
               {"rows", info->rows}});
  } else {
    std::cout << "Imported " << RowsText(*info) << ", checksum " << info->sha256 << std::endl;
  }
  return kDone;
}

}  // namespace

Action AddImport(CLI::App& verb) {
  auto options = std::make_shared<ImportOptions>();
  verb.add_option("FILE", options->file, "An export as JSON")->required();
  AddDaemonOptions(verb, "import", *options);
  return [options] { return Import(*options); };
}

}  // namespace myograde::server
