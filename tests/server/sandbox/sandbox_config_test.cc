// The shipped sandbox configs load, and typos in them are reported.
#include "server/sandbox/sandbox_config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class SandboxConfigTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / absl::StrCat("sandbox-config-", getpid());
    fs::create_directories(folder_ / "sandbox");
  }
  void TearDown() override { fs::remove_all(folder_); }

  static nlohmann::json Shipped(const std::string& name) {
    return ReadJsonFile(absl::StrCat(MYOGRADE_SOURCE_DIR, "/configs/sandbox/", name, ".json"))
        .value();
  }

  // The shipped files, with `key` of `name` replaced, or removed if `value` is discarded.
  absl::Status LoadWith(const std::string& name, const std::string& key,
                        const std::string& value) const {
    for (const std::string file : {"policy", "sim"}) {
      nlohmann::json json = Shipped(file);
      std::string text = json.dump();
      if (file == name) {
        json.erase(key);
        text = json.dump();
        text.pop_back();
        // As text, to allow values that are not valid JSON.
        if (!value.empty()) text += absl::StrCat(",\"", key, "\":", value);
        text += "}";
      }
      std::ofstream(folder_ / "sandbox" / (file + ".json")) << text;
    }
    return LoadSandboxConfig(folder_.string()).status();
  }

  fs::path folder_;
};

TEST_F(SandboxConfigTest, ReadsTheShippedOnes) {
  const auto config = LoadSandboxConfig(std::string(MYOGRADE_SOURCE_DIR) + "/configs");
  ASSERT_TRUE(config.ok()) << config.status();
  EXPECT_THAT(config->policy.denied_system_calls, ::testing::Contains("ptrace"));
  EXPECT_THAT(config->policy.unimplemented_system_calls, ::testing::Contains("clone3"));
  EXPECT_THAT(config->sim.allowed_system_calls, ::testing::Contains("recvmsg"));
  EXPECT_THAT(config->sim.allowed_system_calls, ::testing::Not(::testing::Contains("openat")));
}

TEST_F(SandboxConfigTest, NoLimitIsZeroAbsentNegativeOrAbsurd) {
  const struct {
    const char* file;
    std::vector<const char*> keys;
  } limits[] = {{"policy", {"cpu_refresh_s", "kill_s"}},
                {"sim", {"memory_bytes", "tasks", "open_files", "silence_s", "lease_slack_s"}}};
  for (const auto& [file, keys] : limits) {
    for (const char* key : keys) {
      ASSERT_TRUE(LoadWith(file, "//no-such-key", "0").ok());
      for (const char* value : {"", "0", "-1", "1e18", "NaN", "null", "\"many\"", "[]", "true"}) {
        const absl::Status status = LoadWith(file, key, value);
        EXPECT_FALSE(status.ok()) << file << " " << key << " " << value;
        EXPECT_THAT(std::string(status.message()), HasSubstr(absl::StrCat(file, ".json")));
      }
      EXPECT_THAT(std::string(LoadWith(file, key, "0").message()), HasSubstr(key));
    }
  }
}

TEST_F(SandboxConfigTest, AFarewellMayTakeNoTime) {
  ASSERT_TRUE(LoadWith("policy", "farewell_s", "0").ok());
  for (const char* value : {"-1", "11", "NaN", "null", "\"many\""}) {
    EXPECT_THAT(std::string(LoadWith("policy", "farewell_s", value).message()),
                HasSubstr("farewell_s")) << value;
  }
}

TEST_F(SandboxConfigTest, ListsAreOfSystemCallsAndNeverEmpty) {
  const std::pair<const char*, const char*> lists[] = {{"policy", "denied_system_calls"},
                                                       {"policy", "unimplemented_system_calls"},
                                                       {"sim", "allowed_system_calls"}};
  for (const auto& [file, key] : lists) {
    for (const char* value : {"", "[]", "[\"ptrace\", \"ptrase\"]", "[7]", "\"ptrace\""}) {
      const absl::Status status = LoadWith(file, key, value);
      EXPECT_FALSE(status.ok()) << key << " " << value;
      EXPECT_THAT(std::string(status.message()), HasSubstr(key));
    }
    EXPECT_THAT(std::string(LoadWith(file, key, "[\"ptrase\"]").message()), HasSubstr("ptrase"));
  }
  EXPECT_FALSE(LoadWith("policy", "socket_families", "[\"netlink\"]").ok());
}

TEST_F(SandboxConfigTest, AnUnknownKeyIsAMistake) {
  EXPECT_THAT(std::string(LoadWith("sim", "memory_byte", "1").message()), HasSubstr("memory_byte"));
  EXPECT_THAT(std::string(LoadWith("policy", "tasks", "1").message()), HasSubstr("tasks"));
}

}  // namespace
}  // namespace myograde::server
