// An HTTP server on a Unix socket: cpp-httplib's parsing and routing with an
// accept loop of our own. Clients that ask for nothing cost a descriptor and no
// thread; a request has a deadline as a whole, so a client that dribbles can't
// hold a worker; handlers learn who asks, from the kernel.
#pragma once

#include <httplib.h>
#include <sys/types.h>

#include <condition_variable>
#include <deque>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include <absl/status/status.h>
#include <absl/time/time.h>

#include "protocol/base/fd.h"
#include "server/daemon/server_config.h"

namespace myograde::server {

class UnixHttpServer : public httplib::Server {
 public:
  explicit UnixHttpServer(const HttpLimits& limits);
  ~UnixHttpServer() override;

  // Binds `path` (replacing a socket that nobody listens on) and starts the
  // threads. AlreadyExistsError: something listens there, or it is no socket.
  absl::Status Start(const std::string& path);

  // Stops accepting, lets running requests end (each has its deadline), hangs up
  // on the others and removes the socket.
  void Shutdown();

  // Gives the request that this thread is handling more time: `limits.upload`
  // in place of `limits.request`. Only inside a handler.
  static void AllowUploadTime();

  // Reads on after a body was refused, up to `most` bytes and no longer than the request has
  // time, so that the client can send it to its end and hear why; then hangs up. Only inside a
  // handler.
  static constexpr int64_t kDrainBytes = int64_t{64} << 20;
  static void Drain(const httplib::ContentReader& content, int64_t most = kDrainBytes);
  // Hangs up after this request's answer. Only inside a handler.
  static void HangUpAfter();

  // The caller's user id as the kernel knows it; only inside a handler.
  static uid_t PeerUid();

 private:

  absl::Status Bind(const std::string& path);
  void AcceptLoop();
  void AcceptOne();
  void Work();
  // Serves one request; true if the connection may carry another.
  bool ServeOne(int fd);
  void Wake();

  const HttpLimits limits_;
  std::string path_;
  Fd listener_;
  Fd wake_;
  std::thread acceptor_;
  std::vector<std::thread> workers_;

  std::mutex mutex_;
  std::condition_variable ready_;
  std::deque<int> requests_;       // connections with something to read; guarded by mutex_
  std::vector<int> returned_;      // connections that a worker is done with; guarded by mutex_
  int open_ = 0;                   // connections; guarded by mutex_
  bool stop_ = false;              // guarded by mutex_
  std::map<int, absl::Duration> idle_;  // connection to its end of patience; acceptor's own
};

}  // namespace myograde::server
