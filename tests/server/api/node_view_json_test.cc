// The nodes of a cluster: what the executor knows, and what the store has as drained.
#include "server/api/views.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace myograde::server {
namespace {

NodeView Node(const std::string& name, const std::string& state, const std::string& why = "") {
  NodeView node;
  node.name = name;
  node.state = state;
  node.why = why;
  return node;
}

TEST(NodesToJson, HasEachNodeOnceByName) {
  NodeView proved = Node("n2", "proved");
  proved.processor = "a processor";
  proved.running = 3;
  proved.done = 20;
  proved.faults = 1;
  const Json nodes = NodesToJson({proved, Node("n1", "drained", "its proof differs")},
                                 {{1000, "n1", "daemon 5", "its proof differs"},
                                  {2000, "n3", "uid 0", "a fan is broken"}}, true);
  ASSERT_EQ(nodes.size(), 3u);
  EXPECT_EQ(nodes[0]["node"], "n1");
  EXPECT_EQ(nodes[0]["state"], "drained");
  EXPECT_EQ(nodes[0]["reason"], "its proof differs");
  EXPECT_EQ(nodes[0]["drained_by"], "daemon 5");
  EXPECT_EQ(nodes[0]["drained_at"], "1970-01-01T00:00:01.000Z");
  EXPECT_EQ(nodes[0]["processor"], nullptr);
  EXPECT_EQ(nodes[1], Json({{"node", "n2"}, {"state", "proved"}, {"reason", nullptr},
                            {"drained_at", nullptr}, {"drained_by", nullptr},
                            {"processor", "a processor"}, {"running", 3}, {"done", 20},
                            {"faults", 1}}));
  EXPECT_EQ(nodes[2]["node"], "n3") << "drained before the daemon met it";
  EXPECT_EQ(nodes[2]["state"], "drained");
  EXPECT_EQ(nodes[2]["reason"], "a fan is broken");
  EXPECT_EQ(nodes[2]["running"], 0);
}

TEST(NodesToJson, ANodeThatIsAdmittedAgainIsDrainedByNobody) {
  const Json nodes =
      NodesToJson({Node("n1", "new")}, {{1000, "n1", "uid 0", "a fan is broken"}}, true);
  EXPECT_EQ(nodes[0]["state"], "new") << "the executor heard of it before the store was read";
  EXPECT_EQ(nodes[0]["drained_by"], nullptr);
}

TEST(NodesToJson, WhatAClusterHadBeforeIsNothingWithoutOne) {
  EXPECT_EQ(NodesToJson({}, {{1000, "n1", "uid 0", "a fan is broken"}}, false), Json::array());
}

}  // namespace
}  // namespace myograde::server
