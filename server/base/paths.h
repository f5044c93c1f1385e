// Where the project's own files lie on this host.
#pragma once

#include <string>

#include <absl/status/statusor.h>

namespace myograde::server {

// The folder of the project's programs: MYOGRADE_BIN_DIR where that is set,
// else the folder of the running program.
absl::StatusOr<std::string> BinDir();

// The folder that holds tracks/ and sandbox/: MYOGRADE_CONFIG_DIR where that is
// set, else share/myograde/configs beside the programs' folder if it is there
// (an installed MyoGrade), else the source tree's configs/.
std::string ConfigDir();

// Where data and caches lie if nobody says otherwise: /var/lib/myograde and
// /var/cache/myograde for root, the XDG folders for other users.
std::string UsualDataDir();
std::string UsualCacheDir();

}  // namespace myograde::server
