#include "server/api/resources.h"

#include <fcntl.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdint>
#include <string>
#include <string_view>

#include <absl/cleanup/cleanup.h>
#include <absl/status/status.h>
#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "server/api/board_source.h"
#include "server/engine/stored.h"
#include "server/http/http_server.h"
#include "server/store/transfer.h"

namespace myograde::server {
namespace {

absl::Status WriteExport(ReaderPool& readers, const std::string& path) {
  const Fd fd(open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
  if (!fd.valid()) return absl::ErrnoToStatus(errno, absl::StrCat(path, ": can't be created"));
  absl::Status written;
  std::string buffer;
  const absl::Status status = readers.Read([&](const Transaction& reader) {
    return reader.Export([&](std::string_view text) {
      buffer.append(text);
      if (buffer.size() < (1 << 16)) return true;
      written = WriteAll(fd.get(), buffer);
      buffer.clear();
      return written.ok();
    });
  });
  written.Update(status);
  if (written.ok()) written = WriteAll(fd.get(), buffer);
  return written;
}

std::string SpoolPath(const ApiContext& context) {
  static std::atomic<int64_t> names = 0;
  return absl::StrCat(context.data_dir, "/spool/", ++names);
}

// `make` writes the file; the client gets it with its length, or the reason why not.
absl::Status SendMade(const ApiContext& context, const char* type, Response& response,
                      const std::function<absl::Status(const std::string&)>& make) {
  HttpServer::AllowUploadTime();
  context.access_log.Flush();  // what organisers did before is in the copy
  const std::string path = SpoolPath(context);
  // The answer keeps the file open, so its name can go at once.
  const absl::Cleanup remove = [&] { unlink(path.c_str()); };
  RETURN_IF_ERROR(make(path));
  return response.SetFile(path, type);
}

absl::Status SendExport(const ApiContext& context, const Request&, Response& response) {
  return SendMade(context, "application/json", response, [&context](const std::string& path) {
    return WriteExport(context.readers, path);
  });
}

absl::Status SendBackup(const ApiContext& context, const Request&, Response& response) {
  const auto copy = [&context](const std::string& path) {
    return context.readers.Backup(
        path,
        [](int64_t done, int64_t total) {
          spdlog::info("backup: {} of {} pages are copied", done, total);
        },
        [](const std::string& what) {
          spdlog::error("backup: a row of the store, and of its copy, is damaged: {}", what);
        });
  };
  RETURN_IF_ERROR(SendMade(context, "application/vnd.sqlite3", response, copy));
  // An export is a function of the store's rows, so it adds none.
  NoteAct("store", "backed up");
  return absl::OkStatus();
}

ApiResult ImportStore(const ApiContext& context, const Request& request) {
  HttpServer::AllowUploadTime();
  const std::string path = SpoolPath(context);
  const absl::Cleanup remove = [&] { unlink(path.c_str()); };
  RETURN_IF_ERROR(request.body->MoveTo(path));
  ASSIGN_OR_RETURN(ExportInfo info, CheckExport(path));
  RETURN_IF_ERROR(context.engine.Change(
      [path, checked = info, who = CallerKey()](Transaction& writer) {
        return writer.Import(path, checked, who, CheckReadable);
      },
      context.config.http.upload));
  // Boards make what the view lacks on the spot, so this may as well fail.
  const absl::Status filled = RewriteStandings(context, /*missing_only=*/true).status();
  if (!filled.ok()) spdlog::warn("import: {}", std::string(filled.message()));
  NoteAct("store", absl::StrCat("filled from an export with the SHA-256 ", info.sha256));
  return ApiAnswer{200, {{"sha256", info.sha256}, {"schema", info.schema}, {"rows", info.rows}}};
}

}  // namespace

void AddTransfer(Routes& routes, const ApiContext& context) {
  routes.GetFile("/v1/export", Action::kExport, Bind(context, SendExport));
  routes.GetFile("/v1/backup", Action::kBackup, Bind(context, SendBackup));
  routes.PostUpload("/v1/import", Action::kImport,
                    {.most = context.config.artefacts.archive_bytes,
                     .upload = true,
                     .types = {"application/json", "application/octet-stream"}},
                    Bind(context, ImportStore));
}

}  // namespace myograde::server
