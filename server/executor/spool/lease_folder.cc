#include "server/executor/spool/lease_folder.h"

#include <utility>

#include <absl/strings/str_cat.h>

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
  const absl::StatusOr<std::string> text = folder.Read(name, kMostFormBytes);
  if (!text.ok()) return text.status();
  return parse(*text, absl::StrCat(folder.path(), "/", name));
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
  const absl::StatusOr<int64_t> size = RecordsSize();
  if (!size.ok()) return size.status();
  if (*size > kMostRecordBytes) {
    return absl::InvalidArgumentError(absl::StrCat(path(), "/", kRecords, ": is larger than ",
                                                   kMostRecordBytes, " bytes"));
  }
  if (offset >= *size) return std::string();
  return folder_.ReadAt(kRecords, offset, most);
}

absl::StatusOr<int64_t> LeaseFolder::RecordsSize() const {
  const absl::StatusOr<int64_t> size = folder_.SizeOf(kRecords);
  if (absl::IsNotFound(size.status())) return 0;
  return size;
}

absl::StatusOr<Fd> LeaseFolder::OpenLog(const std::string& log) const {
  if (!IsLogName(log)) return NoName(log, "log");
  const absl::StatusOr<Folder> logs = folder_.OpenFolder(kLogs);
  if (!logs.ok()) return logs.status();
  return logs->OpenFile(log);
}

absl::StatusOr<std::string> LeaseFolder::OrderText() const {
  return folder_.Read(kOrder, kMostOrderBytes);
}

absl::StatusOr<NodeOrder> LeaseFolder::Order() const {
  const absl::StatusOr<std::string> text = OrderText();
  if (!text.ok()) return text.status();
  return NodeOrderFromText(*text, absl::StrCat(path(), "/", kOrder));
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
  const absl::StatusOr<Folder> logs = folder_.MakeFolder(kLogs);
  if (!logs.ok()) return logs.status();
  return logs->PutFrom(log, source, most);
}

absl::StatusOr<bool> LeaseFolder::stopped() const { return folder_.Has(kStop); }

absl::StatusOr<bool> LeaseFolder::IsThere() const { return folder_.IsStill(leases_, name_); }

absl::StatusOr<Spool> Spool::Make(const std::string& path) {
  absl::StatusOr<Folder> folder = Folder::Make(path);
  if (!folder.ok()) return folder.status();
  absl::StatusOr<Folder> artefacts = folder->MakeFolder("artefacts");
  if (!artefacts.ok()) return artefacts.status();
  absl::StatusOr<Folder> leases = folder->MakeFolder("leases");
  if (!leases.ok()) return leases.status();
  return OfFolders(*std::move(folder), *std::move(artefacts), *std::move(leases));
}

absl::StatusOr<Spool> Spool::Open(const std::string& path) {
  absl::StatusOr<Folder> folder = Folder::Open(path);
  if (!folder.ok()) return folder.status();
  absl::StatusOr<Folder> artefacts = folder->OpenFolder("artefacts");
  if (!artefacts.ok()) return artefacts.status();
  absl::StatusOr<Folder> leases = folder->OpenFolder("leases");
  if (!leases.ok()) return leases.status();
  return OfFolders(*std::move(folder), *std::move(artefacts), *std::move(leases));
}

absl::StatusOr<Spool> Spool::OfFolders(Folder folder, Folder artefacts, Folder leases) {
  for (const Folder* part : {&folder, &artefacts, &leases}) {
    if (absl::Status status = part->CheckPrivate(); !status.ok()) return status;
  }
  return Spool(std::move(folder), std::move(artefacts), std::move(leases));
}

absl::Status Spool::PutEpoch(const std::string& epoch) const { return folder_.Put(kEpoch, epoch); }

absl::StatusOr<std::string> Spool::Epoch() const { return folder_.Read(kEpoch, kMostEpochBytes); }

absl::StatusOr<LeaseFolder> Spool::MakeLease(const std::string& name) const {
  if (!IsLeaseName(name)) return NoName(name, "lease folder");
  absl::StatusOr<Folder> leases = folder_.OpenFolder("leases");
  if (!leases.ok()) return leases.status();
  absl::StatusOr<Folder> folder = leases->MakeNewFolder(name);
  if (!folder.ok()) return folder.status();
  return LeaseFolder(name, *std::move(leases), *std::move(folder));
}

absl::StatusOr<LeaseFolder> Spool::OpenLease(const std::string& name) const {
  if (!IsLeaseName(name)) return NoName(name, "lease folder");
  absl::StatusOr<Folder> leases = folder_.OpenFolder("leases");
  if (!leases.ok()) return leases.status();
  absl::StatusOr<Folder> folder = leases->OpenFolder(name);
  if (!folder.ok()) return folder.status();
  return LeaseFolder(name, *std::move(leases), *std::move(folder));
}

absl::Status Spool::RemoveLease(const std::string& name) const {
  if (!IsLeaseName(name)) return NoName(name, "lease folder");
  return leases_.RemoveFolder(name);
}

absl::StatusOr<std::vector<std::string>> Spool::Leases() const { return leases_.Names(kMostNames); }

absl::Status Spool::RemoveLeases() const {
  const absl::StatusOr<std::vector<std::string>> names = Leases();
  if (!names.ok()) return names.status();
  absl::Status first;
  for (const std::string& name : *names) {
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
  const absl::StatusOr<std::vector<std::string>> names = artefacts_.Names(kMostNames);
  if (!names.ok()) return names.status();
  std::vector<std::string> digests;
  for (const std::string& name : *names) {
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
  if (absl::Status status = folder_.Put(kProbe, text); !status.ok()) return status;
  const absl::StatusOr<std::string> read = folder_.Read(kProbe, text.size());
  if (!read.ok()) return read.status();
  if (*read != text) {
    return absl::UnavailableError(absl::StrCat(path(), "/", kProbe, ": reads other than written"));
  }
  return folder_.Remove(kProbe);
}

}  // namespace myograde::server
