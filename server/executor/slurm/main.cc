// myograde-node: plays one attempt of a lease on a node of a cluster, or proves the node.
//
//   myograde-node --spool DIR --lease NAME [--cache DIR] [--configs DIR] [--node-dir DIR]
//   myograde-node --url URL --lease NAME [--ca FILE] [...]
//   myograde-node --reach --url URL [--ca FILE]
//   myograde-node --prove [--again] [--adapter NAME] [--uid-base N] [...]
//
// The first takes the order out of a shared folder, the second from the daemon, with the token in the
// environment variable MYOGRADE_LEASE_TOKEN. The third tries the daemon's address. The fourth prints the
// node's proof, as JSON. Exit status: 0 the daemon was told how it ended (or answered, or the proof was
// printed, whatever it says), 2 wrong use, else as in spool/forms.h.
#include <signal.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <string_view>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "protocol/base/status_macros.h"
#include "server/base/harmless.h"
#include "server/base/paths.h"
#include "server/base/stop_signals.h"
#include "server/executor/node/folder_channel.h"
#include "server/executor/node/http_channel.h"
#include "server/executor/node/play.h"
#include "server/executor/node/proof.h"
#include "server/executor/spool/folder.h"
#include "server/sandbox/doctor.h"

namespace myograde::server {
namespace {

constexpr int kWrongUse = 2;
constexpr char kToken[] = "MYOGRADE_LEASE_TOKEN";
constexpr char kUsage[] =
    "usage: myograde-node --spool DIR --lease NAME [--cache DIR] [--configs DIR] [--node-dir DIR]\n"
    "       myograde-node --url URL --lease NAME [--ca FILE] [--cache DIR] ...\n"
    "       myograde-node --reach --url URL [--ca FILE]\n"
    "       myograde-node --prove [--again] [--adapter NAME] [--uid-base N] [--cache DIR] ...\n";

struct Arguments {
  std::map<std::string, std::string, std::less<>> values;
  bool prove = false;
  bool reach = false;
  bool again = false;

  std::string Get(std::string_view name, const std::string& otherwise = "") const {
    const auto found = values.find(name);
    return found == values.end() ? otherwise : found->second;
  }
};

// False: they are not of any of the forms.
bool Parse(int argc, char** argv, Arguments& arguments) {
  static const std::set<std::string_view> known = {"--spool", "--lease", "--url",      "--ca",
                                                   "--cache", "--configs", "--node-dir",
                                                   "--adapter", "--uid-base"};
  for (int i = 1; i < argc; ++i) {
    const std::string_view name = argv[i];
    if (name == "--prove") {
      arguments.prove = true;
    } else if (name == "--reach") {
      arguments.reach = true;
    } else if (name == "--again") {
      arguments.again = true;
    } else if (!known.contains(name) || i + 1 == argc ||
               !arguments.values.emplace(name, argv[++i]).second) {
      return false;
    }
  }
  const bool spool = arguments.values.contains("--spool");
  const bool url = arguments.values.contains("--url");
  if (arguments.prove) return !spool && !url;
  if (arguments.reach) return !spool && url;
  return spool != url && IsLeaseName(arguments.Get("--lease"));
}

// Folders of the order are mounted, so they must be absolute.
std::string Absolute(const std::string& path) {
  return std::filesystem::absolute(path).lexically_normal().string();
}

// Root's in /var/lib, as nothing else of that host knows it; an ordinary user's in the cache folder
// of the home, with the node's name, as homes are often shared by nodes.
std::string UsualNodeDir() {
  if (geteuid() == 0) return "/var/lib/myograde-node";
  return absl::StrCat(OwnCacheDir(), "-node-", NodeName());
}

absl::Status MakeNodeDir(const std::string& path) {
  std::error_code error;
  std::filesystem::create_directories(std::filesystem::path(path).parent_path(), error);
  RETURN_IF_ERROR(Folder::Make(path).status());
  struct stat info;
  if (stat(path.c_str(), &info) != 0) return DiskError(path, "examined");
  if (info.st_uid != geteuid() || (info.st_mode & 022) != 0) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": belongs to uid ", info.st_uid, " or can be written by others; name a folder of "
        "this user alone with --node-dir"));
  }
  return absl::OkStatus();
}

// Takes the token out of the environment, which every process that this one starts would have.
std::string TakeToken() {
  char* text = std::getenv(kToken);
  if (text == nullptr) return "";
  std::string token = text;
  explicit_bzero(text, token.size());
  unsetenv(kToken);
  return token;
}

int Trouble(const absl::Status& status) {
  std::fprintf(stderr, "myograde-node: %s\n", Harmless(std::string(status.message())).c_str());
  return kNodeTrouble;
}

int Prove(const Arguments& arguments, const std::string& cache, const std::string& configs,
          const std::string& node_dir) {
  ProofOptions options = {.cache_dir = cache,
                          .config_dir = configs,
                          .node_dir = node_dir,
                          .node = NodeName(),
                          .adapter = arguments.Get("--adapter"),
                          .uid_base = -1};
  const std::string uid_base = arguments.Get("--uid-base", geteuid() == 0 ? "62000" : "-1");
  if (!absl::SimpleAtoi(uid_base, &options.uid_base)) {
    std::fputs(kUsage, stderr);
    return kWrongUse;
  }
  if (geteuid() != 0) options.uid_base = -1;
  const std::atomic<bool> never = false;
  const absl::StatusOr<NodeProof> proof = KnownOrNewProof(options, arguments.again, never);
  if (!proof.ok()) return Trouble(proof.status());
  std::printf("%s\n", NodeProofToText(*proof).c_str());
  return kNodeDone;
}

int Reach(const Arguments& arguments) {
  const absl::StatusOr<std::unique_ptr<HttpChannel>> channel = HttpChannel::Open(
      {.url = arguments.Get("--url"), .lease = "", .token = "", .ca_file = arguments.Get("--ca")});
  if (!channel.ok()) return Trouble(channel.status());
  const absl::Status status = (*channel)->Reach();
  if (status.ok()) return kNodeDone;
  Trouble(status);
  return ExitStatusOf(status);
}

int Main(int argc, char** argv) {
  // What the doctor starts in its trial sandbox.
  if (argc == 3 && std::string_view(argv[1]) == "doctor" &&
      std::string_view(argv[2]) == "--probe-bus") {
    return ProbeBus();
  }
  const std::string token = TakeToken();
  Arguments arguments;
  if (!Parse(argc, argv, arguments)) {
    std::fputs(kUsage, stderr);
    return kWrongUse;
  }
  if (arguments.reach) return Reach(arguments);
  umask(077);
  const std::string configs = Absolute(arguments.Get("--configs", ConfigDir()));
  setenv("MYOGRADE_CONFIG_DIR", configs.c_str(), 1);
  const char* cache_dir = std::getenv("MYOGRADE_CACHE");
  const std::string cache = Absolute(
      arguments.Get("--cache", cache_dir != nullptr ? cache_dir : UsualCacheDir()));
  const std::string node_dir = Absolute(arguments.Get("--node-dir", UsualNodeDir()));
  if (absl::Status status = MakeNodeDir(node_dir); !status.ok()) return Trouble(status);
  if (arguments.prove) return Prove(arguments, cache, configs, node_dir);
  const Fd stop = StopSignals();
  const std::string lease = arguments.Get("--lease");
  const PlayOptions options = {.cache_dir = cache,
                               .config_dir = configs,
                               .node_dir = node_dir,
                               .lease = lease,
                               .stop = stop.get()};
  if (arguments.values.contains("--spool")) {
    FolderChannel channel(Absolute(arguments.Get("--spool")), lease);
    return PlayLease(channel, options);
  }
  const absl::StatusOr<std::unique_ptr<HttpChannel>> channel = HttpChannel::Open(
      {.url = arguments.Get("--url"), .lease = lease, .token = token, .ca_file = arguments.Get("--ca")});
  if (!channel.ok()) return Trouble(channel.status());
  return PlayLease(**channel, options);
}

}  // namespace
}  // namespace myograde::server

int main(int argc, char** argv) { return myograde::server::Main(argc, argv); }
