// Uploads: spooled to a file, unpacked, and put in their place by their hash.
#include <fcntl.h>
#include <sys/stat.h>

#include <filesystem>

#include <absl/cleanup/cleanup.h>
#include <absl/strings/str_cat.h>

#include "protocol/sha256.h"
#include "server/api/api.h"
#include "server/api/requests.h"
#include "server/artefact/artefact.h"
#include "server/artefact/unpack_process.h"
#include "server/names.h"
#include "server/sandbox/program.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr uint64_t kSmallUpload = 1 << 20;

absl::Status WriteAll(int fd, const char* data, size_t size) {
  while (size > 0) {
    const ssize_t n = write(fd, data, size);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return absl::ErrnoToStatus(errno, "the upload can't be kept on the server's disk");
    data += n;
    size -= static_cast<size_t>(n);
  }
  return absl::OkStatus();
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

absl::StatusOr<std::string> Api::Spool(const httplib::ContentReader& content,
                                       const std::string& archive) const {
  const Fd fd(open(archive.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
  if (!fd.valid()) {
    return absl::ErrnoToStatus(errno, absl::StrCat(archive, ": can't be made"));
  }
  const int64_t limit = options_.config.artefacts.archive_bytes;
  int64_t size = 0;
  Sha256 hash;
  absl::Status status;
  const bool whole = content([&](const char* data, size_t n) {
    size += static_cast<int64_t>(n);
    if (status.ok() && size > limit) {
      status = absl::OutOfRangeError(absl::StrCat("the archive is larger than ", limit, " bytes"));
    } else if (status.ok()) {
      hash.Update(std::string_view(data, n));
      status = WriteAll(fd.get(), data, n);
    }
    // What was refused is read and dropped, so that the client hears why.
    return size <= limit + UnixHttpServer::kDrainBytes;
  });
  if (!status.ok()) return status;
  if (!whole || size == 0) {
    return absl::InvalidArgumentError("the archive did not arrive whole; send it again");
  }
  return hash.FinishHex();
}

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

absl::StatusOr<ArtefactRow> Api::Receive(const httplib::ContentReader& content, bool& is_new) {
  const absl::Duration deadline = clock_.Monotonic() + options_.config.http.upload;
  const std::string name = absl::StrCat(options_.data_dir, "/spool/", ++upload_names_);
  const std::string archive = name + ".archive";
  const std::string folder = name + ".folder";
  const absl::Cleanup remove = [&] {
    std::error_code error;
    fs::remove(archive, error);
    fs::remove_all(folder, error);
  };
  const absl::StatusOr<std::string> sha256 = Spool(content, archive);
  if (!sha256.ok()) return sha256.status();
  absl::StatusOr<ArtefactRow> known = Known(*sha256);
  if (!absl::IsNotFound(known.status())) return known;

  const ArtefactLimits limits{.bytes = options_.config.artefacts.bytes,
                              .files = options_.config.artefacts.files};
  // A second is kept for the answer.
  const absl::Duration left = deadline - clock_.Monotonic() - absl::Seconds(1);
  const UnpackBudget budget{
      .time = std::max(left, absl::Seconds(1)),
      .memory_bytes = options_.config.artefacts.unpack_memory_bytes};
  absl::StatusOr<Artefact> artefact = UnpackInProcess(archive, folder, limits, budget);
  if (!artefact.ok()) return artefact.status();
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
  status = Settle(folder, absl::StrCat(options_.data_dir, "/artefacts/", artefact->digest));
  if (!status.ok()) return status;
  // What is known needs no change of the store, and no wait for the disk.
  status = readers_.Read([&](Reader& reader) { return reader.Artefact(row.hash).status(); });
  if (absl::IsNotFound(status)) {
    absl::StatusOr<bool> added = engine_.AddArtefact(row, options_.config.http.request);
    if (added.ok()) is_new = *added;
    status = added.status();
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

// With team and track given, a refused archive is a failed try of theirs.
Api::Result Api::Upload(const Request& request, const httplib::ContentReader& content) {
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
  const int64_t drain = options_.config.artefacts.archive_bytes + UnixHttpServer::kDrainBytes;
  if (!allowed.ok()) {
    UnixHttpServer::Drain(content, drain);
    ApiError error = TeamErrorOf(allowed, team);
    if (absl::IsNotFound(allowed)) error = {400, "unknown_track", error.message};
    return error;
  }
  // Small ones are through in no time: they wait for their turn. A chunked one has any length.
  const bool small = request.has_header("Content-Length") &&
                     request.get_header_value<uint64_t>("Content-Length") <= kSmallUpload;
  const bool may = small ? small_uploads_.try_acquire_for(
                               absl::ToChronoMilliseconds(options_.config.http.upload))
                         : ++uploads_ <= options_.config.artefacts.uploads;
  const absl::Cleanup leave = [&] {
    if (!small) --uploads_;
    if (small && may) small_uploads_.release();
  };
  if (!may) {
    UnixHttpServer::Drain(content, drain);
    return ApiError{429, "too_many", "too many uploads run already; try again in a second"};
  }
  UnixHttpServer::AllowUploadTime();
  bool is_new = false;
  absl::StatusOr<ArtefactRow> row = Receive(content, is_new);
  if (!row.ok()) {
    UnixHttpServer::HangUpAfter();  // the rest of the body may be unread
    ApiError error = ErrorOf(row.status());
    if (absl::IsInvalidArgument(row.status())) {
      error.code = "bad_artefact";
      if (absl::Status charged = ChargeRefusal(team, track, error.message); !charged.ok()) {
        return ErrorOf(charged);
      }
    }
    if (absl::IsOutOfRange(row.status())) error = {413, "too_large", error.message};
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
