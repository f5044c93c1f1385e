#include "server/base/temp_folder.h"

#include <fcntl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include <absl/strings/str_cat.h>

#include "protocol/base/spawn.h"

namespace myograde::server {
namespace {

void Remove(const std::string& path) {
  std::error_code ignored;  // nobody is left to tell
  std::filesystem::remove_all(path, ignored);
}

// Waits until the other end of `alive` is closed, in a process group of its own, so that what ends
// the parent's does not end it.
[[noreturn]] void WaitAndRemove(int alive, const std::string& path) {
  setpgid(0, 0);
  for (const int stop : {SIGHUP, SIGINT, SIGTERM}) signal(stop, SIG_IGN);
  dup2(alive, STDIN_FILENO);
  syscall(SYS_close_range, 1U, ~0U, 0U);
  char byte = 0;
  while (read(STDIN_FILENO, &byte, 1) < 0 && errno == EINTR) {
  }
  // The parent's children end with it, and may write until then.
  for (int tries = 0; tries < 50; ++tries) {
    Remove(path);
    if (access(path.c_str(), F_OK) != 0) break;
    usleep(100'000);
  }
  _exit(0);
}

}  // namespace

absl::StatusOr<TempFolder> TempFolder::Make(const std::string& purpose) {
  std::error_code error;
  const std::filesystem::path base = std::filesystem::temp_directory_path(error);
  std::string name = (base / absl::StrCat("myograde-", purpose, ".XXXXXX")).string();
  if (error || ::mkdtemp(name.data()) == nullptr) {
    return absl::InternalError(absl::StrCat(
        "can't make a temporary folder in ", base.string(), ": ",
        error ? error.message() : std::strerror(errno), "; set TMPDIR to a folder with space"));
  }
  TempFolder folder(name);
  absl::StatusOr<Pipe> pipe = MakePipe();
  if (!pipe.ok()) return folder;
  folder.remover_ = fork();
  if (folder.remover_ == 0) {
    pipe->write.reset();
    WaitAndRemove(pipe->read.get(), name);
  }
  if (folder.remover_ > 0) setpgid(folder.remover_, folder.remover_);  // before this returns
  folder.alive_ = std::move(pipe->write);
  return folder;
}

TempFolder::~TempFolder() {
  if (path_.empty()) return;
  Remove(path_);
  alive_.reset();
  if (remover_ > 0) waitpid(remover_, nullptr, 0);
}

}  // namespace myograde::server
