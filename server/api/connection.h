// One connection: what has come, what is to be sent, and how far its request is.
// The gate owns it and lends it to one worker at a time.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/fd.h"
#include "server/api/http_request.h"
#include "server/api/http_response.h"
#include "server/api/peer.h"
#include "server/api/transport.h"
#include "server/api/work_queue.h"

namespace myograde::server {

// Bodies up to here stay in memory, and only larger ones are kept on the disk.
inline constexpr int64_t kMemoryBody = 64 << 10;

// What an address takes for a body.
struct BodyRule {
  int64_t most = 0;                // bytes
  bool upload = false;             // has the time of uploads, and workers of their own
  std::vector<std::string> types;  // of content; the first is the one to tell
};

class Connection;

// Where bodies lie, and how much of them.
struct SpoolOptions {
  std::string folder;
  int64_t disk_reserve = 0;  // bytes of the disk that are left free
  SpoolBudget* budget = nullptr;
  // Asked before any of a large body goes to the disk: why its sender may not send it.
  std::function<std::optional<ApiError>(Connection&)> admit = nullptr;
};

// A body of a request: in memory, or in a file that goes with it.
class Body {
 public:
  Body() = default;
  ~Body() { Drop(); }
  Body(const Body&) = delete;
  Body& operator=(const Body&) = delete;

  int64_t size() const { return size_; }
  // All of it; not for bodies of any length.
  absl::StatusOr<std::string> Text() const;
  // At most `size` bytes from `offset` on; 0 at its end, negative for errors.
  ssize_t ReadAt(char* to, size_t size, int64_t offset) const;
  // Puts it into a new file at `path`, on the spool's file system. It is read no more.
  absl::Status MoveTo(const std::string& path);

  void Append(std::string_view bytes) { memory_.append(bytes), size_ += std::ssize(bytes); }
  bool spooled() const { return !path_.empty(); }
  // From here on in a new file at `path`, with what is there already.
  absl::Status Spool(const std::string& path);
  absl::Status Write(std::string_view bytes);
  // Frees memory and disk.
  void Drop();

 private:
  std::string memory_;
  std::string path_;
  Fd file_;
  int64_t size_ = 0;
};

class Connection {
 public:
  // kStreaming: all of a stream that is there was sent, and more is to come.
  enum class State { kHandshake, kIdle, kReceiving, kAnswering, kStreaming, kRefused };
  // What is to be done for it next.
  enum class Next { kHandshake, kRead, kSend, kServe, kSpool, kRefuse, kClose };

  // `transport_given`: what is spoken over the socket; nullptr: bytes as they are.
  Connection(uint64_t id_given, Fd socket_given, std::shared_ptr<PeerLoad> peer_given,
             std::unique_ptr<Transport> transport_given = nullptr);
  ~Connection();

  // Does what a worker has to do other than answering, until it is the others' turn.
  Next Work(WorkKind kind, const SpoolOptions& spool);
  // Goes on with the transport's handshake. kHandshake: it must wait for the other end; kRead once
  // it is done; kRefuse (with `error`) or kClose.
  Next Handshake();

  // Goes on with the bytes in `in`. kRead, kServe, kSpool or kRefuse (with `error`).
  Next Feed(const std::function<BodyRule(const Request&)>& rule_of, const SpoolOptions& spool);
  // Reads once into `in`, at most `most` bytes. False: the other end has hung up.
  bool Read(size_t most);
  // Sends what it takes without waiting. False: it takes nothing any more.
  bool Send();
  size_t unsent() const { return out.size() - sent; }
  // Moves a piece of a large body to the disk. As Feed, or kClose.
  Next Spool(const SpoolOptions& options);
  // Its request can't be taken: kRefuse, with what is still to be read of it for its sender to
  // hear why.
  Next Refuse(ApiError why);
  // Fills `out`, all of which was sent, with the next piece of the file. kSend, or kClose if it
  // can't be read.
  Next ReadFile();
  // Makes ready for the next request; what has come of it stays.
  void Forget();
  WorkKind work() const;
  // Whose request it is: the peer, or whom a proxy forwards.
  Peer Asker() const;

  const uint64_t id;
  const Fd fd;
  const std::shared_ptr<PeerLoad> peer;
  std::unique_ptr<Transport> transport;

  State state = State::kIdle;
  bool lent = false;         // to a worker, or waits for one
  bool ended = false;        // the other end sends no more
  bool close_after = false;  // its answer
  bool counted = false;      // among its peer's bodies
  bool admitted = false;     // its request was counted against its sender's limits
  std::shared_ptr<void> upload;  // its place among the uploads of its sender's team; given back with it
  std::string in;
  std::string out;
  size_t sent = 0;
  int64_t counted_unsent = 0;  // among its peer's
  FilePart file;               // follows `out`
  std::unique_ptr<Stream> stream;  // of the answer; nullptr: it ends

  // The request.
  RequestParser parser;
  std::optional<Request> head;
  BodyRule rule;
  Body body;
  int64_t reserved = 0;  // bytes of the spool's budget
  ApiError error;
  Next next = Next::kRead;  // what the worker found

  // Clocks: monotonic.
  absl::Duration since;          // in its state
  absl::Duration deadline;
  absl::Duration waiting_since;  // for the other end
  absl::Duration waited;         // for it, in this window
  int64_t moved = 0;             // bytes in this window
  int64_t drain_left = 0;        // bytes to be dropped, those in `in` among them

 private:
  Transport::Outcome ReadOnce(size_t most);
  Next StartBody(const std::function<BodyRule(const Request&)>& rule_of,
                 const SpoolOptions& spool);
  bool Reserve(int64_t bytes, const SpoolOptions& spool);
  bool CheckDisk(const SpoolOptions& spool);
  SpoolBudget* budget_ = nullptr;
};

}  // namespace myograde::server
