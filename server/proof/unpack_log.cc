#include "server/proof/unpack_log.h"

#include <archive.h>
#include <archive_entry.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <memory>

#include <absl/strings/str_cat.h>

#include "protocol/sha256.h"

namespace myograde::server {
namespace {

constexpr std::string_view kZstdMagic = "\x28\xb5\x2f\xfd";

absl::Status TooLarge() {
  return absl::DataLossError(absl::StrCat("the log is larger than ", kMaxLogBytes,
                                          " bytes, so it is no log of an episode"));
}

}  // namespace

absl::StatusOr<std::string> UnpackLog(std::string_view packed) {
  if (!packed.starts_with(kZstdMagic)) return std::string(packed);
  const std::unique_ptr<archive, int (*)(archive*)> reader(archive_read_new(), archive_read_free);
  archive_read_support_filter_zstd(reader.get());
  archive_read_support_format_raw(reader.get());
  archive_entry* entry = nullptr;
  const auto damaged = [&] {
    const char* why = archive_error_string(reader.get());
    return absl::DataLossError(absl::StrCat("the log can't be unpacked (",
                                            why == nullptr ? "no reason given" : why,
                                            "); the file was altered or damaged"));
  };
  if (archive_read_open_memory(reader.get(), packed.data(), packed.size()) != ARCHIVE_OK ||
      archive_read_next_header(reader.get(), &entry) != ARCHIVE_OK) {
    return damaged();
  }
  std::string log;
  std::string block(256 << 10, '\0');
  while (true) {
    const la_ssize_t n = archive_read_data(reader.get(), block.data(), block.size());
    if (n < 0) return damaged();
    if (n == 0) return log;
    log.append(block, 0, static_cast<size_t>(n));
    if (static_cast<int64_t>(log.size()) > kMaxLogBytes) return TooLarge();
  }
}

absl::StatusOr<std::string> ReadLog(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    return absl::NotFoundError(absl::StrCat(path, ": can't be opened: ", std::strerror(errno)));
  }
  std::string bytes;
  std::string block(256 << 10, '\0');
  while (file.read(block.data(), std::ssize(block)) || file.gcount() > 0) {
    bytes.append(block, 0, static_cast<size_t>(file.gcount()));
    if (static_cast<int64_t>(bytes.size()) > kMaxLogBytes) return TooLarge();
  }
  if (file.bad()) return absl::NotFoundError(absl::StrCat(path, ": can't be read"));
  return UnpackLog(bytes);
}

absl::StatusOr<std::string> UnpackLogOf(const std::string& sha256, std::string_view packed) {
  absl::StatusOr<std::string> log = UnpackLog(packed);
  if (log.ok() && Sha256Hex(*log) != sha256) {
    return absl::DataLossError(absl::StrCat("the log was altered: its SHA-256 is ",
                                            Sha256Hex(*log), ", its record says ", sha256));
  }
  return log;
}

}  // namespace myograde::server
