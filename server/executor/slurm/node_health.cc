#include "server/executor/slurm/node_health.h"

#include <utility>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"

namespace myograde::server {
namespace {

constexpr size_t kLongestPart = 80;

std::string PartText(const nlohmann::json& json) {
  if (json.is_null()) return "none";
  const std::string text = json.is_string() ? json.get<std::string>() : json.dump();
  return text.size() <= kLongestPart ? text : absl::StrCat(text.substr(0, kLongestPart), "...");
}

}  // namespace

std::string BuildDifference(const std::string& expected, const std::string& found) {
  const absl::StatusOr<nlohmann::json> ours = ParseJson(expected, "the daemon's build");
  const absl::StatusOr<nlohmann::json> theirs = ParseJson(found, "the node's build");
  if (!ours.ok()) return std::string(ours.status().message());
  if (!theirs.ok()) return std::string(theirs.status().message());
  if (*ours == *theirs) return "";
  const nlohmann::json flat_ours = ours->flatten();
  const nlohmann::json flat_theirs = theirs->flatten();
  for (const auto* side : {&flat_ours, &flat_theirs}) {
    for (const auto& [key, value] : side->items()) {
      const nlohmann::json& a = flat_ours.contains(key) ? flat_ours[key] : nlohmann::json();
      const nlohmann::json& b = flat_theirs.contains(key) ? flat_theirs[key] : nlohmann::json();
      if (a == b && flat_ours.contains(key) == flat_theirs.contains(key)) continue;
      return absl::StrCat(key.substr(1), " is ", PartText(b), ", and the daemon's is ", PartText(a));
    }
  }
  return "build is of another form than the daemon's";
}

std::string NodeHealth::Prove(const NodeProof& proof, const std::string& grader) {
  Node& node = nodes_[proof.node];
  node.processor = proof.processor;
  if (node.drained) return absl::StrCat("the node ", proof.node, " is drained: ", node.why);
  std::string why;
  if (const std::string other = BuildDifference(grader, proof.grader); !other.empty()) {
    why = absl::StrCat("its ", other, "; install the daemon's version and models there");
  } else if (!proof.reference.empty()) {
    why = absl::StrCat("it does not play the reference episodes as they are: ", proof.reference);
  } else if (!proof.doctor.empty()) {
    why = proof.doctor.front();
  }
  if (why.empty()) {
    node.proved = true;
    node.prove_again = false;
    return "";
  }
  DrainIt(proof.node, why);
  return absl::StrCat("the node ", proof.node, " is drained: ", why);
}

void NodeHealth::DrainIt(const std::string& name, const std::string& why) {
  Drain(name, why);
  news_.push_back({name, why});
}

void NodeHealth::Ended(const std::string& name, bool badly, const std::string& why) {
  Node& node = nodes_[name];
  if (!badly) {
    ++node.done;
    node.bad_ends = 0;
    return;
  }
  ++node.faults;
  if (++node.bad_ends < kMostBadEnds || node.drained) return;
  DrainIt(name, absl::StrCat(kMostBadEnds, " leases in a row ended badly there, the last one: ", why));
}

void NodeHealth::Began(const std::string& node) { ++nodes_[node].running; }

void NodeHealth::Left(const std::string& node) {
  const auto it = nodes_.find(node);
  if (it != nodes_.end() && it->second.running > 0) --it->second.running;
}

void NodeHealth::Drain(const std::string& name, const std::string& why) {
  Node& node = nodes_[name];
  node.drained = true;
  node.proved = false;
  node.why = why;
}

void NodeHealth::Admit(const std::string& name) {
  Node& node = nodes_[name];
  node.drained = node.proved = false;
  node.prove_again = true;
  node.why.clear();
  node.bad_ends = 0;
}

bool NodeHealth::drained(const std::string& name) const {
  const auto it = nodes_.find(name);
  return it != nodes_.end() && it->second.drained;
}

std::string NodeHealth::WhyDrained(const std::string& name) const {
  return drained(name) ? nodes_.at(name).why : "";
}

std::vector<std::string> NodeHealth::Drained() const {
  std::vector<std::string> names;
  for (const auto& [name, node] : nodes_) {
    if (node.drained) names.push_back(name);
  }
  return names;
}

std::vector<std::string> NodeHealth::ToProveAgain() const {
  std::vector<std::string> names;
  for (const auto& [name, node] : nodes_) {
    if (node.prove_again) names.push_back(name);
  }
  return names;
}

std::vector<NodeView> NodeHealth::Views() const {
  std::vector<NodeView> views;
  for (const auto& [name, node] : nodes_) {
    views.push_back({.name = name,
                     .state = node.drained ? "drained" : node.proved ? "proved" : "new",
                     .why = node.why,
                     .processor = node.processor,
                     .running = node.running,
                     .done = node.done,
                     .faults = node.faults});
  }
  return views;
}

std::vector<DrainedNode> NodeHealth::TakeDrained() { return std::exchange(news_, {}); }

}  // namespace myograde::server
