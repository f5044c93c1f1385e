// The doctor's probe that runs inside a policy's sandbox.
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <optional>
#include <string>

#include "protocol/bridge/bus.h"
#include "protocol/policy/channels.h"
#include "server/sandbox/doctor.h"

namespace myograde::server {

int ProbeBus() {
  constexpr auto kPatience = std::chrono::seconds(2);
  constexpr std::string_view kChannel = "MYOGRADE_DOCTOR";
  std::string problem;
  std::optional<Bus> one = Bus::Open(kBusUrl, kPatience, problem);
  std::optional<Bus> other = one ? Bus::Open(kBusUrl, kPatience, problem) : std::nullopt;
  if (other) {
    one->Send(kChannel, {});
    const std::optional<Datagram> heard = ParseDatagram(other->Await());
    if (heard && heard->channel == kChannel) return 0;
    problem = "a datagram did not come through in 2 s";
  }
  dprintf(STDERR_FILENO, "the bus of the sandbox: %s\n", problem.c_str());
  return 1;
}

}  // namespace myograde::server
