#include "server/executor/node/folder_channel.h"

#include <unistd.h>

#include <algorithm>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

constexpr size_t kCopyBytes = 256u << 10;

}  // namespace

absl::Status FolderChannel::Open() {
  if (folder_.has_value()) return absl::OkStatus();
  ASSIGN_OR_RETURN(Spool spool, Spool::Open(path_));
  ASSIGN_OR_RETURN(LeaseFolder folder, spool.OpenLease(name_));
  spool_.emplace(std::move(spool));
  folder_.emplace(std::move(folder));
  return absl::OkStatus();
}

absl::StatusOr<NodeOrder> FolderChannel::Order() {
  RETURN_IF_ERROR(Open());
  absl::StatusOr<NodeOrder> order = folder_->Order();
  if (order.ok()) epoch_ = order->epoch;
  return order;
}

absl::Status FolderChannel::Look() {
  RETURN_IF_ERROR(Open());
  ASSIGN_OR_RETURN(const bool there, folder_->IsThere());
  if (!there) return absl::CancelledError("the daemon has given the lease up: its folder is gone");
  const absl::StatusOr<bool> stopped = folder_->stopped();
  if (!stopped.ok()) return stopped.status();
  if (*stopped) return absl::CancelledError("the daemon asked for the lease's end");
  const absl::StatusOr<std::string> epoch = spool_->Epoch();
  if (epoch.ok()) {
    epoch_missing_.reset();
    if (*epoch == epoch_) return absl::OkStatus();
    return absl::CancelledError("the daemon was started again, and plays the lease anew");
  }
  if (!absl::IsNotFound(epoch.status())) return epoch.status();
  const absl::Duration now = clock_.Monotonic();
  if (!epoch_missing_.has_value()) epoch_missing_ = now;
  if (now - *epoch_missing_ < kEpochMissing) return absl::OkStatus();
  return absl::CancelledError(absl::StrCat("there was no daemon's epoch in ", path_, " for ",
                                           absl::FormatDuration(kEpochMissing)));
}

absl::Status FolderChannel::PutClaim(const NodeClaim& claim) {
  RETURN_IF_ERROR(Look());
  return folder_->PutClaim(claim);
}

absl::Status FolderChannel::PutProof(const NodeProof& proof) {
  RETURN_IF_ERROR(Look());
  return folder_->PutProof(proof);
}

absl::Status FolderChannel::FetchArtefact(const NodeArtefact& artefact, int file) {
  RETURN_IF_ERROR(Look());
  ASSIGN_OR_RETURN(const Fd source, spool_->OpenArtefact(artefact.digest));
  std::string piece(kCopyBytes, '\0');
  for (int64_t copied = 0;;) {
    const ssize_t n = read(source.get(), piece.data(), piece.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return DiskError(spool_->ArtefactPath(artefact.digest), "read");
    if (n == 0) return absl::OkStatus();
    copied += n;
    if (copied > artefact.archive_bytes) {
      return absl::DataLossError(absl::StrCat(spool_->ArtefactPath(artefact.digest),
                                              ": is larger than the order says"));
    }
    RETURN_IF_ERROR(WriteAll(file, std::string_view(piece.data(), static_cast<size_t>(n))));
  }
}

absl::Status FolderChannel::AddRecords(int64_t offset, std::string_view bytes) {
  if (absl::Status status = Look(); !status.ok() || bytes.empty()) return status;
  const absl::Status status = folder_->WriteRecords(offset, bytes);
  if (absl::IsResourceExhausted(status) &&
      offset + static_cast<int64_t>(bytes.size()) > kMostRecordBytes) {
    return absl::OutOfRangeError(status.message());  // waiting makes no room
  }
  return status;
}

absl::Status FolderChannel::PutLog(const std::string& log, int file) {
  RETURN_IF_ERROR(Look());
  if (lseek(file, 0, SEEK_SET) != 0) return DiskError(log, "read");
  return folder_->PutLog(log, BytesOf(file), INT64_MAX);
}

absl::Status FolderChannel::PutEnd(const NodeEnd& end) {
  // Also after the daemon has asked for the end, as long as the folder is there.
  RETURN_IF_ERROR(Open());
  ASSIGN_OR_RETURN(const bool there, folder_->IsThere());
  if (!there) return absl::CancelledError("the daemon has given the lease up: its folder is gone");
  return folder_->PutEnd(end);
}

}  // namespace myograde::server
