// One connection, told from its first byte to its last by a coroutine (Run): a handshake, and then
// requests, each of which is read, answered by a worker, and its answer sent. Whoever does nothing,
// dribbles or does not read costs a descriptor and at most some hundred kilobytes, and has deadlines
// and a least speed, which CheckClock sees to.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>

#include <absl/time/time.h>
#include <boost/asio/awaitable.hpp>
#include <boost/asio/buffer.hpp>
#include <boost/asio/generic/stream_protocol.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <boost/asio/steady_timer.hpp>

#include "server/http/body.h"
#include "server/http/peer.h"
#include "server/http/request.h"
#include "server/http/response.h"
#include "server/http/work_queue.h"

namespace myograde::server {

class HttpServer;
struct TlsContext;

inline const ApiError kStoppingError = {503, "stopping",
                                        "the daemon is stopping; nothing was changed"};

// For the thread of its executor; what a worker may touch is said.
class Connection {
 public:
  enum class State { kHandshake, kIdle, kReceiving, kAnswering, kStreaming, kRefused };
  using Socket = boost::asio::generic::stream_protocol::socket;

  // `server` must outlive it. `tls`: nullptr for plain HTTP.
  Connection(uint64_t id, Socket socket, std::shared_ptr<PeerLoad> peer,
             std::shared_ptr<TlsContext> tls, HttpServer& server);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  // Serves it until it ends. It must exist as long as this runs.
  boost::asio::awaitable<void> Run();
  // Ends what is late or too slow.
  void CheckClock(absl::Duration now);
  // Makes Run end, soon.
  void Close();
  // The same for all at once, when the server stops.
  void CloseForStop();

  const uint64_t id;
  const std::shared_ptr<PeerLoad> peer;

  State state() const { return state_; }
  absl::Duration since() const { return since_; }  // in its state, or in its stream; monotonic
  bool at_work() const { return at_work_; }        // a worker has it, or will
  bool receives_body() const { return receives_body_; }
  bool has_input() const { return !in_.empty(); }  // of which nothing was read
  bool is_new() const { return new_; }             // its first request may be there already

  // A worker that has the connection may use what follows.
  int fd() { return socket_.native_handle(); }
  // Whose request it is: the peer, or whom a proxy forwards.
  Peer Asker() const;
  std::optional<Request> head;
  bool admitted = false;         // its request was counted against its sender's limits
  std::shared_ptr<void> upload;  // its place among the uploads of its sender's team; given back with it
  Body body;

 private:
  template <typename T>
  using Awaitable = boost::asio::awaitable<T>;

  // Each of these is false once the connection is to end.
  Awaitable<bool> Handshake();
  Awaitable<bool> ReadRequest();
  Awaitable<bool> ReadHead();
  Awaitable<bool> ReadBody();
  Awaitable<bool> Answer();
  Awaitable<bool> SendFile(FilePart& file);
  // What one read gives.
  Awaitable<std::tuple<boost::system::error_code, size_t>> ReadSome(
      boost::asio::mutable_buffer buffer);
  // Waits for bytes, which follow those in in_, at most `most`.
  Awaitable<bool> Receive(size_t most);
  Awaitable<bool> Send(std::string_view bytes);

  // Sends what comes of a stream, until it or the connection ends.
  Awaitable<void> SendStream(Stream& stream);
  // Reads until the other end hangs up.
  Awaitable<void> DropInput();
  // Tells the other end the refusal, and reads what is left of the request for it to hear that.
  Awaitable<void> Refuse();
  Awaitable<void> SayGoodbye();
  Awaitable<void> OnWorker(WorkKind kind, const std::function<void()>& work);

  // These are false. The request is refused, after which the connection ends; `read_on`: its sender
  // may still be sending.
  bool Fail(ApiError why, bool read_on = true);
  // No more of a request will come.
  bool FailUnfinished();

  void Enter(State state);
  std::optional<ApiError> CheckHost() const;
  std::optional<ApiError> BeginBody();
  std::optional<ApiError> CountBody();
  void UncountBody();
  WorkKind KindOfWork() const;
  int64_t LeftToRead() const;
  bool TooSlow(absl::Duration now);
  void Forget();

  HttpServer& server_;
  Socket socket_;
  std::shared_ptr<TlsContext> tls_context_;
  std::unique_ptr<boost::asio::ssl::stream<Socket&>> tls_;  // nullptr: plain HTTP
  boost::asio::steady_timer timer_;                         // of a stream

  State state_ = State::kIdle;
  bool at_work_ = false;
  bool receives_body_ = false;
  bool new_ = true;
  bool closed_ = false;   // by Close
  bool ended_ = false;    // the other end sends no more
  bool expired_ = false;  // its request took too long to arrive
  std::string in_;        // what came and was not read yet
  std::string buffer_;    // for what comes
  std::optional<ApiError> refusal_;
  int64_t left_to_read_ = 0;  // bytes of a refused request
  int64_t unsent_ = 0;        // bytes of the peer's that are of this connection
  RequestParser parser_;
  BodyRule rule_;

  absl::Duration since_;
  absl::Duration deadline_;
  absl::Duration waiting_since_;  // for the other end
  absl::Duration waited_;         // for it, in this window
  int64_t moved_ = 0;             // bytes in this window
};

}  // namespace myograde::server
