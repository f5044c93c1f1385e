// myograde import
#include <absl/strings/str_cat.h>
#include <unistd.h>

#include <filesystem>
#include <iostream>
#include <memory>

#include "protocol/base/clock.h"
#include "protocol/base/status_macros.h"
#include "server/base/peer_key.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/options.h"
#include "server/cli/base/print_json.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/server_choice.h"
#include "server/cli/offline/verbs.h"
#include "server/cli/terminal/progress.h"
#include "server/cli/terminal/text.h"
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
  ASSIGN_OR_RETURN(const DataLock lock, HostStatus("import", DataLock::Take(data)));
  const std::string path = data + "/store.db";
  ASSIGN_OR_RETURN(const std::unique_ptr<Store> store,
                   HostStatus("import", Store::Open(path, SystemClock())));
  RETURN_IF_ERROR(HostStatus("import", store->Write([&](Writer& writer) {
    return writer.Import(file, info, PeerKey(getuid()), CheckReadable);
  })));
  ReaderPool readers(path);
  // Without this, the first board would have to compute what the view lacks.
  return HostStatus("import", FillStandings(*store, readers).status());
}

absl::StatusOr<int> Import(const ImportOptions& options) {
  // A bad file is reported before anything is touched.
  ASSIGN_OR_RETURN(const ExportInfo info, CheckExport(options.file));
  ASSIGN_OR_RETURN(const ServerChoice choice, ChooseServer(options));
  const Client client(choice);
  const absl::Status heard = client.Get("/v1/health").status();
  absl::Status status;
  if (heard.ok()) {
    Progress progress("import", Progress::Unit::kBytes);
    status = client.Upload("/v1/import", options.file, [&](int64_t done, int64_t total) {
      progress.Show(done, total, done < total ? "" : "the daemon imports it");
    }, "application/json").status();
  } else if (choice.address.network()) {
    status = heard;
  } else if (!options.socket.empty()) {
    status = absl::UnavailableError(absl::StrCat("no daemon listens on ", options.socket));
  } else {
    status = ImportHere(DataDir(options.data), options.file, info);
  }
  RETURN_IF_ERROR(status);
  return PrintAnswer(Json{{"file", options.file},
                          {"sha256", info.sha256},
                          {"schema", info.schema},
                          {"rows", info.rows}},
                     options.json, [](const Json& loaded) {
                       std::cout << "Imported "
                                 << CountCell(loaded["rows"], "submission", "submission") << " and "
                                 << CountCell(loaded["rows"], "episode", "episode") << ", checksum "
                                 << Cell(loaded, "sha256") << std::endl;
                     });
}

}  // namespace

Action AddImport(CLI::App& verb) {
  auto options = std::make_shared<ImportOptions>();
  verb.add_option("FILE", options->file, "An export as JSON")->required();
  AddDaemonOptions(verb, "import", *options);
  return [options] { return Import(*options); };
}

}  // namespace myograde::server
