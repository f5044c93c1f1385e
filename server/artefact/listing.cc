#include "server/artefact/listing.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <functional>

#include <absl/strings/ascii.h>
#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

absl::Status Broken(std::string_view path, absl::string_view rule) {
  return absl::InvalidArgumentError(absl::StrCat("the entry ", Quoted(path), " ", rule));
}

bool HasControlCharacter(std::string_view text) {
  return std::ranges::any_of(text, absl::ascii_iscntrl);
}

}  // namespace

std::string Quoted(std::string_view path) {
  constexpr size_t kShown = 120;
  std::string shown(path.substr(0, kShown));
  std::ranges::replace_if(shown, std::not_fn(absl::ascii_isprint), '?');
  return absl::StrCat("\"", shown, path.size() > kShown ? "..." : "", "\"");
}

absl::Status HostError(std::string_view what) {
  const int error = errno;
  const std::string message =
      absl::StrCat(absl::string_view(what.data(), what.size()), ": ", std::strerror(error));
  if (error == ENOSPC || error == EDQUOT) return absl::ResourceExhaustedError(message);
  if (error == ENAMETOOLONG) return absl::InvalidArgumentError(message);
  return absl::UnavailableError(message);
}

absl::StatusOr<std::string> Listing::CleanPath(std::string_view path) const {
  if (path.starts_with('/')) return Broken(path, "has an absolute path; paths must be relative");
  if (HasControlCharacter(path)) return Broken(path, "has a control character in its name");
  if (!IsUtf8(path)) return Broken(path, "has a name that is not UTF-8");
  std::string clean;
  int64_t depth = 0;
  while (!path.empty()) {
    const size_t slash = path.find('/');
    const std::string_view name = path.substr(0, slash);
    path = slash == std::string_view::npos ? "" : path.substr(slash + 1);
    if (name.empty() || name == ".") continue;
    if (name == "..") return Broken(clean + "/..", "has \"..\" in its path, which is not allowed");
    if (static_cast<int64_t>(name.size()) > limits_.name_bytes) {
      return Broken(name, absl::StrCat("has a name of ", name.size(), " bytes; at most ",
                                       limits_.name_bytes, " are allowed"));
    }
    if (++depth > limits_.depth) {
      return Broken(clean, absl::StrCat("lies deeper than ", limits_.depth, " folders"));
    }
    if (!clean.empty()) clean += '/';
    clean += name;
  }
  return clean;
}

absl::StatusOr<Entry*> Listing::Add(const std::string& path, EntryType type) {
  for (size_t slash = path.find('/'); slash != std::string::npos;
       slash = path.find('/', slash + 1)) {
    const std::string above = path.substr(0, slash);
    const auto [it, added] = entries_.try_emplace(above, Entry{.type = EntryType::kFolder});
    if (it->second.type != EntryType::kFolder) {
      return Broken(path, absl::StrCat("lies below ", Quoted(above), ", which is not a folder"));
    }
  }
  const auto [it, added] = entries_.try_emplace(path, Entry{.type = type});
  Entry& entry = it->second;
  const bool implied_folder = entry.type == EntryType::kFolder && type == EntryType::kFolder;
  if (!added && (entry.stated || !implied_folder)) return Broken(path, "appears twice");
  entry.stated = true;
  if (static_cast<int64_t>(entries_.size()) > limits_.files) {
    return TooManyEntries(path);
  }
  return &entry;
}

absl::Status Listing::TooManyEntries(std::string_view where) const {
  return absl::InvalidArgumentError(
      absl::StrCat("there are more than ", limits_.files, " files, folders and links (at ",
                   Quoted(where), "); leave out what the policy does not need"));
}

absl::Status Listing::CheckRoom(const std::string& path, int64_t bytes) const {
  if (bytes < 0 || bytes > limits_.bytes - bytes_) {
    return absl::InvalidArgumentError(
        absl::StrCat("the files together are larger than ", limits_.bytes, " bytes unpacked (at ",
                     Quoted(path), "); leave out what the policy does not need"));
  }
  return absl::OkStatus();
}

absl::Status Listing::AddBytes(const std::string& path, int64_t bytes) {
  const absl::Status fits = CheckRoom(path, bytes);
  if (fits.ok()) bytes_ += bytes;
  return fits;
}

std::string Listing::Digest() const {
  Sha256 hash;
  hash.Update(std::string_view("myograde artefact 1\n"));
  for (const auto& [path, entry] : entries_) {
    nlohmann::json line = {{"path", path}, {"type", "folder"}};
    if (entry.type == EntryType::kFile) {
      line.update({{"type", "file"}, {"executable", entry.executable}, {"size", entry.size},
                   {"sha256", entry.sha256}});
    } else if (entry.type == EntryType::kLink) {
      line.update({{"type", "link"}, {"target", entry.target}});
    }
    hash.Update(CanonicalJson(line) + "\n");
  }
  return hash.FinishHex();
}

int64_t KeptTime(int64_t seconds) { return std::clamp<int64_t>(seconds, 0, UINT32_MAX); }

absl::Status CheckLinkText(std::string_view path, std::string_view target) {
  if (target.empty()) return Broken(path, "is a symbolic link without a target");
  if (HasControlCharacter(target) || !IsUtf8(target)) {
    return Broken(path, "is a symbolic link whose target is not plain UTF-8 text");
  }
  return absl::OkStatus();
}

absl::Status CheckLinkTarget(std::string_view path, std::string_view target) {
  RETURN_IF_ERROR(CheckLinkText(path, target));
  if (target == ".." || target.starts_with("../") || target.ends_with("/..") ||
      target.find("/../") != std::string_view::npos) {
    return Broken(path, absl::StrCat("is a symbolic link to ", Quoted(target),
                                     "; targets with \"..\" are not allowed, put a copy there"));
  }
  return absl::OkStatus();
}

Utf8Names::Utf8Names() : utf8_(::newlocale(LC_CTYPE_MASK, "C.UTF-8", nullptr)) {
  before_ = ::uselocale(utf8_);  // a null locale changes nothing
}

Utf8Names::~Utf8Names() {
  ::uselocale(before_);
  if (utf8_ != nullptr) ::freelocale(utf8_);
}

}  // namespace myograde::server
