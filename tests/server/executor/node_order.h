// An order for a node, for tests.
#pragma once

#include <string>

#include "server/executor/spool/forms.h"

namespace myograde::server {

// Plays two episodes of a demo track.
inline NodeOrder SomeNodeOrder() {
  NodeOrder order;
  order.name = "12-1-0123456789abcdef";
  order.epoch = "today";
  order.order.lease = "12-1";
  order.order.command = {"./policy"};
  order.order.track =
      *LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", "demo-locomotion", "");
  order.order.episodes = {{0, 7, 8}, {1, 9, 10}};
  order.artefact = NodeArtefact{std::string(64, 'a'), std::string(64, 'b'), 10240};
  order.runtimes = {{"torch", std::string(64, 'c'), "/opt/torch"}};
  order.grader = R"({"models":{},"version":"0.1.0"})";
  order.wall_s = 60;
  order.uid_base = 62000;
  order.prove_again = {"n1"};
  return order;
}

}  // namespace myograde::server
