#include "server/runner/runner_process.h"

#include <fcntl.h>
#include <signal.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/base/spawn.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/policy_seed.h"
#include "server/base/paths.h"

namespace myograde::server {
namespace {

// A record holds two tails of output; a longer line is not a record.
constexpr size_t kMaxRecordBytes = 256 << 10;
// How much nicer than the daemon a lease is, with all its processes alike: leases keep the
// processors busy for days, and requests to the daemon must not wait behind them.
constexpr int kNice = 5;
constexpr int kBackgroundNice = 19;

absl::Status WriteOrder(const std::string& text, const std::string& path) {
  ::unlink(path.c_str());
  Fd file(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
  if (!file.valid()) {
    return absl::NotFoundError(
        absl::StrCat("can't write the lease order ", path, ": ", std::strerror(errno)));
  }
  const absl::Status written = WriteAll(file.get(), text);
  if (written.ok()) return written;
  return absl::InternalError(
      absl::StrCat("can't write the lease order ", path, ": ", written.message()));
}

}  // namespace

std::vector<EpisodeOrder> EpisodesOf(const TrackConfig& track, const std::vector<uint64_t>& seeds,
                                     int64_t first, int64_t last) {
  std::vector<EpisodeOrder> episodes;
  for (int64_t index = first; index <= last; ++index) {
    episodes.push_back({index, seeds.at(static_cast<size_t>(index)),
                        PolicySeed(track.policy_seed_secret, index)});
  }
  return episodes;
}

LeaseOrder MakeLeaseOrder(std::string id, const TrackConfig& track,
                          std::vector<EpisodeOrder> episodes, const LeaseProgram& program,
                          const LeasePlace& place) {
  LeaseOrder order;
  static_cast<LeaseProgram&>(order) = program;
  static_cast<LeasePlace&>(order) = place;
  order.lease = std::move(id);
  order.track = track;
  order.episodes = std::move(episodes);
  return order;
}

absl::StatusOr<std::unique_ptr<RunnerProcess>> RunnerProcess::Start(const LeaseOrder& order) {
  ASSIGN_OR_RETURN(Started started,
                   Launch(order, "myograde-runner", LeaseOrderToJson(order).dump()));
  return std::make_unique<RunnerProcess>(std::move(started));
}

absl::StatusOr<RunnerProcess::Started> RunnerProcess::Launch(const LeaseOrder& order,
                                                             const std::string& name,
                                                             const std::string& text) {
  ASSIGN_OR_RETURN(std::string bin_dir, BinDir());
  const std::string program = absl::StrCat(bin_dir, "/", name);
  if (::access(program.c_str(), X_OK) != 0) {
    return absl::NotFoundError(absl::StrCat("no program ", program, " (", std::strerror(errno),
                                            "); build it or set MYOGRADE_BIN_DIR"));
  }
  const std::string order_path = order.work_dir + "/order.json";
  RETURN_IF_ERROR(WriteOrder(text, order_path));

  ASSIGN_OR_RETURN(Pipe in, MakePipe());
  ASSIGN_OR_RETURN(Pipe out, MakeOutputPipe());
  ASSIGN_OR_RETURN(ChildProcess child,
                   ChildProcess::Start({.program = program,
                                        .words = {program, "--lifeline", order_path},
                                        .in = in.read.get(),
                                        .out = out.write.get(),
                                        .nice = order.background ? kBackgroundNice : kNice}));
  return Started{order.lease, std::move(child), std::move(in.write), std::move(out.read)};
}

RunnerProcess::~RunnerProcess() { Kill(); }

absl::StatusOr<std::vector<LeaseRecord>> RunnerProcess::Read() {
  started_.child.Look();
  std::vector<LeaseRecord> records;
  char buffer[16 << 10];
  while (started_.records.valid()) {
    const ssize_t n = ::read(started_.records.get(), buffer, sizeof(buffer));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 && errno == EAGAIN) return records;
    if (n <= 0) {
      started_.records.reset();
      if (line_.empty()) return records;
      return absl::DataLossError(
          absl::StrCat("the runner of lease ", started_.lease, " ended in the middle of a record"));
    }
    line_.append(buffer, static_cast<size_t>(n));
    size_t start = 0;
    for (size_t end; (end = line_.find('\n', start)) != std::string::npos; start = end + 1) {
      absl::StatusOr<LeaseRecord> record =
          LeaseRecordFromLine(std::string_view(line_).substr(start, end - start));
      if (!record.ok() || saw_end_) {
        return absl::DataLossError(absl::StrCat(
            "the runner of lease ", started_.lease, " printed ",
            saw_end_ ? "a record after its last one"
                     : absl::StrCat("a malformed record: ", record.status().message())));
      }
      saw_end_ = std::holds_alternative<LeaseEndRecord>(*record);
      records.push_back(*std::move(record));
    }
    line_.erase(0, start);
    if (line_.size() > kMaxRecordBytes) {
      return absl::DataLossError(
          absl::StrCat("the runner of lease ", started_.lease, " printed a line without an end"));
    }
  }
  return records;
}

void RunnerProcess::AskToEnd() {
  if (dead()) return;
  started_.lifeline.reset();
  started_.child.Signal(SIGTERM);
}

void RunnerProcess::Kill() {
  if (dead()) return;
  AskToEnd();
  if (!EndsWithin(pid(), kCleanUpGrace)) {
    KillNow();
    EndsWithin(pid(), absl::Milliseconds(250));
  }
  (void)dead();
}

}  // namespace myograde::server
