#include "server/proof/reference_check.h"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <utility>

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

absl::StatusOr<LogHeader> ReadHeader(const std::string& file) {
  ASSIGN_OR_RETURN(const std::string bytes, ReadLog(file));
  ASSIGN_OR_RETURN(EpisodeLog log, ParseEpisodeLog(bytes));
  return std::move(log.header);
}

absl::StatusOr<ReplayRecord> PlayOne(const std::string& file, const LogHeader& header,
                                     const ReferenceOptions& options, const std::stop_token& stop) {
  std::error_code error;
  fs::remove_all(options.work_dir, error);
  fs::create_directory(options.work_dir, error);
  fs::permissions(options.work_dir, fs::perms::owner_all, error);
  ReplayOrder order;
  order.track = header.track;
  order.blocks = {{{{header.episode, header.seed, 0}}, {file}}};
  order.work_dir = options.work_dir;
  order.cache_dir = options.cache_dir;
  order.uid_base = options.uid;
  const absl::StatusOr<std::vector<ReplayRecord>> records =
      RunReplay(order, {.stopped = [&] { return stop.stop_requested(); }});
  fs::remove_all(options.work_dir, error);
  RETURN_IF_ERROR(records.status());
  return records->front();
}

}  // namespace

References::References(std::string folder) : folder_(std::move(folder)) {
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_, error)) {
    if (entry.path().extension() != ".zst") continue;
    const std::string file = fs::absolute(entry.path());
    logs_.push_back({file, ReadHeader(file)});
  }
  std::ranges::sort(logs_, {}, &Log::file);
}

std::string References::WhyLacking(std::string_view kind) const {
  if (std::ranges::any_of(logs_, [&](const Log& log) { return log.IsOf(kind); })) return "";
  return absl::StrCat("no reference episode in ", folder_, " is of the environment ",
                      absl::string_view(kind.data(), kind.size()), ", so nothing shows that this host "
                      "computes it as others do; record one (configs/README.md)");
}

absl::StatusOr<std::string> References::Play(const ReferenceOptions& options,
                                             const std::stop_token& stop,
                                             const ReferenceHooks& hooks) const {
  if (logs_.empty()) {
    return absl::NotFoundError(absl::StrCat(folder_, ": holds no reference episodes"));
  }
  const auto named = [](const Log& log, const absl::Status& status) {
    return absl::Status(status.code(), absl::StrCat(fs::path(log.file).filename().string(), ": ",
                                                    status.message()));
  };
  for (const Log& log : logs_) {
    if (!log.header.ok()) return named(log, log.header.status());
  }
  std::vector<const Log*> left;
  for (const Log& log : logs_) left.push_back(&log);
  while (!left.empty()) {
    const auto of = [&](std::string_view kind) {
      return std::ranges::find_if(left, [&](const Log* each) { return each->IsOf(kind); });
    };
    const auto wanted = of(hooks.next ? hooks.next() : "");
    const auto chosen = wanted == left.end() ? left.begin() : wanted;
    const Log& log = **chosen;
    left.erase(chosen);
    const absl::StatusOr<ReplayRecord> record = PlayOne(log.file, *log.header, options, stop);
    if (!record.ok()) return named(log, record.status());
    if (!record->equal) {
      return absl::StrCat("this host does not compute the states of the reference episode ",
                          fs::path(log.file).filename().string(), " (", record->detail,
                          "), so its results would not be those of others");
    }
    const std::string kind(log.header->track.kind->name);
    if (hooks.matched && of(kind) == left.end()) hooks.matched(kind);
  }
  return std::string();
}

ReferenceCheck::ReferenceCheck(std::string folder, ReferenceOptions options)
    : options_(std::move(options)),
      references_(std::move(folder)),
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
        const absl::StatusOr<std::string> verdict = references_.Play(
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
