#include "server/sandbox/network.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <linux/inet_diag.h>
#include <linux/netlink.h>
#include <linux/rtnetlink.h>
#include <linux/sock_diag.h>
#include <net/if.h>
#include <net/route.h>
#include <netinet/in.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <filesystem>
#include <set>
#include <thread>
#include <utility>
#include <vector>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>
#include <absl/strings/string_view.h>

#include "server/sandbox/kernel_files.h"

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

// An error number, 0 if none.
int SetUpLoopback() {
  const Fd socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  ifreq request = {};
  char device[] = "lo";
  std::memcpy(request.ifr_name, device, sizeof(device));
  if (!socket.valid() || ioctl(socket.get(), SIOCGIFFLAGS, &request) != 0) return errno;
  request.ifr_flags =
      static_cast<int16_t>(request.ifr_flags | IFF_UP | IFF_RUNNING | IFF_MULTICAST);
  if (ioctl(socket.get(), SIOCSIFFLAGS, &request) != 0) return errno;
  rtentry route = {};
  route.rt_dst = Address(kBusNetwork);
  route.rt_genmask = Address(kBusMask);
  route.rt_flags = RTF_UP;
  route.rt_dev = device;
  return ioctl(socket.get(), SIOCADDRT, &route) == 0 ? 0 : errno;
}

// For the calling thread's network. Someone filling the host's UDP memory must not block anybody's
// small messages before that memory is completely full.
bool BoundBuffers() {
  bool all = true;
  for (const auto& [name, value] :
       {std::pair("tcp_rmem", absl::StrCat("4096 131072 ", kStreamBufferBytes)),
        std::pair("tcp_wmem", absl::StrCat("4096 16384 ", kStreamBufferBytes)),
        std::pair("udp_rmem_min", std::string("212992"))}) {
    all = WriteKernelFile(absl::StrCat("/proc/sys/net/ipv4/", name), value) && all;
  }
  return all;
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

// Withdraws the right to read from all files of /proc/net, of the calling thread's network, but
// those about its own sockets, addresses and routes. Some of the others count the whole host.
// An ordinary user may not.
void HideNetworkCounters() {
  static const std::set<std::string> shown = {"dev",  "if_inet6", "igmp", "ipv6_route", "route",
                                              "tcp",  "tcp6",     "udp",  "udp6",       "unix"};
  std::error_code error;
  std::filesystem::directory_iterator it("/proc/thread-self/net", error);
  for (; it != std::filesystem::directory_iterator(); it.increment(error)) {
    if (shown.contains(it->path().filename())) continue;
    ::chmod(it->path().c_str(), 0);
  }
}

constexpr uint32_t kAllStates = ~0U;

struct Request {
  nlmsghdr header = {};
  inet_diag_req_v2 about = {};
};

// Requests all sockets of a family and protocol.
bool Ask(const Fd& diagnosis, int family, int protocol) {
  Request request;
  request.header.nlmsg_len = sizeof(request);
  request.header.nlmsg_type = SOCK_DIAG_BY_FAMILY;
  request.header.nlmsg_flags = NLM_F_REQUEST | NLM_F_DUMP;
  request.about.sdiag_family = static_cast<uint8_t>(family);
  request.about.sdiag_protocol = static_cast<uint8_t>(protocol);
  request.about.idiag_ext = 1 << (INET_DIAG_SKMEMINFO - 1);
  request.about.idiag_states = kAllStates;
  return send(diagnosis.get(), &request, sizeof(request), 0) == sizeof(request);
}

// The bytes of one socket in an answer.
int64_t BytesOf(const nlmsghdr* header) {
  auto* about = static_cast<inet_diag_msg*>(NLMSG_DATA(header));
  int length = static_cast<int>(header->nlmsg_len) - static_cast<int>(NLMSG_LENGTH(sizeof(*about)));
  for (auto* entry = reinterpret_cast<rtattr*>(about + 1); RTA_OK(entry, length);
       entry = RTA_NEXT(entry, length)) {
    uint32_t held[SK_MEMINFO_VARS] = {};
    if (entry->rta_type != INET_DIAG_SKMEMINFO) continue;
    std::memcpy(held, RTA_DATA(entry), std::min<size_t>(sizeof(held), RTA_PAYLOAD(entry)));
    return int64_t{held[SK_MEMINFO_RMEM_ALLOC]} + held[SK_MEMINFO_FWD_ALLOC] +
           std::max(held[SK_MEMINFO_WMEM_QUEUED], held[SK_MEMINFO_WMEM_ALLOC]) +
           held[SK_MEMINFO_OPTMEM] + held[SK_MEMINFO_BACKLOG];
  }
  return 0;
}

// Reads the answer to its end, or until the kernel sends no more.
int64_t SumOfAnswer(const Fd& diagnosis) {
  alignas(nlmsghdr) std::byte buffer[32768];
  int64_t sum = 0;
  while (true) {
    const ssize_t received = recv(diagnosis.get(), buffer, sizeof(buffer), 0);
    if (received <= 0) return sum;
    auto length = static_cast<uint32_t>(received);
    for (auto* header = reinterpret_cast<nlmsghdr*>(buffer); NLMSG_OK(header, length);
         header = NLMSG_NEXT(header, length)) {
      if (header->nlmsg_type == NLMSG_DONE || header->nlmsg_type == NLMSG_ERROR) return sum;
      if (header->nlmsg_type == SOCK_DIAG_BY_FAMILY) sum += BytesOf(header);
    }
  }
}

// A descriptor for querying the calling thread's network by sock_diag(7), usable from other
// networks too; invalid if the kernel lacks it.
Fd OpenSocketDiagnosis() {
  Fd diagnosis(socket(AF_NETLINK, SOCK_DGRAM | SOCK_CLOEXEC, NETLINK_SOCK_DIAG));
  const timeval patience = {1, 0};
  if (diagnosis.valid()) {
    setsockopt(diagnosis.get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof(patience));
  }
  return diagnosis;
}

std::vector<absl::string_view> Words(absl::string_view line) {
  return absl::StrSplit(line, ' ', absl::SkipEmpty());
}

}  // namespace

int64_t SocketStatistic(const std::string& text, const std::string& name,
                        const std::string& field) {
  const std::string line = absl::StrCat(" ", KernelValue(text, name));
  const size_t at = line.find(absl::StrCat(" ", field, " "));
  return at == std::string::npos ? 0 : KernelNumber(line.substr(at + 1), field);
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
    const auto at = static_cast<size_t>(std::ranges::find(names, field) - names.begin());
    int64_t number = 0;
    if (at < std::min(names.size(), words.size()) && absl::SimpleAtoi(words[at], &number)) {
      return number;
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
      // Where the kernel has this setting per network (Linux 6.8), limits the packet filters of a
      // socket, which the kernel compiles into memory that all programs share.
      WriteKernelFile("/proc/sys/net/core/optmem_max", "4096");
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
  network.full_pages_ = KernelSetting("net/ipv4/udp_mem", 1);
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

int64_t BusNetwork::socket_bytes() const {
  int64_t sum = 0;
  for (const int family : {AF_INET, AF_INET6}) {
    for (const int protocol : {IPPROTO_UDP, IPPROTO_TCP}) {
      if (diagnosis_.valid() && Ask(diagnosis_, family, protocol)) sum += SumOfAnswer(diagnosis_);
    }
  }
  return sum;
}

int64_t BusNetwork::dropped() const {
  return CounterBelow(ReadAnew(counters_), "Udp:", "MemErrors");
}

}  // namespace myograde::server
