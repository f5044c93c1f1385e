// Opens files below a folder that a participant filled, without following links.
#pragma once

#include <sys/types.h>

#include <string>

#include "protocol/base/fd.h"

namespace myograde::server {

// Opens `path` (relative, without ".." or empty names) below the folder `root`, like openat(2) with
// O_CLOEXEC and O_NOFOLLOW. A symbolic link anywhere in the path, or an escape from the folder, is
// ELOOP or EXDEV; with O_PATH a link as the last name is itself opened. Returns an invalid Fd and
// sets errno on failure.
Fd OpenBeneath(int root, const std::string& path, int flags, mode_t mode = 0);

}  // namespace myograde::server
