#include "server/engine/retention.h"

#include <sys/stat.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <tuple>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/status_macros.h"
#include "server/artefact/share_files.h"
#include "server/engine/stored.h"
#include "server/metrics/disk_space.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr absl::Duration kChange = absl::Seconds(30);
constexpr absl::Duration kLatestFirstSweep = absl::Minutes(10);
constexpr absl::Duration kDenialsKept = absl::Hours(24 * 30);
constexpr absl::Duration kDiskLook = absl::Seconds(2);
constexpr size_t kHashDigits = 64;
// The row that names a log is written after its file.
constexpr int64_t kFreshMs = 10 * 60 * 1000;

int64_t ToMs(const timespec& time) {
  return static_cast<int64_t>(time.tv_sec) * 1000 + time.tv_nsec / 1'000'000;
}

// When the entry got its current name and content: a renamed folder counts as new.
int64_t ChangedAt(const fs::path& path) {
  struct stat info;
  return lstat(path.c_str(), &info) == 0 ? ToMs(info.st_ctim) : INT64_MAX;
}

}  // namespace

std::vector<KeptFile> ChooseRemovals(std::vector<KeptFile> files, absl::Duration age, int64_t bytes,
                                     int64_t now_ms) {
  std::sort(files.begin(), files.end(), [](const KeptFile& a, const KeptFile& b) {
    return std::tie(a.last_use, a.name) < std::tie(b.last_use, b.name);
  });
  int64_t sum = 0;
  for (const KeptFile& file : files) sum += file.bytes;
  size_t may_age_out = std::max(kFewestAgedOut, files.size() / 10);
  std::vector<KeptFile> choices;
  for (KeptFile& file : files) {
    if (file.needed) continue;
    const absl::Duration unused = absl::Milliseconds(now_ms - file.last_use);
    if (unused > age && may_age_out > 0) {
      --may_age_out;
      file.why = absl::StrCat("unused for ", absl::ToInt64Hours(unused) / 24,
                              " days; the limit is ",
                              absl::ToInt64Hours(age) / 24);
    } else if (sum > bytes) {
      file.why = absl::StrCat("all of them had ", sum, " bytes; the limit is ", bytes);
    } else {
      continue;
    }
    sum -= file.bytes;
    choices.push_back(std::move(file));
  }
  return choices;
}

TrustedTime::TrustedTime(std::optional<absl::Time> before, const Clock& clock)
    : clock_(clock),
      began_(clock.Monotonic()),
      at_began_(before ? std::min(clock.Now(), *before + kLongestPause) : clock.Now()) {
  if (!before.has_value() || clock.Now() <= *before + kLongestPause) return;
  spdlog::warn("the clock is {} days ahead of this store's last use; if it is wrong, set it. For "
               "the next {} days of running, retention counts ages from {}",
               absl::ToInt64Hours(clock.Now() - *before) / 24, absl::ToInt64Hours(kDoubt) / 24,
               absl::FormatTime("%Y-%m-%d", at_began_, absl::UTCTimeZone()));
}

absl::Time TrustedTime::Now() const {
  const absl::Duration running = clock_.Monotonic() - began_;
  return running >= kDoubt ? clock_.Now() : std::min(clock_.Now(), at_began_ + running);
}

Retention::Retention(RetentionLimits limits, int64_t disk_reserve, std::string data_dir,
                     Engine& engine, ReaderPool& readers, const Clock& clock,
                     std::optional<absl::Time> before)
    : limits_(limits),
      disk_reserve_(disk_reserve),
      data_dir_(std::move(data_dir)),
      engine_(engine),
      readers_(readers),
      clock_(clock),
      time_(before, clock),
      thread_([this](std::stop_token stop) {
        stop_ = std::move(stop);
        Loop();
      }) {}

void Retention::Loop() {
  NoteTime();
  absl::Duration wait = std::min(limits_.every, kLatestFirstSweep);
  for (; !WaitForSweep(wait); wait = limits_.every) Sweep();
}

bool Retention::WaitForSweep(absl::Duration wait) {
  const Deadline deadline(wait);
  while (!WaitForStop(stop_, std::min(kDiskLook, deadline.left()))) {
    if (deadline.over()) return false;
    MakeRoom();
  }
  return true;
}

void Retention::MakeRoom() {
  const std::optional<DiskSpace> disk = DiskSpaceAt(data_dir_);
  if (!disk.has_value() || disk->free >= disk_reserve_) return;
  std::vector<KeptFile> logs = Logs();
  using Hashes = std::set<std::string>;
  const absl::StatusOr<Hashes> practice = readers_.Read<Hashes>(
      [](const Transaction& reader) { return reader.episodes.PracticeLogs(); });
  if (!practice.ok()) {
    spdlog::warn("room for the disk's reserve: {}", std::string(practice.status().message()));
    return;
  }
  std::erase_if(logs, [&](const KeptFile& log) { return !practice->contains(log.name); });
  int64_t sum = 0;
  for (const KeptFile& log : logs) sum += log.bytes;
  // A little more, so that not every episode begins this again.
  const int64_t wanted = disk_reserve_ - disk->free + disk_reserve_ / 8;
  std::vector<KeptFile> choices =
      ChooseRemovals(std::move(logs), absl::InfiniteDuration(), std::max<int64_t>(sum - wanted, 0),
                     absl::ToUnixMillis(clock_.Now()));
  for (KeptFile& choice : choices) {
    choice.why = absl::StrCat("the disk had ", disk->free, " bytes free; its reserve is ",
                              disk_reserve_);
  }
  Remove(kPracticeLogKind, choices);
}

void Retention::Write(const char* what, const std::function<void(Transaction&)>& change) {
  const absl::Status status = engine_.Change(
      [change](Transaction& writer) {
        change(writer);
        return absl::OkStatus();
      },
      kChange);
  if (!status.ok()) spdlog::warn("{}: {}", what, std::string(status.message()));
}

void Retention::NoteTime() {
  Write("the time of the store's last use", [now = absl::ToUnixMillis(time_.Now())](
                                           Transaction& writer) { writer.SetTrustedTime(now); });
}

void Retention::Sweep() {
  MakeRoom();
  NoteTime();
  const int64_t now = absl::ToUnixMillis(time_.Now());
  Write("retention of denials", [before = now - absl::ToInt64Milliseconds(kDenialsKept)](
                                    Transaction& writer) { writer.callers.RemoveDenials(before); });
  const auto look = [&](const char* kind, absl::StatusOr<std::vector<KeptFile>> files,
                        absl::Duration age, int64_t bytes) {
    if (!files.ok()) {
      spdlog::warn("retention of {}s: {}", kind, std::string(files.status().message()));
      return;
    }
    int64_t kept = 0;
    for (const KeptFile& file : *files) kept += file.bytes;
    const std::vector<KeptFile> choices = ChooseRemovals(*std::move(files), age, bytes, now);
    for (const KeptFile& choice : choices) kept -= choice.bytes;
    Remove(kind, choices);
    engine_.metrics().SetKept(kind, kept, clock_.Now());
  };
  absl::StatusOr<std::vector<KeptFile>> unsubmitted = Unsubmitted(now);
  if (unsubmitted.ok()) {
    Remove(kUploadKind, *unsubmitted);
  } else {
    spdlog::warn("retention of uploads: {}", std::string(unsubmitted.status().message()));
  }
  look("artefact", Artefacts(), limits_.artefact_age, limits_.artefact_bytes);
  const int64_t freed = SweepPool(SharedFolder(data_dir_));
  if (freed > 0) spdlog::info("removed {} bytes that images had shared", freed);
  absl::StatusOr<std::vector<KeptFile>> logs = Logs();  // `needed` is unset
  // Which logs are needed is in every episode's row, so don't ask while there is room for all.
  if (!ChooseRemovals(*logs, limits_.log_age, limits_.log_bytes, now).empty()) {
    logs = WithNeeded(*std::move(logs));
  }
  look("log", std::move(logs), limits_.log_age, limits_.log_bytes);
}

absl::StatusOr<std::vector<KeptFile>> Retention::Unsubmitted(int64_t now_ms) {
  using Uploads = std::vector<ArtefactUse>;
  ASSIGN_OR_RETURN(const Uploads uploads, readers_.Read<Uploads>([](const Transaction& reader) {
    return reader.content.Uploads();
  }));
  std::vector<KeptFile> choices;
  for (const ArtefactUse& upload : uploads) {
    if (absl::Milliseconds(now_ms - upload.last_use) <= limits_.upload_age ||
        choices.size() == kFewestAgedOut) {
      break;
    }
    choices.push_back(
        {upload.hash, ArtefactFolder(data_dir_, upload.hash), upload.bytes,
         upload.last_use, /*needed=*/false,
         absl::StrCat("was not submitted within ", absl::FormatDuration(limits_.upload_age))});
  }
  return choices;
}

absl::StatusOr<std::vector<KeptFile>> Retention::Artefacts() {
  using Uses = std::vector<ArtefactUse>;
  ASSIGN_OR_RETURN(const Uses uses, readers_.Read<Uses>([](const Transaction& reader) {
    return reader.content.ArtefactUses();
  }));
  std::vector<KeptFile> files;
  for (const ArtefactUse& use : uses) {
    KeptFile file{use.hash, ArtefactFolder(data_dir_, use.hash), use.bytes, use.last_use,
                  use.needed};
    std::error_code error;
    if (!fs::exists(file.path, error)) continue;
    file.last_use = std::max(file.last_use, ChangedAt(file.path));
    // What it shares with others would be counted for each of them.
    if (fs::exists(absl::StrCat(file.path, "/", kImageFolder), error)) {
      file.bytes = DiskBytes(file.path);
    }
    files.push_back(std::move(file));
  }
  return files;
}

std::vector<KeptFile> Retention::Logs() {
  std::vector<KeptFile> files;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(data_dir_ + "/logs", error)) {
    const std::string name = entry.path().filename().string();
    // Others are logs still being written.
    if (name.size() <= kHashDigits || name[kHashDigits] != '.') continue;
    std::error_code gone;
    const auto bytes = static_cast<int64_t>(entry.file_size(gone));
    if (gone) continue;
    files.push_back({name.substr(0, kHashDigits), entry.path().string(), bytes,
                     ChangedAt(entry.path()), /*needed=*/false});
  }
  return files;
}

absl::StatusOr<std::vector<KeptFile>> Retention::WithNeeded(std::vector<KeptFile> files) {
  using Hashes = std::set<std::string>;
  ASSIGN_OR_RETURN(const Hashes needed, readers_.Read<Hashes>([](const Transaction& reader) {
    return reader.episodes.NeededLogs();
  }));
  const int64_t old = absl::ToUnixMillis(time_.Now()) - kFreshMs;
  for (KeptFile& file : files) {
    file.needed = needed.contains(file.name) || file.last_use > old;
  }
  return files;
}

// Removes row and file together, on the engine's thread, and only if the file is still not needed:
// a submission accepted before keeps the file, and a later one finds it gone. If the row can't be
// written after all, the file comes back.
void Retention::Remove(const std::string& kind, const std::vector<KeptFile>& files) {
  for (const KeptFile& file : files) {
    if (stop_.stop_requested()) return;
    const std::string& from = file.path;
    const std::string to = absl::StrCat(data_dir_, "/spool/removed-", file.name);
    const absl::StatusOr<bool> removed = engine_.Change<bool>(
        [=](Transaction& writer) -> absl::StatusOr<bool> {
          ASSIGN_OR_RETURN(const bool unneeded,
                           writer.content.Remove(kind, file.name, file.bytes, file.why));
          if (unneeded && rename(from.c_str(), to.c_str()) != 0 && errno != ENOENT) {
            return absl::InternalError(
                absl::StrCat(from, ": can't be removed: ", std::strerror(errno)));
          }
          return unneeded;
        },
        kChange);
    if (!removed.ok()) {
      rename(to.c_str(), from.c_str());  // if it was moved at all
      spdlog::warn("retention: {}", std::string(removed.status().message()));
      return;
    }
    std::error_code error;
    fs::remove_all(to, error);
    if (!*removed) continue;
    engine_.metrics().CountRemoved(kind == kPracticeLogKind ? "log" : kind, file.bytes);
    spdlog::info("removed {} {}: {}", kind, file.name, file.why);
  }
}

}  // namespace myograde::server
