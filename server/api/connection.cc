#include "server/api/connection.h"

#include <fcntl.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdio>

#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "server/base/ip_address.h"

namespace myograde::server {
namespace {

constexpr size_t kPiece = 256 << 10;           // read from a connection at once
constexpr int64_t kTurn = 4 << 20;             // moved to the disk before others have a turn
constexpr int64_t kReserveStep = 4 << 20;      // of a body that has any length
constexpr int64_t kLookAtDisk = 16 << 20;      // written between two looks at what is free
constexpr int64_t kSmallUpload = 1 << 20;
constexpr int64_t kDrainBytes = int64_t{64} << 20;

absl::Status WriteToDisk(int fd, std::string_view bytes) {
  const absl::Status status = WriteAll(fd, bytes);
  if (status.ok()) return status;
  return absl::Status(status.code(), "the server's disk does not take the request");
}

absl::StatusOr<Fd> NewFile(const std::string& path) {
  Fd fd(::open(path.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
  if (!fd.valid()) return absl::ErrnoToStatus(errno, absl::StrCat(path, ": can't be made"));
  return fd;
}

// What a program on this host calls it: "localhost" or a loopback address; "" is HTTP/1.0.
bool IsLocalHost(const std::string& host) {
  const std::string name = host.ends_with('.') ? host.substr(0, host.size() - 1) : host;
  if (name.empty() || name == "localhost" || name.ends_with(".localhost")) return true;
  const bool v6 = name.front() == '[';
  const auto address = IpAddress::Parse(v6 ? name.substr(1, name.size() - 2) : name);
  return address.has_value() && address->IsLoopback();
}

}  // namespace

absl::StatusOr<std::string> Body::Text() const {
  if (!spooled()) return memory_;
  std::string text(static_cast<size_t>(size_), '\0');
  for (size_t done = 0; done < text.size();) {
    const ssize_t n = ReadAt(text.data() + done, text.size() - done, static_cast<int64_t>(done));
    if (n <= 0) return absl::UnavailableError("a request can't be read back from the server's disk");
    done += static_cast<size_t>(n);
  }
  return text;
}

ssize_t Body::ReadAt(char* to, size_t size, int64_t offset) const {
  if (spooled()) return ::pread(file_.get(), to, size, static_cast<off_t>(offset));
  return static_cast<ssize_t>(memory_.copy(to, size, static_cast<size_t>(offset)));
}

absl::Status Body::MoveTo(const std::string& path) {
  if (!spooled()) {
    ASSIGN_OR_RETURN(Fd fd, NewFile(path));
    const absl::Status written = WriteToDisk(fd.get(), memory_);
    if (!written.ok()) ::unlink(path.c_str());
    return written;
  }
  if (::rename(path_.c_str(), path.c_str()) != 0) {
    return absl::ErrnoToStatus(errno, absl::StrCat(path, ": can't be made"));
  }
  path_.clear();
  Drop();
  return absl::OkStatus();
}

absl::Status Body::Spool(const std::string& path) {
  ASSIGN_OR_RETURN(file_, NewFile(path));
  path_ = path;
  const absl::Status written = WriteToDisk(file_.get(), memory_);
  memory_ = std::string();
  return written;
}

absl::Status Body::Write(std::string_view bytes) {
  size_ += std::ssize(bytes);
  return WriteToDisk(file_.get(), bytes);
}

void Body::Drop() {
  if (spooled()) ::unlink(path_.c_str());
  path_.clear();
  memory_ = std::string();
  file_.reset();
  size_ = 0;
}

Connection::Connection(uint64_t id_given, Fd socket_given, std::shared_ptr<PeerLoad> peer_given,
                       std::unique_ptr<Transport> transport_given)
    : id(id_given),
      fd(std::move(socket_given)),
      peer(std::move(peer_given)),
      transport(transport_given != nullptr ? std::move(transport_given)
                                           : MakePlainTransport(fd.get())) {}

Connection::~Connection() {
  Forget();
  peer->unsent -= counted_unsent;
}

Connection::Next Connection::Work(WorkKind kind, const SpoolOptions& spool) {
  if (kind == WorkKind::kHandshake) return Handshake();
  return file.left > 0 ? ReadFile() : Spool(spool);
}

Connection::Next Connection::Handshake() {
  switch (transport->Handshake()) {
    case Transport::Outcome::kDone:
      return Next::kRead;
    case Transport::Outcome::kBlocked:
      return Next::kHandshake;
    default:
      break;
  }
  if (!transport->met_plain_http()) return Next::kClose;
  // Whoever forgot the s of https gets an answer that a browser or curl can show.
  transport = MakePlainTransport(fd.get());
  return Refuse(
      {400, "bad_request", "this port speaks HTTPS alone; write https:// in the address"});
}

Transport::Outcome Connection::ReadOnce(size_t most) {
  const size_t before = in.size();
  in.resize(before + most);
  const Transport::Moved read = transport->Read(in.data() + before, most);
  in.resize(before + read.bytes);
  moved += static_cast<int64_t>(read.bytes);
  return read.outcome;
}

bool Connection::Read(size_t most) {
  const Transport::Outcome outcome = ReadOnce(most);
  if (outcome == Transport::Outcome::kEnded) ended = true;
  // Nobody would be told of what is here already.
  if (outcome == Transport::Outcome::kDone && transport->pending() > 0) {
    ReadOnce(transport->pending());
  }
  return outcome == Transport::Outcome::kDone || outcome == Transport::Outcome::kBlocked;
}

bool Connection::Send() {
  while (unsent() > 0) {
    const Transport::Moved written = transport->Write(std::string_view(out).substr(sent));
    if (written.outcome == Transport::Outcome::kBlocked) break;
    if (written.outcome != Transport::Outcome::kDone) return false;
    sent += written.bytes;
    moved += static_cast<int64_t>(written.bytes);
  }
  if (unsent() == 0) {
    out.clear();
    sent = 0;
  } else if (sent >= kPiece * 4) {
    out.erase(0, sent);
    sent = 0;
  }
  return true;
}

Connection::Next Connection::Refuse(ApiError why) {
  error = std::move(why);
  drain_left = rule.most + kDrainBytes;
  if (head.has_value() && !head->chunked && parser.in_body()) {
    drain_left = std::min(drain_left, head->length - parser.size());
  }
  body.Drop();
  return Next::kRefuse;
}

Connection::Next Connection::StartBody(
    const std::function<BodyRule(const Request&)>& rule_of, const SpoolOptions& spool) {
  rule = rule_of(*head);
  parser.BeginBody(*head, rule.most);
  const bool known = head->content_type.empty() ||
                     std::find(rule.types.begin(), rule.types.end(), head->content_type) !=
                         rule.types.end();
  if (!known) {
    return Refuse({415, "bad_type",
                   absl::StrCat("this address takes a body of type ", rule.types.front(),
                                "; send it with the header Content-Type: ", rule.types.front())});
  }
  if (parser.error()) return Refuse(*parser.error());
  // Told before a byte of it is sent, where it could not be kept.
  if (head->length > kMemoryBody && !Reserve(head->length, spool)) return Refuse(error);
  if (head->expects_continue && in.empty()) out += "HTTP/1.1 100 Continue\r\n\r\n";
  return Next::kRead;
}

Connection::Next Connection::Feed(const std::function<BodyRule(const Request&)>& rule_of,
                                  const SpoolOptions& spool) {
  if (!head.has_value()) {
    if (!in.empty()) state = State::kReceiving;
    Request request;
    in.erase(0, parser.TakeHead(in, request));
    if (parser.error()) return Refuse(*parser.error());
    if (!parser.has_head()) return Next::kRead;
    head = std::move(request);
    // A browser that was led here by another site's name (DNS rebinding) has that name as its origin.
    const bool local = peer->peer.local || (peer->peer.proxy && head->forwarded_for.empty());
    if (local && !IsLocalHost(head->host)) {
      return Refuse({421, "bad_request",
                     absl::StrCat("this server is reached by localhost or an address of this host, not by \"",
                                  head->host, "\"; for other names give it a certificate, or a proxy and "
                                  "\"behind_proxy\" (server.json)")});
    }
    if (!head->has_body()) return Next::kServe;
    if (StartBody(rule_of, spool) == Next::kRefuse) return Next::kRefuse;
  }
  if (head->length > kMemoryBody || body.spooled()) return Next::kSpool;
  std::string piece;
  in.erase(0, parser.TakeBody(in, piece));
  body.Append(piece);
  if (parser.error()) return Refuse(*parser.error());
  if (parser.done()) return Next::kServe;
  // Over the network, who sends more than comes with the head is asked first who they are.
  return body.size() > kMemoryBody || peer->peer.network ? Next::kSpool : Next::kRead;
}

bool Connection::Reserve(int64_t bytes, const SpoolOptions& spool) {
  budget_ = spool.budget;
  switch (budget_->Take(*peer, bytes)) {
    case SpoolBudget::Answer::kTaken:
      reserved += bytes;
      return true;
    case SpoolBudget::Answer::kPeerFull:
      error = {429, "too_many",
               "what you are sending at once is more than one sender may; let other uploads of "
               "yours end first"};
      return false;
    case SpoolBudget::Answer::kAllFull:
      error = {429, "too_many",
               "the server is receiving as much as it can keep; try again in some minutes"};
      return false;
  }
  return false;
}

bool Connection::CheckDisk(const SpoolOptions& spool) {
  struct statvfs disk;
  if (::statvfs(spool.folder.c_str(), &disk) != 0) {
    error = {503, "store", "the server's folder for uploads can't be looked at; tell the organiser"};
    return false;
  }
  const auto free = static_cast<int64_t>(disk.f_bavail) * static_cast<int64_t>(disk.f_frsize);
  if (free - (reserved - body.size()) >= spool.disk_reserve) return true;
  error = {503, "store",
           "the server's disk is too full for this; try again later, or tell the organiser"};
  return false;
}

Connection::Next Connection::Spool(const SpoolOptions& options) {
  static std::atomic<int64_t> names = 0;
  if (!body.spooled()) {
    if (options.admit != nullptr) {
      if (std::optional<ApiError> refusal = options.admit(*this)) {
        return Refuse(*std::move(refusal));
      }
    }
    if (head->chunked && !Reserve(kReserveStep, options)) return Refuse(error);
    if (!CheckDisk(options)) return Refuse(error);
    const absl::Status made = body.Spool(absl::StrCat(options.folder, "/body-", ++names));
    if (!made.ok()) return Refuse({503, "store", std::string(made.message())});
  }
  std::string piece;
  for (int64_t turn = 0; turn < kTurn;) {
    piece.clear();
    in.erase(0, parser.TakeBody(in, piece));
    const int64_t after = body.size() + std::ssize(piece);
    if (after > reserved && !Reserve(kReserveStep, options)) return Refuse(error);
    if (body.size() / kLookAtDisk != after / kLookAtDisk && !CheckDisk(options)) {
      return Refuse(error);
    }
    if (const absl::Status written = body.Write(piece); !written.ok()) {
      return Refuse({503, "store", std::string(written.message())});
    }
    turn += std::ssize(piece);
    if (parser.error()) return Refuse(*parser.error());
    if (parser.done()) return Next::kServe;
    const size_t before = in.size();
    if (!Read(kPiece)) {
      return ended ? Refuse({400, "bad_request", "the request did not arrive whole; send it again"})
                   : Next::kClose;
    }
    if (in.size() == before) return Next::kRead;
  }
  // The others' turn. What is read already may be all that comes, so nobody waits for more.
  return Next::kSpool;
}

Connection::Next Connection::ReadFile() {
  const auto most = static_cast<size_t>(std::min<int64_t>(file.left, kPiece));
  out.resize(most);
  ssize_t n;
  do {
    n = ::pread(file.fd.get(), out.data(), most, static_cast<off_t>(file.at));
  } while (n < 0 && errno == EINTR);
  // The length was told already, so only the end of the connection tells that it is less.
  if (n <= 0) return Next::kClose;
  out.resize(static_cast<size_t>(n));
  file.at += n;
  file.left -= n;
  return Next::kSend;
}

void Connection::Forget() {
  file = FilePart();
  stream.reset();
  if (out.empty()) out.shrink_to_fit();
  body.Drop();
  if (reserved > 0) budget_->Give(*peer, reserved);
  reserved = 0;
  head.reset();
  parser = RequestParser();
  rule = BodyRule();
  admitted = false;
  upload.reset();
}

Peer Connection::Asker() const {
  Peer asker = peer->peer;
  if (!asker.proxy || !head.has_value()) return asker;
  const std::optional<IpAddress> address = IpAddress::Parse(head->forwarded_for);
  if (address.has_value()) asker.key = address->Key();
  return asker;
}

WorkKind Connection::work() const {
  if (!rule.upload) return WorkKind::kServe;
  return body.size() <= kSmallUpload ? WorkKind::kSmallUpload : WorkKind::kLargeUpload;
}

}  // namespace myograde::server
