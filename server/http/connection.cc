#include "server/http/connection.h"

#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <utility>

#include <boost/asio/as_tuple.hpp>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/experimental/awaitable_operators.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/use_awaitable.hpp>

#include "protocol/base/clock.h"
#include "server/http/http_server.h"

namespace myograde::server {
namespace {

namespace asio = boost::asio;
using asio::awaitable;
// clang-tidy does not see where an operator is used.
using asio::experimental::awaitable_operators::operator||;  // NOLINT(misc-unused-using-decls)
using boost::system::error_code;

constexpr auto kAwait = asio::as_tuple(asio::use_awaitable);
constexpr size_t kHeadPiece = 4 << 10;   // read at once of heads
constexpr size_t kBodyPiece = 64 << 10;  // of bodies in memory
constexpr size_t kDiskPiece = 256 << 10;  // moved to or from the disk at once
// Answers that a peer has not read yet; more is asked for in vain.
constexpr int64_t kMaxUnsent = int64_t{64} << 20;
constexpr absl::Duration kGoodbye = absl::Seconds(1);

absl::Duration MonotonicNow() { return SystemClock().Monotonic(); }

}  // namespace

Connection::Connection(uint64_t id_given, Socket socket, std::shared_ptr<PeerLoad> peer_given,
                       std::shared_ptr<TlsContext> tls, HttpServer& server)
    : id(id_given),
      peer(std::move(peer_given)),
      body(server.spool_, *peer),
      server_(server),
      socket_(std::move(socket)),
      tls_context_(std::move(tls)),
      timer_(socket_.get_executor()) {
  Enter(tls_context_ == nullptr ? State::kIdle : State::kHandshake);
}

Connection::~Connection() {
  UncountBody();
  peer->unsent -= unsent_;
}

awaitable<void> Connection::Run() {
  // GCC 12 evaluates both sides of && and || where one of them awaits.
  bool goes_on = true;
  if (tls_context_ != nullptr) goes_on = co_await Handshake();
  while (goes_on && !closed_) {
    goes_on = co_await ReadRequest();
    if (goes_on) goes_on = co_await Answer();
  }
  if (refusal_.has_value() && !closed_) co_await Refuse();
}

awaitable<bool> Connection::Handshake() {
  tls_ = std::make_unique<asio::ssl::stream<Socket&>>(socket_, tls_context_->context);
  const auto handshake = [this]() -> awaitable<error_code> {
    const auto [error] = co_await tls_->async_handshake(asio::ssl::stream_base::server, kAwait);
    co_return error;
  };
  const error_code error =
      co_await asio::co_spawn(server_.handshakes_, handshake, asio::use_awaitable);
  if (!error) {
    Enter(State::kIdle);
    co_return true;
  }
  tls_.reset();
  const bool plain_http = error.category() == asio::error::get_ssl_category() &&
                          ERR_GET_REASON(static_cast<unsigned long>(error.value())) ==
                              SSL_R_HTTP_REQUEST;
  // Whoever forgot the s of https gets an answer that a browser or curl can show.
  co_return plain_http && Fail({400, "bad_request",
                                "this port speaks only HTTPS; write https:// in the address"});
}

awaitable<bool> Connection::ReadRequest() {
  if (!co_await ReadHead()) co_return FailUnfinished();
  if (std::optional<ApiError> wrong = CheckHost()) co_return Fail(*std::move(wrong));
  if (!head->has_body()) co_return true;
  if (std::optional<ApiError> wrong = BeginBody()) co_return Fail(*std::move(wrong));
  if (head->expects_continue && in_.empty()) {
    if (!co_await Send("HTTP/1.1 100 Continue\r\n\r\n")) co_return false;
  }
  if (!co_await ReadBody()) co_return FailUnfinished();
  UncountBody();
  co_return true;
}

awaitable<bool> Connection::ReadHead() {
  for (;;) {
    if (!in_.empty()) {
      if (state_ == State::kIdle) Enter(State::kReceiving);
      Request request;
      in_.erase(0, parser_.TakeHead(in_, request));
      if (parser_.error()) co_return Fail(*parser_.error());
      if (parser_.has_head()) {
        head = std::move(request);
        co_return true;
      }
    }
    if (!co_await Receive(kHeadPiece)) co_return false;
  }
}

awaitable<bool> Connection::ReadBody() {
  bool to_disk = head->length > kMemoryBody;
  for (;;) {
    std::string piece;
    in_.erase(0, parser_.TakeBody(in_, piece));
    std::optional<ApiError> wrong;
    if (!to_disk) {
      body.Append(piece);
    } else {
      const std::function<void()> write = [&] {
        if (!body.spooled()) wrong = server_.hooks_.admit(*this);
        if (!wrong.has_value()) wrong = body.Write(piece);
      };
      co_await OnWorker(WorkKind::kDisk, write);
    }
    if (!wrong.has_value()) wrong = parser_.error();
    if (!wrong.has_value() && parser_.done()) co_return true;
    if (!wrong.has_value() && server_.stopping_) wrong = kStoppingError;
    if (!wrong.has_value()) wrong = CountBody();
    if (wrong.has_value()) co_return Fail(*std::move(wrong));
    // Over the network, who sends more than comes with the head is asked first who they are.
    to_disk = to_disk || body.size() > kMemoryBody || peer->peer.network;
    if (to_disk && !body.spooled()) continue;
    if (!co_await Receive(to_disk ? kDiskPiece : kBodyPiece)) co_return false;
  }
}

awaitable<bool> Connection::Answer() {
  if (peer->unsent > kMaxUnsent) {
    co_return Fail({429, "too_many", "read the answers that wait for you first"}, false);
  }
  Response response;
  const std::function<void()> serve = [&] {
    server_.Serve(*this, response);
    // The body's place is free before the client knows that it may send the next.
    body.Drop();
  };
  co_await OnWorker(KindOfWork(), serve);
  const bool last = !head->keep_alive || response.stream != nullptr;
  Enter(State::kAnswering);
  std::string bytes = response.TakeBytes(head->method == "HEAD", last);
  if (!co_await Send(bytes)) co_return false;
  bytes = std::string();
  if (!co_await SendFile(response.file)) co_return false;
  // Nothing is asked after a stream, but whoever hangs up is gone.
  if (response.stream != nullptr) co_await (SendStream(*response.stream) || DropInput());
  if (last) {
    co_await SayGoodbye();
    co_return false;
  }
  Forget();
  Enter(State::kIdle);
  server_.LetWaitingIn();
  co_return true;
}

awaitable<bool> Connection::SendFile(FilePart& file) {
  std::string piece;
  while (file.left > 0) {
    piece.resize(static_cast<size_t>(std::min<int64_t>(file.left, kDiskPiece)));
    ssize_t n = -1;
    const std::function<void()> read = [&] {
      do {
        n = ::pread(file.fd.get(), piece.data(), piece.size(), static_cast<off_t>(file.at));
      } while (n < 0 && errno == EINTR);
    };
    co_await OnWorker(WorkKind::kDisk, read);
    // The length was told already, so only the end of the connection tells that it is less.
    if (n <= 0) co_return false;
    if (!co_await Send(std::string_view(piece).substr(0, static_cast<size_t>(n)))) co_return false;
    file.at += n;
    file.left -= n;
  }
  co_return true;
}

awaitable<void> Connection::SendStream(Stream& stream) {
  while (!closed_) {
    std::optional<std::string> more;
    const std::function<void()> next = [&] { more = server_.Continue(*this, stream); };
    co_await OnWorker(WorkKind::kServe, next);
    Enter(State::kAnswering);
    if (!more.has_value()) co_return;
    if (!co_await Send(*more)) co_return;
    Enter(State::kStreaming);
    // Among those who may give way to others it has waited since the stream began.
    since_ = stream.began;
    deadline_ = stream.until;
    timer_.expires_after(absl::ToChronoNanoseconds(stream.every));
    co_await timer_.async_wait(kAwait);
  }
}

awaitable<void> Connection::DropInput() {
  std::array<char, 512> dropped;
  while (!closed_) {
    const auto [error, n] = co_await ReadSome(asio::buffer(dropped));
    if (error) co_return;
  }
}

// --- bytes ------------------------------------------------------------------------

awaitable<std::tuple<error_code, size_t>> Connection::ReadSome(asio::mutable_buffer buffer) {
  if (tls_ != nullptr) co_return co_await tls_->async_read_some(buffer, kAwait);
  co_return co_await socket_.async_read_some(buffer, kAwait);
}

awaitable<bool> Connection::Receive(size_t most) {
  if (closed_) co_return false;
  buffer_.resize(most);
  waiting_since_ = MonotonicNow();
  const auto [error, n] = co_await ReadSome(asio::buffer(buffer_));
  waited_ += std::max(MonotonicNow() - waiting_since_, absl::ZeroDuration());
  moved_ += static_cast<int64_t>(n);
  in_.append(buffer_, 0, n);
  new_ = false;
  if (error == asio::error::eof || error == asio::ssl::error::stream_truncated) ended_ = true;
  co_return !error && !closed_;
}

awaitable<bool> Connection::Send(std::string_view bytes) {
  peer->unsent += std::ssize(bytes);
  unsent_ += std::ssize(bytes);
  while (!bytes.empty() && !closed_) {
    const auto buffer = asio::buffer(bytes.data(), bytes.size());
    error_code error;
    size_t n = 0;
    waiting_since_ = MonotonicNow();
    if (tls_ != nullptr) {
      std::tie(error, n) = co_await tls_->async_write_some(buffer, kAwait);
    } else {
      std::tie(error, n) = co_await socket_.async_write_some(buffer, kAwait);
    }
    waited_ += std::max(MonotonicNow() - waiting_since_, absl::ZeroDuration());
    moved_ += static_cast<int64_t>(n);
    peer->unsent -= static_cast<int64_t>(n);
    unsent_ -= static_cast<int64_t>(n);
    bytes.remove_prefix(n);
    if (error) break;
  }
  co_return bytes.empty() && !closed_;
}

awaitable<void> Connection::OnWorker(WorkKind kind, const std::function<void()>& work) {
  at_work_ = true;
  const auto start = [&](auto handler) {
    // A job can be copied, which a handler can't.
    const auto done = std::make_shared<decltype(handler)>(std::move(handler));
    server_.queue_.Push({[work, done, executor = socket_.get_executor()] {
                           work();
                           asio::post(executor, [done] { std::move (*done)(); });
                         },
                         kind, Asker()});
  };
  co_await asio::async_initiate<const asio::use_awaitable_t<>, void()>(start, asio::use_awaitable);
  at_work_ = false;
}

// --- ends -------------------------------------------------------------------------

awaitable<void> Connection::Refuse() {
  server_.hooks_.count_refusal(refusal_->http);
  Forget();
  in_ = std::string();
  Enter(left_to_read_ > 0 ? State::kRefused : State::kAnswering);
  const std::string bytes = RefusalBytes(*refusal_);
  if (!co_await Send(bytes)) co_return;
  if (left_to_read_ <= 0) {
    co_await SayGoodbye();
    co_return;
  }
  ::shutdown(socket_.native_handle(), SHUT_WR);
  while (left_to_read_ > 0) {
    if (!co_await Receive(kDiskPiece)) co_return;
    left_to_read_ -= std::ssize(in_);
    in_.clear();
  }
}

// TLS ends with a message each way; who does not answer it is not waited for.
awaitable<void> Connection::SayGoodbye() {
  if (tls_ == nullptr || closed_) co_return;
  deadline_ = MonotonicNow() + kGoodbye;
  co_await tls_->async_shutdown(kAwait);
}

void Connection::Close() {
  if (closed_) return;
  closed_ = true;
  timer_.cancel();
  // A socket that another thread uses is only ended.
  if (at_work_ || state_ == State::kHandshake) {
    ::shutdown(socket_.native_handle(), SHUT_RDWR);
  } else {
    error_code ignored;
    socket_.close(ignored);
  }
}

void Connection::CloseForStop() {
  const bool hears = state_ == State::kReceiving && tls_ == nullptr && !at_work_ && !closed_;
  if (hears) SendRefusal(socket_.native_handle(), kStoppingError);
  Close();
}

void Connection::Forget() {
  UncountBody();
  body.Drop();
  head.reset();
  parser_ = RequestParser();
  rule_ = BodyRule();
  admitted = false;
  upload.reset();
  buffer_ = std::string();
}

}  // namespace myograde::server
