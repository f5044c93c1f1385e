#include "server/base/service_manager.h"

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <fcntl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstddef>
#include <cstdlib>
#include <cstring>

#include "server/base/paths.h"

namespace myograde::server {
namespace {

constexpr int kFirstSocket = 3;

std::string TakeVariable(const char* name) {
  std::string text = EnvironmentVariable(name);
  unsetenv(name);
  return text;
}

int SocketOption(int fd, int option) {
  int value = 0;
  socklen_t size = sizeof(value);
  return getsockopt(fd, SOL_SOCKET, option, &value, &size) == 0 ? value : 0;
}

bool IsListeningStream(int fd) {
  return SocketOption(fd, SO_TYPE) == SOCK_STREAM && SocketOption(fd, SO_ACCEPTCONN) != 0;
}

// Variables for another process are none for this one.
bool IsForThisProcess(const std::string& pid_text) {
  int64_t pid = 0;
  return absl::SimpleAtoi(pid_text, &pid) && pid == getpid();
}

}  // namespace

absl::StatusOr<ServiceManager> ServiceManager::FromEnvironment() {
  ServiceManager manager;
  manager.address_ = TakeVariable("NOTIFY_SOCKET");
  const std::string watched_pid = TakeVariable("WATCHDOG_PID");
  int64_t watchdog_us = 0;
  if (absl::SimpleAtoi(TakeVariable("WATCHDOG_USEC"), &watchdog_us) && watchdog_us > 0 &&
      (watched_pid.empty() || IsForThisProcess(watched_pid))) {
    manager.watchdog_ = absl::Microseconds(watchdog_us);
  }
  const std::string pid_text = TakeVariable("LISTEN_PID");
  const std::string count_text = TakeVariable("LISTEN_FDS");
  unsetenv("LISTEN_FDNAMES");
  int count = 0;
  if (!IsForThisProcess(pid_text)) return manager;
  if (!absl::SimpleAtoi(count_text, &count) || count <= 0) return manager;
  for (int fd = kFirstSocket; fd < kFirstSocket + count; ++fd) {
    const int domain = SocketOption(fd, SO_DOMAIN);
    Fd& place = domain == AF_UNIX ? manager.socket_ : manager.network_socket_;
    const bool known = domain == AF_UNIX || domain == AF_INET || domain == AF_INET6;
    if (!known || !IsListeningStream(fd) || place.valid()) {
      return absl::InvalidArgumentError(absl::StrCat(
          "the service manager handed over ", count,
          " descriptors, where at most one listening "
          "stream socket of Unix and one of TCP are taken; give its socket units one ListenStream= "
          "with a path, and one with a port"));
    }
    fcntl(fd, F_SETFD, FD_CLOEXEC);
    fcntl(fd, F_SETFL, fcntl(fd, F_GETFL) | O_NONBLOCK);
    place = Fd(fd);
  }
  return manager;
}

void ServiceManager::Tell(const std::string& state) const {
  sockaddr_un address = {};
  address.sun_family = AF_UNIX;
  if (address_.empty() || address_.size() >= sizeof(address.sun_path)) return;
  std::memcpy(address.sun_path, address_.data(), address_.size());
  if (address.sun_path[0] == '@') address.sun_path[0] = '\0';  // an abstract one
  const Fd sender(socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (!sender.valid()) return;
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + address_.size());
  sendto(sender.get(), state.data(), state.size(), MSG_NOSIGNAL,
         reinterpret_cast<const sockaddr*>(&address), size);
}

}  // namespace myograde::server
