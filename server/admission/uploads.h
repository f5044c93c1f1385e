// Turns an uploaded archive into an artefact: a row in the store and a folder of files.
#pragma once

#include <sys/types.h>

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/artefact/artefact.h"
#include "server/artefact/known_archives.h"
#include "server/config/server_config.h"
#include "server/engine/engine.h"
#include "server/store/reader_pool.h"

namespace myograde::server {

// A complete archive, wherever its bytes are kept.
class IncomingArchive {
 public:
  virtual ~IncomingArchive() = default;

  virtual int64_t size() const = 0;  // bytes
  // At most `size` bytes from `offset` on; 0 at its end, negative for errors.
  virtual ssize_t ReadAt(char* to, size_t size, int64_t offset) const = 0;
  // Moves the archive to a new file at `path`, in the data folder's spool/. Nothing else is called
  // afterwards.
  virtual absl::Status MoveTo(const std::string& path) = 0;
};

struct ReceivedArtefact {
  ArtefactRow artefact;
  bool is_new = false;  // false: the store had it already
};

// Whether an artefact with this adapter can be used; an error is that of the whole upload.
using ArtefactCheck = std::function<absl::Status(const std::string& adapter)>;

// Safe from any thread.
class Uploads {
 public:
  // All must outlive it. artefacts/ and spool/ lie in `data_dir`.
  Uploads(const ServerConfig& config, const std::string& data_dir, Engine& engine,
          ReaderPool& readers)
      : config_(config), data_dir_(data_dir), engine_(engine), readers_(readers) {}

  // Unpacks the archive in a separate process, unless the same bytes were received before, asks
  // `check`, writes the artefact's row and moves its files to artefacts/. Leaves nothing in the spool.
  // `stopping` is polled; once it returns true, the upload is given up.
  //   InvalidArgumentError        the archive breaks a rule, or its command could not start
  //   FailedPreconditionError     code "quota": too many uploads that were never submitted
  //   UnavailableError            code "busy": the host was too busy to unpack it
  //   CancelledError              `stopping` returned true
  //   ResourceExhaustedError      the disk is too full
  // and the errors of `check`, Engine::AddArtefact and ReaderPool::Read.
  absl::StatusOr<ReceivedArtefact> Take(IncomingArchive& archive, const NewUpload& from,
                                        const ArtefactCheck& check,
                                        const std::function<bool()>& stopping);

 private:
  // The artefact of an archive with this hash that was received before. NotFoundError: unpack it.
  absl::StatusOr<ArtefactRow> Known(const std::string& archive_sha256);
  absl::StatusOr<Artefact> Unpack(const std::string& file, const std::string& folder,
                                  const std::function<bool()>& stopping) const;
  // Records who has uploaded an artefact whose files are here. Whoever holds it already causes no
  // change of the store, and no wait for the disk.
  absl::StatusOr<bool> Hold(const ArtefactRow& row, const NewUpload& from);
  // Writes the row and moves the unpacked `folder` to artefacts/.
  absl::StatusOr<ReceivedArtefact> Keep(const Artefact& artefact, const std::string& folder,
                                        const NewUpload& from);

  const ServerConfig& config_;
  const std::string& data_dir_;
  Engine& engine_;
  ReaderPool& readers_;
  KnownArchives known_archives_{4096};
  std::atomic<int64_t> names_ = 0;  // of files in the spool
};

}  // namespace myograde::server
