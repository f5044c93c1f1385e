#include "server/api/resources.h"

#include <functional>
#include <memory>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/api/requests.h"
#include "server/api/unix_http_server.h"

namespace myograde::server {
namespace {

// Nodes send at most half of it at once.
constexpr int64_t kMostRecordsAtOnce = 2 << 20;

std::string PathOfLease(const char* rest) {
  return absl::StrCat("/v1/leases/([A-Za-z0-9-]{1,64})/", rest);
}

std::string NameOf(const Request& request) { return request.matches[1]; }

// What the door says, to a node.
absl::Status RefusalOf(const absl::Status& status) {
  if (absl::IsNotFound(status)) return WithErrorCode(status, kLeaseOverCode);
  if (!absl::IsAlreadyExists(status)) return status;
  return WithErrorCode(absl::FailedPreconditionError(status.message()), "claimed");
}

ApiResult Done(const absl::Status& status) {
  if (!status.ok()) return RefusalOf(status);
  return ApiAnswer{200, nlohmann::json::object()};
}

// The body as a form of the node's, which `put` takes.
template <typename Form>
ApiResult TakeForm(const Request& request,
                   absl::StatusOr<Form> (*parse)(std::string_view, const std::string&),
                   const std::function<absl::Status(const Form&)>& put) {
  ASSIGN_OR_RETURN(const std::string body, request.body->Text());
  ASSIGN_OR_RETURN(const Form form, parse(body, "request"));
  return Done(put(form));
}

absl::Status CheckNode(LeaseDoor* door, const Request& request) {
  if (door != nullptr && Caller().lease == NameOf(request)) return absl::OkStatus();
  return absl::NotFoundError(
      absl::StrCat("there is no such attempt of a lease for you; only the node that plays it may ask, "
                   "with the token of attempt ", NameOf(request)));
}

ApiResult GetOrder(LeaseDoor* door, const Request& request) {
  RETURN_IF_ERROR(CheckNode(door, request));
  absl::StatusOr<std::string> text = door->OrderText(NameOf(request));
  if (!text.ok()) return RefusalOf(text.status());
  ApiAnswer answer;
  answer.text = std::make_shared<const std::string>(*std::move(text) + "\n");
  return answer;
}

absl::Status SendArtefact(LeaseDoor* door, const Request& request, Response& response) {
  RETURN_IF_ERROR(CheckNode(door, request));
  const absl::StatusOr<std::string> path = door->ArtefactPath(NameOf(request));
  if (!path.ok()) return RefusalOf(path.status());
  UnixHttpServer::AllowUploadTime();
  const absl::Status status = response.SetFile(*path, "application/x-tar");
  if (!status.ok()) return RefusalOf(status);
  response.SetHeader("Cache-Control", "no-store");
  response.SetHeader("X-Content-Type-Options", "nosniff");
  return absl::OkStatus();
}

ApiResult TakeClaim(LeaseDoor* door, const Request& request) {
  RETURN_IF_ERROR(CheckNode(door, request));
  return TakeForm<NodeClaim>(request, NodeClaimFromText, [&](const NodeClaim& claim) {
    return door->PutClaim(NameOf(request), claim);
  });
}

ApiResult TakeProof(LeaseDoor* door, const Request& request) {
  RETURN_IF_ERROR(CheckNode(door, request));
  return TakeForm<NodeProof>(request, NodeProofFromText, [&](const NodeProof& proof) {
    return door->PutProof(NameOf(request), proof);
  });
}

ApiResult TakeRecords(LeaseDoor* door, const Request& request) {
  RETURN_IF_ERROR(CheckNode(door, request));
  int64_t offset = -1;
  absl::Status status = CheckParameters(request, {"offset"});
  status.Update(ReadNumber(request, "offset", kMostRecordBytes, offset, /*min=*/0));
  if (status.ok() && offset < 0) {
    status = absl::InvalidArgumentError("\"offset\" is missing: where in the records these belong");
  }
  RETURN_IF_ERROR(status);
  ASSIGN_OR_RETURN(const std::string bytes, request.body->Text());
  const absl::StatusOr<RecordsState> state =
      door->AddRecords(NameOf(request), offset, bytes);
  if (!state.ok()) return RefusalOf(state.status());
  return ApiAnswer{200, {{"size", state->size}, {"taken", state->taken}, {"stop", state->stop}}};
}

ApiResult TakeLog(LeaseDoor* door, const Request& request) {
  RETURN_IF_ERROR(CheckNode(door, request));
  const Body& body = *request.body;
  int64_t at = 0;
  const ByteSource source = [&](char* to, size_t size) {
    const ssize_t n = body.ReadAt(to, size, at);
    if (n > 0) at += n;
    return n;
  };
  return Done(door->PutLog(NameOf(request), request.matches[2] + ".lcmlog.zst", source));
}

ApiResult TakeEnd(LeaseDoor* door, const Request& request) {
  RETURN_IF_ERROR(CheckNode(door, request));
  return TakeForm<NodeEnd>(request, NodeEndFromText, [&](const NodeEnd& end) {
    return door->PutEnd(NameOf(request), end);
  });
}

}  // namespace

void AddLeases(Routes& routes, LeaseDoor* door) {
  const BodyRule form = {.most = static_cast<int64_t>(kMostFormBytes),
                         .types = {"application/json"}};
  const auto add = [&](const char* rest, const BodyRule& rule,
                       ApiResult (*handle)(LeaseDoor*, const Request&)) {
    routes.PostUpload(PathOfLease(rest), Action::kPlayLease, rule, std::bind_front(handle, door));
  };
  routes.Get(PathOfLease("order"), Action::kPlayLease, std::bind_front(GetOrder, door));
  routes.GetFile(PathOfLease("artefact"), Action::kPlayLease,
                 std::bind_front(SendArtefact, door));
  add("claim", form, TakeClaim);
  add("proof", form, TakeProof);
  add("records", {.most = kMostRecordsAtOnce, .types = {"application/octet-stream"}},
      TakeRecords);
  add("logs/([0-9a-f]{64})",
      {.most = door == nullptr ? kMostRecordsAtOnce : door->most_log_bytes(),
       .upload = true,
       .types = {"application/octet-stream"}},
      TakeLog);
  add("end", form, TakeEnd);
}

}  // namespace myograde::server
