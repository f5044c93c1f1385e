// Opening files below a folder that a participant filled, following nothing.
#pragma once

#include <sys/types.h>

#include <string>

#include "protocol/base/fd.h"

namespace myograde::server {

// Opens `path` (relative, without ".." or empty names) below the folder `root`
// like openat(2) with O_CLOEXEC and O_NOFOLLOW. A symbolic link anywhere in the
// path, or a way out of the folder, is ELOOP or EXDEV; with O_PATH a link as the
// last name is opened itself. An invalid Fd and errno on failure.
Fd OpenBeneath(int root, const std::string& path, int flags, mode_t mode = 0);

}  // namespace myograde::server
