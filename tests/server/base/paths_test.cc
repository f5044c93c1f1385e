#include "server/base/paths.h"

#include <filesystem>
#include <fstream>
#include <string>

#include <gtest/gtest.h>

#include "protocol/base/set_up.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

class Paths : public testing::Test {
 protected:
  void SetUp() override { fs::remove_all(root_); }
  void TearDown() override { fs::remove_all(root_); }
  void Fill(const std::string& folder, const std::string& name) {
    fs::create_directories(folder + "/" + name);
  }

  const std::string root_ = testing::TempDir() + "/paths_test";
  const std::string own_ = root_ + "/own";
  const std::string system_ = root_ + "/system";
};

TEST_F(Paths, TheSystemsCacheServesWhoHasNoModelsOfTheirOwn) {
  EXPECT_EQ(CacheDirOf(own_, system_), own_);  // where set-up will put them
  Fill(system_, "models");
  EXPECT_EQ(CacheDirOf(own_, system_), system_);
  Fill(own_, "runtimes");
  Fill(own_, "myosuite-2.8.4");  // as get-models has it, not compiled
  EXPECT_EQ(CacheDirOf(own_, system_), system_);
  Fill(own_, "models");
  EXPECT_EQ(CacheDirOf(own_, system_), own_);
}

TEST_F(Paths, AnInstalledProgramIsToldFromABuilds) {
  Fill(root_, "build/bin");
  std::ofstream(root_ + "/build/CMakeCache.txt") << "\n";
  EXPECT_FALSE(IsInstalled(root_ + "/build/bin/myograde"));
  EXPECT_TRUE(IsInstalled("/usr/bin/myograde"));
  EXPECT_TRUE(IsInstalled("/usr/libexec/myograde/myograde-sim"));
}

}  // namespace
}  // namespace myograde::server
