// Makes the files of an archive's entries, which a participant chose, in a folder.
#pragma once

#include <archive.h>

#include <cstdint>
#include <functional>
#include <set>
#include <string>
#include <utility>

#include <absl/status/status.h>
#include <absl/strings/string_view.h>

#include "server/artefact/beneath.h"
#include "server/artefact/listing.h"

namespace myograde::server {

class Unpacker {
 public:
  // Into the empty folder `root`. `whose`: whose archive it is. `read` is called after each block.
  Unpacker(archive* reader, int root, const ArtefactLimits& limits, FolderOf whose,
           std::function<void()> read)
      : reader_(reader),
        root_(root),
        limits_(limits),
        submitted_(whose == FolderOf::kParticipant),
        read_(std::move(read)),
        listing_(limits) {}

  // Unpacks all entries of an opened archive. InvalidArgumentError: it is broken, or breaks a rule
  // of submissions; an archive of the daemon's is not judged by those that no path depends on.
  // Other codes: a problem of this host.
  absl::Status UnpackAll();

  // Why the archive can't be read any further: `what`, and libarchive's reason.
  absl::Status Failure(absl::string_view what) const;

  const Listing& listing() const { return listing_; }

 private:
  absl::Status Take(archive_entry* entry);
  absl::Status TakeFile(const std::string& path, archive_entry* entry);
  absl::Status MakeFoldersOf(const std::string& path);

  archive* const reader_;
  const int root_;
  const ArtefactLimits limits_;
  const bool submitted_;
  const std::function<void()> read_;
  Listing listing_;
  int64_t headers_ = 0;
  std::set<std::string> made_;  // folders
};

}  // namespace myograde::server
