// Where the project's own files are on this host.
#pragma once

#include <string>

#include <absl/status/statusor.h>

namespace myograde::server {

// A variable of the environment; "" if it is not set.
std::string EnvironmentVariable(const char* name);

// The folder of the project's programs: MYOGRADE_BIN_DIR if set, else libexec/myograde beside the
// folder of the running program if the programs are there (a package keeps those there that people
// don't call themselves), else the folder of the running program.
absl::StatusOr<std::string> BinDir();

// The folder with what the programs read: share/myograde beside their folder, or beside that of the
// running program if BinDir() has none. In a build's folder it has links to the source tree.
std::string ShareDir();

// share/myograde of an installation that has its programs in `bin_dir`. There need not be one.
std::string ShareDir(const std::string& bin_dir);

// The folder with tracks/ and sandbox/: MYOGRADE_CONFIG_DIR if set, else configs/ of ShareDir().
std::string ConfigDir();

// The folder of the documents' site: MYOGRADE_DOCS_DIR if set, else share/myograde/docs beside the
// programs' folder if it exists, else docs/ beside it (a build folder). There need not be one.
std::string DocsDir();

// The folder of an adapter's program (server/artefact/adapters.h), for programs in `bin_dir`. There
// need not be one.
std::string AdapterFolder(const std::string& adapter, const std::string& bin_dir);

// The default folders of data and caches: /var/lib/myograde and /var/cache/myograde for root, the
// XDG folders for other users.
std::string DefaultDataDir();
std::string OwnCacheDir();

// The cache folder that programs read: the user's own, or, where that has no compiled models, the system's,
// which a package's myograde-setup fills for all users.
std::string DefaultCacheDir();
// Of these two: `system` if only it has compiled models.
std::string CacheDirOf(const std::string& own, const std::string& system);

}  // namespace myograde::server
