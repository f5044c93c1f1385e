#include "server/sandbox/network.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <net/if.h>
#include <net/route.h>
#include <netinet/in.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>
#include <absl/strings/string_view.h>

#include "protocol/base/file.h"
#include "server/sandbox/kernel_files.h"
#include "server/sandbox/socket_bytes.h"

namespace myograde::server {
namespace {

constexpr uint32_t kBusNetwork = 0xEFFF0000;  // 239.255.0.0
constexpr uint32_t kBusMask = 0xFFFF0000;

sockaddr Address(uint32_t address) {
  sockaddr_in inet = {};
  inet.sin_family = AF_INET;
  inet.sin_addr.s_addr = htonl(address);
  sockaddr generic;
  std::memcpy(&generic, &inet, sizeof(generic));
  return generic;
}

int SetUp(int socket) {
  ifreq request = {};
  std::memcpy(request.ifr_name, "lo", 3);
  if (ioctl(socket, SIOCGIFFLAGS, &request) != 0) return errno;
  request.ifr_flags =
      static_cast<int16_t>(request.ifr_flags | IFF_UP | IFF_RUNNING | IFF_MULTICAST);
  if (ioctl(socket, SIOCSIFFLAGS, &request) != 0) return errno;
  char device[] = "lo";
  rtentry route = {};
  route.rt_dst = Address(kBusNetwork);
  route.rt_genmask = Address(kBusMask);
  route.rt_flags = RTF_UP;
  route.rt_dev = device;
  if (ioctl(socket, SIOCADDRT, &route) != 0) return errno;
  return 0;
}

// An error number, 0 if none.
int SetUpLoopback() {
  const Fd socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  return socket.valid() ? SetUp(socket.get()) : errno;
}

// For the calling thread's network. Someone filling the host's UDP memory must not block anybody's
// small messages before that memory is completely full.
bool BoundBuffers() {
  const std::pair<const char*, std::string> settings[] = {
      {"tcp_rmem", absl::StrCat("4096 131072 ", kStreamBufferBytes)},
      {"tcp_wmem", absl::StrCat("4096 16384 ", kStreamBufferBytes)},
      {"udp_rmem_min", "212992"}};
  bool all = true;
  for (const auto& [name, value] : settings) {
    const Fd file(open(absl::StrCat("/proc/sys/net/ipv4/", name).c_str(), O_WRONLY | O_CLOEXEC));
    all = file.valid() && write(file.get(), value.data(), value.size()) == std::ssize(value) && all;
  }
  return all;
}

// For the same network, where the kernel has this setting per network (Linux 6.8): limits the
// packet filters of a socket, which the kernel compiles into memory that all programs share.
void BoundFilters() {
  const Fd file(open("/proc/sys/net/core/optmem_max", O_WRONLY | O_CLOEXEC));
  if (file.valid()) (void)!write(file.get(), "4096", 4);
}

Fd OpenOwn(const char* name) {
  return Fd(open(absl::StrCat("/proc/thread-self/", name).c_str(), O_RDONLY | O_CLOEXEC));
}

// Rereads a /proc file, which the kernel generates anew on each read from its start.
std::string ReadAnew(const Fd& file) {
  char buffer[4096];
  std::string text;
  ssize_t n = sizeof(buffer);
  while (file.valid() && n == sizeof(buffer)) {
    n = pread(file.get(), buffer, sizeof(buffer), static_cast<off_t>(text.size()));
    if (n > 0) text.append(buffer, static_cast<size_t>(n));
  }
  return text;
}

std::vector<absl::string_view> Words(absl::string_view line) {
  return absl::StrSplit(line, ' ', absl::SkipEmpty());
}

int64_t NumberOf(absl::string_view word) {
  int64_t number = 0;
  return absl::SimpleAtoi(word, &number) ? number : 0;
}

}  // namespace

int64_t SocketStatistic(const std::string& text, const std::string& name,
                        const std::string& field) {
  for (const absl::string_view line : absl::StrSplit(text, '\n')) {
    const std::vector<absl::string_view> words = Words(line);
    if (words.empty() || words[0] != name) continue;
    for (size_t i = 1; i + 1 < words.size(); i += 2) {
      if (words[i] == field) return NumberOf(words[i + 1]);
    }
  }
  return 0;
}

int64_t CounterBelow(const std::string& text, const std::string& name,
                        const std::string& field) {
  std::vector<absl::string_view> names;
  for (const absl::string_view line : absl::StrSplit(text, '\n')) {
    const std::vector<absl::string_view> words = Words(line);
    if (words.empty() || words[0] != name) continue;
    if (names.empty()) {
      names = words;
      continue;
    }
    for (size_t i = 1; i < names.size() && i < words.size(); ++i) {
      if (names[i] == field) return NumberOf(words[i]);
    }
  }
  return 0;
}

absl::StatusOr<BusNetwork> BusNetwork::Make() {
  BusNetwork network;
  const char* refused = nullptr;
  int error = 0;
  // On a separate thread, as a thread that leaves the host's network can't always return.
  std::thread([&] {
    if (unshare(CLONE_NEWNET) != 0) {
      refused = "network namespace";
      error = errno;
    } else if ((error = SetUpLoopback()) != 0) {
      refused = "loopback";
    } else {
      network.bounded_ = BoundBuffers();
      BoundFilters();
      network.namespace_ = OpenOwn("ns/net");
      network.sockets_ = OpenOwn("net/sockstat");
      network.sockets_six_ = OpenOwn("net/sockstat6");
      network.counters_ = OpenOwn("net/snmp");
      network.diagnosis_ = OpenSocketDiagnosis();
      HideNetworkCounters();
      if (!network.namespace_.valid() || !network.sockets_.valid() || !network.counters_.valid()) {
        refused = "files of the network namespace";
        error = errno;
      }
    }
  }).join();
  std::istringstream pages(ReadFile("/proc/sys/net/ipv4/udp_mem").value_or(""));
  int64_t least = 0;
  if (!(pages >> least >> network.full_pages_)) network.full_pages_ = 0;
  if (refused == nullptr) return network;
  return absl::UnavailableError(
      absl::StrCat("sandbox: ", refused, ": ", std::strerror(error)));
}

NetworkUse BusNetwork::Sample() const {
  const std::string four = ReadAnew(sockets_);
  const std::string six = ReadAnew(sockets_six_);
  // "inuse" counts this network, "mem" all networks.
  return {SocketStatistic(four, "UDP:", "inuse") + SocketStatistic(four, "TCP:", "inuse") +
              SocketStatistic(six, "UDP6:", "inuse") + SocketStatistic(six, "TCP6:", "inuse"),
          SocketStatistic(four, "sockets:", "used"),
          full_pages_ > 0 && SocketStatistic(four, "UDP:", "mem") > full_pages_};
}

int64_t BusNetwork::socket_bytes() const { return SocketBytes(diagnosis_); }

int64_t BusNetwork::dropped() const {
  return CounterBelow(ReadAnew(counters_), "Udp:", "MemErrors");
}

}  // namespace myograde::server
