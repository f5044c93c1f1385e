#include "server/store/home.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <memory>

#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/base/this_host.h"
#include "server/store/connection.h"

namespace myograde::server {

// Device numbers and the host's name are left out, as a restart may change them.
absl::StatusOr<DataHome> HomeOf(const std::string& dir) {
  struct statx info = {};
  if (statx(AT_FDCWD, dir.c_str(), 0, STATX_INO | STATX_BTIME, &info) != 0) {
    return absl::UnavailableError(absl::StrCat(dir, ": can't be examined"));
  }
  const std::string machine = ReadFile("/etc/machine-id").value_or("");  // none in most containers
  const bool dated = (info.stx_mask & STATX_BTIME) != 0;
  const std::string born =
      dated ? absl::StrCat(info.stx_btime.tv_sec, ".", info.stx_btime.tv_nsec) : "";
  return DataHome{Sha256Hex(absl::StrCat("a data folder\n", machine, "\n", info.stx_ino, "\n", born)),
                  absl::StrCat(dir, " on host ", HostName())};
}

absl::StatusOr<std::optional<DataHome>> RecordedHome(const std::string& store) {
  std::optional<DataHome> home;
  RETURN_IF_ERROR(GuardSqlite(store, [&]() -> absl::Status {
    ASSIGN_OR_RETURN(const auto db, OpenForReading(store));
    SQLite::Statement select(*db, "SELECT CAST(value AS TEXT) FROM meta WHERE key = 'home'");
    if (!select.executeStep()) return absl::OkStatus();
    const std::string text = select.getColumn(0).getString();
    const size_t key = text.find('\n');
    home = {text.substr(0, key), key == std::string::npos ? "" : text.substr(key + 1)};
    return absl::OkStatus();
  }));
  return home;
}

absl::Status RecordHome(const std::string& store, const DataHome& home) {
  return GuardSqlite(store, [&]() -> absl::Status {
    ASSIGN_OR_RETURN(const OpenedStore opened, OpenForWriting(store));
    SQLite::Statement set(*opened.db, "INSERT INTO meta VALUES ('home', ?) ON CONFLICT (key) "
                                       "DO UPDATE SET value = excluded.value");
    const std::string text = absl::StrCat(home.key, "\n", home.place);
    set.bind(1, text.data(), static_cast<int>(text.size()));
    set.exec();
    return absl::OkStatus();
  });
}

}  // namespace myograde::server
