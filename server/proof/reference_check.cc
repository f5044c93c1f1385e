#include "server/proof/reference_check.h"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/status_macros.h"
#include "server/proof/logs.h"
#include "server/proof/replay_run.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

absl::StatusOr<ReplayRecord> PlayOne(const fs::path& file, const ReferenceOptions& options,
                                     const std::stop_token& stop) {
  ASSIGN_OR_RETURN(std::string bytes, ReadLog(file));
  ASSIGN_OR_RETURN(EpisodeLog log, ParseEpisodeLog(bytes));
  ReplayOrder order;
  order.track = log.header.track;
  order.blocks = {{{{log.header.episode, log.header.seed, 0}}, {file}}};
  order.work_dir = options.work_dir;
  order.cache_dir = options.cache_dir;
  order.uid_base = options.uid;
  ASSIGN_OR_RETURN(const std::vector<ReplayRecord> records,
                   RunReplay(order, {.stopped = [&] { return stop.stop_requested(); }}));
  return records.front();
}

std::vector<fs::path> LogsIn(const std::string& folder) {
  std::error_code error;
  std::vector<fs::path> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    if (entry.path().extension() == ".zst") files.push_back(fs::absolute(entry.path()));
  }
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace

std::string WhyUnreferenced(const std::string& folder, std::string_view kind) {
  for (const fs::path& file : LogsIn(folder)) {
    const absl::StatusOr<std::string> bytes = ReadLog(file);
    if (!bytes.ok()) continue;
    const absl::StatusOr<EpisodeLog> log = ParseEpisodeLog(*bytes);
    if (log.ok() && log->header.track.kind->name == kind) return "";
  }
  return absl::StrCat("no reference episode in ", folder, " is of the environment ",
                      absl::string_view(kind.data(), kind.size()), ", so nothing shows that this host "
                      "computes it as others do; record one (configs/README.md)");
}

absl::StatusOr<std::string> PlayReference(const ReferenceOptions& options,
                                          const std::stop_token& stop) {
  std::error_code error;
  const std::vector<fs::path> files = LogsIn(options.folder);
  if (files.empty()) {
    return absl::NotFoundError(absl::StrCat(options.folder, ": holds no reference episodes"));
  }
  for (const fs::path& file : files) {
    fs::remove_all(options.work_dir, error);
    fs::create_directory(options.work_dir, error);
    fs::permissions(options.work_dir, fs::perms::owner_all, error);
    const absl::StatusOr<ReplayRecord> record = PlayOne(file, options, stop);
    fs::remove_all(options.work_dir, error);
    const std::string name = file.filename();
    if (!record.ok()) {
      return absl::Status(record.status().code(),
                          absl::StrCat(name, ": ", record.status().message()));
    }
    if (record->equal) continue;
    return absl::StrCat("this host does not compute the states of the reference episode ", name,
                        " (", record->detail, "), so its results would not be those of others");
  }
  return std::string();
}

ReferenceCheck::ReferenceCheck(ReferenceOptions options)
    : options_(std::move(options)), thread_([this](const std::stop_token& stop) {
        const absl::StatusOr<std::string> verdict = PlayReference(options_, stop);
        if (!verdict.ok() && !stop.stop_requested()) {
          spdlog::warn("the reference episodes could not be played: {}",
                       std::string(verdict.status().message()));
        } else if (verdict.ok() && !verdict->empty()) {
          spdlog::error("no ranked submission is graded here: {}", *verdict);
        }
        const MutexLock lock(mutex_);
        verdict_ = verdict.ok() ? *verdict : "";
        known_.NotifyAll();
      }) {}

std::optional<std::string> ReferenceCheck::Result(std::string_view kind,
                                                  absl::Duration timeout) const {
  if (std::string why = WhyUnreferenced(options_.folder, kind); !why.empty()) return why;
  const auto deadline = std::chrono::steady_clock::now() + absl::ToChronoNanoseconds(timeout);
  const MutexLock lock(mutex_);
  while (!verdict_.has_value() && known_.WaitUntil(mutex_, deadline)) {
  }
  return verdict_;
}

}  // namespace myograde::server
