#include "server/artefact/beneath.h"

#include <fcntl.h>
#include <linux/openat2.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>

namespace myograde::server {
namespace {

// The same, one path component at a time, for kernels and container hosts without openat2.
Fd OpenByNames(int root, const std::string& path, int flags, mode_t mode) {
  Fd folder;
  size_t begin = 0;
  for (;;) {
    const int at = folder.valid() ? folder.get() : root;
    const size_t slash = path.find('/', begin);
    const std::string name = path.substr(begin, slash - begin);
    if (name == ".." || name.empty()) {
      errno = EXDEV;
      return Fd();
    }
    if (slash == std::string::npos) return Fd(::openat(at, name.c_str(), flags, mode));
    Fd next(::openat(at, name.c_str(), O_PATH | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
    if (!next.valid()) return Fd();
    folder = std::move(next);
    begin = slash + 1;
  }
}

}  // namespace

Fd OpenBeneath(int root, const std::string& path, int flags, mode_t mode) {
  flags |= O_CLOEXEC | O_NOFOLLOW;
  struct open_how how = {};
  how.flags = static_cast<unsigned>(flags);
  how.mode = (flags & O_CREAT) != 0 ? mode : 0;
  how.resolve = RESOLVE_BENEATH | RESOLVE_NO_SYMLINKS | RESOLVE_NO_MAGICLINKS;
  const long fd = ::syscall(SYS_openat2, root, path.c_str(), &how, sizeof how);
  if (fd >= 0) return Fd(static_cast<int>(fd));
  if (errno == ENOSYS || errno == EPERM) return OpenByNames(root, path, flags, mode);
  return Fd();
}

}  // namespace myograde::server
