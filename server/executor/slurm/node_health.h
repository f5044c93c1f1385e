// Which of a cluster's nodes may play leases: a state machine without clock, disk or process.
//
//   new ──its proof equals the daemon's──► proved
//    ▲         │ it differs                  │ too many bad ends in a row, or an organiser
//    └──Admit──┴──────────► drained ◄────────┘
#pragma once

#include <map>
#include <string>
#include <vector>

#include "server/executor/executor.h"

namespace myograde::server {

class NodeHealth {
 public:
  // Attempts in a row that ended badly on a node drain it.
  static constexpr int kMostBadEnds = 3;

  // The node has found that its results are the daemon's.
  void Proved(const std::string& node, const std::string& processor);
  // It has found that they are not, or something else for which it must get no leases.
  void Unfit(const std::string& node, const std::string& why);

  // An attempt ended on the node, by itself or otherwise: badly if by the grader's fault, by the
  // node's own word, or because it never took its lease.
  void Ended(const std::string& node, bool badly, const std::string& why);

  // Counts the leases that run there, for views.
  void Began(const std::string& node);
  void Left(const std::string& node);

  void Drain(const std::string& node, const std::string& why);
  void Admit(const std::string& node);

  // By name, and why.
  std::map<std::string, std::string> Drained() const;
  // Nodes that were admitted again, and have not proved themselves since.
  std::vector<std::string> ToProveAgain() const;
  std::vector<NodeView> Views() const;
  // Those that Unfit and Ended drained since the last call.
  std::vector<DrainedNode> TakeDrained();

 private:
  struct Node {
    NodeView view;  // without its name
    bool prove_again = false;
    int bad_ends = 0;  // in a row
  };
  std::map<std::string, Node> nodes_;
  std::vector<DrainedNode> news_;
};

}  // namespace myograde::server
