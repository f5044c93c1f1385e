// Who counts as an organiser.
#include "server/base/peer_key.h"

#include <unistd.h>

#include <gtest/gtest.h>

namespace myograde::server {
namespace {

TEST(PeerKeyTest, NamesTheUserAsStoredRowsDo) {
  EXPECT_EQ(PeerKey(0), "uid 0");
  EXPECT_EQ(PeerKey(1000), "uid 1000");
  EXPECT_EQ(PeerKey(4294967294), "uid 4294967294");
}

TEST(PeerKeyTest, OrganisersAreRootAndTheProcessesOwnUser) {
  EXPECT_TRUE(IsOrganiser("uid 0"));
  EXPECT_TRUE(IsOrganiser(PeerKey(geteuid())));
  EXPECT_FALSE(IsOrganiser(PeerKey(geteuid() + 1)));
  for (const char* key : {"", "0", "uid ", "uid 00", "uid 0 ", "root"}) {
    EXPECT_FALSE(IsOrganiser(key)) << key;
  }
}

// A daemon that root does not run has two organisers.
TEST(PeerKeyTest, AnotherUsersProcessHasAnotherOrganiser) {
  if (geteuid() != 0) GTEST_SKIP() << "only root can become another user";
  EXPECT_FALSE(IsOrganiser("uid 71998"));
  ASSERT_EQ(seteuid(71998), 0);
  EXPECT_TRUE(IsOrganiser("uid 71998"));
  EXPECT_TRUE(IsOrganiser("uid 0"));
  ASSERT_EQ(seteuid(0), 0);
}

}  // namespace
}  // namespace myograde::server
