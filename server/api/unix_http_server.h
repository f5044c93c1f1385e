// An HTTP server on a Unix socket and, if there is one, a TCP port. The gate (gate.h) collects
// requests, so that a handler runs when its request is there as a whole, whatever other clients do
// or don't; handlers learn who asks, from the kernel.
#pragma once

#include <sys/types.h>

#include <atomic>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <absl/status/status.h>
#include <absl/time/time.h>

#include "protocol/base/fd.h"
#include "server/api/gate.h"
#include "server/api/network_door.h"
#include "server/api/router.h"
#include "server/config/server_config.h"

namespace myograde::server {

class UnixHttpServer {
 public:
  // Large bodies lie in the folder `spool`, which must be there.
  UnixHttpServer(const HttpLimits& limits, std::string spool);
  ~UnixHttpServer();
  UnixHttpServer(const UnixHttpServer&) = delete;
  UnixHttpServer& operator=(const UnixHttpServer&) = delete;

  // Who answers requests; add to it before Start.
  Router& router() { return router_; }

  // Who of this host's users is an organiser, besides root and the user that runs this process: has
  // places kept free. Before Start.
  void SetOrganisers(std::function<bool(const Peer&)> is_organiser) {
    is_organiser_ = std::move(is_organiser);
  }
  // Asked before a large body is received. Before Start.
  void SetAdmit(std::function<std::optional<ApiError>(Connection&)> admit) {
    admit_ = std::move(admit);
  }
  // Is told of each request that is refused before a handler sees it, with its status. Before Start.
  void SetRefusalCounter(std::function<void(int http)> count) { count_refusal_ = std::move(count); }

  // Opens the door to the network; before Start, if at all. `handed` and errors as of
  // NetworkDoor::Open.
  absl::Status OpenNetwork(const ListenConfig& config, Fd handed = Fd());
  // Where the network finds it, as in "https://192.0.2.1:8443"; "" if there is no such door.
  std::string NetworkUrl() const { return network_ == nullptr ? "" : network_->url(); }
  // From any thread, and from a signal handler: see NetworkDoor::Reload.
  void ReloadCertificate();

  // Binds `path` (replacing a socket that nobody listens on) and starts the
  // threads. AlreadyExistsError: something listens there, or it is no socket.
  absl::Status Start(const std::string& path);
  // The same on a listening socket that somebody else made, who also removes it.
  void StartOn(Fd listener);

  // From any thread, and from a signal handler: bodies are refused from now on,
  // and what takes long is asked to end (Stopping).
  void BeginStop();
  // Hangs up on everybody, lets the handlers that run end, and removes the socket.
  void Shutdown();

  // Only inside handlers. Whether what takes long should be given up.
  static bool Stopping();
  // How much of its time the request has left; infinite outside of handlers.
  static absl::Duration TimeLeft();
  // Whether nobody waits for the answer any more: it is late, the server stops, or the client is gone.
  static bool IsOver();
  // Gives the client more time to take a long answer: `limits.upload` in place of
  // `limits.request`.
  static void AllowUploadTime();
  // The connection of the request that this thread handles: who is at its other end, and the
  // request's head.
  static Connection& RequestConnection();

 private:
  absl::Status Bind(const std::string& path);
  void Begin();
  BodyRule RuleOf(const Request& head) const;
  std::optional<Peer> PeerOf(int fd) const;
  void Work();
  void Serve(Connection& connection);
  void Continue(Connection& connection);

  const HttpLimits limits_;
  const std::string spool_;
  Router router_;
  std::function<bool(const Peer&)> is_organiser_;
  std::function<std::optional<ApiError>(Connection&)> admit_;
  std::function<void(int http)> count_refusal_;
  SpoolBudget budget_;
  WorkQueue queue_;
  Gate gate_;
  std::atomic<bool> stopping_ = false;
  std::string path_;
  Fd listener_;
  std::unique_ptr<NetworkDoor> network_;
  std::thread acceptor_;
  std::vector<std::thread> workers_;
};

}  // namespace myograde::server
