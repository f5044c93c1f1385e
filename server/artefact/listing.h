// An artefact's content as a list, and the rules for every entry, whether from an archive or from a
// folder.
#pragma once

#include <cstdint>
#include <locale>
#include <map>
#include <string>
#include <string_view>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/artefact/artefact.h"

namespace myograde::server {

enum class EntryType { kFile, kFolder, kLink };

struct Entry {
  EntryType type = EntryType::kFile;
  bool stated = false;      // listed in the archive itself, not only implied by an entry below it
  bool executable = false;  // files only
  int64_t size = 0;         // files only
  int64_t time = 0;         // files only; from KeptTime, not part of the digest
  std::string sha256 = {};  // files only; hex
  std::string target = {};  // links only
};

class Listing {
 public:
  explicit Listing(const ArtefactLimits& limits) : limits_(limits) {}

  // The path in the listing's form: no leading "./", no doubled or trailing slash; "" for the top
  // folder. An error if it is absolute, has "..", control characters or invalid UTF-8, or breaks a
  // limit.
  absl::StatusOr<std::string> CleanPath(std::string_view path) const;

  // Adds an entry at a clean path, and its parent folders. An error if it exists already, lies
  // below something that is not a folder, or breaks a limit.
  absl::StatusOr<Entry*> Add(const std::string& path, EntryType type);

  // AddBytes counts `bytes` more of file content; CheckRoom only checks whether they would fit.
  absl::Status AddBytes(const std::string& path, int64_t bytes);
  absl::Status CheckRoom(const std::string& path, int64_t bytes) const;

  // An entry that is there, to be completed.
  Entry& at(const std::string& path) { return entries_.at(path); }

  // The error for an archive with too many entries.
  absl::Status TooManyEntries(std::string_view where) const;

  // SHA-256 over one canonical line per entry, sorted by path.
  std::string Digest() const;

  // By path, sorted bytewise. Folders come before their content.
  const std::map<std::string, Entry>& entries() const { return entries_; }
  int64_t bytes() const { return bytes_; }

 private:
  const ArtefactLimits limits_;
  std::map<std::string, Entry> entries_;
  int64_t bytes_ = 0;
};

// A file's time as it is kept, in seconds since 1970-01-01 UTC: clamped to 32 bits, which every
// file system can store and which are all that Python compares for compiled modules.
int64_t KeptTime(int64_t seconds);

// An error if the target of a symbolic link has "..", is empty or not UTF-8.
absl::Status CheckLinkTarget(std::string_view path, std::string_view target);

// An error if the text of a symbolic link is empty or not plain UTF-8.
absl::Status CheckLinkText(std::string_view path, std::string_view target);

// A path for a message: quoted, shortened, and without bytes that could affect a terminal.
std::string Quoted(std::string_view path);

// "what: reason of errno", with a code that blames the host.
absl::Status HostError(std::string_view what);

// libarchive converts names by the calling thread's locale; while this object lives, that is UTF-8,
// whatever the environment says.
class Utf8Names {
 public:
  Utf8Names();
  ~Utf8Names();
  Utf8Names(const Utf8Names&) = delete;
  Utf8Names& operator=(const Utf8Names&) = delete;

 private:
  locale_t utf8_;
  locale_t before_;
};

}  // namespace myograde::server
