#include "server/executor/slurm/node_health.h"

#include <utility>

#include <absl/strings/str_cat.h>

namespace myograde::server {

void NodeHealth::Proved(const std::string& name, const std::string& processor) {
  Node& node = nodes_[name];
  node.processor = processor;
  if (node.drained) return;
  node.proved = true;
  node.prove_again = false;
}

void NodeHealth::Unfit(const std::string& name, const std::string& why) {
  if (drained(name)) return;
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
  if (++node.bad_ends < kMostBadEnds) return;
  Unfit(name, absl::StrCat(kMostBadEnds, " leases in a row ended badly there, the last one: ", why));
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
