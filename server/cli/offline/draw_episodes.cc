#include "server/cli/offline/draw_episodes.h"

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/time/time.h>
#include <fcntl.h>
#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <string_view>
#include <utility>
#include <vector>

#include "protocol/base/clock.h"
#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/spawn.h"
#include "protocol/base/status_macros.h"
#include "server/base/child_process.h"
#include "server/base/paths.h"
#include "server/cli/base/exit_status.h"

namespace myograde::server {
namespace {

constexpr int kLowPriority = 10;  // as of nice(1)
constexpr int kLookMilliseconds = 100;
constexpr size_t kMaxPngBytes = size_t{256} << 20;
constexpr absl::Duration kAfterDeadline = absl::Seconds(10);  // in which myograde-render says so itself

struct Received {
  const int fd;
  std::function<absl::Status(std::string_view)> take;
  bool open = true;
};

absl::Status ReceiveMore(Received& from) {
  char buffer[65536];
  while (from.open) {
    const ssize_t size = ::read(from.fd, buffer, sizeof(buffer));
    if (size < 0 && errno == EINTR) continue;
    if (size < 0 && errno == EAGAIN) break;
    if (size <= 0) {
      from.open = false;
      break;
    }
    RETURN_IF_ERROR(from.take({buffer, static_cast<size_t>(size)}));
  }
  return absl::OkStatus();
}

// Waits until all of `children` have ended and `from` is read to its end.
absl::Status AwaitAll(const std::vector<ChildProcess*>& children, Received& from,
                      double deadline_s) {
  const Deadline deadline(absl::Seconds(deadline_s) + kAfterDeadline);
  while (true) {
    if (StopRequested()) return absl::CancelledError("the drawing was interrupted");
    if (deadline.over()) {
      return absl::DeadlineExceededError(absl::StrCat("drawing took longer than ", deadline_s, " s"));
    }
    RETURN_IF_ERROR(ReceiveMore(from));
    bool ended = !from.open;
    std::vector<pollfd> fds;
    if (from.open) fds.push_back({from.fd, POLLIN, 0});
    for (ChildProcess* child : children) {
      ended = child->Look() && ended;
      if (child->err_fd() >= 0) fds.push_back({child->err_fd(), POLLIN, 0});
    }
    if (ended) return absl::OkStatus();
    ::poll(fds.data(), fds.size(), kLookMilliseconds);
  }
}

absl::StatusOr<ChildProcess> StartRenderer(const RenderOrder& order, const std::string& folder,
                                           Fd out) {
  ASSIGN_OR_RETURN(const std::string programs, BinDir());
  const std::string file = folder + "/order.json";
  if (absl::Status status = WriteFile(file, RenderOrderToJson(order).dump()); !status.ok()) {
    return absl::InternalError(status.message());
  }
  const Fd opened(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  const Fd in(::fcntl(opened.get(), F_DUPFD_CLOEXEC, STDERR_FILENO + 1));
  if (!in.valid()) return absl::InternalError(absl::StrCat(file, ": can't be read again"));
  return ChildProcess::Start({.program = programs + "/myograde-render",
                              .words = {"myograde-render"},
                              .in = in.get(),
                              .out = out.get(),
                              .nice = kLowPriority});
}

// What the end of myograde-render means.
absl::Status RenderStatus(const ChildProcess& renderer, const RenderOrder& order) {
  if (renderer.succeeded()) return absl::OkStatus();
  const int status = renderer.wait_status();
  if (WIFSIGNALED(status) && WTERMSIG(status) == SIGALRM) {
    return absl::DeadlineExceededError(
        absl::StrCat("drawing took longer than ", order.deadline_s, " s"));
  }
  if (WIFEXITED(status) && WEXITSTATUS(status) == kRenderLogFault) {
    return absl::DataLossError(renderer.Failure());
  }
  return absl::InternalError(absl::StrCat("no picture can be drawn: ", renderer.Failure()));
}

std::vector<std::string> EncoderWords(const RenderOrder& order, FilmFormat format,
                                      const std::string& path) {
  std::vector<std::string> words = {
      "ffmpeg", "-hide_banner", "-loglevel", "error", "-nostdin", "-nostats",
      "-progress", "pipe:1",
      // What comes in: the pictures, one after the other.
      "-f", "rawvideo", "-pix_fmt", "rgb24",
      "-video_size", absl::StrCat(order.width, "x", order.height),
      "-framerate", absl::StrCat(order.frames_per_second), "-i", "pipe:0",
      // What goes out has no date or version in it.
      "-an", "-map_metadata", "-1", "-fflags", "+bitexact", "-flags:v", "+bitexact",
      "-pix_fmt", "yuv420p"};
  const std::vector<std::string> codec =
      format == FilmFormat::kMp4
          ? std::vector<std::string>{"-c:v", "libx264",   "-preset",    "veryfast", "-crf",
                                     "20",   "-movflags", "+faststart", "-f",       "mp4"}
          : std::vector<std::string>{"-c:v",    "libvpx-vp9", "-b:v",     "0",         "-crf",
                                     "33",      "-deadline",  "realtime", "-cpu-used", "6",
                                     "-row-mt", "1",          "-f",       "webm"};
  words.insert(words.end(), codec.begin(), codec.end());
  words.insert(words.end(), {"-y", "file:" + path});
  return words;
}

absl::StatusOr<ChildProcess> StartEncoder(std::vector<std::string> words, Fd in, Fd out) {
  absl::StatusOr<std::string> program = FindProgram("ffmpeg");
  if (!program.ok()) {
    return absl::InternalError(absl::StrCat(
        "films are encoded by ffmpeg, and ", program.status().message(),
        ": install it (Debian: apt-get install ffmpeg), or write a .png"));
  }
  return ChildProcess::Start({.program = *program,
                              .words = std::move(words),
                              .in = in.get(),
                              .out = out.get(),
                              .nice = kLowPriority});
}

}  // namespace

absl::StatusOr<std::string> DrawPng(const RenderOrder& order, const std::string& folder) {
  CatchStopSignals();
  ASSIGN_OR_RETURN(Pipe pictures, MakeOutputPipe());
  ASSIGN_OR_RETURN(ChildProcess renderer, StartRenderer(order, folder, std::move(pictures.write)));
  std::string png;
  Received from = {pictures.read.get(), [&](std::string_view piece) {
                     png.append(piece);
                     if (png.size() <= kMaxPngBytes) return absl::OkStatus();
                     return absl::InternalError("the picture has more than 256 MiB");
                   }};
  RETURN_IF_ERROR(AwaitAll({&renderer}, from, order.deadline_s));
  RETURN_IF_ERROR(RenderStatus(renderer, order));
  return png;
}

absl::Status EncodeFilm(const RenderOrder& order, FilmFormat format, const std::string& folder,
                        const std::string& path, const std::function<void(int64_t)>& progress) {
  CatchStopSignals();
  ASSIGN_OR_RETURN(Pipe pictures, MakePipe());
  ASSIGN_OR_RETURN(Pipe said, MakeOutputPipe());
  ASSIGN_OR_RETURN(ChildProcess encoder,
                   StartEncoder(EncoderWords(order, format, path), std::move(pictures.read),
                                std::move(said.write)));
  ASSIGN_OR_RETURN(ChildProcess renderer, StartRenderer(order, folder, std::move(pictures.write)));
  std::string lines;  // of ffmpeg, "frame=12" among them
  Received from = {said.read.get(), [&](std::string_view piece) {
                     lines.append(piece);
                     for (size_t end; (end = lines.find('\n')) != std::string::npos;) {
                       int64_t frame = 0;
                       const std::string line = lines.substr(0, end);
                       lines.erase(0, end + 1);
                       if (line.starts_with("frame=") && absl::SimpleAtoi(line.substr(6), &frame)) {
                         progress(frame);
                       }
                     }
                     return absl::OkStatus();
                   }};
  RETURN_IF_ERROR(AwaitAll({&renderer, &encoder}, from, order.deadline_s));
  const absl::Status drawn = RenderStatus(renderer, order);
  // Without its reader the renderer can't go on, and it was not its fault.
  const bool unread = WIFSIGNALED(renderer.wait_status()) &&
                      WTERMSIG(renderer.wait_status()) == SIGPIPE;
  if (!drawn.ok() && !unread) return drawn;
  if (encoder.succeeded() && drawn.ok()) return absl::OkStatus();
  return absl::InternalError(absl::StrCat("ffmpeg can't encode the film: ", encoder.Failure()));
}

}  // namespace myograde::server
