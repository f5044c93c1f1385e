#include "server/executor/slurm/node_state.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <set>
#include <tuple>
#include <vector>

#include <absl/strings/str_cat.h>
#include <absl/time/clock.h>
#include <nlohmann/json.hpp>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/listing.h"
#include "server/artefact/share_files.h"
#include "server/base/paths.h"
#include "server/base/plain_text.h"
#include "server/base/ip_address.h"
#include "server/proof/grader_build.h"
#include "server/proof/reference_check.h"
#include "server/sandbox/doctor.h"
#include "server/sandbox/kernel_files.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr absl::Duration kLockPoll = absl::Milliseconds(100);
// For another lease to unpack a submission.
constexpr absl::Duration kUnpacking = absl::Minutes(10);
constexpr char kHeldTooLong[] =
    "another lease has been unpacking this submission for too long on this node";
constexpr absl::Duration kOthersProof = absl::Minutes(10);
constexpr size_t kLongestPart = 80;

std::string PartText(const nlohmann::json& json) {
  if (json.is_null()) return "none";
  const std::string text = json.is_string() ? json.get<std::string>() : json.dump();
  return text.size() <= kLongestPart ? text : absl::StrCat(text.substr(0, kLongestPart), "...");
}

// What the doctor's trial sandboxes get: the budgets of the track that wants the most memory.
std::optional<TrackConfig> LargestTrack(const std::string& config_dir) {
  std::optional<TrackConfig> largest;
  std::error_code error;
  std::set<fs::path> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(config_dir + "/tracks", error)) {
    if (entry.path().extension() == ".json") files.insert(entry.path());
  }
  for (const fs::path& file : files) {
    absl::StatusOr<TrackConfig> track = LoadTrackConfig(config_dir + "/tracks", file.stem(), "");
    if (!track.ok()) continue;
    if (!largest || track->budgets.memory_bytes > largest->budgets.memory_bytes) {
      largest = *std::move(track);
    }
  }
  return largest;
}

std::string FirstMissing(const NodeOptions& options, int64_t uid_base) {
  DoctorOptions doctor;
  const absl::StatusOr<std::string> bin_dir = BinDir();
  if (bin_dir.ok()) doctor.bin_dir = fs::absolute(*bin_dir).lexically_normal();
  doctor.config_dir = fs::absolute(options.config_dir).lexically_normal();
  doctor.cache_dir = options.cache_dir;
  doctor.data_dir = options.node_dir;
  doctor.track = LargestTrack(options.config_dir);
  doctor.uid_base = std::max<int64_t>(uid_base, 0);
  for (const Check& check : ExamineHost(doctor)) {
    if (check.state == CheckState::kMissing) {
      return absl::StrCat("can't grade: ", check.name, ": ", check.found,
                          "; run \"myograde doctor\" on it");
    }
  }
  return "";
}

// The file that tells that this boot and this build were proved.
std::string ProvedPath(const NodeOptions& options, const std::string& build) {
  const std::string boot = ReadFile("/proc/sys/kernel/random/boot_id").value_or("");
  return absl::StrCat(options.node_dir, "/proved-",
                      Sha256Hex(absl::StrCat(boot, build, options.config_dir)).substr(0, 16));
}

// What is wrong with this host, whatever the daemon's build.
std::string WhyNotEqual(const NodeOptions& options, int64_t uid_base) {
  // Where sandboxes can't start, no episode can be played either.
  if (std::string why = FirstMissing(options, uid_base); !why.empty()) return why;
  const References references(options.config_dir + "/reference");
  const absl::StatusOr<std::string> differs =
      references.Play({.work_dir = options.node_dir + "/reference",
                       .cache_dir = options.cache_dir,
                       .uid = uid_base < 0 ? -1 : uid_base + kReferenceUsers},
                      /*stop=*/{});
  if (!differs.ok()) {
    return absl::StrCat("can't play the reference episodes: ", differs.status().message());
  }
  return differs->empty() ? ""
                          : absl::StrCat("does not play the reference episodes as they are: ", *differs);
}

// A file of the node's to lock by flock(2), made if it is not there.
absl::StatusOr<Fd> OpenLock(const std::string& path) {
  Fd lock(open(path.c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0600));
  if (!lock.valid()) return HostError(absl::StrCat("can't open ", path));
  return lock;
}

// Takes the lock: LOCK_SH or LOCK_EX. DeadlineExceededError(`why`): another process has it for too
// long.
absl::Status TakeLock(const Fd& lock, int how, const Deadline& deadline, const std::string& why) {
  while (flock(lock.get(), how | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK && errno != EINTR) return HostError("can't take a lock");
    if (deadline.over()) return absl::DeadlineExceededError(why);
    absl::SleepFor(kLockPoll);
  }
  return absl::OkStatus();
}

absl::Status MakePrivate(const std::string& path) {
  std::error_code error;
  if (fs::create_directory(path, error); error) {
    return absl::UnavailableError(absl::StrCat(path, ": can't be created: ", error.message()));
  }
  fs::permissions(path, fs::perms::owner_all, error);
  return absl::OkStatus();
}

bool IsFolder(const std::string& path) {
  struct stat info;
  return lstat(path.c_str(), &info) == 0 && S_ISDIR(info.st_mode);
}

// REQUIRES: the lock of `place` is this process' alone.
absl::Status Unpack(const std::string& place, const std::string& digest, const ByteSource& source) {
  const std::string part = place + ".part";
  std::error_code ignored;
  fs::remove_all(part, ignored);
  RETURN_IF_ERROR(PlaceStreamedArtefact(source, digest, part));
  // A node that loses its power must not find half a submission under the whole one's name.
  const Fd placed(open(part.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  if (!placed.valid() || syncfs(placed.get()) != 0) {
    return HostError(absl::StrCat("can't write ", part, " to the disk"));
  }
  if (rename(part.c_str(), place.c_str()) != 0) {
    return HostError(absl::StrCat("can't put ", part, " in place"));
  }
  return absl::OkStatus();
}

void MakeRoom(const std::string& artefacts, int64_t most_bytes) {
  std::vector<std::tuple<int64_t, std::string, int64_t>> known;  // last use, place, bytes
  int64_t total = 0;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(artefacts, error)) {
    const std::string place = entry.path();
    struct stat info;
    if (!IsSha256Hex(entry.path().filename().string()) ||
        stat((place + ".lock").c_str(), &info) != 0) {
      continue;
    }
    const int64_t bytes = DiskBytes(place);
    known.emplace_back(info.st_mtim.tv_sec, place, bytes);
    total += bytes;
  }
  std::sort(known.begin(), known.end());
  for (const auto& [used, place, bytes] : known) {
    if (total <= most_bytes) return;
    const absl::StatusOr<Fd> lock = OpenLock(place + ".lock");
    // One that is played stays.
    if (!lock.ok() || flock(lock->get(), LOCK_EX | LOCK_NB) != 0) continue;
    fs::remove_all(place, error);
    total -= bytes;
  }
}

}  // namespace

std::string NodeName() {
  const char* given = std::getenv("SLURMD_NODENAME");
  std::string name = given != nullptr && *given != '\0' ? given : HostName();
  for (char& c : name) {
    if (!IsNodeName(std::string(1, c)) && c != '.') c = '-';
  }
  return IsNodeName(name) ? name : "unknown";
}

std::string ProcessorName() {
  const std::string name = KernelValue(ReadKernelFile("/proc/cpuinfo"), "model name");
  return name.starts_with(": ") ? PrintableUtf8(name.substr(2)) : "unknown";
}

std::string BuildDifference(const std::string& expected, const std::string& found) {
  const absl::StatusOr<nlohmann::json> ours = ParseJson(expected, "the daemon's build");
  const absl::StatusOr<nlohmann::json> theirs = ParseJson(found, "the node's build");
  if (!ours.ok()) return std::string(ours.status().message());
  if (!theirs.ok()) return std::string(theirs.status().message());
  if (*ours == *theirs) return "";
  const nlohmann::json flat_ours = ours->flatten();
  const nlohmann::json flat_theirs = theirs->flatten();
  for (const auto* side : {&flat_ours, &flat_theirs}) {
    for (const auto& [key, value] : side->items()) {
      const nlohmann::json& a = flat_ours.contains(key) ? flat_ours[key] : nlohmann::json();
      const nlohmann::json& b = flat_theirs.contains(key) ? flat_theirs[key] : nlohmann::json();
      if (a == b && flat_ours.contains(key) == flat_theirs.contains(key)) continue;
      return absl::StrCat(key.substr(1), " is ", PartText(b), ", and the daemon's is ", PartText(a));
    }
  }
  return "build is of another form than the daemon's";
}

absl::StatusOr<std::string> WhyUnfit(const NodeOptions& options, const ClusterOrder& order) {
  const std::string build = CanonicalJson(GraderBuild(options.cache_dir, {order.order.adapter}));
  if (const std::string other = BuildDifference(order.grader, build); !other.empty()) {
    return absl::StrCat("has another grader: its ", other,
                        "; install the daemon's version and models there");
  }
  const std::string path = ProvedPath(options, build);
  ASSIGN_OR_RETURN(const Fd lock, OpenLock(options.node_dir + "/proof.lock"));
  RETURN_IF_ERROR(TakeLock(lock, LOCK_EX, Deadline(kOthersProof),
                           absl::StrCat("another process has been making this node's proof for ",
                                        absl::FormatDuration(kOthersProof))));
  const std::vector<std::string>& again = order.prove_again;
  const bool anew = std::find(again.begin(), again.end(), NodeName()) != again.end();
  if (!anew && fs::exists(path)) return "";
  // With problems it is made again until they are mended.
  std::error_code ignored;
  fs::remove(path, ignored);
  std::string why = PrintableUtf8(WhyNotEqual(options, order.uid_base));
  // Without it the next lease proves the node anew, so an error does no harm.
  if (why.empty()) WriteFile(path, "").IgnoreError();
  return why;
}

absl::StatusOr<NodeSlot> NodeSlot::Take(const std::string& node_dir, int64_t uid_base) {
  if (geteuid() == 0 && uid_base < 0) {
    return absl::InvalidArgumentError(
        "this node runs leases as root and was given no users for their sandboxes; run the daemon "
        "as root too, or let the cluster run its jobs as an ordinary user");
  }
  for (const char* name : {"/slots", "/work"}) {
    RETURN_IF_ERROR(MakePrivate(node_dir + name));
  }
  const SlotProcesses processes(geteuid() == 0 ? uid_base : -1, node_dir + "/marks");
  for (int number = 0; number < kMostSlots; ++number) {
    ASSIGN_OR_RETURN(Fd lock, OpenLock(absl::StrCat(node_dir, "/slots/", number)));
    if (flock(lock.get(), LOCK_EX | LOCK_NB) != 0) continue;
    // What a killed lease left in it must be dead first.
    if (!processes.Find(number, 1).empty()) continue;
    return NodeSlot(number, std::move(lock), absl::StrCat(node_dir, "/work/", number), processes);
  }
  return absl::ResourceExhaustedError(
      absl::StrCat("all ", kMostSlots, " slots of this node are taken"));
}

absl::Status NodeSlot::Prepare(LeaseOrder& order) const {
  CleanUp();
  for (const std::string& path : {work_dir_, work_dir_ + "/lease", work_dir_ + "/logs"}) {
    RETURN_IF_ERROR(MakePrivate(path));
  }
  order.slot = number_;
  order.uid = -1;
  order.work_dir = work_dir_ + "/lease";
  return processes_.Claim(order);
}

void NodeSlot::CleanUp() const {
  std::error_code ignored;
  fs::remove_all(work_dir_, ignored);
}

absl::StatusOr<HeldArtefact> HoldArtefact(const std::string& node_dir, const std::string& digest,
                                          const ByteSource& source, int64_t most_bytes) {
  const std::string artefacts = node_dir + "/artefacts";
  if (::mkdir(artefacts.c_str(), 0700) != 0 && errno != EEXIST) {
    return HostError(absl::StrCat("can't make ", artefacts));
  }
  const std::string place = absl::StrCat(artefacts, "/", digest);
  ASSIGN_OR_RETURN(Fd lock, OpenLock(place + ".lock"));
  const Deadline deadline(kUnpacking);
  for (;;) {
    RETURN_IF_ERROR(TakeLock(lock, LOCK_SH, deadline, kHeldTooLong));
    if (IsFolder(place)) {
      // When it was used last; the lock's own time, as the folder's is part of what is played.
      futimens(lock.get(), nullptr);
      return HeldArtefact{place, std::move(lock)};
    }
    RETURN_IF_ERROR(TakeLock(lock, LOCK_EX, deadline, kHeldTooLong));
    if (IsFolder(place)) continue;
    MakeRoom(artefacts, most_bytes);
    RETURN_IF_ERROR(Unpack(place, digest, source));
  }
}

}  // namespace myograde::server
