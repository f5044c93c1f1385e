// The channel of a node that shares no folder with the daemon: HTTPS, with the token of this lease
// alone (server/api/README.md, /v1/leases).
#pragma once

#include <memory>
#include <string>

#include <absl/status/statusor.h>

#include "server/base/http_client.h"
#include "server/executor/node/channel.h"

namespace myograde::server {

struct HttpChannelOptions {
  std::string url;      // of the daemon: https://HOST:PORT; plain http for this host itself alone
  std::string lease;    // name of the attempt; "": none, to try the address
  std::string token;
  std::string ca_file;  // who signs the daemon's certificate; "": the host's usual authorities
};

class HttpChannel : public LeaseChannel {
 public:
  // Asks nothing yet. InvalidArgumentError: the URL is of another form, or there is no token.
  static absl::StatusOr<std::unique_ptr<HttpChannel>> Open(const HttpChannelOptions& options);

  // Whether the daemon answers, by the same connection as a lease's requests.
  absl::Status Reach();

  absl::StatusOr<NodeOrder> Order() override;
  absl::Status PutClaim(const NodeClaim& claim) override;
  absl::Status PutProof(const NodeProof& proof) override;
  absl::Status FetchArtefact(const NodeArtefact& artefact, int file) override;
  absl::Status AddRecords(int64_t offset, std::string_view bytes) override;
  absl::Status PutLog(const std::string& log, int file) override;
  absl::Status PutEnd(const NodeEnd& end) override;

 private:
  explicit HttpChannel(const HttpChannelOptions& options);
  absl::StatusOr<std::string> Ask(const std::string& path, HttpRequest request);
  std::string OfLease(const std::string& path) const;

  const HttpChannelOptions options_;
  HttpClient client_;
};

}  // namespace myograde::server
