// Export, import and backup: whole stores as files.
#include <fcntl.h>

#include <filesystem>

#include <absl/cleanup/cleanup.h>
#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/file.h"
#include "server/api/api.h"
#include "server/engine/standings.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

}  // namespace

std::string Api::SpoolPath() {
  return absl::StrCat(options_.data_dir, "/spool/", ++upload_names_);
}

absl::Status Api::MakeExport(const std::string& path) {
  const Fd fd(open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
  if (!fd.valid()) return absl::ErrnoToStatus(errno, absl::StrCat(path, ": can't be made"));
  absl::Status written;
  std::string buffer;
  const absl::Status status = readers_.Read([&](Reader& reader) {
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

// `make` writes the file; the client gets it with its length, or the reason why not.
void Api::SendMade(const char* type, httplib::Response& response,
                   const std::function<absl::Status(const std::string&)>& make) {
  if (const auto error = OnlyOrganiser()) return SendError(response, *error);
  UnixHttpServer::AllowUploadTime();
  const std::string path = SpoolPath();
  // The answer keeps the file open, so its name can go at once.
  const absl::Cleanup remove = [&] {
    std::error_code error;
    fs::remove(path, error);
  };
  absl::Status status = make(path);
  if (status.ok()) status = UnixHttpServer::AnswerWithFile(path, type, response);
  if (!status.ok()) SendError(response, ErrorOf(status));
}

Api::Result Api::Import() {
  if (const auto error = OnlyOrganiser()) return *error;
  UnixHttpServer::AllowUploadTime();
  const std::string path = SpoolPath();
  const absl::Cleanup remove = [&] {
    std::error_code error;
    fs::remove(path, error);
  };
  absl::Status status = UnixHttpServer::RequestBody().MoveTo(path);
  if (!status.ok()) return ErrorOf(status);
  absl::StatusOr<ExportInfo> info = CheckExport(path);
  if (!info.ok()) return ErrorOf(info.status());
  status = engine_.Change(
      [path, checked = *info, who = Who()](Writer& writer) {
        return writer.Import(path, checked, who);
      },
      options_.config.http.upload);
  if (!status.ok()) return ErrorOf(status);
  // Boards make what the view lacks on the spot, so this may as well fail.
  absl::StatusOr<Standings> standings = MakeStandings(readers_, /*missing_only=*/true);
  if (standings.ok()) {
    status = engine_.Change(
        [rows = std::move(standings->rows)](Writer& writer) {
          absl::Status written;
          for (const auto& [evaluation, standing] : rows) {
            written.Update(writer.SetStanding(evaluation, standing));
          }
          return written;
        },
        options_.config.http.upload);
  }
  if (!status.ok()) spdlog::warn("import: {}", std::string(status.message()));
  return Answer{200, {{"sha256", info->sha256}, {"schema", info->schema}, {"rows", info->rows}}};
}

void Api::InstallTransfer(UnixHttpServer& server) {
  server.Get("/v1/export", [this](const Request&, httplib::Response& response) {
    SendMade("application/json", response,
             [this](const std::string& path) { return MakeExport(path); });
  });
  server.Get("/v1/backup", [this](const Request&, httplib::Response& response) {
    SendMade("application/vnd.sqlite3", response, [this](const std::string& path) {
      return readers_.Backup(
          path,
          [](int64_t done, int64_t total) {
            spdlog::info("backup: {} of {} pages are copied", done, total);
          },
          [](const std::string& what) {
            spdlog::error("backup: a row of the store is damaged, and so in the copy: {}", what);
          });
    });
  });
  server.Post("/v1/import", [this](const Request&, httplib::Response& response,
                                   const httplib::ContentReader&) {
    const Result result = Import();
    if (const auto* error = std::get_if<ApiError>(&result)) return SendError(response, *error);
    SendAnswer(response, std::get<Answer>(result));
  });
}

}  // namespace myograde::server
