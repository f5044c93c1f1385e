// What a service manager such as systemd hands to a program that it starts, and hears from it: its
// protocols of sd_listen_fds(3), sd_notify(3) and sd_watchdog_enabled(3).
#pragma once

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include <string>
#include <utility>

#include "protocol/base/fd.h"

namespace myograde::server {

class ServiceManager {
 public:
  // Reads what the environment says to this process and removes it there, so that no child takes it
  // for its own. Without a service manager there is neither a socket nor anybody to tell.
  // InvalidArgumentError if what was handed over is anything but listening stream sockets, at most
  // one of Unix and one of TCP.
  static absl::StatusOr<ServiceManager> FromEnvironment();

  // The listening Unix socket, once; invalid if none was handed over.
  Fd TakeSocket() { return std::move(socket_); }
  // The listening TCP socket, likewise.
  Fd TakeNetworkSocket() { return std::move(network_socket_); }

  // How long it may hear nothing of "WATCHDOG=1" before it kills and starts this process again;
  // infinite if it does not watch.
  absl::Duration watchdog() const { return watchdog_; }

  // Tells the service manager, if there is one, in the words of sd_notify(3) ("READY=1"). Never
  // waits.
  void Tell(const std::string& state) const;

 private:
  Fd socket_;
  Fd network_socket_;
  absl::Duration watchdog_ = absl::InfiniteDuration();
  std::string address_;  // of the service manager's socket; "": nobody listens
};

}  // namespace myograde::server
