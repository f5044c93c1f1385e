// Uploads: unpacked in a process of their own, and put in their place by their hash.
#include <fcntl.h>
#include <sys/stat.h>
#include <sys/statvfs.h>

#include <algorithm>
#include <filesystem>

#include <absl/cleanup/cleanup.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/sha256.h"
#include "server/api/api.h"
#include "server/api/requests.h"
#include "server/artefact/artefact.h"
#include "server/artefact/unpack_process.h"
#include "server/base/names.h"
#include "server/sandbox/program.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr char kStopsNow[] = "the daemon is about to stop; nothing was changed";
constexpr size_t kCopiedAtOnce = 256 << 10;

absl::StatusOr<std::string> HashOf(const Body& body) {
  Sha256 hash;
  std::string piece(std::min(kCopiedAtOnce, static_cast<size_t>(body.size())), '\0');
  for (int64_t done = 0; done < body.size();) {
    if (UnixHttpServer::Stopping()) return absl::CancelledError(kStopsNow);
    const ssize_t n = body.ReadAt(piece.data(), piece.size(), done);
    if (n <= 0) return absl::UnavailableError("the upload can't be read back from the disk");
    hash.Update(std::string_view(piece.data(), static_cast<size_t>(n)));
    done += n;
  }
  return hash.FinishHex();
}

// Whether an upload may go on: not on a full disk, and not when the daemon is asked to end.
absl::Status MayGoOn(const std::string& folder, int64_t disk_reserve) {
  if (UnixHttpServer::Stopping()) return absl::CancelledError(kStopsNow);
  struct statvfs disk;
  if (statvfs(folder.c_str(), &disk) != 0) {
    return absl::ErrnoToStatus(errno, absl::StrCat(folder, ": can't be looked at"));
  }
  const auto free = static_cast<int64_t>(disk.f_bavail) * static_cast<int64_t>(disk.f_frsize);
  if (free >= disk_reserve) return absl::OkStatus();
  return absl::ResourceExhaustedError(
      "the server's disk is too full to unpack the archive; try again later, or tell the organiser");
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
  return absl::ErrnoToStatus(errno, absl::StrCat(place, ": can't be put in its place"));
}

// What a runtime that is not there would bring can't be said. One that is not known is told when it is
// submitted, and one without its folder is the host's trouble.
absl::Status CheckStart(const ArtefactManifest& manifest, const std::string& folder,
                        const ServerConfig& config) {
  std::vector<std::string> runtimes;
  for (const std::string& name : manifest.runtimes) {
    const auto known = config.runtimes.find(name);
    if (known == config.runtimes.end() || !fs::is_directory(known->second)) {
      return absl::OkStatus();
    }
    runtimes.push_back(known->second);
  }
  return CheckProgram(manifest, folder, runtimes);
}

}  // namespace

absl::StatusOr<ArtefactRow> Api::Known(const std::string& archive_sha256) {
  const std::optional<std::string> artefact = known_archives_.Find(archive_sha256);
  if (!artefact.has_value()) return absl::NotFoundError("not seen before");
  if (absl::Status status = HasFiles(*artefact); !status.ok()) return status;
  absl::StatusOr<ArtefactRow> row = absl::InternalError("");
  const absl::Status status = readers_.Read([&](Reader& reader) {
    row = reader.Artefact(*artefact);
    return row.status();
  });
  if (!status.ok()) return status;
  return row;
}

absl::StatusOr<ArtefactRow> Api::Receive(const NewUpload& upload, bool& is_new) {
  const std::string name = SpoolPath();
  const std::string archive = name + ".archive";
  const std::string folder = name + ".folder";
  const absl::Cleanup remove = [&] {
    std::error_code error;
    fs::remove(archive, error);
    fs::remove_all(folder, error);
  };
  Body& body = UnixHttpServer::RequestBody();
  if (body.size() == 0) return absl::InvalidArgumentError("the archive is empty");
  const absl::StatusOr<std::string> sha256 = HashOf(body);
  if (!sha256.ok()) return sha256.status();
  absl::StatusOr<ArtefactRow> known = Known(*sha256);
  if (!absl::IsNotFound(known.status())) return known;
  if (absl::Status moved = body.MoveTo(archive); !moved.ok()) return moved;

  const UploadLimits& own = options_.config.artefacts;
  const UnpackBudget budget{
      .time = options_.config.http.upload,
      .memory_bytes = own.unpack_memory_bytes,
      .cpu = own.unpack_cpu,
      .go_on = [&] { return MayGoOn(options_.data_dir + "/spool", own.disk_reserve); }};
  absl::StatusOr<Artefact> artefact =
      UnpackInProcess(archive, folder, {.bytes = own.bytes, .files = own.files}, budget);
  if (!artefact.ok()) return TroubleOf(artefact.status());
  ArtefactRow row{artefact->digest,            artefact->manifest.name,
                  artefact->manifest.command,  artefact->manifest.runtimes,
                  artefact->bytes,             artefact->files,
                  artefact->manifest.environment};
  absl::Status status = CheckStart(artefact->manifest, folder, options_.config);
  if (!status.ok()) return status;
  // One that came before keeps its name.
  status = readers_.Read([&](Reader& reader) { return reader.Artefact(row.hash).status(); });
  if (absl::IsNotFound(status)) {
    absl::StatusOr<std::string> clean = CleanName(row.name, "policy.json: \"name\"");
    if (!clean.ok()) return clean.status();
    row.name = *std::move(clean);
  }
  // What is known and here needs no change of the store, and no wait for the disk. Else the row
  // comes first: whose the files are is known before there are any.
  if (status.ok()) status = HasFiles(row.hash);
  if (absl::IsNotFound(status)) {
    absl::StatusOr<bool> added =
        engine_.AddArtefact(row, upload, own.unsubmitted, options_.config.http.request);
    if (added.ok()) is_new = *added;
    status = added.status();
  }
  if (status.ok()) {
    status = Settle(folder, absl::StrCat(options_.data_dir, "/artefacts/", artefact->digest));
  }
  if (!status.ok()) return status;
  known_archives_.Learn(*sha256, row.hash);
  return row;
}

absl::Status Api::ChargeRefusal(const std::string& team, const std::string& track,
                                const std::string& why) {
  if (team.empty()) return absl::OkStatus();
  return engine_.Change(
      [team, track, who = Who(), text = absl::StrCat("upload refused: ", why)](Writer& writer) {
        return writer.ChargeFailure(team, track, who, text);
      },
      options_.config.http.request);
}

// With team and track given, an archive that breaks a rule is a failed try of theirs; what the
// host or the connection did to it is not.
Api::Result Api::Upload(const Request& request) {
  const std::string team = request.get_param_value("team");
  const std::string track = request.get_param_value("track");
  absl::Status allowed = CheckParameters(request, {"team", "track"});
  if (allowed.ok() && request.has_param("team") != request.has_param("track")) {
    allowed = absl::InvalidArgumentError("\"team\" and \"track\" go together: give both or none");
  }
  if (allowed.ok() && request.has_param("team")) allowed = CheckTeam(team);
  if (allowed.ok() && request.has_param("track")) {
    allowed = tracks_.Find(track, "").status();
    if (allowed.ok()) allowed = CheckTries(team, track);
  }
  if (!allowed.ok()) {
    ApiError error = TeamErrorOf(allowed, team);
    if (absl::IsNotFound(allowed)) error = {400, "unknown_track", error.message};
    return error;
  }
  bool is_new = false;
  absl::StatusOr<ArtefactRow> row =
      Receive({Who(), team, UnixHttpServer::PeerIsOrganiser()}, is_new);
  if (!row.ok()) {
    ApiError error = ErrorOf(row.status());
    if (absl::IsInvalidArgument(row.status())) {
      error.code = "bad_artefact";
      if (absl::Status charged = ChargeRefusal(team, track, error.message); !charged.ok()) {
        return ErrorOf(charged);
      }
    }
    return error;
  }
  return Answer{is_new ? 201 : 200,
                {{"artefact", row->hash},
                 {"name", row->name},
                 {"command", row->command},
                 {"runtimes", row->runtimes},
                 {"env", row->environment},
                 {"bytes", row->bytes},
                 {"files", row->files},
                 {"new", is_new}}};
}

}  // namespace myograde::server
