// Packets on the channel between runner and simulator, and the fault evidence in them.
#include <sys/socket.h>

#include <utility>

#include "protocol/base/config_reader.h"
#include "protocol/lease/sim_channel.h"
#include "tests/fuzz/fuzz.h"

using namespace myograde;
using fuzz::Require;

namespace {

const std::pair<Fd, Fd>& SocketPair() {
  static const std::pair<Fd, Fd> ends = [] {
    int fds[2] = {-1, -1};
    Require(socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, fds) == 0, "there are sockets");
    return std::pair<Fd, Fd>(Fd(fds[0]), Fd(fds[1]));
  }();
  return ends;
}

}  // namespace

MYOGRADE_FUZZ_TARGET(sim_message)(const uint8_t* data, size_t size) {
  const auto& [here, there] = SocketPair();
  // An empty packet looks like the channel's end.
  if (size == 0 || send(here.get(), data, size, MSG_DONTWAIT) != static_cast<ssize_t>(size)) {
    return 0;
  }
  const absl::StatusOr<SimMessage> message = ReceiveSimMessage(there.get(), absl::Seconds(10));
  if (!message.ok()) {
    Require(absl::IsInvalidArgument(message.status()), "nonsense is a mistake of its sender");
    return 0;
  }
  Require(message->json.at("type").is_string(), "a message has a type");
  const absl::StatusOr<FaultEvidence> evidence = FaultEvidenceFromJson(message->json);
  if (!evidence.ok()) return 0;
  const nlohmann::json written = FaultEvidenceToJson(*evidence);
  const absl::StatusOr<FaultEvidence> again = FaultEvidenceFromJson(written);
  Require(again.ok(), "what was written can be read");
  Require(CanonicalJson(FaultEvidenceToJson(*again)) == CanonicalJson(written),
          "evidence keeps its values");
  return 0;
}
