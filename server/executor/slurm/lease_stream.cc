#include "server/executor/slurm/lease_stream.h"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr size_t kLongestHead = 32;
constexpr char kWhere[] = "a cluster's order";

absl::Status Broken(absl::string_view what) {
  return absl::DataLossError(absl::StrCat("the other end of the lease sent ", what));
}

}  // namespace

absl::Status LeaseStream::Fill() {
  char buffer[64 << 10];
  ssize_t n;
  while ((n = ::read(in_, buffer, sizeof(buffer))) < 0 && errno == EINTR) {
  }
  if (n < 0 && errno == EAGAIN) return absl::OkStatus();
  if (n < 0) return absl::UnavailableError(absl::StrCat("can't read: ", std::strerror(errno)));
  if (n == 0) return arrived_.empty() ? absl::OutOfRangeError("the end") : Broken("half a message");
  arrived_.append(buffer, static_cast<size_t>(n));
  return absl::OkStatus();
}

absl::StatusOr<std::optional<LeaseMessage>> LeaseStream::Next() {
  const size_t end = arrived_.find('\n');
  if (std::min(end, arrived_.size()) > kLongestHead) return Broken("a malformed message");
  if (end == std::string::npos) return std::nullopt;
  const size_t space = arrived_.find(' ');
  size_t size = 0;
  if (space >= end || arrived_[space + 1] == '+' || arrived_[space + 1] == '-' ||
      !absl::SimpleAtoi(arrived_.substr(space + 1, end - space - 1), &size)) {
    return Broken("a malformed message");
  }
  if (size > most_) return Broken(absl::StrCat("a message of ", size, " bytes"));
  if (arrived_.size() - end - 1 <= size) return std::nullopt;
  if (arrived_[end + 1 + size] != '\n') return Broken("a message without an end");
  LeaseMessage message{arrived_.substr(0, space), arrived_.substr(end + 1, size)};
  arrived_.erase(0, end + 2 + size);
  return message;
}

absl::StatusOr<std::string> LeaseStream::Await(std::string_view kind, absl::Duration patience) {
  const Deadline deadline(patience);
  while (true) {
    ASSIGN_OR_RETURN(std::optional<LeaseMessage> message, Next());
    if (message.has_value()) {
      if (message->kind == kind) return std::move(message->bytes);
      return Broken(absl::StrCat("\"", message->kind, "\" where ", std::string(kind), " belongs"));
    }
    pollfd entry = {in_, POLLIN, 0};
    if (::poll(&entry, 1, static_cast<int>(absl::ToInt64Milliseconds(deadline.left()))) > 0) {
      RETURN_IF_ERROR(Fill());
    } else if (deadline.over()) {
      return absl::DeadlineExceededError(absl::StrCat("the other end of the lease sent no ",
                                                      std::string(kind), " for ",
                                                      absl::FormatDuration(patience)));
    }
  }
}

absl::Status LeaseStream::Send(std::string_view kind, std::string_view bytes) {
  // Slurm carries whole lines, and keeps what follows the last one.
  RETURN_IF_ERROR(WriteAll(out_, absl::StrCat(std::string(kind), " ", bytes.size(), "\n")));
  RETURN_IF_ERROR(WriteAll(out_, bytes));
  return WriteAll(out_, "\n");
}

std::string ClusterOrderToText(const ClusterOrder& order) {
  Json runtimes = Json::array();
  for (const auto& [name, digest] : order.runtimes) {
    runtimes.push_back({{"name", name}, {"digest", digest}});
  }
  return Json({{"order", LeaseOrderToJson(order.order)},
               {"artefact", order.artefact},
               {"runtimes", std::move(runtimes)},
               {"grader", order.grader},
               {"uid_base", order.uid_base},
               {"prove_again", order.prove_again},
               {"comment", order.comment},
               {"srun", order.srun},
               {"squeue", order.squeue},
               {"queue_wait_s", absl::ToDoubleSeconds(order.queue_wait)}})
      .dump();
}

absl::StatusOr<ClusterOrder> ClusterOrderFromText(std::string_view text) {
  ASSIGN_OR_RETURN(const Json json, ParseJson(text, kWhere));
  ConfigReader reader(json, kWhere);
  ClusterOrder order;
  const Json& lease = reader.Object("order");
  order.artefact = reader.String("artefact");
  for (const Json& entry : reader.Array("runtimes")) {
    ConfigReader runtime(entry, absl::StrCat(kWhere, ": runtimes"));
    order.runtimes.emplace_back(runtime.String("name"), runtime.String("digest"));
    RETURN_IF_ERROR(runtime.Finish());
  }
  order.grader = reader.String("grader");
  order.uid_base = reader.Integer("uid_base", -1, INT32_MAX);
  order.prove_again = reader.Strings("prove_again");
  order.comment = reader.String("comment");
  order.srun = reader.Strings("srun");
  order.squeue = reader.Strings("squeue");
  order.queue_wait = absl::Seconds(reader.Number("queue_wait_s", {0, 1e9}));
  RETURN_IF_ERROR(reader.Finish());
  ASSIGN_OR_RETURN(order.order, LeaseOrderFromJson(lease, absl::StrCat(kWhere, ": order")));
  if (order.runtimes.size() != order.order.runtimes.size()) {
    return absl::InvalidArgumentError(absl::StrCat(kWhere, ": runtimes: not those of its lease"));
  }
  if (!IsSha256Hex(order.artefact)) {
    return absl::InvalidArgumentError(absl::StrCat(kWhere, ": artefact: is not a digest"));
  }
  return order;
}

}  // namespace myograde::server
