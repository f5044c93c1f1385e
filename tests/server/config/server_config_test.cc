// Every number in the shipped server.json is a limit that can't be missing, zero, negative or
// absurd; a mistake is reported with file and key.
#include "server/config/server_config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <vector>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::json;
using Pointer = Json::json_pointer;

class ServerConfigTest : public ::testing::Test {
 protected:
  void SetUp() override {
    path_ = std::filesystem::temp_directory_path() / absl::StrCat("server-", getpid(), ".json");
    shipped_ = ReadJsonFile(MYOGRADE_SOURCE_DIR "/configs/server.json").value();
  }
  void TearDown() override { std::filesystem::remove(path_); }

  absl::Status Load(const std::string& text) const {
    std::ofstream(path_) << text;
    return LoadServerConfig(path_.string(), "/cache").status();
  }

  static bool MayBeLeftOut(const Pointer& place) {
    static const std::set<std::string> optional = {"unpack_cpu_s",
                                                   "disk_reserve_bytes",
                                                   "unsubmitted",
                                                   "unsubmitted_bytes",
                                                   "uploader_unsubmitted",
                                                   "uploader_unsubmitted_bytes",
                                                   "unsubmitted_s",
                                                   "organiser_workers",
                                                   "organiser_clients",
                                                   "peer_clients",
                                                   "address_clients",
                                                   "min_bytes_per_s",
                                                   "speed_window_s",
                                                   "spool_bytes",
                                                   "peer_spool_bytes",
                                                   "unfinished",
                                                   "of_one",
                                                   "of_a_submission",
                                                   "of_organisers",
                                                   "requests_per_s",
                                                   "burst",
                                                   "teams_of_a_user",
                                                   "level",
                                                   "samples",
                                                   "places",
                                                   "picture_bytes",
                                                   "pictures_ahead_s"};
    return place.parent_pointer() == Pointer("/slurm") || optional.contains(place.back());
  }

  // Keys whose 0 says that the daemon works the number out, or never does it.
  static bool MayBeZero(const Pointer& place) {
    static const std::set<std::string> derived = {"time_limit_min", "memory_mib", "cpus",
                                                   "pictures_ahead_s"};
    return derived.contains(place.back());
  }

  // The places of all numbers.
  std::vector<Pointer> Numbers() const {
    std::vector<Pointer> found;
    const Json flat = shipped_.flatten();
    for (const auto& [place, value] : flat.items()) {
      if (value.is_number()) found.emplace_back(place);
    }
    return found;
  }

  std::filesystem::path path_;
  Json shipped_;
};

TEST_F(ServerConfigTest, ReadsTheShippedOne) {
  EXPECT_TRUE(Load(shipped_.dump()).ok()) << Load(shipped_.dump());
  EXPECT_GT(Numbers().size(), 10u);
}

TEST_F(ServerConfigTest, NoLimitIsZeroAbsentNegativeOrAbsurd) {
  for (const Pointer& place : Numbers()) {
    const std::string key = place.back();
    Json json = shipped_;
    json.at(place.parent_pointer()).erase(key);
    if (!MayBeLeftOut(place)) {
      EXPECT_THAT(std::string(Load(json.dump()).message()), HasSubstr(key)) << "absent";
    } else {
      EXPECT_TRUE(Load(json.dump()).ok()) << key;
    }
    for (const std::string value : {"0", "-1", "1e18", "1e999", "null", "true", "\"many\"", "[5]"}) {
      if (value == "0" && MayBeZero(place)) continue;
      json = shipped_;
      json.at(place) = "stands here";
      std::string text = json.dump();
      text.replace(text.find("\"stands here\""), 13, value);
      const absl::Status status = Load(text);
      EXPECT_FALSE(status.ok()) << place << " = " << value;
      // Invalid JSON is reported with its position in the file.
      if (Json::accept(text)) {
        EXPECT_THAT(std::string(status.message()), HasSubstr(key)) << value;
      }
    }
  }
}

TEST_F(ServerConfigTest, KeysThatAreLeftOutHaveTheShippedValues) {
  std::ofstream(path_) << shipped_.dump();
  const ServerConfig now = LoadServerConfig(path_.string(), "/cache").value();
  Json json = shipped_;
  for (const Pointer& place : Numbers()) {
    if (MayBeLeftOut(place)) json.at(place.parent_pointer()).erase(place.back());
  }
  json.erase("reruns");
  json.erase("access");
  json.erase("statistics");
  json.erase("executor");
  json.erase("slurm");
  std::ofstream(path_) << json.dump();
  const ServerConfig fallback = LoadServerConfig(path_.string(), "/cache").value();
  const auto numbers = [](const ServerConfig& config) {
    const HttpLimits& http = config.http;
    const UploadLimits& uploads = config.artefacts;
    return std::vector<int64_t>{
        http.organiser_workers, http.organiser_clients, http.peer_clients, http.address_clients,
        http.min_bytes_per_s,
        absl::ToInt64Seconds(http.speed_window), http.spool_bytes, http.peer_spool_bytes,
        http.disk_reserve, http.large_uploads, absl::ToInt64Seconds(uploads.unpack_cpu),
        uploads.disk_reserve, uploads.unsubmitted.count, uploads.unsubmitted.bytes,
        uploads.unsubmitted.of_one, uploads.unsubmitted.bytes_of_one,
        absl::ToInt64Seconds(uploads.unsubmitted.age),
        absl::ToInt64Seconds(config.retention.upload_age), config.reruns.unfinished,
        config.reruns.of_one, config.reruns.of_a_submission, config.reruns.of_organisers,
        static_cast<int64_t>(http.requests_per_s), static_cast<int64_t>(http.burst),
        config.access.teams_of_a_user, config.retention.picture_bytes, config.slurm.most_jobs,
        config.slurm.time_limit_min, config.slurm.memory_mib,
        config.slurm.cpus, absl::ToInt64Seconds(config.slurm.queue_wait),
        absl::ToInt64Seconds(config.pictures_ahead), config.public_replay ? 1 : 0};
  };
  EXPECT_EQ(numbers(fallback), numbers(now));
  EXPECT_EQ(fallback.statistics, now.statistics);
}

TEST_F(ServerConfigTest, AClusterTakesTheSlotsPlace) {
  const auto load = [&](Json slurm) {
    Json json = shipped_;
    json["executor"] = "slurm";
    json["slurm"].update(slurm);
    std::ofstream(path_) << json.dump();
    return LoadServerConfig(path_.string(), "/cache");
  };
  const auto config = load({{"most_jobs", 5000}});
  ASSERT_TRUE(config.ok()) << config.status();
  EXPECT_TRUE(config->on_cluster);
  EXPECT_EQ(config->scheduler.slots, 5000);
  const auto mistake = [&](Json slurm) { return std::string(load(slurm).status().message()); };
  EXPECT_THAT(mistake({{"node_dir", "node"}}), HasSubstr("absolute"));
  EXPECT_THAT(mistake({{"partition", "a b"}}), HasSubstr("partition"));
  EXPECT_THAT(mistake({{"extra_options", {"--label"}}}), HasSubstr("the daemon sets itself"));
  EXPECT_THAT(mistake({{"extra_options", {"--nice 5"}}}), HasSubstr("in one word"));
  EXPECT_THAT(mistake({{"partitions", "a"}}), HasSubstr("partitions"));
  EXPECT_THAT(mistake({{"shared_dir", "/shared"}}), HasSubstr("shared_dir"));
}

TEST_F(ServerConfigTest, StatisticsAreReadAndMustBeAbleToDecide) {
  const auto load = [&](const char* statistics) {
    Json json = shipped_;
    json["statistics"] = Json::parse(statistics);
    std::ofstream(path_) << json.dump();
    return LoadServerConfig(path_.string(), "/cache");
  };
  const auto config = load(R"({"level": 0.01, "samples": 20000, "places": 5, "ranks": "groups"})");
  ASSERT_TRUE(config.ok()) << config.status();
  EXPECT_EQ(config->statistics.groups,
            (scoring::GroupRules{.level = 0.01, .samples = 20000, .places = 5}));
  EXPECT_EQ(config->statistics.ranks, scoring::StatisticsConfig::Ranks::kGroups);
  const std::pair<const char*, const char*> bad[] = {
      {R"({"places": 50})", "24500"},
      {R"({"samples": 899})", "no test could decide anything below 900"},
      {R"({"places": 1})", "\"places\" is 1"},
      {R"({"method": "t-test"})", "paired-permutation"},
      {R"({"ranks": "stars"})", "rules, groups"},
      {R"({"power": 1})", "\"power\""}};
  for (const auto& [statistics, sentence] : bad) {
    const std::string said(load(statistics).status().message());
    EXPECT_THAT(said, HasSubstr(sentence)) << statistics;
    EXPECT_THAT(said, HasSubstr(": statistics: ")) << statistics;
  }
}

TEST_F(ServerConfigTest, UsersHaveRolesAndParticipantsTeams) {
  Json json = shipped_;
  json["access"]["users"] = Json::parse(R"([
      {"uid": 1001, "role": "participant", "team": "alpha"}, {"user": "ada", "role": "organiser"},
      {"group": "lab", "role": "participant"}, {"gid": 7, "role": "operator"}])");
  std::ofstream(path_) << json.dump();
  const AccessConfig access = LoadServerConfig(path_.string(), "/cache").value().access;
  ASSERT_EQ(access.users.size(), 4u);
  EXPECT_EQ(access.users[0].uid, 1001u);
  EXPECT_EQ(access.users[0].team, "alpha");
  EXPECT_EQ(access.users[1].user, "ada");
  EXPECT_EQ(access.users[1].role, Role::kOrganiser);
  EXPECT_EQ(access.users[2].role, Role::kParticipant);
  EXPECT_EQ(access.users[3].gid, 7u);
}

TEST_F(ServerConfigTest, AUserThatIsNotClearIsRefused) {
  for (const char* entry :
       {R"({"role": "organiser"})", R"({"uid": 1, "user": "ada", "role": "organiser"})",
        R"({"uid": 1})", R"({"uid": 1, "role": "public"})", R"({"uid": 1, "role": "root"})",
        R"({"uid": -1, "role": "organiser"})", R"({"uid": 4294967295, "role": "organiser"})",
        R"({"uid": "1", "role": "organiser"})", R"({"user": "", "role": "organiser"})",
        R"({"uid": 1, "role": "organiser", "team": "alpha"})",
        R"({"uid": 1, "role": "participant", "team": ""})",
        R"({"uid": 1, "role": "participant", "teams": ["a"]})", R"(5)", R"([])"}) {
    Json json = shipped_;
    json["access"]["users"] = Json::array({Json::parse(entry)});
    EXPECT_THAT(std::string(Load(json.dump()).message()), HasSubstr("access: users[0]")) << entry;
  }
}

TEST_F(ServerConfigTest, NamesAreThoseOfTheHost) {
  AccessConfig access;
  access.users.resize(2);
  access.users[0].user = "root";
  access.users[1].group = "root";
  ASSERT_TRUE(ResolveNames("server.json", access).ok());
  EXPECT_EQ(access.users[0].uid, 0u);
  EXPECT_EQ(access.users[1].gid, 0u);
  access.users[1].group = "no such group";
  EXPECT_THAT(std::string(ResolveNames("server.json", access).message()),
              HasSubstr("server.json: access: users[1]: this host has no group"));
}

TEST_F(ServerConfigTest, SlotsAndClientsTakeDescriptors) {
  ServerConfig config;
  config.scheduler.slots = 1024;
  config.http.clients = 256;
  config.http.workers = 64;
  EXPECT_GT(DescriptorsNeeded(config), 3 * 1024 + 2 * 256 + config.http.waiting());
  const int64_t many = DescriptorsNeeded(config);
  config.http.clients += 100;
  EXPECT_GE(DescriptorsNeeded(config), many + 300) << "connections, bodies and those in line";
}

TEST_F(ServerConfigTest, SlotsAreANumberOrTheWordCores) {
  for (const char* value : {"0", "-1", "1025", "1.5", "\"all\"", "null"}) {
    Json json = shipped_;
    json["slots"] = Json::parse(value);
    EXPECT_THAT(std::string(Load(json.dump()).message()), HasSubstr("slots")) << value;
  }
}

TEST_F(ServerConfigTest, PicturesMayBeMadeOnlyWhenTheyAreAskedFor) {
  Json json = shipped_;
  json["pictures_ahead_s"] = 0;
  std::ofstream(path_) << json.dump();
  EXPECT_EQ(LoadServerConfig(path_.string(), "/cache")->pictures_ahead, absl::InfiniteDuration());
}

TEST_F(ServerConfigTest, ADoorToTheNetworkIsSafeOrAMistake) {
  const auto load = [this](const char* listen) {
    Json json = shipped_;
    json["http"]["listen"] = Json::parse(listen);
    return std::string(Load(json.dump()).message());
  };
  for (const char* good :
       {"null", R"({"address": "127.0.0.1", "port": 0})",
        R"({"address": "::1", "port": 8080, "certificate": null, "key": null, "behind_proxy": true})",
        R"({"//": "x", "address": "0.0.0.0", "port": 443, "certificate": "/c", "key": "/k"})"}) {
    EXPECT_EQ(load(good), "");
  }
  const std::pair<const char*, const char*> bad[] = {
      {"[]", "listen"},
      {"false", "listen"},
      {R"({"port": 1})", "\"address\" is missing"},
      {R"({"address": "127.0.0.1"})", "\"port\" is missing"},
      {R"({"address": "127.0.0.1", "port": 65536})", "\"port\" is 65536"},
      {R"({"address": "127.0.0.1", "port": 1, "ports": 2})", "\"ports\" is not a known key"},
      {R"({"address": "localhost", "port": 1})", "must be an IP address"},
      {R"({"address": "0.0.0.0", "port": 1})", "without TLS the daemon listens only"},
      {R"({"address": "::", "port": 1})", "without TLS the daemon listens only"},
      {R"({"address": "0.0.0.0", "port": 1, "certificate": "/c"})", "\"key\" is missing"},
      {R"({"address": "0.0.0.0", "port": 1, "key": "/k"})", "\"certificate\" is missing"},
      {R"({"address": "0.0.0.0", "port": 1, "certificate": "c", "key": "/k"})", "absolute path"},
      {R"({"address": "0.0.0.0", "port": 1, "certificate": "/c", "key": "/k", "behind_proxy": true})",
       "for a proxy on this host"}};
  for (const auto& [listen, sentence] : bad) EXPECT_THAT(load(listen), HasSubstr(sentence)) << listen;
}

TEST_F(ServerConfigTest, AnUnknownKeyIsAMistake) {
  for (const char* place : {"/slot", "/scheduler/replays", "/http/worker", "/artefacts/byte"}) {
    Json json = shipped_;
    json[Pointer(place)] = 1;
    EXPECT_THAT(std::string(Load(json.dump()).message()), HasSubstr(Pointer(place).back()));
  }
}

}  // namespace
}  // namespace myograde::server
