// Turns an uploaded archive into an artefact: a row in the store and a folder of files.
#include <fcntl.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <system_error>
#include <utility>
#include <vector>

#include <absl/cleanup/cleanup.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/admission/admission.h"
#include "server/artefact/adapters.h"
#include "server/artefact/share_files.h"
#include "server/artefact/unpack_process.h"
#include "server/base/error_code.h"
#include "server/base/names.h"
#include "server/engine/stored.h"
#include "server/sandbox/program.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr char kStopsNow[] = "the daemon is stopping; nothing was changed";
constexpr size_t kReadAtOnce = 256 << 10;

absl::StatusOr<std::string> HashArchive(const IncomingArchive& archive,
                                        const std::function<bool()>& stopping) {
  Sha256 hash;
  std::string piece(std::min(kReadAtOnce, static_cast<size_t>(archive.size())), '\0');
  for (int64_t done = 0; done < archive.size();) {
    if (stopping()) return absl::CancelledError(kStopsNow);
    const ssize_t n = archive.ReadAt(piece.data(), piece.size(), done);
    if (n <= 0) return absl::UnavailableError("can't read the upload back from the disk");
    hash.Update(std::string_view(piece.data(), static_cast<size_t>(n)));
    done += n;
  }
  return hash.FinishHex();
}

// Whether an upload may go on: not on a full disk, and not when the daemon is asked to end.
absl::Status MayGoOn(const std::string& folder, int64_t disk_reserve,
                     const std::function<bool()>& stopping) {
  if (stopping()) return absl::CancelledError(kStopsNow);
  std::error_code error;
  const fs::space_info disk = fs::space(folder, error);
  if (error) {
    return absl::ErrnoToStatus(error.value(), absl::StrCat(folder, ": can't be examined"));
  }
  if (static_cast<int64_t>(disk.available) >= disk_reserve) return absl::OkStatus();
  return absl::ResourceExhaustedError(
      "the server's disk is too full to unpack the archive; try again later, or tell the "
      "organisers");
}

// What the host did to an unpacking has a word of its own.
absl::Status TroubleOf(const absl::Status& status) {
  if (!absl::IsUnavailable(status) && !absl::IsDeadlineExceeded(status)) return status;
  return WithErrorCode(absl::UnavailableError(status.message()), "busy");
}

// Makes a whole folder durable before the store names it.
absl::Status Sync(const std::string& path) {
  const Fd fd(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_DIRECTORY));
  if (!fd.valid() || syncfs(fd.get()) != 0) {
    return absl::ErrnoToStatus(errno, absl::StrCat(path, ": can't be synced to disk"));
  }
  return absl::OkStatus();
}

// Moves a fresh folder to its place; one that is there already has the same content.
absl::Status Settle(const std::string& fresh, const std::string& place) {
  std::error_code error;
  if (fs::exists(place, error)) {
    fs::remove_all(fresh, error);
    return absl::OkStatus();
  }
  if (rename(fresh.c_str(), place.c_str()) == 0 || errno == EEXIST || errno == ENOTEMPTY) {
    return Sync(fs::path(place).parent_path());
  }
  return absl::ErrnoToStatus(errno, absl::StrCat(place, ": can't be moved to its place"));
}

// Checks nothing if a runtime is missing, as nobody can say what it would bring: an unknown one is
// refused when the artefact is submitted, and one without its folder is the host's trouble.
absl::Status CheckStart(const PolicyManifest& manifest, const std::string& folder,
                        const Runtimes& runtimes_here) {
  std::vector<std::string> runtimes;
  for (const std::string& name : manifest.runtimes) {
    const absl::StatusOr<Runtime> known = runtimes_here.Find(name);
    if (!known.ok()) return absl::OkStatus();
    runtimes.push_back(known->folder);
  }
  return CheckProgram(manifest, folder, runtimes);
}

}  // namespace

absl::StatusOr<ReceivedArtefact> Admission::Take(const UploadRequest& request,
                                                 IncomingArchive& archive, const TrackKind* kind) {
  const auto check = [kind](const std::string& adapter) {
    return kind == nullptr ? absl::OkStatus() : CheckAdapter(adapter, *kind);
  };
  if (archive.size() == 0) return absl::InvalidArgumentError("the archive is empty");
  ASSIGN_OR_RETURN(const std::string sha256, HashArchive(archive, request.stopping));
  absl::StatusOr<ArtefactRow> known = Known(sha256);
  if (known.ok()) {
    RETURN_IF_ERROR(check(known->adapter));
    RETURN_IF_ERROR(Hold(*known, request.from, /*here=*/true).status());
    return ReceivedArtefact{*std::move(known)};
  }
  if (!absl::IsNotFound(known.status())) return known.status();

  const std::string name = absl::StrCat(options_.data_dir, "/spool/", ++spooled_);
  const std::string file = name + ".archive";
  const std::string folder = name + ".folder";
  const absl::Cleanup remove = [&] {
    std::error_code error;
    fs::remove(file, error);
    fs::remove_all(folder, error);
  };
  RETURN_IF_ERROR(archive.MoveTo(file));
  ASSIGN_OR_RETURN(const Artefact artefact, Unpack(file, folder, request.stopping));
  RETURN_IF_ERROR(check(artefact.manifest.adapter));
  absl::StatusOr<ReceivedArtefact> kept = Keep(artefact, folder, request.from);
  if (kept.ok()) known_archives_.Learn(sha256, kept->artefact.hash);
  return kept;
}

absl::StatusOr<ArtefactRow> Admission::Known(const std::string& archive_sha256) {
  const std::optional<std::string> artefact = known_archives_.Find(archive_sha256);
  if (!artefact.has_value()) return absl::NotFoundError("not seen before");
  RETURN_IF_ERROR(HasArtefactFiles(options_.data_dir, *artefact));
  return readers_.Read<ArtefactRow>(
      [&](const Transaction& reader) { return reader.content.Artefact(*artefact); });
}

absl::StatusOr<bool> Admission::Hold(const ArtefactRow& row, const NewUpload& from, bool here) {
  ASSIGN_OR_RETURN(const bool held, readers_.Read<bool>([&](const Transaction& reader) {
    return here && reader.content.UploadedArtefact(row.hash, from.uploader) &&
           (from.team.empty() || reader.content.TeamHoldsArtefact(row.hash, from.team));
  }));
  if (held) return false;
  const ServerConfig& config = options_.config;
  return engine_.AddArtefact(row, from, config.artefacts.unsubmitted, config.http.request);
}

absl::StatusOr<Artefact> Admission::Unpack(const std::string& file, const std::string& folder,
                                           const std::function<bool()>& stopping) const {
  const UploadLimits& limits = options_.config.artefacts;
  const std::string spool = options_.data_dir + "/spool";
  const UnpackBudget budget{
      .time = options_.config.http.upload,
      .memory_bytes = limits.unpack_memory_bytes,
      .cpu = limits.unpack_cpu,
      .go_on = [&] { return MayGoOn(spool, limits.disk_reserve, stopping); }};
  absl::StatusOr<Artefact> artefact =
      UnpackInProcess(file, folder, {.bytes = limits.bytes, .files = limits.files}, budget);
  if (!artefact.ok()) return TroubleOf(artefact.status());
  RETURN_IF_ERROR(CheckStart(artefact->manifest, folder, runtimes_));
  return artefact;
}

absl::StatusOr<ReceivedArtefact> Admission::Keep(const Artefact& artefact,
                                                 const std::string& folder, const NewUpload& from) {
  ReceivedArtefact received{{artefact.manifest, artefact.digest, artefact.bytes, artefact.files}};
  ArtefactRow& row = received.artefact;
  const absl::Status known = readers_.Read(
      [&](const Transaction& reader) { return reader.content.Artefact(row.hash).status(); });
  if (absl::IsNotFound(known)) {  // one that came before keeps its name
    ASSIGN_OR_RETURN(row.name, CleanName(row.name, "policy.json: \"name\""));
  } else if (!known.ok()) {
    return known;
  }
  // The row comes first: whose the files are is known before there are any.
  const bool here = known.ok() && HasArtefactFiles(options_.data_dir, row.hash).ok();
  ASSIGN_OR_RETURN(received.is_new, Hold(row, from, here));
  RETURN_IF_ERROR(ShareImage(folder, SharedFolder(options_.data_dir)));
  RETURN_IF_ERROR(Settle(folder, ArtefactFolder(options_.data_dir, row.hash)));
  return received;
}

}  // namespace myograde::server
