// myograde-node: both ends of a lease on a Slurm cluster.
//
//   myograde-node --lifeline ORDER.json
//   myograde-node --play [--cache DIR] [--configs DIR] [--node-dir DIR]
//
// The daemon starts the first on its own host, in the place of a runner (lease_stream.h); that has
// srun start the second on a node. Exit status: 0 all was said, 2 wrong use, else as in
// lease_stream.h.
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "server/base/paths.h"
#include "server/base/plain_text.h"
#include "server/base/child_process.h"
#include "server/executor/slurm/lease_stream.h"
#include "server/executor/slurm/node_state.h"
#include "server/sandbox/doctor.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr int kWrongUse = 2;
constexpr int kTrouble = 4;
constexpr char kUsage[] =
    "usage: myograde-node --lifeline ORDER.json\n"
    "       myograde-node --play [--cache DIR] [--configs DIR] [--node-dir DIR]\n";

// Of --play; nullopt: they are not of that form.
std::optional<NodeOptions> Parse(int argc, char** argv) {
  NodeOptions options;
  const std::map<std::string_view, std::string*> known = {{"--cache", &options.cache_dir},
                                                          {"--configs", &options.config_dir},
                                                          {"--node-dir", &options.node_dir}};
  for (int i = 2; i < argc; i += 2) {
    const auto option = known.find(argv[i]);
    if (option == known.end() || i + 1 == argc || !option->second->empty()) return std::nullopt;
    *option->second = argv[i + 1];
  }
  return options;
}

// Root's in /var/lib, as nothing else of that host knows it; an ordinary user's in the cache folder
// of the home, with the node's name, as homes are often shared by nodes.
std::string DefaultNodeDir() {
  if (geteuid() == 0) return "/var/lib/myograde-node";
  return absl::StrCat(OwnCacheDir(), "-node-", NodeName());
}

// Why the folder can't be used; "": it can.
std::string MakeNodeDir(const std::string& path) {
  std::error_code error;
  fs::create_directories(fs::path(path).parent_path(), error);
  struct stat info;
  if ((mkdir(path.c_str(), 0700) != 0 && errno != EEXIST) || lstat(path.c_str(), &info) != 0) {
    return absl::StrCat(path, ": can't be created: ", std::strerror(errno));
  }
  if (S_ISDIR(info.st_mode) && info.st_uid == geteuid() && (info.st_mode & 022) == 0) return "";
  return absl::StrCat(path, ": is not a folder of only this user; name one in \"node_dir\" of "
                            "server.json");
}

int Play(NodeOptions options) {
  umask(077);
  // Folders of the order are mounted, so they must be absolute.
  const auto fill = [](std::string& option, const std::string& fallback) {
    option = fs::absolute(option.empty() ? fallback : option).lexically_normal().string();
  };
  fill(options.config_dir, ConfigDir());
  setenv("MYOGRADE_CONFIG_DIR", options.config_dir.c_str(), 1);
  const char* cache_dir = std::getenv("MYOGRADE_CACHE");
  fill(options.cache_dir, cache_dir != nullptr ? cache_dir : DefaultCacheDir());
  fill(options.node_dir, DefaultNodeDir());
  if (const std::string why = MakeNodeDir(options.node_dir); !why.empty()) {
    std::fprintf(stderr, "myograde-node: %s\n", Sanitized(why).c_str());
    return kTrouble;
  }
  const Fd stop = StopSignals();
  options.stop = stop.get();
  return PlayOnNode(options);
}

int Main(int argc, char** argv) {
  const std::string_view verb = argc > 1 ? argv[1] : "";
  // What the doctor starts in its trial sandbox.
  if (argc == 3 && verb == "doctor" && std::string_view(argv[2]) == "--probe-bus") return ProbeBus();
  if (argc == 3 && verb == "--lifeline") {
    const Fd stop = StopSignals();
    return FollowLease(argv[2], stop.get());
  }
  const std::optional<NodeOptions> options = verb == "--play" ? Parse(argc, argv) : std::nullopt;
  if (options.has_value()) return Play(*options);
  std::fputs(kUsage, stderr);
  return kWrongUse;
}

}  // namespace
}  // namespace myograde::server

int main(int argc, char** argv) { return myograde::server::Main(argc, argv); }
