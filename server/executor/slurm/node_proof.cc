#include "server/executor/node/proof.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <set>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <absl/time/clock.h>
#include <nlohmann/json.hpp>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "server/base/host_name.h"
#include "server/base/output_tail.h"
#include "server/base/paths.h"
#include "server/base/plain_text.h"
#include "server/executor/spool/folder.h"
#include "server/proof/grader_build.h"
#include "server/proof/reference_check.h"
#include "server/sandbox/doctor.h"
#include "server/sandbox/users.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr size_t kMostWord = 255;
constexpr absl::Duration kOthersProof = absl::Minutes(10);

std::string Plain(const std::string& text) {
  const size_t begin = text.find_first_not_of(' ');
  if (begin == std::string::npos) return "";
  const std::string trimmed = text.substr(begin, text.find_last_not_of(' ') - begin + 1);
  return IsPlainText(trimmed, kMostWord) ? trimmed : "";
}

std::string ProcessorName() {
  const std::string text = ReadFile("/proc/cpuinfo").value_or("");
  const size_t key = text.find("model name");
  const size_t colon = text.find(':', key);
  if (key == std::string::npos || colon == std::string::npos) return "";
  return Plain(text.substr(colon + 1, text.find('\n', colon) - colon - 1));
}

std::string KernelRelease() {
  utsname names;
  return uname(&names) == 0 ? Plain(names.release) : "";
}

std::string BuildOf(const ProofOptions& options) {
  return CanonicalJson(GraderBuild(options.cache_dir, {options.adapter}));
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

std::vector<std::string> MissingHere(const ProofOptions& options) {
  DoctorOptions doctor;
  const absl::StatusOr<std::string> bin_dir = BinDir();
  if (bin_dir.ok()) doctor.bin_dir = fs::absolute(*bin_dir).lexically_normal();
  doctor.config_dir = fs::absolute(options.config_dir).lexically_normal();
  doctor.cache_dir = options.cache_dir;
  doctor.data_dir = options.node_dir;
  doctor.track = LargestTrack(options.config_dir);
  doctor.uid_base = options.uid_base < 0 ? 0 : options.uid_base;
  std::vector<std::string> missing;
  for (const Check& check : ExamineHost(doctor)) {
    if (check.state != CheckState::kMissing) continue;
    missing.push_back(PrintableUtf8(absl::StrCat(check.name, ": ", check.found)));
  }
  return missing;
}

std::string ProofPath(const ProofOptions& options, const std::string& build) {
  const std::string boot = ReadFile("/proc/sys/kernel/random/boot_id").value_or("");
  return absl::StrCat(options.node_dir, "/proof-",
                      Sha256Hex(absl::StrCat(boot, build, options.config_dir)).substr(0, 16),
                      ".json");
}

std::optional<NodeProof> Known(const ProofOptions& options, const std::string& path) {
  const absl::StatusOr<std::string> text = ReadFile(path, kMostFormBytes);
  if (!text.ok()) return std::nullopt;
  absl::StatusOr<NodeProof> proof = NodeProofFromText(*text, path);
  if (!proof.ok()) return std::nullopt;
  proof->node = options.node;
  return *std::move(proof);
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

absl::StatusOr<NodeProof> MakeProof(const ProofOptions& options, const std::atomic<bool>& stop) {
  NodeProof proof;
  proof.node = options.node;
  proof.processor = ProcessorName();
  proof.kernel = KernelRelease();
  proof.version = GraderVersion();
  proof.grader = BuildOf(options);
  proof.doctor = MissingHere(options);
  // Where sandboxes can't start, no episode can be played either.
  if (!proof.doctor.empty()) return proof;
  const absl::StatusOr<std::string> reference = PlayReference(
      {.folder = options.config_dir + "/reference",
       .work_dir = absl::StrCat(options.node_dir, "/reference"),
       .cache_dir = options.cache_dir,
       .uid = options.uid_base < 0 ? -1 : options.uid_base + kReferenceUsers},
      stop);
  if (!reference.ok()) {
    if (stop) return absl::CancelledError("the proof was stopped");
    proof.reference = PrintableUtf8(absl::StrCat("the reference episodes could not be played: ",
                                                 reference.status().message()));
  } else {
    proof.reference = PrintableUtf8(*reference);
  }
  return proof;
}

absl::StatusOr<NodeProof> KnownOrNewProof(const ProofOptions& options, bool again,
                                          const std::atomic<bool>& stop) {
  const std::string path = ProofPath(options, BuildOf(options));
  if (!again) {
    if (std::optional<NodeProof> known = Known(options, path)) return *std::move(known);
  }
  const std::string lock_path = options.node_dir + "/proof.lock";
  const Fd lock(open(lock_path.c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0600));
  if (!lock.valid()) return DiskError(lock_path, "opened");
  const Deadline deadline(kOthersProof);
  while (flock(lock.get(), LOCK_EX | LOCK_NB) != 0) {
    if (stop) return absl::CancelledError("the proof was stopped");
    if (deadline.over()) {
      return absl::DeadlineExceededError(absl::StrCat(
          "another process has been making this node's proof for ",
          absl::FormatDuration(kOthersProof), " (", lock_path, ")"));
    }
    absl::SleepFor(absl::Milliseconds(100));
  }
  if (!again) {
    if (std::optional<NodeProof> known = Known(options, path)) return *std::move(known);
  }
  absl::StatusOr<NodeProof> proof = MakeProof(options, stop);
  if (!proof.ok()) return proof;
  // One with problems is made again until they are mended.
  std::error_code ignored;
  fs::remove(path, ignored);
  const bool good = proof->reference.empty() && proof->doctor.empty();
  const absl::StatusOr<Folder> folder = Folder::Open(options.node_dir);
  if (good && folder.ok()) {
    // Without it the next lease makes it anew, so an error does no harm.
    (void)folder->Put(fs::path(path).filename(), NodeProofToText(*proof));
  }
  return proof;
}

std::string WhyNotEqual(const NodeProof& proof, const std::string& grader) {
  if (!proof.doctor.empty()) {
    return absl::StrCat("this node can't grade: ", absl::StrJoin(proof.doctor, "; "),
                        "; run \"myograde doctor\" on it");
  }
  if (!proof.reference.empty()) return proof.reference;
  if (proof.grader == grader) return "";
  const absl::StatusOr<Json> mine = ParseJson(proof.grader, "grader");
  const absl::StatusOr<Json> wanted = ParseJson(grader, "grader");
  std::vector<std::string> differs;
  if (mine.ok() && wanted.ok() && mine->is_object() && wanted->is_object()) {
    for (const auto& [key, value] : wanted->items()) {
      if (!mine->contains(key) || mine->at(key) != value) differs.push_back(key);
    }
    for (const auto& [key, value] : mine->items()) {
      if (!wanted->contains(key)) differs.push_back(key);
    }
  }
  return absl::StrCat("this node's grader is not the daemon's: they differ in ",
                      differs.empty() ? "form" : absl::StrJoin(differs, ", "),
                      "; install the same MyoGrade and cache on it");
}

}  // namespace myograde::server
