#include "server/cli/base/files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>

#include <absl/strings/ascii.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/track_config.h"

namespace myograde::server {
namespace {

constexpr size_t kMaxSeedFileBytes = 1 << 20;

bool IsNoFile(const std::string& path) {
  struct stat info;
  return stat(path.c_str(), &info) == 0 && !S_ISREG(info.st_mode) && !S_ISDIR(info.st_mode);
}

}  // namespace

absl::Status CantWrite(const std::string& path) {
  return absl::InvalidArgumentError(absl::StrCat(
      path, ": can't be written: ", std::strerror(errno), "; choose another place or make room"));
}

NewFile::NewFile(std::string path, mode_t mode)
    : path_(std::move(path)), in_place_(IsNoFile(path_)), part_(path_ + ".part") {
  if (in_place_) {
    fd_ = Fd(open(path_.c_str(), O_WRONLY | O_CLOEXEC));
  } else {
    // One that an earlier run left, or that another user has put there to read along.
    unlink(part_.c_str());
    fd_ = Fd(open(part_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, mode));
  }
  if (!fd_.valid()) status_ = CantWrite(path_);
}

NewFile::~NewFile() {
  if (fd_.valid() && !in_place_) unlink(part_.c_str());
}

absl::Status NewFile::Write(std::string_view text) {
  hash_.Update(text);
  while (status_.ok() && !text.empty()) {
    const ssize_t n = write(fd_.get(), text.data(), text.size());
    if (n >= 0) {
      text.remove_prefix(static_cast<size_t>(n));
    } else if (errno != EINTR) {
      status_ = CantWrite(path_);
    }
  }
  return status_;
}

absl::StatusOr<std::string> NewFile::Keep() {
  if (!in_place_ && (fsync(fd_.get()) != 0 || rename(part_.c_str(), path_.c_str()) != 0)) {
    return CantWrite(path_);
  }
  fd_.reset();
  return hash_.FinishHex();
}

absl::StatusOr<std::string> WriteNewFile(const std::string& path, std::string_view content,
                                         mode_t mode) {
  NewFile file(path, mode);
  RETURN_IF_ERROR(file.Write(content));
  return file.Keep();
}

absl::Status MakeFolders(const std::string& folder, const std::string& todo) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (!error) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(folder, ": can't be created: ", error.message(), todo));
}

absl::Status MakeEmptyFolder(const std::string& folder, const std::string& todo) {
  RETURN_IF_ERROR(MakeFolders(folder, todo));
  std::error_code error;
  const bool empty = std::filesystem::is_empty(folder, error);
  if (empty && !error) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(folder, ": is not empty", error ? ", or can't be read" : "", todo));
}

absl::StatusOr<std::vector<uint64_t>> ReadSeeds(const std::string& path) {
  ASSIGN_OR_RETURN(const std::string text, ReadFile(path, kMaxSeedFileBytes));
  const absl::string_view content = absl::StripLeadingAsciiWhitespace(text);
  if (!content.empty() && (content[0] == '[' || content[0] == '{')) {
    ASSIGN_OR_RETURN(const nlohmann::json json, ParseJson(text, path));
    return ParseSeeds(json, path);
  }
  std::vector<uint64_t> seeds;
  int number = 0;
  for (absl::string_view line : absl::StrSplit(text, '\n')) {
    ++number;
    line = absl::StripAsciiWhitespace(line.substr(0, line.find('#')));
    if (line.empty()) continue;
    if (!absl::ascii_isdigit(static_cast<unsigned char>(line[0])) ||
        !absl::SimpleAtoi(line, &seeds.emplace_back())) {
      return absl::InvalidArgumentError(
          absl::StrCat(path, ": line ", number,
                       " is not a seed; write one whole number from 0 to 2^63-1 on each line"));
    }
  }
  return ParseSeeds(nlohmann::json(seeds), path);
}

}  // namespace myograde::server
