// What leaves the simulator's sandbox to be kept: the logs of episodes, and a replay's trajectory.
// No path leads through a place that a participant can write to: folders and files are opened
// before any sandbox exists, and the logs' are created relative to theirs.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/fd.h"
#include "protocol/tracks/episode_facts.h"

namespace myograde::server {

// The file name of a log in its folder.
std::string LogFileName(const std::string& sha256);

// Reads the bytes that the simulator sends and writes each log to a file named after its content.
class LogKeeper {
 public:
  // `folder` must exist; `lease` makes the names of unfinished files unique; `budget` is the
  // largest packed log in bytes.
  static absl::StatusOr<LogKeeper> Open(const std::string& folder, const std::string& lease,
                                        int64_t budget);
  LogKeeper(LogKeeper&&) = default;
  ~LogKeeper();

  // Stores a whole log that was made elsewhere. Errors as of Finish.
  static absl::Status Keep(const std::string& folder, const std::string& lease,
                           const EpisodeLogInfo& info, std::string_view bytes);

  // The simulator's end of the pipe. Closed by CloseWriter().
  int writer() const { return writer_.get(); }
  void CloseWriter() { writer_.reset(); }

  // Readable while the simulator sends.
  int reader() const { return reader_.get(); }

  // Reads at most one pipe's worth of what is in the pipe; never blocks. ResourceExhaustedError if
  // the folder's disk is full, InternalError if a log is larger than allowed.
  absl::Status Drain();

  // Call when all bytes of the log have been sent: completes its file, which is on disk under its
  // final name on return. Bytes of the next log may follow and are kept for it.
  absl::Status Finish(const EpisodeLogInfo& info);

 private:
  LogKeeper() = default;
  // Reads at most `most` bytes; 0 if there are none.
  absl::StatusOr<size_t> Take(size_t most);
  absl::Status Write(std::string_view bytes);
  absl::Status TooLarge() const;
  absl::Status Trouble(const char* what) const;

  std::string folder_;
  std::string draft_;  // name of the unfinished file
  int64_t budget_ = 0;
  Fd directory_;
  Fd reader_;
  Fd writer_;
  Fd file_;            // invalid between logs
  int64_t written_ = 0;  // to `file_`
};

// The trajectory of a replayed episode: a memory file that the simulator maps, as it can write no
// other, and the file that its content is kept in.
class TrajectoryFile {
 public:
  // Creates `path`, which must not exist yet, and the memory file.
  static absl::StatusOr<TrajectoryFile> Make(const std::string& path);

  // Of a fixed size, kMostTrajectoryFileBytes, which nobody can change.
  int memory() const { return memory_.get(); }

  // Copies the first `bytes` of the memory file to the file. InternalError: there can't be so many,
  // or the copy fails; nothing is kept then.
  absl::Status Keep(int64_t bytes);

 private:
  TrajectoryFile(std::string path, Fd file, Fd memory)
      : path_(std::move(path)), file_(std::move(file)), memory_(std::move(memory)) {}
  std::string path_;
  Fd file_;
  Fd memory_;
};

}  // namespace myograde::server
