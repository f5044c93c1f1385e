// Which of a cluster's nodes may play leases: a state machine without clock, disk or process.
//
//   new ──its proof equals the daemon's──► proved
//    ▲         │ it differs                  │ too many bad ends in a row, or an organiser
//    └──Admit──┴──────────► drained ◄────────┘
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "server/executor/node_view.h"
#include "server/executor/spool/forms.h"

namespace myograde::server {

class NodeHealth {
 public:
  // Attempts in a row that ended badly on a node drain it.
  static constexpr int kMostBadEnds = 3;

  // What a node says of itself, for a lease whose order names `grader` (canonical JSON, GraderBuild).
  // "": it may play it. Else why not, and the node is drained.
  std::string Prove(const NodeProof& proof, const std::string& grader);

  // An attempt ended on the node, by itself or otherwise: badly if by the grader's fault, by the
  // node's own word, or because it never took its lease.
  void Ended(const std::string& node, bool badly, const std::string& why);

  // Counts the leases that run there, for views.
  void Began(const std::string& node);
  void Left(const std::string& node);

  void Drain(const std::string& node, const std::string& why);
  void Admit(const std::string& node);

  bool drained(const std::string& node) const;
  // "": it is not drained.
  std::string WhyDrained(const std::string& node) const;
  std::vector<std::string> Drained() const;
  // Nodes that were admitted again, and have not proved themselves since.
  std::vector<std::string> ToProveAgain() const;
  std::vector<NodeView> Views() const;
  // Those that Prove and Ended drained since the last call.
  std::vector<DrainedNode> TakeDrained();

 private:
  struct Node {
    bool proved = false;
    bool drained = false;
    bool prove_again = false;
    std::string why;
    std::string processor;
    int bad_ends = 0;  // in a row
    int running = 0;
    int64_t done = 0;
    int64_t faults = 0;
  };
  void DrainIt(const std::string& name, const std::string& why);

  std::map<std::string, Node> nodes_;
  std::vector<DrainedNode> news_;
};

// Why the build `found` is not `expected` (GraderBuild as canonical JSON), to follow "its": one
// part that differs. "" if they are equal.
std::string BuildDifference(const std::string& expected, const std::string& found);

}  // namespace myograde::server
