#include "server/executor/spool/lease_folder.h"

#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

constexpr char kEpoch[] = "epoch";
constexpr char kOrder[] = "order.json";
constexpr char kClaim[] = "claim";
constexpr char kProof[] = "node.json";
constexpr char kRecords[] = "records";
constexpr char kLogs[] = "logs";
constexpr char kEnd[] = "end.json";
constexpr char kStop[] = "stop";
constexpr char kArtefactEnding[] = ".tar";
constexpr size_t kMostEpochBytes = 256;
constexpr size_t kMostNames = 1u << 20;

std::string ArtefactName(const std::string& digest) { return digest + kArtefactEnding; }

absl::Status NoName(const std::string& name, const char* what) {
  return absl::InvalidArgumentError(absl::StrCat("\"", name, "\" is no name of a ", what));
}

template <typename Form>
absl::StatusOr<Form> ReadForm(const Folder& folder, const char* name,
                              absl::StatusOr<Form> (*parse)(std::string_view,
                                                            const std::string&)) {
  ASSIGN_OR_RETURN(const std::string text, folder.Read(name, kMostFormBytes));
  return parse(text, absl::StrCat(folder.path(), "/", name));
}

}  // namespace

absl::Status LeaseFolder::PutOrder(const NodeOrder& order) const {
  const std::string text = NodeOrderToText(order);
  if (text.size() > kMostOrderBytes) {
    return absl::InvalidArgumentError(
        absl::StrCat(path(), "/", kOrder, ": would be larger than ", kMostOrderBytes, " bytes"));
  }
  return folder_.Put(kOrder, text);
}

absl::Status LeaseFolder::Stop() const { return folder_.Put(kStop, ""); }

absl::StatusOr<NodeClaim> LeaseFolder::Claim() const {
  return ReadForm(folder_, kClaim, NodeClaimFromText);
}

absl::StatusOr<NodeProof> LeaseFolder::Proof() const {
  return ReadForm(folder_, kProof, NodeProofFromText);
}

absl::StatusOr<NodeEnd> LeaseFolder::End() const {
  return ReadForm(folder_, kEnd, NodeEndFromText);
}

absl::StatusOr<std::string> LeaseFolder::Records(int64_t offset, size_t most) const {
  ASSIGN_OR_RETURN(const int64_t size, RecordsSize());
  if (size > kMostRecordBytes) {
    return absl::InvalidArgumentError(absl::StrCat(path(), "/", kRecords, ": is larger than ",
                                                   kMostRecordBytes, " bytes"));
  }
  if (offset >= size) return std::string();
  return folder_.ReadAt(kRecords, offset, most);
}

absl::StatusOr<int64_t> LeaseFolder::RecordsSize() const {
  const absl::StatusOr<int64_t> size = folder_.SizeOf(kRecords);
  if (absl::IsNotFound(size.status())) return 0;
  return size;
}

absl::StatusOr<Fd> LeaseFolder::OpenLog(const std::string& log) const {
  if (!IsLogName(log)) return NoName(log, "log");
  ASSIGN_OR_RETURN(const Folder logs, folder_.OpenFolder(kLogs));
  return logs.OpenFile(log);
}

absl::StatusOr<std::string> LeaseFolder::OrderText() const {
  return folder_.Read(kOrder, kMostOrderBytes);
}

absl::StatusOr<NodeOrder> LeaseFolder::Order() const {
  ASSIGN_OR_RETURN(const std::string text, OrderText());
  return NodeOrderFromText(text, absl::StrCat(path(), "/", kOrder));
}

absl::Status LeaseFolder::PutClaim(const NodeClaim& claim) const {
  const std::string text = NodeClaimToText(claim);
  const absl::Status status = folder_.PutNew(kClaim, text);
  if (!absl::IsAlreadyExists(status)) return status;
  const absl::StatusOr<std::string> present = folder_.Read(kClaim, kMostFormBytes);
  return present.ok() && *present == text ? absl::OkStatus() : status;
}

absl::Status LeaseFolder::PutProof(const NodeProof& proof) const {
  return folder_.Put(kProof, NodeProofToText(proof));
}

absl::Status LeaseFolder::PutEnd(const NodeEnd& end) const {
  return folder_.Put(kEnd, NodeEndToText(end));
}

absl::Status LeaseFolder::WriteRecords(int64_t offset, std::string_view bytes) const {
  if (offset + static_cast<int64_t>(bytes.size()) > kMostRecordBytes) {
    return absl::ResourceExhaustedError(absl::StrCat(
        path(), "/", kRecords, ": would be larger than ", kMostRecordBytes, " bytes"));
  }
  return folder_.WriteAt(kRecords, offset, bytes);
}

absl::Status LeaseFolder::PutLog(const std::string& log, const ByteSource& source,
                                 int64_t most) const {
  if (!IsLogName(log)) return NoName(log, "log");
  ASSIGN_OR_RETURN(const Folder logs, folder_.MakeFolder(kLogs));
  return logs.PutFrom(log, source, most);
}

absl::StatusOr<bool> LeaseFolder::stopped() const { return folder_.Has(kStop); }

absl::StatusOr<bool> LeaseFolder::IsThere() const { return folder_.IsStill(leases_, name_); }

absl::StatusOr<Spool> Spool::Make(const std::string& path) {
  ASSIGN_OR_RETURN(Folder folder, Folder::Make(path));
  ASSIGN_OR_RETURN(Folder artefacts, folder.MakeFolder("artefacts"));
  ASSIGN_OR_RETURN(Folder leases, folder.MakeFolder("leases"));
  return OfFolders(std::move(folder), std::move(artefacts), std::move(leases));
}

absl::StatusOr<Spool> Spool::Open(const std::string& path) {
  ASSIGN_OR_RETURN(Folder folder, Folder::Open(path));
  ASSIGN_OR_RETURN(Folder artefacts, folder.OpenFolder("artefacts"));
  ASSIGN_OR_RETURN(Folder leases, folder.OpenFolder("leases"));
  return OfFolders(std::move(folder), std::move(artefacts), std::move(leases));
}

absl::StatusOr<Spool> Spool::OfFolders(Folder folder, Folder artefacts, Folder leases) {
  for (const Folder* part : {&folder, &artefacts, &leases}) {
    RETURN_IF_ERROR(part->CheckPrivate());
  }
  return Spool(std::move(folder), std::move(artefacts), std::move(leases));
}

absl::Status Spool::PutEpoch(const std::string& epoch) const { return folder_.Put(kEpoch, epoch); }

absl::StatusOr<std::string> Spool::Epoch() const { return folder_.Read(kEpoch, kMostEpochBytes); }

absl::StatusOr<LeaseFolder> Spool::MakeLease(const std::string& name) const {
  if (!IsLeaseName(name)) return NoName(name, "lease folder");
  ASSIGN_OR_RETURN(Folder leases, folder_.OpenFolder("leases"));
  ASSIGN_OR_RETURN(Folder folder, leases.MakeNewFolder(name));
  return LeaseFolder(name, std::move(leases), std::move(folder));
}

absl::StatusOr<LeaseFolder> Spool::OpenLease(const std::string& name) const {
  if (!IsLeaseName(name)) return NoName(name, "lease folder");
  ASSIGN_OR_RETURN(Folder leases, folder_.OpenFolder("leases"));
  ASSIGN_OR_RETURN(Folder folder, leases.OpenFolder(name));
  return LeaseFolder(name, std::move(leases), std::move(folder));
}

absl::Status Spool::RemoveLease(const std::string& name) const {
  if (!IsLeaseName(name)) return NoName(name, "lease folder");
  return leases_.RemoveFolder(name);
}

absl::StatusOr<std::vector<std::string>> Spool::Leases() const { return leases_.Names(kMostNames); }

absl::Status Spool::RemoveLeases() const {
  ASSIGN_OR_RETURN(const std::vector<std::string> names, Leases());
  absl::Status first;
  for (const std::string& name : names) {
    absl::Status status = leases_.RemoveFolder(name);
    if (absl::IsInvalidArgument(status)) status = leases_.Remove(name);
    first.Update(status);
  }
  return first;
}

absl::StatusOr<bool> Spool::HasArtefact(const std::string& digest) const {
  if (!IsDigest(digest)) return NoName(digest, "packed submission");
  return artefacts_.Has(ArtefactName(digest));
}

absl::StatusOr<Fd> Spool::OpenArtefact(const std::string& digest) const {
  if (!IsDigest(digest)) return NoName(digest, "packed submission");
  return artefacts_.OpenFile(ArtefactName(digest));
}

std::string Spool::ArtefactPath(const std::string& digest) const {
  return artefacts_.path() + "/" + ArtefactName(digest);
}

absl::Status Spool::PutArtefact(const std::string& digest, const ByteSource& source,
                                int64_t most) const {
  if (!IsDigest(digest)) return NoName(digest, "packed submission");
  return artefacts_.PutFrom(ArtefactName(digest), source, most);
}

absl::Status Spool::RemoveArtefact(const std::string& digest) const {
  if (!IsDigest(digest)) return NoName(digest, "packed submission");
  return artefacts_.Remove(ArtefactName(digest));
}

absl::StatusOr<std::vector<std::string>> Spool::Artefacts() const {
  ASSIGN_OR_RETURN(const std::vector<std::string> names, artefacts_.Names(kMostNames));
  std::vector<std::string> digests;
  for (const std::string& name : names) {
    if (name.size() > 64 && IsDigest(name.substr(0, 64)) && name.substr(64) == kArtefactEnding) {
      digests.push_back(name.substr(0, 64));
    }
  }
  return digests;
}

absl::Status Spool::Probe() const {
  constexpr char kProbe[] = "probe";
  // Larger than what a full disk may still take in a file's own entry.
  const std::string text(64u << 10, 'p');
  RETURN_IF_ERROR(folder_.Put(kProbe, text));
  ASSIGN_OR_RETURN(const std::string read, folder_.Read(kProbe, text.size()));
  if (read != text) {
    return absl::UnavailableError(absl::StrCat(path(), "/", kProbe, ": reads other than written"));
  }
  return folder_.Remove(kProbe);
}

}  // namespace myograde::server
