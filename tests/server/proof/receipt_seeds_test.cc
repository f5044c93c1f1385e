// Receipts of phases with hidden seeds, before and after the reveal.
#include <cstdlib>
#include <filesystem>

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/base/config_reader.h"
#include "protocol/lease/policy_seed.h"
#include "protocol/lease/seed_commitment.h"
#include "protocol/lease/track_config.h"
#include "server/grading/results.h"
#include "server/proof/receipt.h"
#include "server/proof/seed_list.h"
#include "server/proof/signing_key.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

class HiddenReceiptTest : public ::testing::Test {
 protected:
  HiddenReceiptTest() {
    char name[] = "/tmp/myograde-hidden-receipt-XXXXXX";
    if (mkdtemp(name) == nullptr) std::abort();
    folder_ = name;
  }
  ~HiddenReceiptTest() override { std::filesystem::remove_all(folder_); }

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

// A receipt of a phase with hidden seeds, with the secret that opens it.
struct Hidden {
  Hidden() {
    const TrackConfig track =
        *LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", "manipulation", "");
    const PhaseSecrets secrets = SecretsOfPhase(secret, "final");
    config = *WithPhase(track, {{"phase", "final"},
                                {"seeds", seeds},
                                {"policy_seed_secret", secrets.policy_seed_secret},
                                {"seed_salt", secrets.seed_salt}});
    std::vector<EpisodeRow> rows;
    for (int64_t index = 0; index < 3; ++index) {
      EpisodeRow& row = rows.emplace_back();
      row.index = index;
      row.seed = seeds[static_cast<size_t>(index)];
      row.facts_json = R"({"steps":10,"digest":"d"})";
      row.metrics_json = R"({"time_s":0.5})";
    }
    Json shown = config.effective;
    for (const char* key : {"seeds", "policy_seed_secret", "seed_salt"}) shown.erase(key);
    Json episodes = Json::array();
    for (const EpisodeRow& row : rows) episodes.push_back(ReceiptEntry(row, config.seed_salt));
    receipt = {{"format", 2},
               {"track_kind", "manipulation"},
               {"track_config", shown},
               {"config", config.hash},
               {"seeds", SeedListHash(seeds)},
               {"policy_seeds", nullptr},
               {"hidden", {{"commitment", SecretCommitment(secret)}, {"count", 3}}},
               {"grader", Json::object()},
               {"results", ResultsHash(rows, config.seed_salt)},
               {"merkle_root", ComputeMerkleRoot(rows, config.seed_salt)},
               {"episodes", episodes}};
  }

  std::string secret = std::string(kSeedSecretBytes, 's');
  std::vector<uint64_t> seeds = DeriveSeeds(secret, "final", 3);
  TrackConfig config;
  Json receipt;
};

TEST_F(HiddenReceiptTest, HiddenSeedsAreInNoByteOfIt) {
  const Hidden hidden;
  const std::string text = *SignReceipt(hidden.receipt, Key());
  for (const uint64_t seed : hidden.seeds) {
    EXPECT_EQ(text.find(absl::StrCat(seed)), std::string::npos);
    EXPECT_EQ(text.find(absl::StrCat(absl::Hex(seed))), std::string::npos);
  }
  EXPECT_EQ(text.find(hidden.config.seed_salt), std::string::npos);
  EXPECT_EQ(text.find(hidden.config.policy_seed_secret), std::string::npos);
  EXPECT_EQ(text.find(absl::BytesToHexString(hidden.secret)), std::string::npos);
}

TEST_F(HiddenReceiptTest, BeforeTheRevealItSaysWhatCanNotBeChecked) {
  const SigningKey key = Key();
  const PublicKey known = *PublicKey::Parse(key.PublicPem(), "test");
  const std::string text = *SignReceipt(Hidden().receipt, key);
  ASSERT_TRUE(ParseReceipt(text).ok());
  const std::vector<ReceiptCheck> checks = CheckReceipt(text, known);
  EXPECT_TRUE(Wrong(checks).empty());
  EXPECT_EQ(checks.back().name, "hidden");
  EXPECT_THAT(checks.back().detail, testing::HasSubstr("can't be checked"));
}

TEST_F(HiddenReceiptTest, TheRevealedSecretOpensEveryCommitment) {
  const SigningKey key = Key();
  const PublicKey known = *PublicKey::Parse(key.PublicPem(), "test");
  const Hidden hidden;
  const auto checked = [&](const Json& receipt, const std::string& secret) {
    return CheckReceipt(*SignReceipt(receipt, key), known, secret);
  };
  const std::vector<ReceiptCheck> checks = checked(hidden.receipt, hidden.secret);
  EXPECT_TRUE(Wrong(checks).empty());
  std::vector<std::string> names;
  for (const ReceiptCheck& check : checks) names.push_back(check.name);
  EXPECT_THAT(names, testing::ElementsAre("signature", "merkle_root", "results", "commitment",
                                          "seed_commitments", "seeds", "config", "policy_seeds"));
  const auto opened = OpenedReceipt(hidden.receipt, hidden.secret);
  ASSERT_TRUE(opened.ok()) << opened.status();
  EXPECT_EQ((*opened)["track_config"], hidden.config.effective);
  EXPECT_EQ((*opened)["policy_seeds"][2], PolicySeed(hidden.config.policy_seed_secret, 2));

  EXPECT_THAT(Wrong(checked(hidden.receipt, std::string(kSeedSecretBytes, 't'))),
              testing::ElementsAre("commitment", "seed_commitments", "seeds", "config"));
  Json receipt = hidden.receipt;
  receipt["hidden"]["commitment"] = nullptr;
  EXPECT_TRUE(Wrong(checked(receipt, hidden.secret)).empty());
  receipt["hidden"]["count"] = 4;
  EXPECT_THAT(Wrong(checked(receipt, hidden.secret)), testing::ElementsAre("seeds", "config"));
  receipt = hidden.receipt;
  receipt["track_config"]["episodes_per_lease"] = 3;
  EXPECT_THAT(Wrong(checked(receipt, hidden.secret)), testing::ElementsAre("config"));
  receipt["track_config"]["budgets"] = "none";
  EXPECT_THAT(Wrong(checked(receipt, hidden.secret)), testing::ElementsAre("config"));
  receipt = hidden.receipt;
  std::swap(receipt["episodes"][0]["seed_commitment"], receipt["episodes"][1]["seed_commitment"]);
  EXPECT_THAT(Wrong(checked(receipt, hidden.secret)),
              testing::ElementsAre("merkle_root", "results", "seed_commitments"));
  receipt = hidden.receipt;
  receipt["episodes"].erase(1);
  EXPECT_THAT(Wrong(checked(receipt, hidden.secret)),
              testing::ElementsAre("merkle_root", "results", "seeds", "seeds"));
}

TEST_F(HiddenReceiptTest, FormsWithASeedAndACommitmentAreNone) {
  const SigningKey key = Key();
  const auto known = [&](const Json& receipt) {
    return ParseReceipt(*SignReceipt(receipt, key)).ok();
  };
  const Json good = Hidden().receipt;
  EXPECT_TRUE(known(good));
  for (const auto& [pointer, value] : std::initializer_list<std::pair<const char*, Json>>{
           {"/format", 3},
           {"/format", 1},
           {"/hidden", nullptr},
           {"/hidden/count", 0},
           {"/hidden/count", 10001},
           {"/hidden/commitment", "abc"},
           {"/track_config", 7},
           {"/track_config/phase", ""},
           {"/episodes/0/seed", 5},
           {"/episodes/0/seed_commitment", "abc"},
           {"/episodes/0/index", 10000}}) {
    Json bad = good;
    bad[Json::json_pointer(pointer)] = value;
    EXPECT_FALSE(known(bad)) << pointer << " " << value;
  }
}

TEST(SecretOfDigits, TakesDigitsAndNothingElse) {
  const std::string digits(64, 'A');
  EXPECT_EQ(*SecretOfDigits(" " + digits + "\n", "t"), std::string(kSeedSecretBytes, '\xaa'));
  for (const std::string& bad : {std::string(), digits + "0", std::string(64, 'g')}) {
    EXPECT_TRUE(absl::IsInvalidArgument(SecretOfDigits(bad, "t").status())) << bad;
  }
}

}  // namespace
}  // namespace myograde::server
