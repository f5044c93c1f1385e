// myograde-sim: plays one lease. Started by the runner, which hands it the
// descriptors of protocol/lease/sim_channel.h.
//
//   myograde-sim --allow CALLS            plays the lease whose order it inherits
//   myograde-sim --allow CALLS --try      sets its system call filter and ends
//   myograde-sim --compile-models CACHE   compiles and keeps the models of both tracks
//   myograde-sim --replay LOG CACHE       plays a log again and prints a replay record
//   myograde-sim --trajectory LOG FILE CACHE    ... and writes its trajectory
//   myograde-sim --model-file TRACK FILE CACHE  writes the shapes of a track for viewers
//
// CALLS: names of the system calls that episodes may make, with commas between.
// The last four run anywhere, outside of sandboxes too, and see to it that the
// C library's maths are those of every other host.
//
// Exit status: 0 done, 1 the grader is in trouble (one sentence on stderr) or a
// replay differs, 2 wrong use.
#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <absl/strings/str_split.h>

#include "protocol/base/ascii_line.h"
#include "protocol/base/clock.h"
#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "protocol/policy/layout.h"
#include "protocol/lease/lease.h"
#include "protocol/log/packed_log.h"
#include "protocol/base/pinned_maths.h"
#include "protocol/lease/sim_channel.h"
#include "protocol/tracks/registry.h"
#include "sim/confine.h"
#include "sim/episode/lease_player.h"
#include "sim/episode/log_writer.h"
#include "sim/episode/replay_player.h"
#include "sim/model/model.h"
#include "sim/tracks.h"
#include "sim/trajectory/model_file.h"
#include "sim/trajectory/recorder.h"

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
  ASSIGN_OR_RETURN(nlohmann::json json, ParseJson(text, "lease order"));
  return LeaseOrderFromJson(json, "lease order");
}

// Null if the runner shares no page; then CPU time is not measured.
CpuPage* MapCpuPage(int fd) {
  void* page = mmap(nullptr, sizeof(CpuPage), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
  return page == MAP_FAILED ? nullptr : static_cast<CpuPage*>(page);
}

MakeEpisodeRecorder RecordersOf(const Environment& environment) {
  return [&environment](const EpisodeLog& log) -> absl::StatusOr<std::unique_ptr<EpisodeRecorder>> {
    const TrackKind& kind = *log.header.track.kind;
    const SimulatedTrack& track = FindSimulatedTrack(kind);
    ASSIGN_OR_RETURN(
        auto recorder, TrajectoryRecorder::Make(environment, track.telemetry(environment),
                                                 {.track = std::string(kind.name),
                                                  .model = ModelFileKey(*track.model),
                                                  .episode = log.header.episode,
                                                  .steps = log.steps(),
                                                  .control_period_s = kind.control_period_s,
                                                  .end = log.end.end}));
    return std::unique_ptr<EpisodeRecorder>(std::move(recorder));
  };
}

absl::Status PlayLease(const std::vector<std::string>& system_calls) {
  ASSIGN_OR_RETURN(LeaseOrder order, ReadOrder(kSimOrderFd));
  absl::StatusOr<int64_t> max_steps = order.track.kind->max_steps(order.track.rules);
  if (!max_steps.ok()) return max_steps.status();
  ASSIGN_OR_RETURN(std::unique_ptr<Environment> environment,
                   MakeEnvironment(order.track, order.cache_dir));
  if (!order.replay.empty()) {
    // A log may come from anywhere, so it is read behind the filter.
    RETURN_IF_ERROR(AllowOnly(system_calls));
    return ReplayPlayer(order, *environment, kSimChannelFd, SystemClock(),
                        RecordersOf(*environment))
        .Play();
  }
  std::optional<LogWriter> log;
  if (!order.log_dir.empty()) {
    log.emplace(kSimLogFd, order.log_bytes, order.track.kind->control_period_s);
  }
  LeasePlayer player(order, *environment, *max_steps, kSimChannelFd, MapCpuPage(kSimCpuPageFd),
                     SystemClock(), log.has_value() ? &*log : nullptr);
  // All files are read by now; what comes next is fed by a participant.
  RETURN_IF_ERROR(AllowOnly(system_calls));
  return player.Play();
}

// `trajectory`: the file to write; null: none.
absl::Status ReplayFile(const char* path, const char* cache_dir, const char* trajectory,
                        bool& equal) {
  const Fd file(open(path, O_RDONLY | O_CLOEXEC));
  if (!file.valid()) {
    return absl::NotFoundError(absl::StrCat(path, ": can't be opened: ", strerror(errno)));
  }
  ASSIGN_OR_RETURN(std::string bytes, ReadPackedLog(file.get()));
  ASSIGN_OR_RETURN(EpisodeLog log, ParseEpisodeLog(bytes));
  ASSIGN_OR_RETURN(std::unique_ptr<Environment> environment,
                   MakeEnvironment(log.header.track, cache_dir));
  std::unique_ptr<EpisodeRecorder> recorder;
  if (trajectory != nullptr) {
    ASSIGN_OR_RETURN(recorder, RecordersOf(*environment)(log));
  }
  ASSIGN_OR_RETURN(ReplayRecord record,
                   ReplayLog(log, *environment, [](int64_t) {}, recorder.get()));
  equal = record.equal;
  std::printf("%s\n", LeaseRecordToLine(record).c_str());
  if (recorder == nullptr || !equal) return absl::OkStatus();
  const absl::StatusOr<std::string> content = recorder->Finish();
  return content.ok() ? WriteFile(trajectory, *content) : content.status();
}

absl::Status WriteModelFile(const std::string& name, const char* file,
                            const std::string& cache_dir) {
  const TrackKind* kind = FindTrack(name);
  if (kind == nullptr) {
    return absl::InvalidArgumentError(absl::StrCat("there is no track \"", name, "\"; known: ",
                                                   absl::StrJoin(TrackNames(), ", ")));
  }
  const SimulatedTrack& track = FindSimulatedTrack(*kind);
  const absl::StatusOr<ModelPtr> model = LoadModel(*track.model, cache_dir);
  if (!model.ok()) return model.status();
  const absl::StatusOr<std::string> content =
      MakeModelFile(**model, name, ModelFileKey(*track.model), track.view);
  return content.ok() ? WriteFile(file, *content) : content.status();
}

int Main(int argc, char** argv) {
  const std::vector<std::string_view> words(argv + 1, argv + argc);
  absl::Status status;
  bool equal = true;
  if (words.size() == 2 && words[0] == "--compile-models") {
    status = PinMaths(argv);
    if (status.ok()) status = CompileModels(std::string(words[1]));
  } else if (words.size() == 3 && words[0] == "--replay") {
    status = PinMaths(argv);
    if (status.ok()) status = ReplayFile(argv[2], argv[3], nullptr, equal);
  } else if (words.size() == 4 && words[0] == "--trajectory") {
    status = PinMaths(argv);
    if (status.ok()) status = ReplayFile(argv[2], argv[4], argv[3], equal);
  } else if (words.size() == 4 && words[0] == "--model-file") {
    status = PinMaths(argv);
    if (status.ok()) status = WriteModelFile(argv[2], argv[3], argv[4]);
  } else if (words.size() >= 2 && words[0] == "--allow" &&
             (words.size() == 2 || (words.size() == 3 && words[2] == "--try"))) {
    const std::vector<std::string> calls = absl::StrSplit(argv[2], ',', absl::SkipEmpty());
    status = words.size() == 2 ? PlayLease(calls) : AllowOnly(calls);
  } else {
    std::fprintf(stderr,
                 "usage: myograde-sim --allow CALLS           (started by myograde-runner)\n"
                 "       myograde-sim --allow CALLS --try     (tries the system call filter)\n"
                 "       myograde-sim --compile-models CACHE  (compiles both tracks' models)\n"
                 "       myograde-sim --replay LOG CACHE      (plays a log again)\n"
                 "       myograde-sim --trajectory LOG FILE CACHE    (and writes its trajectory)\n"
                 "       myograde-sim --model-file TRACK FILE CACHE  (writes a track's shapes)\n");
    return 2;
  }
  if (status.ok()) return equal ? 0 : 1;
  std::fprintf(stderr, "myograde-sim: %s\n", AsciiLine(std::string(status.message())).c_str());
  return 1;
}

}  // namespace
}  // namespace myograde::sim

int main(int argc, char** argv) { return myograde::sim::Main(argc, argv); }
