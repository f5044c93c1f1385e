#include "server/runtime/tree.h"

#include <filesystem>
#include <system_error>

#include <absl/strings/str_cat.h>

#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/listing.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr ArtefactLimits kAny = {.bytes = int64_t{1} << 50,
                                 .files = int64_t{1} << 40,
                                 .depth = 4096,
                                 .name_bytes = 255};

absl::Status Unreadable(const fs::path& path, const std::string& why) {
  return absl::InternalError(absl::StrCat(path.string(), ": can't be read: ", why));
}

absl::Status AddEntry(const fs::directory_entry& found, const std::string& path, Listing& listing) {
  std::error_code error;
  const fs::file_status status = found.symlink_status(error);
  const EntryType type = fs::is_symlink(status)     ? EntryType::kLink
                         : fs::is_directory(status) ? EntryType::kFolder
                                                    : EntryType::kFile;
  if (type == EntryType::kFile && !fs::is_regular_file(status)) {
    return Unreadable(found.path(), "it is no file, folder or link");
  }
  const absl::StatusOr<Entry*> entry = listing.Add(path, type);
  if (!entry.ok()) return Unreadable(found.path(), std::string(entry.status().message()));
  if (type == EntryType::kLink) {
    (*entry)->target = fs::read_symlink(found.path(), error).string();
  } else if (type == EntryType::kFile) {
    absl::StatusOr<std::string> sha256 = Sha256File(found.path());
    if (!sha256.ok()) return Unreadable(found.path(), std::string(sha256.status().message()));
    (*entry)->sha256 = *std::move(sha256);
    (*entry)->executable = (status.permissions() & fs::perms::owner_exec) != fs::perms::none;
    (*entry)->size = static_cast<int64_t>(found.file_size(error));
    if (!error) return listing.AddBytes(path, (*entry)->size);
  }
  return error ? Unreadable(found.path(), error.message()) : absl::OkStatus();
}

}  // namespace

absl::StatusOr<RuntimeTree> ReadRuntimeTree(const std::string& folder) {
  Listing listing(kAny);
  std::error_code error;
  fs::recursive_directory_iterator found(folder, error);
  for (; !error && found != fs::recursive_directory_iterator(); found.increment(error)) {
    const std::string path = found->path().lexically_relative(folder).string();
    if (path == kRuntimeFile) continue;
    RETURN_IF_ERROR(AddEntry(*found, path, listing));
  }
  if (error) return Unreadable(folder, error.message());
  return RuntimeTree{listing.Digest(), listing.bytes(), std::ssize(listing.entries())};
}

absl::Status CheckRuntime(const Runtime& runtime) {
  if (runtime.digest.empty()) return absl::OkStatus();
  ASSIGN_OR_RETURN(const RuntimeTree tree, ReadRuntimeTree(runtime.folder));
  if (tree.digest == runtime.digest) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat(
      runtime.folder, ": was changed: its files have the digest ", tree.digest.substr(0, 12),
      ", and it was made with ", runtime.digest.substr(0, 12)));
}

}  // namespace myograde::server
