// Keeps the logs of a lease's episodes: takes the bytes that the simulator sends
// and makes a file of each log, named after its content. No path leads through
// a place that a participant can write to: the folder is opened once, before
// any sandbox is there, and files are made relative to it.
#pragma once

#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/tracks/episode_facts.h"
#include "protocol/base/fd.h"

namespace myograde::server {

// The name of a log's file in its folder.
std::string LogFileName(const std::string& sha256);

class LogKeeper {
 public:
  // `folder` must be there; `lease` makes the names of unfinished files unique;
  // `budget` is what a packed log may have.
  static absl::StatusOr<LogKeeper> Open(const std::string& folder, const std::string& lease,
                                        int64_t budget);
  LogKeeper(LogKeeper&&) = default;
  ~LogKeeper();

  // The end of the pipe for the simulator. Closed by CloseWriter().
  int writer() const { return writer_.get(); }
  void CloseWriter() { writer_.reset(); }

  // Readable while the simulator sends.
  int reader() const { return reader_.get(); }

  // Takes a part of what is in the pipe, one pipe's worth at most; never blocks.
  // ResourceExhaustedError if the folder's disk takes no more, InternalError if
  // a log is larger than allowed.
  absl::Status Drain();

  // All bytes of the log were sent: completes its file, which is on the disk
  // under its name on return. Bytes of the next log may follow and are kept for it.
  absl::Status Finish(const EpisodeLogInfo& info);

 private:
  LogKeeper() = default;
  // Takes at most so many bytes; 0 if there are none.
  absl::StatusOr<size_t> Take(size_t most);
  absl::Status Write(const char* bytes, size_t size);
  absl::Status TooLarge() const;
  absl::Status Trouble(const char* what) const;

  std::string folder_;
  std::string draft_;  // name of the unfinished file
  int64_t budget_ = 0;
  Fd directory_;
  Fd reader_;
  Fd writer_;
  Fd file_;            // invalid between two logs
  int64_t written_ = 0;  // to `file_`
};

}  // namespace myograde::server
