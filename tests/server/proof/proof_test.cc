// Merkle trees, seed lists, signatures and receipts: none of it needs a simulator.

#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/lease/policy_seed.h"
#include "server/proof/grader_build.h"
#include "server/proof/logs.h"
#include "server/proof/merkle_tree.h"
#include "server/proof/receipt.h"
#include "server/proof/seed_list.h"
#include "server/proof/signing_key.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// The vectors that RFC 6962 implementations are commonly tested with.
TEST(Merkle, HasTheRootsOfKnownTrees) {
  using namespace std::string_literals;
  const std::vector<std::string> leaves = {
      "",           "\x00"s,         "\x10"s,                 "\x20\x21"s,
      "\x30\x31"s, "\x40\x41\x42\x43"s, "\x50\x51\x52\x53\x54\x55\x56\x57"s,
      "\x60\x61\x62\x63\x64\x65\x66\x67\x68\x69\x6a\x6b\x6c\x6d\x6e\x6f"s};
  const auto first = [&](long n) {
    return MerkleRoot({leaves.begin(), leaves.begin() + n});
  };
  EXPECT_EQ(first(0), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(first(1), "6e340b9cffb37a989ca544e6bb780a2c78901d3fb33738768511a30617afa01d");
  EXPECT_EQ(first(2), "fac54203e7cc696cf0dfcb42c92a1d9dbaf70ad9e621f4bd8d98662f00e3c125");
  EXPECT_EQ(first(3), "aeb6bcfe274b70a14fb067a5e5578264db0fa9b51af5e0ba159158f329e06e77");
  EXPECT_EQ(first(8), "5dc9da79a70659a9ad559cb701ded9a2ab9d823aad2f4960cfe370eff4604328");
}

TEST(Merkle, EveryLeafAndItsPlaceCount) {
  EXPECT_TRUE(rc::check([](const std::vector<std::string>& leaves) {
    RC_PRE(!leaves.empty());
    std::vector<std::string> altered = leaves;
    altered[*rc::gen::inRange<size_t>(0, leaves.size())] += "x";
    RC_ASSERT(MerkleRoot(altered) != MerkleRoot(leaves));
    altered = leaves;
    altered.push_back(leaves.back());
    RC_ASSERT(MerkleRoot(altered) != MerkleRoot(leaves));
  }));
}

TEST(SeedList, FollowsFromSecretAndPhaseAndHasNoRepetition) {
  const std::string secret(kSeedSecretBytes, 's');
  const std::vector<uint64_t> seeds = DeriveSeeds(secret, "final", 1000);
  EXPECT_EQ(seeds.size(), 1000u);
  EXPECT_EQ(std::set<uint64_t>(seeds.begin(), seeds.end()).size(), 1000u);
  EXPECT_LE(*std::max_element(seeds.begin(), seeds.end()), static_cast<uint64_t>(INT64_MAX));
  EXPECT_EQ(DeriveSeeds(secret, "final", 1000), seeds);
  EXPECT_NE(DeriveSeeds(secret, "other", 1000), seeds);
  EXPECT_NE(DeriveSeeds(std::string(kSeedSecretBytes, 't'), "final", 1000), seeds);
  const std::vector<uint64_t> fewer = DeriveSeeds(secret, "final", 10);
  EXPECT_TRUE(std::equal(fewer.begin(), fewer.end(), seeds.begin()));
}

class ReceiptTest : public ::testing::Test {
 protected:
  ReceiptTest() {
    char name[] = "/tmp/myograde-receipt-XXXXXX";
    if (mkdtemp(name) == nullptr) std::abort();
    folder_ = name;
  }
  ~ReceiptTest() override {
    unlink((folder_ + "/key").c_str());
    rmdir(folder_.c_str());
  }

  static Json Receipt() {
    Json episodes = Json::array();
    std::vector<std::string> leaves;
    std::string rows;
    for (const uint64_t index : {0u, 1u, 2u}) {
      Json row = {{"index", index}, {"seed", 100 + index}, {"outcome", "failure"},
                  {"reason", "time"}, {"metrics", {{"time_s", 0.1 * static_cast<double>(index)}}},
                  {"steps", 10},      {"digest", std::string(64, 'd')}};
      leaves.push_back(CanonicalJson(row));
      rows += leaves.back() + "\n";
      row["actions_digest"] = std::string(64, 'a');
      row["log"] = nullptr;
      episodes.push_back(std::move(row));
    }
    const Json config = {{"id", "t"}};
    return {{"format", 1},
            {"track_kind", "locomotion"},
            {"track_config", config},
            {"config", Sha256Hex(CanonicalJson(config))},
            {"seeds", SeedListHash({100, 101, 102})},
            {"grader", {{"simulator", "s"}, {"mujoco", "m"}, {"models", {{"locomotion-1.mjb", "x"}}}}},
            {"results", Sha256Hex(rows)},
            {"merkle_root", MerkleRoot(leaves)},
            {"episodes", std::move(episodes)}};
  }

  SigningKey Key() { return *SigningKey::LoadOrMake(folder_ + "/key"); }

  static std::vector<std::string> Wrong(const std::vector<ReceiptCheck>& checks) {
    std::vector<std::string> names;
    for (const ReceiptCheck& check : checks) {
      if (!check.valid) names.push_back(check.name);
    }
    return names;
  }

  std::string folder_;
};

TEST_F(ReceiptTest, HoldsUnderItsKeyAlone) {
  const SigningKey key = Key();
  const std::string text = *SignReceipt(Receipt(), key);
  ASSERT_TRUE(ParseReceipt(text).ok());
  const PublicKey known = *PublicKey::Parse(key.PublicPem(), "test");
  EXPECT_TRUE(Wrong(CheckReceipt(text, known)).empty());
  EXPECT_EQ(Key().PublicPem(), key.PublicPem()) << "a key that is there is read, not replaced";
  unlink((folder_ + "/key").c_str());
  const PublicKey other = *PublicKey::Parse(Key().PublicPem(), "test");
  EXPECT_EQ(Wrong(CheckReceipt(text, other)), std::vector<std::string>{"signature"});
}

TEST_F(ReceiptTest, NoByteCanBeChanged) {
  const SigningKey key = Key();
  const PublicKey known = *PublicKey::Parse(key.PublicPem(), "test");
  const std::string text = *SignReceipt(Receipt(), key);
  for (size_t i = 0; i < text.size(); ++i) {
    std::string altered = text;
    altered[i] = static_cast<char>(altered[i] ^ 1);
    if (!ParseReceipt(altered).ok()) continue;
    EXPECT_FALSE(Wrong(CheckReceipt(altered, known)).empty()) << "byte " << i;
  }
}

TEST_F(ReceiptTest, NamesWhatDoesNotFitEvenIfItIsSigned) {
  const SigningKey key = Key();
  const PublicKey known = *PublicKey::Parse(key.PublicPem(), "test");
  const auto wrong = [&](const Json& receipt) {
    return Wrong(CheckReceipt(*SignReceipt(receipt, key), known));
  };
  Json receipt = Receipt();
  receipt["track_config"]["id"] = "u";
  EXPECT_EQ(wrong(receipt), std::vector<std::string>{"config"});
  receipt = Receipt();
  receipt["episodes"][1]["digest"] = std::string(64, 'e');
  EXPECT_EQ(wrong(receipt), (std::vector<std::string>{"merkle_root", "results"}));
  receipt = Receipt();
  receipt["episodes"].erase(1);
  EXPECT_EQ(wrong(receipt), (std::vector<std::string>{"merkle_root", "results", "seeds"}));
}

TEST_F(ReceiptTest, PolicySeedsFollowFromTheSecretThatTheConfigNames) {
  const SigningKey key = Key();
  const PublicKey known = *PublicKey::Parse(key.PublicPem(), "test");
  const auto wrong = [&](const Json& receipt) {
    return Wrong(CheckReceipt(*SignReceipt(receipt, key), known));
  };
  EXPECT_TRUE(wrong(Receipt()).empty()) << "a receipt of an earlier version names none";
  Json receipt = Receipt();
  receipt["track_config"]["policy_seed_secret"] = "public";
  receipt["config"] = Sha256Hex(CanonicalJson(receipt["track_config"]));
  const std::vector<std::string> expected = {"policy_seeds"};
  EXPECT_EQ(wrong(receipt), expected);
  Json seeds = Json::array();
  for (const int64_t episode : {0, 1, 2}) seeds.push_back(PolicySeed("public", episode));
  receipt["policy_seeds"] = seeds;
  EXPECT_TRUE(wrong(receipt).empty());
  receipt["policy_seeds"][2] = seeds[1];
  EXPECT_EQ(wrong(receipt), expected);
  receipt["policy_seeds"] = {seeds[0], seeds[1]};
  EXPECT_EQ(wrong(receipt), expected);
  receipt["policy_seeds"] = "none";
  EXPECT_EQ(wrong(receipt), expected);
}

TEST_F(ReceiptTest, AnotherModelIsWrongAndAnotherBuildIsTold) {
  Json grader = Receipt()["grader"];
  EXPECT_TRUE(Wrong(CompareGraders(Receipt(), grader)).empty());
  grader["simulator"] = "t";
  const std::vector<ReceiptCheck> told = CompareGraders(Receipt(), grader);
  EXPECT_TRUE(Wrong(told).empty());
  EXPECT_FALSE(told[0].detail.empty());
  grader["models"]["locomotion-1.mjb"] = "y";
  EXPECT_EQ(Wrong(CompareGraders(Receipt(), grader)),
            std::vector<std::string>{"model locomotion-1.mjb"});
}

TEST_F(ReceiptTest, AnAdapterIsComparedWhereTheReceiptNamesOne) {
  Json receipt = Receipt();
  Json grader = receipt["grader"];
  grader["adapters"]["template-2024"] = "a";
  const size_t parts = CompareGraders(receipt, grader).size();
  receipt["grader"]["adapters"]["template-2024"] = "a";
  std::vector<ReceiptCheck> told = CompareGraders(receipt, grader);
  ASSERT_EQ(told.size(), parts + 1);
  EXPECT_EQ(told[2].name, "adapter template-2024");
  EXPECT_EQ(told[2].detail, "");
  grader.erase("adapters");
  told = CompareGraders(receipt, grader);
  EXPECT_TRUE(Wrong(told).empty()) << "another build may well play the same";
  EXPECT_NE(told[2].detail, "");
}

TEST_F(ReceiptTest, TheBuildNamesTheFilesOfItsAdapters) {
  const std::string adapter = folder_ + "/adapters/template-2024";
  std::filesystem::create_directories(adapter + "/hooks/__pycache__");
  std::filesystem::create_directories(folder_ + "/bin");
  ASSERT_EQ(::setenv("MYOGRADE_BIN_DIR", (folder_ + "/bin").c_str(), 1), 0);
  const auto hash = [&]() -> Json {
    return GraderBuild(folder_, {"template-2024"})["adapters"]["template-2024"];
  };
  EXPECT_TRUE(hash().is_null());
  EXPECT_FALSE(GraderBuild(folder_).contains("adapters"));
  EXPECT_FALSE(GraderBuild(folder_, {""}).contains("adapters"));
  std::ofstream(adapter + "/__main__.py") << "pass\n";
  const Json first = hash();
  EXPECT_EQ(first.get<std::string>().size(), 64u);
  std::ofstream(adapter + "/hooks/__pycache__/x.pyc") << "x";
  EXPECT_EQ(hash(), first);
  std::ofstream(adapter + "/hooks/sitecustomize.py") << "pass\n";
  EXPECT_NE(hash(), first);
  ::unsetenv("MYOGRADE_BIN_DIR");
}

// The names in the key's folder, and the bytes of the key.
std::pair<std::set<std::string>, std::string> Left(const std::string& folder) {
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    names.insert(entry.path().filename());
  }
  std::ifstream file(folder + "/key", std::ios::binary);
  return {names, {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()}};
}

TEST_F(ReceiptTest, ManyAtOnceMakeOneKey) {
  for (int round = 0; round < 5; ++round) {
    constexpr int kProcesses = 6;
    std::vector<pid_t> children;
    for (int process = 0; process < kProcesses; ++process) {
      const pid_t child = fork();
      ASSERT_GE(child, 0);
      if (child == 0) {
        std::atomic<int> bad = 0;
        std::array<std::string, 8> keys;
        std::vector<std::thread> threads;
        for (std::string& key : keys) {
          threads.emplace_back([&] {
            const auto made = SigningKey::LoadOrMake(folder_ + "/key");
            made.ok() ? void(key = made->PublicPem()) : void(++bad);
          });
        }
        for (std::thread& thread : threads) thread.join();
        for (const std::string& key : keys) bad += key != Key().PublicPem();
        _exit(bad == 0 ? 0 : 1);
      }
      children.push_back(child);
    }
    for (const pid_t child : children) {
      int status = 0;
      waitpid(child, &status, 0);
      EXPECT_EQ(status, 0);
    }
    struct stat info = {};
    ASSERT_EQ(stat((folder_ + "/key").c_str(), &info), 0);
    EXPECT_EQ(info.st_mode & 0777u, 0600u);
    EXPECT_EQ(info.st_nlink, 1u);
    EXPECT_EQ(Left(folder_).first, std::set<std::string>{"key"});
    unlink((folder_ + "/key").c_str());
  }
}

TEST_F(ReceiptTest, AKillWhileTheKeyIsWrittenLeavesNoHalfOfIt) {
  const size_t whole = [&] {
    Key();
    return Left(folder_).second.size();
  }();
  for (size_t bytes = 0; bytes < whole; bytes += 7) {
    unlink((folder_ + "/key").c_str());
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      // The kernel kills at the first byte beyond the limit.
      signal(SIGXFSZ, SIG_DFL);
      const rlimit limits = {bytes, bytes};
      setrlimit(RLIMIT_FSIZE, &limits);
      const bool made = SigningKey::LoadOrMake(folder_ + "/key").ok();
      _exit(made ? 1 : 2);
    }
    int status = 0;
    waitpid(child, &status, 0);
    ASSERT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGXFSZ) << status;
    EXPECT_FALSE(Left(folder_).first.contains("key")) << bytes;
    EXPECT_FALSE(Left(folder_).first.empty()) << "the draft that the kill has left";
    EXPECT_TRUE(SigningKey::LoadOrMake(folder_ + "/key").ok());
    EXPECT_EQ(Left(folder_).first, std::set<std::string>{"key"});
  }
}

TEST_F(ReceiptTest, AKilledMakerOfAnyMomentIsFollowedByAWholeKey) {
  for (int round = 0; round < 100; ++round) {
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      while (SigningKey::LoadOrMake(folder_ + "/key").ok()) unlink((folder_ + "/key").c_str());
      _exit(1);
    }
    usleep(static_cast<useconds_t>(37 * round));
    kill(child, SIGKILL);
    int status = 0;
    waitpid(child, &status, 0);
    EXPECT_TRUE(WIFSIGNALED(status)) << "the child ended by itself";
    EXPECT_TRUE(SigningKey::LoadOrMake(folder_ + "/key").ok()) << round;
    EXPECT_EQ(Left(folder_).first, std::set<std::string>{"key"});
  }
}

TEST_F(ReceiptTest, ABrokenKeyIsNamedAndNeverReplaced) {
  KeyFile file(folder_ + "/key");
  const std::string good = (Key(), Left(folder_).second);
  for (const std::string& broken :
       {good.substr(0, good.size() / 2), std::string(), std::string(20'000, 'x')}) {
    std::ofstream(folder_ + "/key", std::ios::trunc) << broken;
    const auto key = file.Get();
    ASSERT_EQ(key.status().code(), absl::StatusCode::kInternal);
    EXPECT_THAT(std::string(key.status().message()),
                ::testing::StartsWith(folder_ + "/key: holds no Ed25519 private key in PEM; put"));
    EXPECT_EQ(Left(folder_).second, broken);
  }
  std::ofstream(folder_ + "/key", std::ios::trunc) << good;
  const auto key = file.Get();
  ASSERT_TRUE(key.ok()) << "a key that was put back serves without a restart";
  unlink((folder_ + "/key").c_str());
  EXPECT_EQ(*file.Get(), *key) << "what was read once needs the file no more";
}

TEST_F(ReceiptTest, NonsenseIsAnErrorAndNeverACrash) {
  for (const char* text : {"", "{}", "[]", "null", "{\"receipt\":{},\"signature\":{}}",
                           "{\"receipt\":1,\"signature\":2}"}) {
    EXPECT_FALSE(ParseReceipt(text).ok()) << text;
  }
  EXPECT_TRUE(rc::check([](const std::string& noise) { RC_ASSERT(!ParseReceipt(noise).ok()); }));
  EXPECT_FALSE(PublicKey::Parse("-----BEGIN PUBLIC KEY-----\n", "test").ok());
}

EpisodeLog TwoSteps() {
  EpisodeLog log;
  log.action_size = 2;
  log.start.emplace();
  log.actions = {1, 2, 3, 4};
  log.observations = {{1}, {2}};
  log.states = {{3}, {4}};
  log.end = {2, 2, "time", ""};
  return log;
}

TEST(CompareLogs, TellsThePolicyFromTheSimulator) {
  EXPECT_EQ(CompareLogs(TwoSteps(), TwoSteps()).cause, Cause::kNone);
  EpisodeLog other = TwoSteps();
  other.actions[3] = 5;
  other.states[1] = {9};
  LogDifference difference = CompareLogs(TwoSteps(), other);
  EXPECT_EQ(difference.cause, Cause::kPolicy);
  EXPECT_EQ(difference.step, 1);
  other = TwoSteps();
  other.states[0] = {9};
  other.observations[1] = {9};
  other.actions[2] = 7;
  difference = CompareLogs(TwoSteps(), other);
  EXPECT_EQ(difference.cause, Cause::kSimulator);
  EXPECT_EQ(difference.step, 0);
  other = TwoSteps();
  other.actions[0] = -0.0;
  EpisodeLog zero = TwoSteps();
  zero.actions[0] = 0.0;
  EXPECT_EQ(CompareLogs(zero, other).cause, Cause::kPolicy) << "actions are compared bit by bit";
  other = TwoSteps();
  other.end = {2, 2, "crash", ""};
  EXPECT_EQ(CompareLogs(TwoSteps(), other).cause, Cause::kPolicy);
  other = TwoSteps();
  other.end = {2, 2, "fell", ""};
  EXPECT_EQ(CompareLogs(TwoSteps(), other).cause, Cause::kSimulator);
}

TEST(LogUnpacker, PiecesOfAnySizeMakeTheSameLog) {
  const std::string path = MYOGRADE_SOURCE_DIR "/configs/reference/manipulation.lcmlog.zst";
  std::ifstream file(path, std::ios::binary);
  const std::string packed{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  const absl::StatusOr<std::string> log = ReadLog(path);
  ASSERT_TRUE(log.ok()) << log.status();
  for (const std::string& sent : {packed, *log}) {
    for (const size_t size : {size_t{1000}, size_t{7}, sent.size()}) {
      std::string got;
      LogUnpacker unpacker([&](std::string_view piece) {
        got.append(piece);
        return absl::OkStatus();
      });
      for (size_t at = 0; at < sent.size(); at += size) {
        ASSERT_TRUE(unpacker.Take(std::string_view(sent).substr(at, size)).ok());
      }
      ASSERT_TRUE(unpacker.End().ok());
      EXPECT_TRUE(got == *log) << size;
    }
  }
}

TEST(LogUnpacker, WhatTheSinkSaysEndsIt) {
  LogUnpacker unpacker([](std::string_view) { return absl::ResourceExhaustedError("full"); });
  EXPECT_TRUE(absl::IsResourceExhausted(unpacker.Take("plain")));
}

TEST(UnpackLog, DamageIsAnError) {
  EXPECT_EQ(*UnpackLog("plain"), "plain");
  EXPECT_FALSE(UnpackLog(std::string_view("\x28\xb5\x2f\xfdxyz")).ok());
  EXPECT_TRUE(CheckLogHash(Sha256Hex("plain"), Sha256Hex("plain")).ok());
  EXPECT_TRUE(absl::IsDataLoss(CheckLogHash(std::string(64, '0'), Sha256Hex("plain"))));
}

}  // namespace
}  // namespace myograde::server
