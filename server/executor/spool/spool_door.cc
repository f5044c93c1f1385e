#include "server/executor/spool/spool_door.h"

#include <algorithm>
#include <cstdint>
#include <span>
#include <utility>

#include <absl/strings/str_cat.h>
#include <openssl/crypto.h>

#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/base/random_bytes.h"

namespace myograde::server {
namespace {

constexpr size_t kTokenBytes = 32;

}  // namespace

absl::StatusOr<std::string> SpoolDoor::Open(const std::string& name, const std::string& artefact) {
  ASSIGN_OR_RETURN(const std::string bytes, RandomBytes(kTokenBytes));
  ASSIGN_OR_RETURN(LeaseFolder folder, spool_.OpenLease(name));
  const std::string token =
      HexOf({reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size()});
  auto attempt = std::make_shared<Attempt>(Sha256Hex(token), artefact, std::move(folder));
  const MutexLock lock(mutex_);
  attempts_[name] = std::move(attempt);
  return token;
}

void SpoolDoor::Close(const std::string& name) {
  const MutexLock lock(mutex_);
  attempts_.erase(name);
}

absl::StatusOr<std::shared_ptr<SpoolDoor::Attempt>> SpoolDoor::Find(
    const std::string& name) const {
  const MutexLock lock(mutex_);
  const auto found = attempts_.find(name);
  if (found == attempts_.end()) {
    return absl::NotFoundError("this attempt of the lease is over; end what plays it");
  }
  return found->second;
}

absl::Status SpoolDoor::Check(const std::string& name, std::string_view token) const {
  ASSIGN_OR_RETURN(const std::shared_ptr<Attempt> attempt, Find(name));
  const std::string hash = Sha256Hex(token);
  const std::string& known = attempt->token_hash;
  if (hash.size() == known.size() && CRYPTO_memcmp(hash.data(), known.data(), hash.size()) == 0) {
    return absl::OkStatus();
  }
  return absl::PermissionDeniedError(
      "this is not the token of this lease; a lease's token is good for that lease alone");
}

absl::StatusOr<std::string> SpoolDoor::OrderText(const std::string& name) const {
  ASSIGN_OR_RETURN(const std::shared_ptr<Attempt> attempt, Find(name));
  return attempt->folder.OrderText();
}

absl::StatusOr<std::string> SpoolDoor::ArtefactPath(const std::string& name) const {
  ASSIGN_OR_RETURN(const std::shared_ptr<Attempt> attempt, Find(name));
  if (attempt->artefact.empty()) {
    return absl::NotFoundError("this lease plays no submission, so it has no archive");
  }
  return spool_.ArtefactPath(attempt->artefact);
}

absl::Status SpoolDoor::PutClaim(const std::string& name, const NodeClaim& claim) {
  const absl::StatusOr<std::shared_ptr<Attempt>> attempt = Find(name);
  return attempt.ok() ? (*attempt)->folder.PutClaim(claim) : attempt.status();
}

absl::Status SpoolDoor::PutProof(const std::string& name, const NodeProof& proof) {
  const absl::StatusOr<std::shared_ptr<Attempt>> attempt = Find(name);
  return attempt.ok() ? (*attempt)->folder.PutProof(proof) : attempt.status();
}

absl::Status SpoolDoor::PutEnd(const std::string& name, const NodeEnd& end) {
  const absl::StatusOr<std::shared_ptr<Attempt>> attempt = Find(name);
  return attempt.ok() ? (*attempt)->folder.PutEnd(end) : attempt.status();
}

absl::StatusOr<RecordsState> SpoolDoor::AddRecords(const std::string& name, int64_t offset,
                                                   std::string_view bytes) {
  ASSIGN_OR_RETURN(const std::shared_ptr<Attempt> found, Find(name));
  Attempt& attempt = *found;
  const absl::StatusOr<bool> stopped = attempt.folder.stopped();
  if (!stopped.ok()) return stopped.status();
  const MutexLock lock(attempt.records);
  ASSIGN_OR_RETURN(const int64_t size, attempt.folder.RecordsSize());
  RecordsState state = {.size = size, .taken = false, .stop = *stopped};
  if (offset < 0 || offset > size) return state;
  // A repeat of what came before, because its answer was lost, must be the same.
  const size_t known = std::min(static_cast<size_t>(size - offset), bytes.size());
  if (known > 0) {
    ASSIGN_OR_RETURN(const std::string present, attempt.folder.Records(offset, known));
    if (present != bytes.substr(0, known)) return state;
  }
  const std::string_view news = bytes.substr(known);
  if (!news.empty()) {
    RETURN_IF_ERROR(attempt.folder.WriteRecords(size, news));
  }
  state.size += static_cast<int64_t>(news.size());
  state.taken = true;
  return state;
}

absl::Status SpoolDoor::PutLog(const std::string& name, const std::string& log,
                               const ByteSource& source) {
  ASSIGN_OR_RETURN(const std::shared_ptr<Attempt> attempt, Find(name));
  return attempt->folder.PutLog(log, source, most_log_bytes_);
}

}  // namespace myograde::server
