// An HTTP server on a Unix socket and, if there is one, a TCP port, on Boost.Asio. One thread moves
// the bytes of all connections (connection.h) and decides who may have one; workers run handlers.
// Those only see requests that are there as a whole, whatever other clients do or don't, and learn
// from the kernel who asks.
#pragma once

#include <atomic>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <absl/status/status.h>
#include <absl/time/time.h>
#include <boost/asio/io_context.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/thread_pool.hpp>

#include "protocol/base/fd.h"
#include "server/access/rate_limit.h"
#include "server/config/server_config.h"
#include "server/http/acceptor.h"
#include "server/http/connection.h"
#include "server/http/connection_table.h"
#include "server/http/router.h"
#include "server/http/tcp_listener.h"
#include "server/http/work_queue.h"

namespace myograde::server {

// What the server asks of whoever has it.
struct HttpHooks {
  // Who of this host's users is an organiser, besides root and the user that runs this process: has
  // connections kept free.
  std::function<bool(const Peer&)> is_organiser = [](const Peer&) { return false; };
  // On a worker, before any of a large body goes to the disk: why its sender may not send it.
  std::function<std::optional<ApiError>(Connection&)> admit = [](Connection&) {
    return std::nullopt;
  };
  // Is told of each request that is refused before a handler sees it, with its status.
  std::function<void(int http)> count_refusal = [](int) {};
};

class HttpServer {
 public:
  // Large bodies lie in the folder `spool`, which must be there.
  HttpServer(const HttpLimits& limits, std::string spool);
  ~HttpServer() { Shutdown(); }
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  // Who answers requests; add to it before Start.
  Router& router() { return router_; }

  // Before Start.
  void SetHooks(HttpHooks hooks) { hooks_ = std::move(hooks); }

  // Opens the port for the network; before Start, if at all. `handed` and errors as of
  // TcpListener::Open.
  absl::Status OpenNetwork(const ListenConfig& config, Fd handed = Fd());
  // Where the network finds it, as in "https://192.0.2.1:8443"; "" if there is no such port.
  std::string NetworkUrl() const { return network_ == nullptr ? "" : network_->url(); }
  // From any thread, and from a signal handler: see TcpListener::Reload.
  void ReloadCertificate() {
    if (network_ != nullptr) network_->Reload();
  }

  // Listens at `path` (errors as of ListenAt) and starts the threads.
  absl::Status Start(const std::string& path);
  // The same on a listening socket that somebody else made, who also removes it.
  void StartOn(Fd listener);
  // The same on listeners of any kind.
  void StartWith(std::vector<Listener> listeners);

  // From any thread, and from a signal handler: bodies are refused from now on,
  // and what takes long is asked to end (Stopping).
  void BeginStop() { stopping_ = true; }
  // Closes all connections, lets the handlers that run end, and removes the socket.
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
  friend class Connection;  // which is a part of it, and uses what all connections share

  // On the thread of the connections.
  boost::asio::awaitable<void> AcceptFrom(const Listener& listener);
  void Receive(AcceptedSocket accepted);
  bool MakeRoom(const Peer& peer);
  void Admit(AcceptedSocket accepted);
  void LetWaitingIn();
  // While there is anybody to watch.
  boost::asio::awaitable<void> WatchClocks();
  boost::asio::awaitable<void> CloseAll();

  // What the address of a request takes for a body.
  BodyRule RuleOf(const Request& head) const;

  // On workers: answers the request.
  void Serve(Connection& connection, Response& response);
  // The next part of a stream; nullopt ends it.
  std::optional<std::string> Continue(Connection& connection, const Stream& stream);

  const HttpLimits limits_;
  Router router_;
  HttpHooks hooks_;
  std::atomic<bool> stopping_ = false;  // bodies are refused
  std::string path_;
  Fd listener_;
  std::unique_ptr<TcpListener> network_;
  std::vector<Listener> listeners_;

  Spool spool_;
  WorkQueue queue_;
  boost::asio::thread_pool handshakes_;  // whose arithmetic would hold up all other connections
  Acceptor acceptor_;
  // How many connections of each peer of the network may begin in a while: each costs a handshake,
  // which is far more work for the server than for whoever asks for it.
  RateLimit arrivals_;
  ConnectionTable connections_;
  WaitingConnections waiting_;
  uint64_t last_id_ = 0;
  int running_ = 0;  // coroutines of connections, of which some may not be in the table any more
  bool watching_clocks_ = false;
  std::optional<boost::asio::io_context> io_;  // has the connections' coroutines, which use all of this
  std::deque<boost::asio::posix::stream_descriptor> descriptors_;  // of what it listens on
  std::thread io_thread_;
  std::vector<std::thread> workers_;
};

}  // namespace myograde::server
