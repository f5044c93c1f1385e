#include "server/runtime/runtimes.h"

#include <stdlib.h>

#include <filesystem>
#include <fstream>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>


namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

// As server/runtime/make/tree.py has it for the files below.
constexpr char kDigest[] = "77be73ea16617921d61bed78b83cf87df0fd02a05de6202a07421dcf2ffc184c";
constexpr char kOther[] = "0000000000000000000000000000000000000000000000000000000000000000";

class RuntimesTest : public testing::Test {
 protected:
  RuntimesTest() {
    std::string name = testing::TempDir() + "runtimes.XXXXXX";
    dir_ = mkdtemp(name.data());
  }
  ~RuntimesTest() override { fs::remove_all(dir_); }

  void Write(const std::string& path, const std::string& text) {
    fs::create_directories((dir_ / path).parent_path());
    std::ofstream(dir_ / path) << text;
  }

  // A runtime in the folder `at` of the runtimes' folder.
  void AddRuntime(const std::string& at, const std::string& name, const std::string& digest) {
    Write(at + "/m.py", "x = 1\n");
    Write(at + "/sub/run", "#!/bin/sh\n");
    fs::permissions(dir_ / at / "sub/run", fs::perms::owner_exec, fs::perm_options::add);
    fs::create_symlink("../m.py", dir_ / at / "sub/link");
    fs::create_directory(dir_ / at / "ä");
    Write(at + "/runtime.json",
          R"({"format": 1, "runtime": ")" + name + R"(", "digest": ")" + digest +
              R"(", "python": "3.11", "made_at": "2026-11-22T12:00:00Z", "made_from": "", "bytes": 16,
                 "files": 5, "packages": [{"name": "m", "version": "1", "source": "pypi",
                 "sha256": ""}]})");
  }

  fs::path dir_;
};

TEST_F(RuntimesTest, ContentHasTheDigestThatTheMakerGivesIt) {
  AddRuntime("good", "good", kDigest);
  const Runtimes runtimes({}, dir_);
  EXPECT_TRUE(CheckRuntime(*runtimes.Find("good")).ok());
  Write("good/more.py", "");
  const absl::Status status = CheckRuntime(*runtimes.Find("good"));
  EXPECT_TRUE(absl::IsDataLoss(status)) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr("was changed"));
}

TEST_F(RuntimesTest, FoldersAreListedAtOnceAndConfiguredOnesHideThem) {
  const Runtimes runtimes({{"mine", dir_ / "elsewhere"}}, dir_);
  EXPECT_TRUE(absl::IsInternal(runtimes.Find("mine").status())) << "its folder is not there";
  fs::create_directory(dir_ / "elsewhere");
  EXPECT_EQ(runtimes.Find("mine")->digest, "") << "nobody described it";
  AddRuntime("good", "good", kDigest);
  AddRuntime("mine", "mine", kDigest);
  fs::create_directory(dir_ / "undescribed");
  Write("broken/runtime.json", "{");
  std::vector<std::string> names;
  for (const Runtime& runtime : runtimes.List()) names.push_back(runtime.name);
  EXPECT_THAT(names, testing::ElementsAre("good", "mine"));
  EXPECT_EQ(runtimes.Find("mine")->folder, dir_ / "elsewhere");
  EXPECT_TRUE(absl::IsNotFound(runtimes.Find("undescribed").status()));
  EXPECT_TRUE(absl::IsNotFound(runtimes.Find("../good").status()));
  EXPECT_TRUE(absl::IsInternal(runtimes.Find("broken").status()));
  EXPECT_EQ(RuntimeDigests(runtimes), nlohmann::json({{"good", kDigest}}));
}

TEST_F(RuntimesTest, AVersionHasItsFolderForGood) {
  AddRuntime("good@77be", "good", kDigest);
  fs::create_directory_symlink("good@77be", dir_ / "good");
  const Runtimes runtimes({}, dir_);
  EXPECT_EQ(runtimes.Find("good", kDigest)->folder, dir_ / "good@77be");
  EXPECT_TRUE(runtimes.Former().empty());
  AddRuntime("good@0000", "good", kOther);
  fs::remove(dir_ / "good");
  fs::create_directory_symlink("good@0000", dir_ / "good");
  EXPECT_EQ(runtimes.Find("good")->folder, dir_ / "good@0000");
  EXPECT_EQ(runtimes.Find("good", kDigest)->folder, dir_ / "good@77be");
  ASSERT_EQ(runtimes.Former().size(), 1);
  EXPECT_EQ(runtimes.Former()[0].digest, kDigest);
  ASSERT_EQ(runtimes.List().size(), 1);
  // server.json may name what is a link by now.
  const Runtimes configured({{"good", dir_ / "good"}}, dir_);
  EXPECT_EQ(configured.Find("good")->folder, dir_ / "good@0000");
  EXPECT_EQ(configured.Find("good", kDigest)->folder, dir_ / "good@77be");
}

TEST_F(RuntimesTest, LinksThatLeadNowhereAreNoRuntimes) {
  fs::create_directory_symlink("good@77be", dir_ / "good@77be");
  fs::create_directory_symlink("good@77be", dir_ / "good");
  const Runtimes runtimes({}, dir_);
  EXPECT_FALSE(runtimes.Find("good").ok());
  EXPECT_TRUE(runtimes.List().empty());
  EXPECT_TRUE(runtimes.Former().empty());
}

TEST_F(RuntimesTest, FormerVersionsOfEarlierReleasesAreFoundByTheirDigest) {
  AddRuntime("good", "good", kDigest);
  AddRuntime(".former/good@0000", "good", kOther);
  const Runtimes runtimes({}, dir_);
  EXPECT_EQ(runtimes.Find("good", kDigest)->folder, dir_ / "good");
  EXPECT_EQ(runtimes.Find("good", kOther)->folder, dir_ / ".former/good@0000");
  fs::remove_all(dir_ / ".former");
  const absl::Status gone = runtimes.Find("good", kOther).status();
  EXPECT_TRUE(absl::IsNotFound(gone));
  EXPECT_THAT(std::string(gone.message()), HasSubstr("\"good\" is 77be73ea1661 now"));
}

}  // namespace
}  // namespace myograde::server
