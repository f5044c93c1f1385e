// The doctor's probe that runs inside a policy's sandbox.
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <optional>
#include <string_view>

#include <absl/status/statusor.h>
#include <absl/strings/string_view.h>

#include "protocol/bridge/bus.h"
#include "protocol/policy/channels.h"
#include "server/sandbox/doctor.h"

namespace myograde::server {
namespace {

int BusComplaint(absl::string_view problem) {
  dprintf(STDERR_FILENO, "the bus of the sandbox: %.*s\n", static_cast<int>(problem.size()),
          problem.data());
  return 1;
}

}  // namespace

int ProbeBus() {
  constexpr auto kPatience = std::chrono::seconds(2);
  constexpr std::string_view kChannel = "MYOGRADE_DOCTOR";
  absl::StatusOr<Bus> one = Bus::Open(kBusUrl, kPatience);
  if (!one.ok()) return BusComplaint(one.status().message());
  absl::StatusOr<Bus> other = Bus::Open(kBusUrl, kPatience);
  if (!other.ok()) return BusComplaint(other.status().message());
  one->Send(kChannel, {});
  const std::optional<Datagram> heard = ParseDatagram(other->Await());
  if (heard && heard->channel == kChannel) return 0;
  return BusComplaint("a datagram did not come through in 2 s");
}

}  // namespace myograde::server
