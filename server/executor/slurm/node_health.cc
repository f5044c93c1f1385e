#include "server/executor/slurm/node_health.h"

#include <utility>

#include <absl/strings/str_cat.h>

namespace myograde::server {
namespace {

constexpr char kNew[] = "new";
constexpr char kProved[] = "proved";
constexpr char kDrained[] = "drained";

}  // namespace

void NodeHealth::Proved(const std::string& name, const std::string& processor) {
  Node& node = nodes_[name];
  node.view.processor = processor;
  if (node.view.state == kDrained) return;
  node.view.state = kProved;
  node.prove_again = false;
}

void NodeHealth::Unfit(const std::string& name, const std::string& why) {
  if (nodes_[name].view.state == kDrained) return;
  Drain(name, why);
  news_.push_back({name, why});
}

void NodeHealth::Ended(const std::string& name, bool badly, const std::string& why) {
  Node& node = nodes_[name];
  if (!badly) {
    ++node.view.done;
    node.bad_ends = 0;
    return;
  }
  ++node.view.faults;
  if (++node.bad_ends < kMostBadEnds) return;
  Unfit(name, absl::StrCat(kMostBadEnds, " leases in a row ended badly there, the last one: ", why));
}

void NodeHealth::Began(const std::string& node) { ++nodes_[node].view.running; }

void NodeHealth::Left(const std::string& name) {
  const auto it = nodes_.find(name);
  if (it != nodes_.end() && it->second.view.running > 0) --it->second.view.running;
}

void NodeHealth::Drain(const std::string& name, const std::string& why) {
  NodeView& view = nodes_[name].view;
  view.state = kDrained;
  view.why = why;
}

void NodeHealth::Admit(const std::string& name) {
  Node& node = nodes_[name];
  node.view.state = kNew;
  node.view.why.clear();
  node.prove_again = true;
  node.bad_ends = 0;
}

std::map<std::string, std::string> NodeHealth::Drained() const {
  std::map<std::string, std::string> drained;
  for (const auto& [name, node] : nodes_) {
    if (node.view.state == kDrained) drained[name] = node.view.why;
  }
  return drained;
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
  for (const auto& [name, node] : nodes_) views.emplace_back(node.view).name = name;
  return views;
}

std::vector<DrainedNode> NodeHealth::TakeDrained() { return std::exchange(news_, {}); }

}  // namespace myograde::server
