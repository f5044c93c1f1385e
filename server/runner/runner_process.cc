#include "server/runner/runner_process.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/base/spawn.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

// A record holds two tails of output; a longer line is not a record.
constexpr size_t kMaxRecordBytes = 256 << 10;
// How much nicer than the daemon a lease is, with all its processes alike: leases keep the
// processors busy for days, and requests to the daemon must not wait behind them.
constexpr int kNice = 5;
constexpr int kBackgroundNice = 19;

double Seconds(const timeval& time) {
  return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
}

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

absl::StatusOr<std::unique_ptr<RunnerProcess>> RunnerProcess::Start(const LeaseOrder& order) {
  return Start(order, "myograde-runner", LeaseOrderToJson(order).dump());
}

absl::StatusOr<std::unique_ptr<RunnerProcess>> RunnerProcess::Start(const LeaseOrder& order,
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
  ASSIGN_OR_RETURN(Pipe err, MakeOutputPipe());

  ASSIGN_OR_RETURN(const pid_t pid, Spawn({program,
                                           {program, "--lifeline", order_path},
                                           in.read.get(),
                                           out.write.get(),
                                           err.write.get(),
                                           order.background ? kBackgroundNice : kNice}));
  std::unique_ptr<RunnerProcess> runner(new RunnerProcess());
  runner->lease_ = order.lease;
  runner->pid_ = pid;
  runner->lifeline_ = std::move(in.write);
  runner->stdout_ = std::move(out.read);
  runner->stderr_ = std::move(err.read);
  return runner;
}

RunnerProcess::~RunnerProcess() { Kill(); }

absl::StatusOr<std::vector<LeaseRecord>> RunnerProcess::Read() {
  DrainStderr();
  std::vector<LeaseRecord> records;
  RETURN_IF_ERROR(DrainStdout(records));
  return records;
}

absl::Status RunnerProcess::DrainStdout(std::vector<LeaseRecord>& records) {
  char buffer[16 << 10];
  while (stdout_.valid()) {
    const ssize_t n = ::read(stdout_.get(), buffer, sizeof(buffer));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 && errno == EAGAIN) return absl::OkStatus();
    if (n <= 0) {
      stdout_.reset();
      if (line_.empty()) return absl::OkStatus();
      return absl::DataLossError(
          absl::StrCat("the runner of lease ", lease_, " ended in the middle of a record"));
    }
    line_.append(buffer, static_cast<size_t>(n));
    size_t start = 0;
    for (size_t end; (end = line_.find('\n', start)) != std::string::npos; start = end + 1) {
      absl::StatusOr<LeaseRecord> record =
          LeaseRecordFromLine(std::string_view(line_).substr(start, end - start));
      if (!record.ok() || saw_end_) {
        return absl::DataLossError(absl::StrCat(
            "the runner of lease ", lease_, " printed ",
            saw_end_ ? "a record after its last one"
                     : absl::StrCat("what is no record: ", record.status().message())));
      }
      saw_end_ = std::holds_alternative<LeaseEndRecord>(*record);
      records.push_back(*std::move(record));
    }
    line_.erase(0, start);
    if (line_.size() > kMaxRecordBytes) {
      return absl::DataLossError(
          absl::StrCat("the runner of lease ", lease_, " printed a line without an end"));
    }
  }
  return absl::OkStatus();
}

void RunnerProcess::DrainStderr() {
  char buffer[16 << 10];
  while (stderr_.valid()) {
    const ssize_t n = ::read(stderr_.get(), buffer, sizeof(buffer));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 && errno == EAGAIN) return;
    if (n <= 0) {
      stderr_.reset();
      return;
    }
    stderr_output_.Append(std::string_view(buffer, static_cast<size_t>(n)));
  }
}

bool RunnerProcess::dead() {
  rusage used = {};
  if (!reaped_ && pid_ > 0 && ::wait4(pid_, &wait_status_, WNOHANG, &used) == pid_) {
    reaped_ = true;
    cpu_s_ = Seconds(used.ru_utime) + Seconds(used.ru_stime);
  }
  return reaped_;
}

absl::StatusOr<int> RunnerProcess::Wait(absl::Duration timeout) {
  if (dead() || (EndsWithin(pid_, timeout) && dead())) return wait_status_;
  return absl::DeadlineExceededError(absl::StrCat("the runner of lease ", lease_, " still runs"));
}

void RunnerProcess::AskToEnd() {
  if (pid_ <= 0 || dead()) return;
  lifeline_.reset();
  ::kill(pid_, SIGTERM);
}

void RunnerProcess::KillNow() {
  if (pid_ <= 0 || dead()) return;
  // Its children have asked the kernel to be killed when it dies, and theirs likewise.
  ::kill(-pid_, SIGKILL);
}

void RunnerProcess::Kill() {
  if (pid_ <= 0 || dead()) return;
  AskToEnd();
  if (Wait(kCleanUpGrace).ok()) return;
  KillNow();
  (void)Wait(absl::Milliseconds(250));
}

}  // namespace myograde::server
