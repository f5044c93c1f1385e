#include "server/api/artefacts_resource.h"

#include <functional>
#include <optional>
#include <string>

#include "protocol/base/status_macros.h"
#include "server/api/founding.h"
#include "server/api/requests.h"
#include "server/api/unix_http_server.h"

namespace myograde::server {
namespace {

class UploadedBody : public IncomingArchive {
 public:
  explicit UploadedBody(Body& body) : body_(body) {}
  int64_t size() const override { return body_.size(); }
  ssize_t ReadAt(char* to, size_t size, int64_t offset) const override {
    return body_.ReadAt(to, size, offset);
  }
  absl::Status MoveTo(const std::string& path) override { return body_.MoveTo(path); }

 private:
  Body& body_;
};

absl::StatusOr<UploadRequest> ParseUpload(const Request& request) {
  absl::Status status = CheckParameters(request, {"team", "track"});
  if (status.ok() && request.HasParam("team") != request.HasParam("track")) {
    status = absl::InvalidArgumentError("\"team\" and \"track\" go together: give both or none");
  }
  const std::string team = request.Param("team");
  if (status.ok() && request.HasParam("team")) status = CheckTeam(team);
  if (!status.ok()) return status;
  return UploadRequest{.from = {CallerKey(), team, CallerIsOrganiser()},
                       .track = request.Param("track"),
                       .stopping = UnixHttpServer::Stopping};
}

// For an upload without a team: one of the caller's must still be allowed to hand something in.
absl::Status CheckSomeTeam(ReaderPool& readers) {
  if (CallerIsOrganiser() || Caller().teams.empty()) return absl::OkStatus();
  return readers.Read([](Reader& reader) {
    absl::Status refusal;
    for (const std::string& team : Caller().teams) {
      refusal = reader.CheckTeam(team);
      if (refusal.ok()) break;
    }
    return refusal;
  });
}

}  // namespace

void ArtefactsResource::Install(Routes& routes) {
  routes.PostUpload("/v1/artefacts", Action::kUpload,
                    {.most = context_.config.artefacts.archive_bytes,
                     .upload = true,
                     .types = {"application/x-tar", "application/tar", "application/gzip",
                               "application/x-gzip", "application/zstd", "application/zip",
                               "application/octet-stream"}},
                    std::bind_front(&ArtefactsResource::Upload, this));
}

ApiResult ArtefactsResource::Upload(const Request& request) const {
  ASSIGN_OR_RETURN(UploadRequest upload, ParseUpload(request));
  if (upload.from.team.empty()) {
    RETURN_IF_ERROR(CheckSomeTeam(context_.readers));
  } else {
    ASSIGN_OR_RETURN(std::optional<Founding> founding, FoundingFor(context_, upload.from.team));
    // An organiser may upload for a team of others.
    if (!CallerIsOrganiser()) upload.founding = std::move(founding);
  }
  UploadedBody body(*request.body);
  const absl::StatusOr<ReceivedArtefact> received = context_.admission.Receive(upload, body);
  if (!received.ok()) return TeamErrorOf(received.status(), upload.from.team);
  const ArtefactRow& artefact = received->artefact;
  return ApiAnswer{received->is_new ? 201 : 200,
                   {{"artefact", artefact.hash},
                    {"name", artefact.name},
                    {"command", artefact.command},
                    {"runtimes", artefact.runtimes},
                    {"env", artefact.environment},
                    {"adapter", artefact.adapter.empty() ? nlohmann::json() : nlohmann::json(artefact.adapter)},
                    {"extra_observations", artefact.extra_observations},
                    {"image", artefact.image ? PolicyImageToJson(*artefact.image) : nlohmann::json()},
                    {"bytes", artefact.bytes},
                    {"files", artefact.files},
                    {"new", received->is_new}}};
}

}  // namespace myograde::server
