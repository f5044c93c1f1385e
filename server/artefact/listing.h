// The content of an artefact as a list, and the rules that every entry obeys
// whether it comes from an archive or from a folder.
#pragma once

#include <archive.h>

#include <cstdint>
#include <locale>
#include <map>
#include <memory>
#include <string>
#include <string_view>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/artefact/artefact.h"

namespace myograde::server {

enum class EntryType { kFile, kFolder, kLink };

struct Entry {
  EntryType type = EntryType::kFile;
  bool stated = false;      // named by the archive, not only implied by an entry below it
  bool executable = false;  // files only
  int64_t size = 0;         // files only
  int64_t time = 0;         // files only; of KeptTime, and no part of the digest
  std::string sha256 = {};  // files only; hex
  std::string target = {};  // links only
};

class Listing {
 public:
  explicit Listing(const ArtefactLimits& limits) : limits_(limits) {}

  // The path as the listing keeps it: no leading "./", no doubled or trailing
  // slash; "" for the top folder. An error if it is absolute, has "..", control
  // characters, text that is not UTF-8, or breaks a limit.
  absl::StatusOr<std::string> CleanPath(std::string_view path) const;

  // Adds an entry at a clean path, and the folders above it. An error if it is
  // there already, lies below something that is no folder, or breaks a limit.
  absl::StatusOr<Entry*> Add(const std::string& path, EntryType type);

  // Counts `bytes` more of file content; CheckRoom only says whether they would fit.
  absl::Status AddBytes(const std::string& path, int64_t bytes);
  absl::Status CheckRoom(const std::string& path, int64_t bytes) const;

  // The error for an archive that has more entries than may be.
  absl::Status TooManyEntries(std::string_view where) const;

  // SHA-256 over one canonical line for each entry, sorted by path.
  std::string Digest() const;

  // By path, sorted by bytes. Folders come before what is in them.
  const std::map<std::string, Entry>& entries() const { return entries_; }
  int64_t bytes() const { return bytes_; }

 private:
  const ArtefactLimits limits_;
  std::map<std::string, Entry> entries_;
  int64_t bytes_ = 0;
};

// The time of a file, in whole seconds since 1970-01-01 UTC, as it is kept: what every file system
// can hold, and no other than a Python of 2024 compares.
int64_t KeptTime(int64_t seconds);

// An error if the target of a symbolic link has "..", is empty or not UTF-8.
absl::Status CheckLinkTarget(std::string_view path, std::string_view target);

// A path for a message: in quotes, cut to a bearable length, without bytes
// that could play tricks on a terminal.
std::string Quoted(std::string_view path);

// "what: reason of errno", with a code that says that the host is in trouble.
absl::Status HostError(std::string_view what);

struct ArchiveReader {
  void operator()(archive* a) const { archive_read_free(a); }
};
struct ArchiveWriter {
  void operator()(archive* a) const { archive_write_free(a); }
};

// libarchive converts names by the calling thread's locale; while this lives
// it is UTF-8, whatever the environment says.
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
