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

// How long a log that nobody asks for waits, so that the check does not take the processors from a
// daemon's start.
constexpr std::chrono::seconds kPause{5};

struct Reference {
  fs::path file;
  LogHeader header;

  std::string Kind() const { return std::string(header.track.kind->name); }
};

absl::StatusOr<Reference> ReadReference(const fs::path& file) {
  ASSIGN_OR_RETURN(const std::string bytes, ReadLog(file));
  ASSIGN_OR_RETURN(EpisodeLog log, ParseEpisodeLog(bytes));
  return Reference{file, std::move(log.header)};
}

absl::StatusOr<ReplayRecord> PlayOne(const Reference& reference, const ReferenceOptions& options,
                                     const std::stop_token& stop) {
  std::error_code error;
  fs::remove_all(options.work_dir, error);
  fs::create_directory(options.work_dir, error);
  fs::permissions(options.work_dir, fs::perms::owner_all, error);
  ReplayOrder order;
  order.track = reference.header.track;
  order.blocks = {{{{reference.header.episode, reference.header.seed, 0}}, {reference.file}}};
  order.work_dir = options.work_dir;
  order.cache_dir = options.cache_dir;
  order.uid_base = options.uid;
  const absl::StatusOr<std::vector<ReplayRecord>> records =
      RunReplay(order, {.stopped = [&] { return stop.stop_requested(); }});
  fs::remove_all(options.work_dir, error);
  RETURN_IF_ERROR(records.status());
  return records->front();
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

References::References(std::string folder) : folder_(std::move(folder)) {
  for (const fs::path& file : LogsIn(folder_)) {
    const absl::StatusOr<Reference> reference = ReadReference(file);
    if (reference.ok()) kinds_.insert(reference->Kind());
  }
}

std::string References::WhyLacking(std::string_view kind) const {
  if (kinds_.contains(kind)) return "";
  return absl::StrCat("no reference episode in ", folder_, " is of the environment ",
                      absl::string_view(kind.data(), kind.size()), ", so nothing shows that this host "
                      "computes it as others do; record one (configs/README.md)");
}

absl::StatusOr<std::string> PlayReference(const ReferenceOptions& options,
                                          const std::stop_token& stop,
                                          const ReferenceHooks& hooks) {
  std::vector<fs::path> files = LogsIn(options.folder);
  if (files.empty()) {
    return absl::NotFoundError(absl::StrCat(options.folder, ": holds no reference episodes"));
  }
  const auto named = [](const fs::path& file, const absl::Status& status) {
    return absl::Status(status.code(),
                        absl::StrCat(file.filename().string(), ": ", status.message()));
  };
  std::vector<Reference> left;
  for (const fs::path& file : files) {
    absl::StatusOr<Reference> reference = ReadReference(file);
    if (!reference.ok()) return named(file, reference.status());
    left.push_back(*std::move(reference));
  }
  while (!left.empty()) {
    const std::string wanted = hooks.next ? hooks.next() : "";
    const auto of = [&](const std::string& kind) {
      return std::find_if(left.begin(), left.end(),
                          [&](const Reference& each) { return each.Kind() == kind; });
    };
    const auto found = of(wanted);
    const auto chosen = found == left.end() ? left.begin() : found;
    const Reference reference = *chosen;
    left.erase(chosen);
    const absl::StatusOr<ReplayRecord> record = PlayOne(reference, options, stop);
    if (!record.ok()) return named(reference.file, record.status());
    if (!record->equal) {
      return absl::StrCat("this host does not compute the states of the reference episode ",
                          reference.file.filename().string(), " (", record->detail,
                          "), so its results would not be those of others");
    }
    if (hooks.matched && of(reference.Kind()) == left.end()) hooks.matched(reference.Kind());
  }
  return std::string();
}

ReferenceCheck::ReferenceCheck(ReferenceOptions options)
    : options_(std::move(options)),
      references_(options_.folder),
      thread_([this](const std::stop_token& stop) {
        const std::stop_callback wake(stop, [this] {
          const MutexLock lock(mutex_);
          changed_.NotifyAll();
        });
        const auto matched = [this](const std::string& kind) {
          const MutexLock lock(mutex_);
          asked_.erase(kind);
          matched_.insert(kind);
          changed_.NotifyAll();
        };
        const absl::StatusOr<std::string> verdict = PlayReference(
            options_, stop, {.next = [&] { return NextKind(stop); }, .matched = matched});
        if (!verdict.ok() && !stop.stop_requested()) {
          spdlog::warn("the reference episodes could not be played: {}",
                       std::string(verdict.status().message()));
        } else if (verdict.ok() && !verdict->empty()) {
          spdlog::error("no ranked submission is graded here: {}", *verdict);
        }
        const MutexLock lock(mutex_);
        verdict_ = verdict.ok() ? *verdict : "";
        changed_.NotifyAll();
      }) {}

std::string ReferenceCheck::NextKind(const std::stop_token& stop) {
  const auto deadline = std::chrono::steady_clock::now() + kPause;
  const MutexLock lock(mutex_);
  while (asked_.empty() && !stop.stop_requested() && changed_.WaitUntil(mutex_, deadline)) {
  }
  return asked_.empty() ? "" : *asked_.begin();
}

std::optional<std::string> ReferenceCheck::Result(std::string_view kind, absl::Duration timeout) {
  if (std::string why = references_.WhyLacking(kind); !why.empty()) return why;
  const auto deadline = std::chrono::steady_clock::now() + absl::ToChronoNanoseconds(timeout);
  const MutexLock lock(mutex_);
  if (matched_.find(kind) == matched_.end()) asked_.emplace(kind);
  changed_.NotifyAll();
  while (!verdict_.has_value() && matched_.find(kind) == matched_.end() &&
         changed_.WaitUntil(mutex_, deadline)) {
  }
  return verdict_.has_value() || matched_.find(kind) == matched_.end() ? verdict_ : "";
}

}  // namespace myograde::server
