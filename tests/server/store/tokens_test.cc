// Bearer tokens in the store.
#include <string>

#include <SQLiteCpp/SQLiteCpp.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/base/error_code.h"
#include "tests/server/store/store_fixture.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;

class TokensTest : public StoreTest {
 protected:
  absl::StatusOr<int64_t> Add(const std::string& hash, const std::string& role,
                              const std::string& team, const std::string& label,
                              int64_t expires_at = 0) {
    absl::StatusOr<int64_t> id = absl::InternalError("");
    const absl::Status status = store_->Write([&](Transaction& writer) {
      id = writer.callers.AddToken(
          hash, {.role = role, .team = team, .label = label, .expires_at = expires_at}, "uid 0");
      return id.status();
    });
    if (!status.ok()) return status;
    return id;
  }
  absl::StatusOr<TokenRow> Find(char digit) {
    absl::StatusOr<TokenRow> token = absl::InternalError("");
    Read([&](const Transaction& reader) {
      token = reader.callers.TokenByHash(std::string(64, digit));
    });
    return token;
  }
  void MakeTeam(const std::string& team) {
    ASSERT_TRUE(store_->Write([&](Transaction& writer) {
      return writer.teams.Create(team, "uid 0", "");
    }).ok());
  }
  int64_t now_ms() { return absl::ToUnixMillis(clock_.Now()); }
};

TEST_F(TokensTest, ATokenIsFoundByItsHash) {
  MakeTeam("alpha");
  const int64_t later = now_ms() + 1000;
  ASSERT_TRUE(Add(std::string(64, 'a'), "participant", "alpha", "laptop", later).ok());
  ASSERT_TRUE(Add(std::string(64, 'b'), "operator", "", "service", 0).ok());
  const absl::StatusOr<TokenRow> token = Find('a');
  ASSERT_TRUE(token.ok()) << token.status();
  EXPECT_EQ(token->role, "participant");
  EXPECT_EQ(token->team, "alpha");
  EXPECT_EQ(token->label, "laptop");
  EXPECT_EQ(token->created_by, "uid 0");
  EXPECT_EQ(token->created_at, now_ms());
  EXPECT_EQ(token->expires_at, later);
  EXPECT_EQ(token->revoked_at, 0);
  EXPECT_EQ(token->last_used_at, 0);
  EXPECT_EQ(Find('b')->expires_at, 0);
  EXPECT_EQ(Find('b')->team, "");
  EXPECT_TRUE(absl::IsNotFound(Find('c').status()));
  Read([&](const Transaction& reader) {
    const std::vector<TokenRow> tokens = reader.callers.Tokens().rows;
    ASSERT_EQ(tokens.size(), 2u);
    EXPECT_GT(tokens[0].id, tokens[1].id);
    EXPECT_EQ(reader.callers.Tokens(tokens[0].id, 5).rows.size(), 1u);
    EXPECT_EQ(reader.callers.Tokens(INT64_MAX, 1).last_id, tokens[0].id);
  });
}

TEST_F(TokensTest, WhatMakesNoTokenIsRefused) {
  MakeTeam("alpha");
  const std::string hash(64, 'a');
  EXPECT_TRUE(absl::IsInvalidArgument(Add(hash, "participant", "", "x").status()));
  EXPECT_TRUE(absl::IsInvalidArgument(Add(hash, "organiser", "alpha", "x").status()));
  EXPECT_TRUE(absl::IsInvalidArgument(Add(hash, "operator", "", "x", now_ms()).status()));
  const absl::Status unknown = Add(hash, "participant", "beta", "x").status();
  EXPECT_EQ(ErrorCodeOf(unknown), "unknown_team") << unknown;
  EXPECT_TRUE(absl::IsFailedPrecondition(Add(hash, "emperor", "", "x").status()));
  ASSERT_TRUE(Add(hash, "organiser", "", "x").ok());
  EXPECT_TRUE(absl::IsFailedPrecondition(Add(hash, "organiser", "", "x").status())) << "twice";
  Read([&](const Transaction& reader) { EXPECT_EQ(reader.callers.Tokens().rows.size(), 1u); });
}

TEST_F(TokensTest, ATokenIsRevokedOnce) {
  const absl::StatusOr<int64_t> id = Add(std::string(64, 'a'), "operator", "", "x");
  ASSERT_TRUE(id.ok());
  const auto revoke = [&](int64_t one, const std::string& who) {
    absl::StatusOr<bool> changed = false;
    EXPECT_TRUE(store_->Write([&](Transaction& writer) {
      changed = writer.callers.RevokeToken(one, who);
      return absl::OkStatus();
    }).ok());
    return changed;
  };
  EXPECT_TRUE(*revoke(*id, "uid 0"));
  const int64_t at = Find('a')->revoked_at;
  clock_.Advance(absl::Hours(1));
  EXPECT_FALSE(*revoke(*id, "uid 7"));
  EXPECT_EQ(Find('a')->revoked_at, at);
  EXPECT_EQ(Find('a')->revoked_by, "uid 0");
  EXPECT_TRUE(absl::IsNotFound(revoke(*id + 1, "uid 0").status()));
}

TEST_F(TokensTest, LastUseIsNotedToTheMinute) {
  const absl::StatusOr<int64_t> id = Add(std::string(64, 'a'), "operator", "", "x");
  ASSERT_TRUE(id.ok());
  const auto touch = [&] {
    ASSERT_TRUE(
        store_->Write([&](Transaction& writer) { return writer.callers.TouchToken(*id); }).ok());
  };
  touch();
  const int64_t first = Find('a')->last_used_at;
  EXPECT_EQ(first % 60'000, 0);
  EXPECT_LE(first, now_ms());
  EXPECT_GT(first, now_ms() - 60'000);
  clock_.Advance(absl::Minutes(1));
  touch();
  EXPECT_EQ(Find('a')->last_used_at, first + 60'000);
  clock_.Jump(-absl::Hours(1));
  touch();
  EXPECT_EQ(Find('a')->last_used_at, first + 60'000) << "a clock that goes back forgets nothing";
}

TEST_F(TokensTest, ATokenFollowsItsTeam) {
  MakeTeam("alpha");
  MakeTeam("beta");
  ASSERT_TRUE(Add(std::string(64, 'a'), "participant", "alpha", "x").ok());
  ASSERT_TRUE(store_->Write([](Transaction& writer) {
    absl::Status status = writer.teams.Rename("alpha", "gamma", "uid 0", "").status();
    status.Update(writer.teams.Merge("alpha", "beta", "uid 0", ""));
    return status;
  }).ok());
  EXPECT_EQ(Find('a')->team, "beta");
  ASSERT_TRUE(Add(std::string(64, 'b'), "participant", "alpha", "x").ok());
  EXPECT_EQ(Find('b')->team, "beta");
}

TEST_F(TokensTest, ADamagedTokenIsNone) {
  MakeTeam("alpha");
  ASSERT_TRUE(Add(std::string(64, 'a'), "participant", "alpha", "x").ok());
  ASSERT_TRUE(Add(std::string(64, 'b'), "organiser", "", "y").ok());
  for (const char* change : {"role = 'operator'", "role = 'emperor'", "team_id = 99",
                             "revoked_at = 5", "expires_at = 999999999999999999"}) {
    SCOPED_TRACE(change);
    ASSERT_EQ(SqlError("BEGIN; PRAGMA ignore_check_constraints = ON; DELETE FROM token; INSERT "
                       "INTO token (id, hash, role, team_id, label, created_at, created_by) VALUES "
                       "(1, '" + std::string(64, 'a') + "', 'participant', 1, 'x', 1, 'uid 0'), "
                       "(2, '" + std::string(64, 'b') + "', 'organiser', NULL, 'y', 1, 'uid 0'); "
                       "UPDATE token SET " + std::string(change) + " WHERE id = 1; COMMIT"),
              "");
    EXPECT_TRUE(ExtractDamage(Find('a').status()).has_value()) << Find('a').status();
    EXPECT_TRUE(Find('b').ok());
    Read([&](const Transaction& reader) {
      const Listed<TokenRow> listed = reader.callers.Tokens();
      EXPECT_EQ(listed.rows.size(), 1u);
      ASSERT_FALSE(listed.damaged.empty());
      EXPECT_EQ(listed.damaged[0].key, "1");
    });
  }
}

}  // namespace
}  // namespace myograde::server
