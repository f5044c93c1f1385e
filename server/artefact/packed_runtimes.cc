#include <archive.h>
#include <archive_entry.h>

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "server/artefact/artefact.h"
#include "server/artefact/listing.h"

namespace myograde::server {
namespace {

constexpr size_t kBlock = 64 << 10;
constexpr int64_t kLargestManifest = 1 << 20;

absl::Status NoRuntimes(archive* reader) {
  const char* why = archive_error_string(reader);
  return absl::InternalError(
      absl::StrCat("the archive can't be read back: ", why != nullptr ? why : "no reason given"));
}

}  // namespace

absl::StatusOr<std::vector<std::string>> PackedRuntimes(const std::string& archive) {
  const Utf8Names utf8_names;
  const std::unique_ptr<struct archive, ArchiveReader> reader(archive_read_new());
  archive_read_support_format_tar(reader.get());
  if (archive_read_open_filename(reader.get(), archive.c_str(), kBlock) != ARCHIVE_OK) {
    return NoRuntimes(reader.get());
  }
  archive_entry* entry = nullptr;
  int result = ARCHIVE_OK;
  while ((result = archive_read_next_header(reader.get(), &entry)) == ARCHIVE_OK) {
    const char* path = archive_entry_pathname(entry);
    if (path == nullptr || std::string_view(path) != "policy.json") continue;
    const int64_t size = archive_entry_size(entry);
    if (size > kLargestManifest) return absl::InvalidArgumentError("policy.json is too large");
    std::string text(static_cast<size_t>(size), '\0');
    if (archive_read_data(reader.get(), text.data(), text.size()) != size) {
      return NoRuntimes(reader.get());
    }
    const absl::StatusOr<nlohmann::json> json = ParseJson(text, "policy.json");
    if (!json.ok()) return json.status();
    ConfigReader manifest(*json, "policy.json");
    if (!manifest.Has("runtimes")) return std::vector<std::string>();
    std::vector<std::string> runtimes = manifest.Strings("runtimes");
    if (!manifest.mistake().ok()) return manifest.mistake();
    return runtimes;
  }
  if (result != ARCHIVE_EOF) return NoRuntimes(reader.get());
  return absl::NotFoundError("the archive has no policy.json at its top");
}

}  // namespace myograde::server
