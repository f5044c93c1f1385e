#include "server/executor/slurm/lease_reader.h"

#include <algorithm>
#include <utility>
#include <variant>

#include <absl/strings/str_cat.h>

#include "server/executor/slurm/log_taker.h"

namespace myograde::server {
namespace {

constexpr size_t kRecordsBytes = 1 << 20;
constexpr int kMostPieces = 4;
// As of a local runner's.
constexpr size_t kMaxRecordBytes = 256 << 10;

// Whether trying again can help.
bool MayPass(const absl::Status& status) {
  return absl::IsNotFound(status) || absl::IsUnavailable(status);
}

}  // namespace

LeaseReader::LeaseReader(std::string name, std::string logs)
    : name_(std::move(name)), logs_(std::move(logs)) {}

LeaseNews LeaseReader::Look(const Spool& spool, absl::Duration now) {
  LeaseNews news;
  if (broken_ || delivered_) return news;
  const absl::StatusOr<LeaseFolder> folder = spool.OpenLease(name_);
  if (!folder.ok()) return news;
  news.looked = true;
  ReadClaim(*folder, news);
  if (trusted_ && news.broken.empty()) ReadRecords(*folder, now, news);
  // A node that does not play says so without a proof that counts.
  if (claim_.has_value() && news.broken.empty()) ReadEnd(*folder, now, news);
  broken_ = !news.broken.empty();
  return news;
}

void LeaseReader::ReadClaim(const LeaseFolder& folder, LeaseNews& news) {
  if (!claim_.has_value()) {
    absl::StatusOr<NodeClaim> claim = folder.Claim();
    if (absl::IsNotFound(claim.status())) return;
    if (!claim.ok()) {
      news.looked = !absl::IsUnavailable(claim.status());
      if (news.looked) news.broken = std::string(claim.status().message());
      return;
    }
    news.claim = claim_ = *std::move(claim);
  }
  if (proved_) return;
  absl::StatusOr<NodeProof> proof = folder.Proof();
  if (absl::IsNotFound(proof.status())) return;
  if (!proof.ok()) {
    news.looked = !absl::IsUnavailable(proof.status());
    if (news.looked) news.broken = std::string(proof.status().message());
  } else if (proof->node != claim_->node) {
    news.broken = absl::StrCat("the node ", claim_->node, " took the lease, and ", proof->node,
                               " proved itself for it");
  } else {
    proved_ = true;
    news.proof = *std::move(proof);
  }
}

void LeaseReader::Bear(const std::string& why, absl::Duration now, LeaseNews& news) {
  if (!trouble_since_.has_value()) trouble_since_ = now;
  if (now - *trouble_since_ >= kPatience) news.broken = why;
}

void LeaseReader::ReadRecords(const LeaseFolder& folder, absl::Duration now, LeaseNews& news) {
  for (int pieces = 0; pieces < kMostPieces; ++pieces) {
    const bool more = ReadBytes(folder, now, news);
    if (!lines_.empty() && news.broken.empty()) TakeLines(folder, now, news);
    if (!more || !news.broken.empty()) return;
  }
}

bool LeaseReader::ReadBytes(const LeaseFolder& folder, absl::Duration now, LeaseNews& news) {
  // What can't be taken yet must not pile up.
  if (lines_.size() > kMaxRecordBytes) return false;
  const absl::StatusOr<std::string> piece = folder.Records(offset_, kRecordsBytes);
  if (!piece.ok()) {
    news.looked = news.looked && !absl::IsUnavailable(piece.status());
    if (!absl::IsUnavailable(piece.status())) news.broken = std::string(piece.status().message());
    return false;
  }
  // A shared file can be longer than what has arrived of it, and shows zeros there.
  const size_t sound = std::min(piece->size(), piece->find('\0'));
  const std::string_view bytes = std::string_view(*piece).substr(0, sound);
  lines_.append(bytes);
  hash_.Update(bytes);
  offset_ += static_cast<int64_t>(sound);
  if (sound == piece->size()) {
    if (sound > 0) trouble_since_.reset();
    return sound == kRecordsBytes;
  }
  Bear(absl::StrCat("the records of lease ", name_, " have zeros at byte ", offset_), now, news);
  return false;
}

void LeaseReader::TakeLines(const LeaseFolder& folder, absl::Duration now, LeaseNews& news) {
  size_t start = 0;
  for (size_t end; (end = lines_.find('\n', start)) != std::string::npos; start = end + 1) {
    const std::string_view line = std::string_view(lines_).substr(start, end - start);
    absl::StatusOr<LeaseRecord> record = LeaseRecordFromLine(line);
    if (!record.ok() || last_.has_value() || line.size() > kMaxRecordBytes) {
      news.broken = absl::StrCat("the runner of lease ", name_, " printed ",
                                 last_.has_value() ? "a record after its last one"
                                 : record.ok() ? "a record that is too long"
                                               : absl::StrCat("what is no record: ",
                                                              record.status().message()));
      break;
    }
    const auto* facts = std::get_if<EpisodeFacts>(&*record);
    if (facts != nullptr && !facts->log.sha256.empty() && !logs_.empty()) {
      const absl::Status taken = TakeLog(folder, facts->log, logs_, name_);
      if (MayPass(taken)) {
        Bear(std::string(taken.message()), now, news);
        break;
      }
      if (!taken.ok()) {
        news.broken = std::string(taken.message());
        break;
      }
      trouble_since_.reset();
    }
    if (auto* end = std::get_if<LeaseEndRecord>(&*record)) {
      last_ = std::move(*end);
    } else {
      news.records.push_back(*std::move(record));
    }
  }
  lines_.erase(0, start);
  if (lines_.size() > kMaxRecordBytes && lines_.find('\n') == std::string::npos) {
    news.broken = absl::StrCat("the runner of lease ", name_, " printed a line without an end");
  }
}

void LeaseReader::ReadEnd(const LeaseFolder& folder, absl::Duration now, LeaseNews& news) {
  if (!end_.has_value()) {
    absl::StatusOr<NodeEnd> end = folder.End();
    if (absl::IsNotFound(end.status())) return;
    if (!end.ok()) {
      news.looked = news.looked && !absl::IsUnavailable(end.status());
      if (news.looked) news.broken = std::string(end.status().message());
      return;
    }
    end_ = *std::move(end);
  }
  // It did not play, or not to its end: what it recorded counts for nothing.
  const bool played = end_->why.empty();
  if (played && !trusted_) {
    if (!proved_) Bear("the node played the lease without a proof of itself", now, news);
    return;
  }
  if (played && (offset_ < end_->records_bytes || !lines_.empty())) {
    return Bear(absl::StrCat("of the ", end_->records_bytes, " bytes of records of lease ", name_,
                             " only ", offset_ - std::ssize(lines_), " could be read"),
                now, news);
  }
  if (played && (offset_ > end_->records_bytes || hash_.FinishHex() != end_->records_sha256)) {
    news.broken = absl::StrCat("the records of lease ", name_, " are not those that its node wrote");
    return;
  }
  delivered_ = true;
  if (played && last_.has_value()) news.records.push_back(*last_);
  news.end = end_;
}

}  // namespace myograde::server
