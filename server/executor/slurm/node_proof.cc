#include "server/executor/slurm/node_proof.h"

#include <sys/file.h>

#include <cstdlib>
#include <filesystem>
#include <optional>
#include <set>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/lease.h"
#include "server/base/ip_address.h"
#include "server/base/paths.h"
#include "server/base/plain_text.h"
#include "server/executor/slurm/node_dir.h"
#include "server/proof/grader_build.h"
#include "server/proof/reference_check.h"
#include "server/sandbox/doctor.h"
#include "server/sandbox/kernel_files.h"
#include "server/sandbox/slot_processes.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

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

std::string FirstMissing(const ProofOptions& options) {
  DoctorOptions doctor;
  const absl::StatusOr<std::string> bin_dir = BinDir();
  if (bin_dir.ok()) doctor.bin_dir = fs::absolute(*bin_dir).lexically_normal();
  doctor.config_dir = fs::absolute(options.config_dir).lexically_normal();
  doctor.cache_dir = options.cache_dir;
  doctor.data_dir = options.node_dir;
  doctor.track = LargestTrack(options.config_dir);
  doctor.uid_base = options.uid_base < 0 ? 0 : options.uid_base;
  for (const Check& check : ExamineHost(doctor)) {
    if (check.state == CheckState::kMissing) {
      return absl::StrCat("can't grade: ", check.name, ": ", check.found,
                          "; run \"myograde doctor\" on it");
    }
  }
  return "";
}

// The file that tells that this boot and this build were proved.
std::string ProvedPath(const ProofOptions& options, const std::string& build) {
  const std::string boot = ReadFile("/proc/sys/kernel/random/boot_id").value_or("");
  return absl::StrCat(options.node_dir, "/proved-",
                      Sha256Hex(absl::StrCat(boot, build, options.config_dir)).substr(0, 16));
}

// What is wrong with this host, whatever the daemon's build.
std::string WhyNotEqual(const ProofOptions& options) {
  // Where sandboxes can't start, no episode can be played either.
  if (std::string missing = FirstMissing(options); !missing.empty()) return missing;
  const absl::StatusOr<std::string> differs = PlayReference(
      {.folder = options.config_dir + "/reference",
       .work_dir = options.node_dir + "/reference",
       .cache_dir = options.cache_dir,
       .uid = options.uid_base < 0 ? -1 : options.uid_base + kReferenceUsers},
      /*stop=*/{});
  if (!differs.ok()) {
    return absl::StrCat("can't play the reference episodes: ", differs.status().message());
  }
  return differs->empty() ? ""
                          : absl::StrCat("does not play the reference episodes as they are: ", *differs);
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

absl::StatusOr<std::string> WhyUnfit(const ProofOptions& options, const std::string& grader) {
  const std::string build = CanonicalJson(GraderBuild(options.cache_dir, {options.adapter}));
  if (const std::string other = BuildDifference(grader, build); !other.empty()) {
    return absl::StrCat("has another grader: its ", other,
                        "; install the daemon's version and models there");
  }
  const std::string path = ProvedPath(options, build);
  ASSIGN_OR_RETURN(const Fd lock, OpenLock(options.node_dir + "/proof.lock"));
  RETURN_IF_ERROR(TakeLock(lock, LOCK_EX, Deadline(kOthersProof),
                           absl::StrCat("another process has been making this node's proof for ",
                                        absl::FormatDuration(kOthersProof))));
  if (!options.again && fs::exists(path)) return "";
  // With problems it is made again until they are mended.
  std::error_code ignored;
  fs::remove(path, ignored);
  std::string why = PrintableUtf8(WhyNotEqual(options));
  // Without it the next lease proves the node anew, so an error does no harm.
  if (why.empty()) WriteFile(path, "").IgnoreError();
  return why;
}

}  // namespace myograde::server
