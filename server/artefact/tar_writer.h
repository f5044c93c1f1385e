// Writes a submission's entries as a tar: the same bytes for the same entries.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include <absl/status/status.h>

#include "server/artefact/beneath.h"
#include "server/artefact/listing.h"

namespace myograde::server {

class TarWriter {
 public:
  // Gets the archive's bytes.
  using Sink = std::function<absl::Status(std::string_view bytes)>;
  explicit TarWriter(Sink sink);
  // Its archive refers to it.
  TarWriter(const TarWriter&) = delete;
  TarWriter& operator=(const TarWriter&) = delete;

  // Begins an entry: without an owner, with the mode 0755 or 0644, and the time in whole seconds.
  // Of a file, entry.size bytes follow. Errors, of all four: the sink's; UnavailableError: another
  // one.
  absl::Status Begin(const std::string& path, const Entry& entry);
  absl::Status Write(std::string_view bytes);
  // Writes the content of a begun file `path` of `size` bytes from an open one, and tells `wrote`
  // of each piece. An error of FolderOf's kind if it can't be read, is no file or has another size.
  absl::Status Copy(int file, const std::string& path, int64_t size, FolderOf whose,
                    const std::function<void(std::string_view piece)>& wrote);
  absl::Status Close();

 private:
  absl::Status Failed() const;

  const Sink sink_;
  absl::Status status_;
  std::unique_ptr<archive, ArchiveWriter> writer_;
};

}  // namespace myograde::server
