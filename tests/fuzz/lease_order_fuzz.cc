// A lease order, a file that another host may have written. The input is a patch to a valid order;
// an accepted order is written and read again.
#include "protocol/base/config_reader.h"
#include "protocol/lease/lease.h"
#include "tests/fuzz/fuzz.h"

using namespace myograde;
using fuzz::Require;

namespace {

const nlohmann::json& GoodOrder() {
  static const nlohmann::json order = [] {
    const auto track =
        LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", "demo-locomotion", "");
    Require(track.ok(), "a shipped config loads");
    LeaseOrder good;
    good.lease = "1-0";
    good.artefact_dir = "/artefact";
    good.command = {"./policy"};
    good.track = *track;
    good.episodes = {{0, 7, 8}, {1, 9, 10}};
    good.work_dir = "/work-dir";
    good.cache_dir = "/cache";
    return LeaseOrderToJson(good);
  }();
  return order;
}

}  // namespace

MYOGRADE_FUZZ_TARGET(lease_order)(const uint8_t* data, size_t size) {
  const auto json = ParseJson({reinterpret_cast<const char*>(data), size}, "order");
  if (!json.ok()) return 0;
  nlohmann::json patched = GoodOrder();
  patched.merge_patch(*json);
  const absl::StatusOr<LeaseOrder> order = LeaseOrderFromJson(patched, "order");
  if (!order.ok()) {
    Require(!order.status().message().empty(), "a refusal says why");
    return 0;
  }
  Require(!order->command.empty() && !order->episodes.empty(), "there is something to play");
  for (size_t i = 0; i < order->episodes.size(); ++i) {
    Require(order->episodes[i].index == order->episodes[0].index + static_cast<int64_t>(i),
            "episodes follow each other");
  }
  const nlohmann::json written = LeaseOrderToJson(*order);
  const absl::StatusOr<LeaseOrder> again = LeaseOrderFromJson(written, "order");
  Require(again.ok() && LeaseOrderToJson(*again) == written, "an order keeps its values");
  return 0;
}
