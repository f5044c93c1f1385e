#include "server/executor/node/http_channel.h"

#include <unistd.h>

#include <utility>

#include <absl/strings/match.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/strip.h>
#include <absl/time/time.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "server/base/output_tail.h"
#include "server/executor/spool/folder.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr absl::Duration kConnect = absl::Seconds(15);
// Of small requests, and of those that carry files; the latter also end when they stand still.
constexpr absl::Duration kShort = absl::Seconds(60);
constexpr absl::Duration kLong = absl::Minutes(20);

// The sentence of an API's error.
std::string MessageOf(const std::string& text) {
  const absl::StatusOr<Json> json = ParseJson(text, "answer");
  if (json.ok() && json->is_object() && json->contains("error") && (*json)["error"].is_object()) {
    const auto message = (*json)["error"].find("message");
    if (message != (*json)["error"].end() && message->is_string()) {
      return PrintableUtf8(message->get<std::string>());
    }
  }
  return "it gave no reason";
}

absl::Status StatusOf(long http, const std::string& text) {
  if (http == 200) return absl::OkStatus();
  const std::string message = absl::StrCat("the daemon answered ", http, ": ", MessageOf(text));
  switch (http) {
    case 404:
    case 410: return absl::CancelledError(message);
    case 409: return absl::AlreadyExistsError(message);
    case 408:
    case 429: return absl::UnavailableError(message);
    case 507: return absl::ResourceExhaustedError(message);
    default: break;
  }
  // A proxy's or a busy daemon's; redirects are not followed.
  if (http >= 500) return absl::UnavailableError(message);
  return absl::FailedPreconditionError(message);
}

// What OpenSSL finds of a certificate before and after its time (X509_V_ERR_CERT_NOT_YET_VALID and
// X509_V_ERR_CERT_HAS_EXPIRED).
constexpr long kNotYetValid = 9;
constexpr long kExpired = 10;

absl::Status StatusOf(const HttpAnswer& answer) {
  using Failure = HttpAnswer::Failure;
  const std::string message = absl::StrCat("the daemon can't be reached: ", answer.problem);
  switch (answer.failure) {
    case Failure::kNotTaken: return absl::DataLossError("the daemon's answer is too long");
    case Failure::kTimeout: return absl::DeadlineExceededError(message);
    // Somebody else answers there, or the option --ca is wrong.
    case Failure::kCertificate:
      return answer.certificate == kNotYetValid || answer.certificate == kExpired
                 ? absl::OutOfRangeError(message)
                 : absl::UnauthenticatedError(message);
    case Failure::kCaFile: return absl::PermissionDeniedError(message);
    default: return absl::UnavailableError(message);
  }
}

bool IsAllowedUrl(const std::string& url) {
  if (absl::StartsWith(url, "https://")) return true;
  for (const char* local : {"http://127.0.0.1:", "http://[::1]:"}) {
    if (absl::StartsWith(url, local)) return true;
  }
  return false;
}

}  // namespace

HttpChannel::HttpChannel(const HttpChannelOptions& options) : options_(options) {}

absl::StatusOr<std::unique_ptr<HttpChannel>> HttpChannel::Open(const HttpChannelOptions& options) {
  if (!IsAllowedUrl(options.url)) {
    return absl::InvalidArgumentError(absl::StrCat(
        options.url, ": must be the daemon's https address; the lease's token is sent there"));
  }
  if (options.token.empty() && !options.lease.empty()) {
    return absl::InvalidArgumentError("MYOGRADE_LEASE_TOKEN is not set; it must hold the lease's token");
  }
  return std::unique_ptr<HttpChannel>(new HttpChannel(options));
}

absl::StatusOr<std::string> HttpChannel::Ask(const std::string& path, HttpRequest request) {
  request.url = absl::StrCat(absl::StripSuffix(options_.url, "/"), path);
  request.ca_file = options_.ca_file;
  if (!options_.token.empty()) {
    request.headers = {absl::StrCat("Authorization: Bearer ", options_.token)};
  }
  request.connect = kConnect;
  request.time = request.body_file >= 0 || request.sink != nullptr ? kLong : kShort;
  request.silence = kShort;
  HttpAnswer answer = client_.Ask(request);
  // A body that is refused by its head ends the connection after the answer.
  if (answer.failure != HttpAnswer::Failure::kNone && answer.status < 400) return StatusOf(answer);
  RETURN_IF_ERROR(StatusOf(answer.status, answer.text));
  return std::move(answer.text);
}

std::string HttpChannel::OfLease(const std::string& path) const {
  return absl::StrCat("/v1/leases/", options_.lease, path);
}

absl::Status HttpChannel::Reach() { return Ask("/v1/live", {}).status(); }

absl::StatusOr<NodeOrder> HttpChannel::Order() {
  ASSIGN_OR_RETURN(const std::string text,
                   Ask(OfLease("/order"), {.most_text = kMostOrderBytes + 1}));
  return NodeOrderFromText(text, "the daemon's order");
}

absl::Status HttpChannel::PutClaim(const NodeClaim& claim) {
  const std::string text = NodeClaimToText(claim);
  return Ask(OfLease("/claim"), {.body = text}).status();
}

absl::Status HttpChannel::PutProof(const NodeProof& proof) {
  const std::string text = NodeProofToText(proof);
  return Ask(OfLease("/proof"), {.body = text}).status();
}

absl::Status HttpChannel::FetchArtefact(const NodeArtefact& artefact, int file) {
  if (ftruncate(file, 0) != 0 || lseek(file, 0, SEEK_SET) != 0) {
    return DiskError("the packed submission", "written");
  }
  int64_t left = artefact.archive_bytes;
  absl::Status written;
  const absl::StatusOr<std::string> answer = Ask(
      OfLease("/artefact"), {.sink = [&](std::string_view piece) {
        left -= std::ssize(piece);
        written = left < 0 ? absl::DataLossError("the packed submission is larger than the order says")
                           : WriteAll(file, piece);
        return written.ok();
      }});
  return written.ok() ? answer.status() : written;
}

absl::Status HttpChannel::AddRecords(int64_t offset, std::string_view bytes) {
  ASSIGN_OR_RETURN(const std::string text, Ask(OfLease(absl::StrCat("/records?offset=", offset)),
          {.body = bytes, .type = "application/octet-stream"}));
  const absl::StatusOr<Json> json = ParseJson(text, "the daemon's answer");
  if (!json.ok()) return absl::UnavailableError(json.status().message());
  ConfigReader reader(*json, "the daemon's answer");
  const bool stop = reader.Boolean("stop");
  const bool taken = reader.Boolean("taken");
  const int64_t size = reader.Integer("size", 0, INT64_MAX);
  if (!reader.mistake().ok()) return absl::UnavailableError(reader.mistake().message());
  if (stop) return absl::CancelledError("the daemon asked for the lease's end");
  if (taken) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat("the daemon has ", size, " bytes of records, and other ones "
                                          "than this node sent before byte ", offset));
}

absl::Status HttpChannel::PutLog(const std::string& log, int file) {
  return Ask(OfLease(absl::StrCat("/logs/", log.substr(0, log.find('.')))),
             {.body_file = file, .type = "application/octet-stream"})
      .status();
}

absl::Status HttpChannel::PutEnd(const NodeEnd& end) {
  const std::string text = NodeEndToText(end);
  return Ask(OfLease("/end"), {.body = text}).status();
}

}  // namespace myograde::server
