// What a node sends the daemon's host, in pieces as they come, and the order that the host sends it:
// messages are whole and within their limits, and an accepted order is written and read again to the
// same text.
#include "server/executor/slurm/lease_stream.h"
#include "tests/fuzz/fuzz.h"

using namespace myograde;
using namespace myograde::server;
using fuzz::Require;

namespace {

constexpr size_t kMost = 1000;

// All messages, as they are sent; what follows them is left out.
std::string Messages(std::string_view text, size_t piece) {
  LeaseStream stream(-1, -1, kMost);
  std::string all;
  for (size_t at = 0; at < text.size(); at += piece) {
    stream.Append(text.substr(at, piece));
    while (true) {
      const absl::StatusOr<std::optional<LeaseMessage>> message = stream.Next();
      Require(message.ok() || !message.status().message().empty(), "a refusal says why");
      if (!message.ok()) return all;
      if (!message->has_value()) break;
      Require((*message)->bytes.size() <= kMost, "a message is within its limit");
      all += (*message)->kind + " " + std::to_string((*message)->bytes.size()) + "\n" +
             (*message)->bytes + "\n";
    }
  }
  return all;
}

}  // namespace

MYOGRADE_FUZZ_TARGET(lease_stream)(const uint8_t* data, size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  Require(Messages(text, size + 1) == Messages(text, 7), "it does not matter how they come");
  const absl::StatusOr<ClusterOrder> order = ClusterOrderFromText(text);
  if (!order.ok()) {
    Require(!order.status().message().empty(), "a refusal says why");
    return 0;
  }
  const std::string written = ClusterOrderToText(*order);
  const absl::StatusOr<ClusterOrder> again = ClusterOrderFromText(written);
  Require(again.ok() && ClusterOrderToText(*again) == written, "an order keeps its values");
  return 0;
}
