#include "server/proof/release.h"

#include <algorithm>
#include <filesystem>
#include <map>
#include <string_view>
#include <system_error>

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kFirstLine = "# myograde release ";
constexpr size_t kMostSums = size_t{4} << 20;
constexpr size_t kMostSignature = 64;
constexpr size_t kLongestName = 64;
constexpr size_t kHashDigits = 64;

bool IsPrintable(std::string_view text) {
  return std::all_of(text.begin(), text.end(),
                     [](unsigned char byte) { return byte >= 0x20 && byte < 0x7f; });
}

// Sums list such a name as it is, without marks.
bool IsPlain(std::string_view path) {
  return std::none_of(path.begin(), path.end(), [](unsigned char byte) {
    return byte < 0x20 || byte == 0x7f || byte == '\\';
  });
}

absl::Status CantRead(const std::string& folder, const std::error_code& error) {
  return absl::InvalidArgumentError(
      absl::StrCat(folder, ": can't be read: ", error.message(), "; name the release's folder"));
}

// The files in and below a folder, by their paths in it; true: something else than a regular file.
absl::StatusOr<std::map<std::string, bool>> ListFiles(const std::string& folder) {
  std::map<std::string, bool> files;
  std::error_code error;
  fs::recursive_directory_iterator entries(folder, error);
  for (; !error && entries != fs::recursive_directory_iterator(); entries.increment(error)) {
    const fs::file_status status = entries->symlink_status(error);
    if (error) break;
    if (fs::is_directory(status)) continue;
    const std::string path = entries->path().lexically_relative(folder).string();
    if (path != kReleaseSums && path != kReleaseSignature) {
      files[path] = !fs::is_regular_file(status);
    }
  }
  if (error) return CantRead(folder, error);
  return files;
}

// Path -> SHA-256, of a text whose signature is valid. DataLossError: it is in no form that
// SignRelease writes.
absl::StatusOr<std::map<std::string, std::string>> ListedFiles(const std::string& sums) {
  std::map<std::string, std::string> files;
  const std::vector<std::string> lines = absl::StrSplit(sums, '\n');
  if (!lines.back().empty()) return absl::DataLossError("its last line has no end");
  for (size_t i = 1; i + 1 < lines.size(); ++i) {
    const std::string& line = lines[i];
    if (line.size() <= kHashDigits + 2 || line.compare(kHashDigits, 2, "  ") != 0) {
      return absl::DataLossError(absl::StrCat("line ", i + 1, " is none of a file"));
    }
    files[line.substr(kHashDigits + 2)] = line.substr(0, kHashDigits);
  }
  return files;
}

}  // namespace

absl::StatusOr<SignedRelease> SignRelease(const std::string& folder, const std::string& name,
                                          const SigningKey& key) {
  if (name.empty() || name.size() > kLongestName || !IsPrintable(name)) {
    return absl::InvalidArgumentError(
        "a release's name has 1 to 64 printable characters of ASCII");
  }
  ASSIGN_OR_RETURN(const auto files, ListFiles(folder));
  if (files.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(folder, ": has no file to sign"));
  }
  SignedRelease release;
  release.sums = absl::StrCat(std::string(kFirstLine), name, "\n");
  for (const auto& [path, special] : files) {
    if (special) {
      return absl::InvalidArgumentError(absl::StrCat(
          folder, "/", path, ": is not a regular file; a release holds files and folders only"));
    }
    if (!IsPlain(path)) {
      return absl::InvalidArgumentError(absl::StrCat(
          folder, "/", path, ": has a control character or a backslash in its name; rename it"));
    }
    ASSIGN_OR_RETURN(const std::string hash, Sha256File((fs::path(folder) / path).string()));
    absl::StrAppend(&release.sums, hash, "  ", path, "\n");
  }
  if (release.sums.size() > kMostSums) {
    return absl::InvalidArgumentError(absl::StrCat(
        folder, ": has more files than a release can list; pack them into archives"));
  }
  ASSIGN_OR_RETURN(const std::string signature, key.Sign(release.sums));
  release.signature = absl::HexStringToBytes(signature);
  release.files = std::ssize(files);
  return release;
}

absl::StatusOr<ReleaseCheck> CheckRelease(const std::string& folder, const PublicKey& key) {
  ASSIGN_OR_RETURN(const std::string sums,
                   ReadFile((fs::path(folder) / kReleaseSums).string(), kMostSums));
  ASSIGN_OR_RETURN(const std::string signature,
                   ReadFile((fs::path(folder) / kReleaseSignature).string(), kMostSignature));
  ReleaseCheck check;
  if (!sums.starts_with(kFirstLine) || !key.Verify(sums, absl::BytesToHexString(signature))) {
    check.wrong.push_back(absl::StrCat(kReleaseSums, " was not signed with this key"));
    return check;
  }
  ASSIGN_OR_RETURN(const auto listed, ListedFiles(sums));
  ASSIGN_OR_RETURN(const auto files, ListFiles(folder));
  check.name = sums.substr(kFirstLine.size(), sums.find('\n') - kFirstLine.size());
  check.files = std::ssize(listed);
  for (const auto& [path, hash] : listed) {
    const auto found = files.find(path);
    if (found == files.end()) {
      check.wrong.push_back(absl::StrCat(path, " is missing"));
      continue;
    }
    const absl::StatusOr<std::string> now =
        found->second ? absl::InvalidArgumentError("is not a regular file")
                      : Sha256File((fs::path(folder) / path).string());
    if (!now.ok()) {
      check.wrong.push_back(absl::StrCat(path, " can't be read or is not a regular file"));
    } else if (*now != hash) {
      check.wrong.push_back(absl::StrCat(path, " is not the file that was signed"));
    }
  }
  for (const auto& [path, special] : files) {
    if (!listed.contains(path)) {
      check.wrong.push_back(absl::StrCat(path, " is not a file of the release"));
    }
  }
  return check;
}

}  // namespace myograde::server
