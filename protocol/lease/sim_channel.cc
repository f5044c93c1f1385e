#include "protocol/lease/sim_channel.h"

#include <poll.h>
#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"

namespace myograde {
namespace {

// Larger than any message: a record with two output tails is about 30 KiB.
constexpr size_t kMaxPacket = 128 * 1024;
constexpr absl::Duration kSendTimeout = absl::Seconds(60);

// Waits until `socket` has one of `events`, or the deadline passes.
absl::Status WaitFor(int socket, int16_t events, const Deadline& deadline) {
  while (true) {
    pollfd entry = {socket, events, 0};
    timespec timeout = absl::ToTimespec(deadline.left());
    const int ready = ppoll(&entry, 1, &timeout, nullptr);
    if (ready > 0) return absl::OkStatus();
    if (ready == 0) return absl::DeadlineExceededError("no message came in time");
    if (errno != EINTR) {
      return absl::InternalError(absl::StrCat("poll on a channel failed: ", strerror(errno)));
    }
  }
}

// Takes the first descriptor of a received packet and closes any others.
Fd TakeDescriptor(msghdr& message) {
  Fd first;
  for (cmsghdr* control = CMSG_FIRSTHDR(&message); control != nullptr;
       control = CMSG_NXTHDR(&message, control)) {
    if (control->cmsg_level != SOL_SOCKET || control->cmsg_type != SCM_RIGHTS) continue;
    const size_t count = (control->cmsg_len - CMSG_LEN(0)) / sizeof(int);
    for (size_t i = 0; i < count; ++i) {
      int fd = -1;
      std::memcpy(&fd, CMSG_DATA(control) + i * sizeof(int), sizeof(int));
      Fd owned(fd);
      if (!first.valid()) first = std::move(owned);
    }
  }
  return first;
}

}  // namespace

absl::Status SendSimMessage(int socket, const nlohmann::json& json, int fd) {
  const std::string text = CanonicalJson(json);
  if (text.size() > kMaxPacket) {
    return absl::InvalidArgumentError(
        absl::StrCat("a message of ", text.size(), " bytes is larger than ", kMaxPacket));
  }
  iovec part = {const_cast<char*>(text.data()), text.size()};
  msghdr message = {};
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(int))> control = {};
  if (fd >= 0) {
    message.msg_control = control.data();
    message.msg_controllen = control.size();
    cmsghdr* header = CMSG_FIRSTHDR(&message);
    header->cmsg_level = SOL_SOCKET;
    header->cmsg_type = SCM_RIGHTS;
    header->cmsg_len = CMSG_LEN(sizeof(int));
    std::memcpy(CMSG_DATA(header), &fd, sizeof(int));
  }
  const Deadline deadline(kSendTimeout);
  while (sendmsg(socket, &message, MSG_NOSIGNAL | MSG_DONTWAIT) < 0) {
    if (errno == EINTR) continue;
    if (errno != EAGAIN && errno != EWOULDBLOCK) {
      return absl::UnavailableError(
          absl::StrCat("sending a message failed: ", strerror(errno)));
    }
    if (absl::Status status = WaitFor(socket, POLLOUT, deadline); !status.ok()) {
      return absl::UnavailableError("the peer did not take a message for 60 s");
    }
  }
  return absl::OkStatus();
}

absl::StatusOr<SimMessage> ReceiveSimMessage(int socket, absl::Duration timeout) {
  RETURN_IF_ERROR(WaitFor(socket, POLLIN, Deadline(timeout)));
  std::vector<char> buffer(kMaxPacket);
  iovec part = {buffer.data(), buffer.size()};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(4 * sizeof(int))> control = {};
  msghdr message = {};
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  ssize_t size;
  do {
    size = recvmsg(socket, &message, MSG_CMSG_CLOEXEC | MSG_DONTWAIT);
  } while (size < 0 && errno == EINTR);
  if (size < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
    return absl::DeadlineExceededError("no message came in time");
  }
  if (size <= 0) {
    return absl::UnavailableError(size == 0 ? "the peer closed the channel"
                                            : absl::StrCat("receiving failed: ", strerror(errno)));
  }
  SimMessage result;
  result.fd = TakeDescriptor(message);
  if (message.msg_flags & (MSG_TRUNC | MSG_CTRUNC)) {
    return absl::InvalidArgumentError("a message was larger than the channel allows");
  }
  ASSIGN_OR_RETURN(
      nlohmann::json json,
      ParseJson(std::string_view(buffer.data(), static_cast<size_t>(size)), "channel message"));
  if (!json.is_object() || !json.contains("type") || !json["type"].is_string()) {
    return absl::InvalidArgumentError("channel message: must be an object with a \"type\"");
  }
  result.json = std::move(json);
  return result;
}

}  // namespace myograde
