// What a connection may do, and how long: the limits on its requests, and its clocks.
#include <algorithm>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "server/base/ip_address.h"
#include "server/http/connection.h"
#include "server/http/connection_table.h"
#include "server/http/http_server.h"

namespace myograde::server {
namespace {

constexpr int64_t kSmallUpload = 1 << 20;
constexpr int64_t kDrainBytes = int64_t{64} << 20;

// What a program on this host calls it: "localhost" or a loopback address; "" is HTTP/1.0.
bool IsLocalHost(const std::string& host) {
  const std::string name = host.ends_with('.') ? host.substr(0, host.size() - 1) : host;
  if (name.empty() || name == "localhost" || name.ends_with(".localhost")) return true;
  const bool v6 = name.front() == '[';
  const auto address = IpAddress::Parse(v6 ? name.substr(1, name.size() - 2) : name);
  return address.has_value() && address->IsLoopback();
}

}  // namespace

// A browser that was led here by another site's name (DNS rebinding) has that name as its origin.
std::optional<ApiError> Connection::CheckHost() const {
  const bool local = peer->peer.local || (peer->peer.proxy && head->forwarded_for.empty());
  if (!local || IsLocalHost(head->host)) return std::nullopt;
  return ApiError{
      421, "bad_request",
      absl::StrCat("this server is reached by localhost or an address of this host, not by \"",
                   head->host, "\"; for other names give it a certificate, or a proxy and "
                   "\"behind_proxy\" (server.json)")};
}

std::optional<ApiError> Connection::BeginBody() {
  rule_ = server_.RuleOf(*head);
  if (rule_.upload) deadline_ = since_ + server_.limits_.upload;
  parser_.BeginBody(*head, rule_.most);
  const bool known = head->content_type.empty() ||
                     std::find(rule_.types.begin(), rule_.types.end(), head->content_type) !=
                         rule_.types.end();
  if (!known) {
    return ApiError{415, "bad_type",
                    absl::StrCat("this address takes a body of type ", rule_.types.front(),
                                 "; send it with the header Content-Type: ", rule_.types.front())};
  }
  if (parser_.error()) return parser_.error();
  // Told before a byte of it is sent, where it could not be kept.
  return head->length > kMemoryBody ? body.Reserve(head->length) : std::nullopt;
}

int64_t Connection::LeftToRead() const {
  const int64_t most = rule_.most + kDrainBytes;
  const bool known = head.has_value() && !head->chunked && parser_.in_body();
  return (known ? std::min(most, head->length - parser_.size()) : most) - std::ssize(in_);
}

bool Connection::Fail(ApiError why, bool read_on) {
  if (refusal_.has_value()) return false;
  refusal_ = std::move(why);
  left_to_read_ = read_on ? LeftToRead() : 0;
  return false;
}

bool Connection::FailUnfinished() {
  if (state_ != State::kReceiving) return false;
  if (expired_ && server_.stopping_) return Fail(kStoppingError, false);
  if (expired_) {
    return Fail({408, "too_slow",
                 absl::StrCat("the request took too long to arrive: a connection brings at least ",
                              server_.limits_.min_bytes_per_s, " bytes a second; send it again")},
                false);
  }
  if (!ended_) return false;
  return Fail({400, "bad_request", "the request did not arrive whole; send it again"}, false);
}

void Connection::Enter(State state) {
  state_ = state;
  since_ = SystemClock().Monotonic();
  waited_ = absl::ZeroDuration();
  moved_ = 0;
  expired_ = false;
  const HttpLimits& limits = server_.limits_;
  deadline_ = since_ + (state == State::kIdle        ? limits.idle
                        : state == State::kAnswering ? limits.upload
                        : state == State::kHandshake ? limits.handshake()
                                                     : limits.request);
}

bool Connection::TooSlow(absl::Duration now) {
  if (state_ == State::kIdle || state_ == State::kHandshake || state_ == State::kStreaming) {
    return false;
  }
  const absl::Duration waited = waited_ + (now - waiting_since_);
  if (waited < server_.limits_.speed_window) return false;
  const double least =
      static_cast<double>(server_.limits_.min_bytes_per_s) * absl::ToDoubleSeconds(waited);
  if (static_cast<double>(moved_) < least) return true;
  waited_ = absl::ZeroDuration();
  waiting_since_ = now;
  moved_ = 0;
  return false;
}

void Connection::CheckClock(absl::Duration now) {
  new_ = false;
  if (at_work_ || closed_) return;
  const bool receiving = state_ == State::kReceiving;
  const bool stops = receiving && server_.stopping_ && parser_.in_body();
  if (!TooSlow(now) && !stops && now < deadline_) return;
  if (!receiving) return Close();
  expired_ = true;
  boost::system::error_code ignored;
  socket_.cancel(ignored);
}

std::optional<ApiError> Connection::CountBody() {
  if (receives_body_) return std::nullopt;
  receives_body_ = true;
  ++peer->bodies;
  if (peer->bodies <= std::max(MaxConnections(peer->peer, server_.limits_) / 2, 1)) {
    return std::nullopt;
  }
  return ApiError{429, "too_many",
                  "too many requests of yours arrive at once; let some of them end first"};
}

void Connection::UncountBody() {
  if (std::exchange(receives_body_, false)) --peer->bodies;
}

Peer Connection::Asker() const {
  Peer asker = peer->peer;
  if (!asker.proxy || !head.has_value()) return asker;
  const std::optional<IpAddress> address = IpAddress::Parse(head->forwarded_for);
  if (address.has_value()) asker.key = address->Key();
  return asker;
}

WorkKind Connection::KindOfWork() const {
  if (!rule_.upload) return WorkKind::kServe;
  return body.size() <= kSmallUpload ? WorkKind::kSmallUpload : WorkKind::kLargeUpload;
}

}  // namespace myograde::server
