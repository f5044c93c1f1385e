#include "server/sandbox/socket_bytes.h"

#include <linux/inet_diag.h>
#include <linux/netlink.h>
#include <linux/rtnetlink.h>
#include <linux/sock_diag.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <vector>

namespace myograde::server {
namespace {

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

}  // namespace

Fd OpenSocketDiagnosis() {
  Fd diagnosis(socket(AF_NETLINK, SOCK_DGRAM | SOCK_CLOEXEC, NETLINK_SOCK_DIAG));
  const timeval patience = {1, 0};
  if (diagnosis.valid()) {
    setsockopt(diagnosis.get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof(patience));
  }
  return diagnosis;
}

int64_t SocketBytes(const Fd& diagnosis) {
  int64_t sum = 0;
  for (const int family : {AF_INET, AF_INET6}) {
    for (const int protocol : {IPPROTO_UDP, IPPROTO_TCP}) {
      if (diagnosis.valid() && Ask(diagnosis, family, protocol)) sum += SumOfAnswer(diagnosis);
    }
  }
  return sum;
}

}  // namespace myograde::server
