// myograde-sim: plays one lease. Started by the runner, which hands it the
// descriptors of protocol/sim_channel.h.
//
//   myograde-sim --allow CALLS            plays the lease whose order it inherits
//   myograde-sim --allow CALLS --try      sets its system call filter and ends
//   myograde-sim --compile-models CACHE   compiles and keeps the models of both tracks
//
// CALLS: names of the system calls that episodes may make, with commas between.
// Exit status: 0 done, 1 the grader is in trouble (one sentence on stderr),
// 2 wrong use.
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include "protocol/base/clock.h"
#include "protocol/config_reader.h"
#include "protocol/layout.h"
#include "protocol/lease.h"
#include "protocol/rules_locomotion.h"
#include "protocol/rules_manipulation.h"
#include "protocol/sim_channel.h"
#include "sim/confine.h"
#include "sim/episode/lease_player.h"
#include "sim/factory.h"
#include "sim/model/model.h"

namespace myograde::sim {
namespace {

constexpr size_t kMaxOrderBytes = 16u << 20;

absl::StatusOr<LeaseOrder> ReadOrder(int fd) {
  std::string text;
  char buffer[65536];
  while (true) {
    const ssize_t size = read(fd, buffer, sizeof(buffer));
    if (size < 0 && errno == EINTR) continue;
    if (size < 0) {
      return absl::InvalidArgumentError(absl::StrCat("the lease order on descriptor ", fd,
                                                     " can't be read: ", strerror(errno)));
    }
    if (size == 0) break;
    text.append(buffer, static_cast<size_t>(size));
    if (text.size() > kMaxOrderBytes) {
      return absl::InvalidArgumentError("the lease order is larger than 16 MiB");
    }
  }
  absl::StatusOr<nlohmann::json> json = ParseJson(text, "lease order");
  if (!json.ok()) return json.status();
  return LeaseOrderFromJson(*json, "lease order");
}

// Null if the runner shares no page; then CPU time is not measured.
const CpuPage* MapCpuPage(int fd) {
  void* page = mmap(nullptr, sizeof(CpuPage), PROT_READ, MAP_SHARED, fd, 0);
  return page == MAP_FAILED ? nullptr : static_cast<const CpuPage*>(page);
}

absl::StatusOr<int64_t> MaxSteps(const TrackConfig& track) {
  if (track.kind == TrackKind::kManipulation) {
    const auto rules = ParseManipulationRules(track.rules, "rules");
    if (!rules.ok()) return rules.status();
    return rules->max_steps;
  }
  const auto rules = ParseLocomotionRules(track.rules, "rules");
  if (!rules.ok()) return rules.status();
  return std::llround(rules->end.time_limit_s / ControlPeriod(track.kind));
}

absl::Status PlayLease(const std::vector<std::string>& system_calls) {
  absl::StatusOr<LeaseOrder> order = ReadOrder(kSimOrderFd);
  if (!order.ok()) return order.status();
  absl::StatusOr<int64_t> max_steps = MaxSteps(order->track);
  if (!max_steps.ok()) return max_steps.status();
  absl::StatusOr<std::unique_ptr<Environment>> environment =
      MakeEnvironment(order->track, order->cache_dir);
  if (!environment.ok()) return environment.status();
  LeasePlayer player(*order, **environment, *max_steps, kSimChannelFd, MapCpuPage(kSimCpuPageFd),
                     SystemClock());
  // All files are read by now; what comes next is fed by a participant.
  if (absl::Status status = AllowOnly(system_calls); !status.ok()) return status;
  return player.Play();
}

int Main(int argc, char** argv) {
  const std::vector<std::string_view> words(argv + 1, argv + argc);
  absl::Status status;
  if (words.size() == 2 && words[0] == "--compile-models") {
    status = CompileModels(std::string(words[1]));
  } else if (words.size() >= 2 && words[0] == "--allow" &&
             (words.size() == 2 || (words.size() == 3 && words[2] == "--try"))) {
    const std::vector<std::string> calls = absl::StrSplit(argv[2], ',', absl::SkipEmpty());
    status = words.size() == 2 ? PlayLease(calls) : AllowOnly(calls);
  } else {
    std::fprintf(stderr,
                 "usage: myograde-sim --allow CALLS           (started by myograde-runner)\n"
                 "       myograde-sim --allow CALLS --try     (tries the system call filter)\n"
                 "       myograde-sim --compile-models CACHE  (compiles both tracks' models)\n");
    return 2;
  }
  if (status.ok()) return 0;
  std::fprintf(stderr, "myograde-sim: %s\n", std::string(status.message()).c_str());
  return 1;
}

}  // namespace
}  // namespace myograde::sim

int main(int argc, char** argv) { return myograde::sim::Main(argc, argv); }
