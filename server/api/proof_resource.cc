#include "server/api/proof_resource.h"

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>

#include "server/api/receipt_view.h"
#include "server/api/requests.h"
#include "server/proof/receipt.h"
#include "server/runner/log_keeper.h"

namespace myograde::server {

void ProofResource::Install(Routes& routes) {
  routes.Get(R"(/v1/submissions/(\d{1,18})/receipt)",
             std::bind_front(&ProofResource::GetReceipt, this));
  routes.Get("/v1/key", std::bind_front(&ProofResource::GetKey, this));
  routes.GetFile(R"(/v1/logs/([0-9a-f]{64}))", std::bind_front(&ProofResource::SendLog, this));
}

ApiResult ProofResource::GetReceipt(const httplib::Request& request) const {
  absl::StatusOr<nlohmann::json> receipt = absl::InternalError("");
  const absl::Status status = context_.readers.Read([&](Reader& reader) {
    receipt = ReceiptOf(reader, IdOf(request));
    return receipt.status();
  });
  if (!status.ok()) return ErrorOf(status);
  const absl::StatusOr<std::shared_ptr<const SigningKey>> key = context_.receipts_key.Get();
  if (!key.ok()) return ErrorOf(key.status());
  absl::StatusOr<std::string> text = SignReceipt(*receipt, **key);
  if (!text.ok()) return ErrorOf(text.status());
  return ApiAnswer{200, nlohmann::json::parse(*text)};
}

ApiResult ProofResource::GetKey(const httplib::Request&) const {
  const absl::StatusOr<std::shared_ptr<const SigningKey>> key = context_.receipts_key.Get();
  if (!key.ok()) return ErrorOf(key.status());
  return ApiAnswer{200, {{"algorithm", "ed25519"}, {"key", (*key)->PublicPem()}}};
}

// The file as it is stored. Its name is a hash, so no path of a client's making is opened.
std::optional<ApiError> ProofResource::SendLog(const httplib::Request& request,
                                               httplib::Response& response) const {
  const std::string path =
      absl::StrCat(context_.data_dir, "/logs/", LogFileName(request.matches[1]));
  absl::Status sent = UnixHttpServer::AnswerWithFile(path, "application/zstd", response);
  if (absl::IsNotFound(sent)) {
    sent = absl::NotFoundError(absl::StrCat("there is no log ", std::string(request.matches[1]),
                                            " here; it was never kept, or was removed"));
  }
  if (!sent.ok()) return ErrorOf(sent);
  return std::nullopt;
}

}  // namespace myograde::server
