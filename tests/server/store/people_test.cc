// Teams with members, former names and bans.
#include <fstream>
#include <set>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/base/error_code.h"
#include "tests/server/store/people_fixture.h"

namespace myograde::server {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

TEST_F(PeopleTest, TheFirstWhoSubmitsForATeamFoundsIt) {
  ASSERT_TRUE(Found("alpha", kAda).ok());
  EXPECT_TRUE(Found("alpha", kAda).ok()) << "a member may go on";
  EXPECT_THAT(TeamsOf(kAda), ElementsAre("alpha"));
  EXPECT_THAT(ListMembers("alpha"), ElementsAre(kAda));
  const absl::Status others = Found("alpha", kBob);
  EXPECT_EQ(ErrorCodeOf(others), kForbiddenCode) << others;
  EXPECT_THAT(Sentence(others), AllOf(HasSubstr("\"alpha\" belongs to others"), HasSubstr(kBob),
                                      Not(HasSubstr(kAda))));
  const absl::Status second = Found("beta", kAda);
  EXPECT_EQ(ErrorCodeOf(second), kForbiddenCode) << "many names of one person gain nothing";
  EXPECT_THAT(Sentence(second), HasSubstr("uid 1001 belongs to team \"alpha\", and one person may "
                                          "belong to 1 team"));
  EXPECT_TRUE(Found("beta", kAda, 2).ok());
  EXPECT_THAT(TeamsOf(kAda), ElementsAre("alpha", "beta"));
  EXPECT_EQ(ErrorCodeOf(Found("ALPHA", kBob)), "look_alike");
  Read([&](const Transaction& reader) {
    const auto events = reader.teams.Events("alpha");
    ASSERT_EQ(events.size(), 1u);
    EXPECT_EQ(events[0].event, "created");
    EXPECT_EQ(events[0].who, kAda);
  });
}

TEST_F(PeopleTest, ATeamThatHadMembersIsNobodysToTake) {
  ASSERT_TRUE(Found("alpha", kAda).ok());
  ASSERT_TRUE(SetMember("alpha", kAda, false).ok());
  EXPECT_THAT(TeamsOf(kAda), IsEmpty());
  EXPECT_EQ(ErrorCodeOf(Found("alpha", kBob)), kForbiddenCode);
  EXPECT_EQ(ErrorCodeOf(Found("alpha", kAda)), kForbiddenCode);
  ASSERT_TRUE(SetMember("alpha", kBob, true).ok());
  EXPECT_TRUE(Found("alpha", kBob).ok());
  // One that only a grant has made has no members yet.
  ASSERT_TRUE(Write([](Transaction& w) {
    return w.quotas.Grant({"gamma", "manipulation", Budget::kRanked, 1, "early"}, "uid 0");
  }).ok());
  EXPECT_TRUE(Found("gamma", kAda).ok());
}

TEST_F(PeopleTest, AMemberIsAddedAndRemovedOnce) {
  ASSERT_TRUE(Create("alpha").ok());
  const auto set = [&](bool belongs) {
    bool changed = false;
    EXPECT_TRUE(Write([&](Transaction& w) {
      const absl::StatusOr<bool> done = w.teams.SetMember("alpha", kAda, belongs, "uid 0");
      changed = done.value_or(false);
      return done.status();
    }).ok());
    return changed;
  };
  EXPECT_FALSE(set(false));
  EXPECT_TRUE(set(true));
  EXPECT_FALSE(set(true));
  EXPECT_TRUE(set(false));
  EXPECT_TRUE(set(true));
  EXPECT_THAT(ListMembers("alpha"), ElementsAre(kAda));
  EXPECT_TRUE(absl::IsNotFound(SetMember("nobody", kAda, true)));
  EXPECT_THAT(SqlError("UPDATE member SET belongs = 0"), HasSubstr("never changed"));
  EXPECT_THAT(SqlError("DELETE FROM member"), HasSubstr("never deleted"));
}

TEST_F(PeopleTest, AFormerNameFindsTheTeamEverywhere) {
  const Accepted first = Submit("alpha", 'a');
  Play(first);
  const int64_t changes = BoardChanges();
  ASSERT_TRUE(Rename("alpha", "Team Blue").ok());
  EXPECT_GT(BoardChanges(), changes) << "a kept board shows the old name";
  EXPECT_THAT(Board(), ElementsAre("Team Blue"));
  for (const char* name : {"alpha", "Team Blue", "Team  Blue", "\xef\xbd\x81lpha"}) {
    EXPECT_EQ(TeamOf(name), "Team Blue") << name;
    EXPECT_TRUE(Try(name, 'b').ok());
    EXPECT_EQ(Quota(name).total_of(Budget::kRanked).charged, 1) << name;
    Read([&](const Transaction& reader) {
      EXPECT_EQ(reader.submissions.List({}).rows.front().team, "Team Blue");
      EXPECT_EQ(reader.submissions.List({.team = reader.teams.NameOf(name)}).rows.size(), 2u);
      EXPECT_EQ(reader.quotas.Ledger(name, "", INT64_MAX, 10).rows.size(), 1u);
      EXPECT_EQ(reader.teams.Find(name)->name, "Team Blue");
      EXPECT_THAT(reader.teams.Find(name)->other_names, ElementsAre("alpha"));
    });
  }
  ASSERT_TRUE(Create("beta").ok());
  EXPECT_THAT(Sentence(Create("alpha")), HasSubstr("\"alpha\" is a former name of team "
                                                   "\"Team Blue\""));
  EXPECT_THAT(Sentence(Rename("beta", "alpha")), HasSubstr("is a former name of team"));
  EXPECT_THAT(Sentence(Rename("beta", "Team Blue")), HasSubstr("there is a team \"Team Blue\""));
  EXPECT_EQ(ErrorCodeOf(Rename("beta", "Alpha")), "look_alike") << "also of a former name";
  EXPECT_EQ(ErrorCodeOf(Try("a1pha", 'c')), "look_alike");
  EXPECT_TRUE(absl::IsInvalidArgument(Rename("beta", "x\n")));
  EXPECT_TRUE(absl::IsNotFound(Rename("nobody", "gamma")));
}

TEST_F(PeopleTest, ATeamMayTakeItsOwnNamesBack) {
  ASSERT_TRUE(Create("alpha").ok());
  ASSERT_TRUE(Rename("alpha", "Alpha").ok()) << "looks only like itself";
  ASSERT_TRUE(Rename("alpha", "beta").ok());
  ASSERT_TRUE(Rename("beta", "alpha").ok());
  for (const char* name : {"alpha", "Alpha", "beta"}) EXPECT_EQ(TeamOf(name), "alpha");
  Read([&](const Transaction& reader) {
    EXPECT_THAT(reader.teams.Find("beta")->other_names, ElementsAre("Alpha", "beta"));
    EXPECT_EQ(reader.teams.Events("alpha").size(), 4u);
  });
  Open();
  EXPECT_EQ(ErrorCodeOf(Try("BETA")), "look_alike") << "after a start too";
}

TEST_F(PeopleTest, UploadsFollowTheirTeamsName) {
  const auto upload = [&](char artefact, const std::string& team) {
    return Write([&](Transaction& w) {
      const ArtefactRow row = {{"walker", {"./policy"}}, std::string(64, artefact), 10, 2};
      absl::Status status = w.content.AddArtefact(row).status();
      status.Update(w.content.AddUpload(row, {.uploader = "", .team = team}, {.of_one = 1}));
      return status;
    });
  };
  ASSERT_TRUE(Create("alpha").ok());
  ASSERT_TRUE(upload('a', "alpha").ok());
  ASSERT_TRUE(Rename("alpha", "beta").ok());
  EXPECT_EQ(ErrorCodeOf(upload('b', "alpha")), "quota");
  EXPECT_EQ(ErrorCodeOf(upload('b', "beta")), "quota");
  ASSERT_TRUE(Ban("beta").ok());
  EXPECT_EQ(ErrorCodeOf(upload('c', "alpha")), kBannedCode);
}

TEST_F(PeopleTest, ARerunOfABannedTeamIsTheOrganisersAlone) {
  const Accepted accepted = Submit("alpha", 'a');
  Play(accepted);
  ASSERT_TRUE(Rename("alpha", "beta").ok());
  const auto rerun = [&](bool organiser) {
    return Write([&](Transaction& w) {
      return w.submissions.CheckReruns(accepted.submission, kAda, organiser, RerunLimits());
    });
  };
  EXPECT_TRUE(rerun(false).ok());
  ASSERT_TRUE(Ban("beta").ok());
  EXPECT_EQ(ErrorCodeOf(rerun(false)), kBannedCode);
  EXPECT_TRUE(rerun(true).ok());
}

TEST_F(PeopleTest, ABannedTeamHandsInNothingAndLeavesTheBoards) {
  ASSERT_TRUE(Found("alpha", kAda).ok());
  Play(Submit("alpha", 'a'));
  Play(Submit("beta", 'b'));
  const Accepted running = Submit("alpha", 'e');
  const int64_t changes = BoardChanges();
  ASSERT_TRUE(Rename("alpha", "gamma").ok());
  ASSERT_TRUE(Ban("gamma").ok());
  EXPECT_GT(BoardChanges(), changes);
  EXPECT_THAT(Board(), ElementsAre("beta"));
  for (const char* name : {"alpha", "gamma"}) {
    const absl::Status refused = Try(name, 'f');
    EXPECT_EQ(ErrorCodeOf(refused), kBannedCode) << refused;
    EXPECT_THAT(Sentence(refused), HasSubstr("team \"gamma\" is banned by the organisers (cheats)"));
    Read([&](const Transaction& reader) {
      EXPECT_EQ(ErrorCodeOf(reader.teams.Check(name)), kBannedCode);
    });
  }
  Play(running);  // what was accepted goes on
  EXPECT_THAT(Board(), ElementsAre("beta"));
  EXPECT_THAT(TeamsOf(kAda), ElementsAre("gamma")) << "and its members may read";
  ASSERT_TRUE(Ban("gamma", false).ok());
  EXPECT_THAT(Board(), ElementsAre("gamma", "beta", "gamma"));
  EXPECT_TRUE(Try("alpha", 'f').ok());
}

TEST_F(PeopleTest, AnExportHoldsAllOfItAndAnImportGivesItBack) {
  ASSERT_TRUE(Found("alpha", kAda).ok());
  ASSERT_TRUE(Found("beta", kBob).ok());
  Play(Submit("beta", 'b'));
  ASSERT_TRUE(Rename("alpha", "Team Blue").ok());
  ASSERT_TRUE(Merge("beta", "alpha").ok());
  ASSERT_TRUE(Create("gamma").ok());
  ASSERT_TRUE(Ban("gamma").ok());
  ASSERT_TRUE(Write([](Transaction& w) {
                return w.callers
                    .AddToken(std::string(64, 'a'),
                              {.role = "participant", .team = "gamma", .label = "laptop"}, "uid 0")
                    .status();
              }).ok());
  const auto text_of = [](const std::string& store) {
    std::string text;
    EXPECT_TRUE(ReaderPool(store).Read([&](const Transaction& reader) {
      return reader.Export([&](std::string_view part) {
        text.append(part);
        return true;
      });
    }).ok());
    return text;
  };
  const std::string text = text_of(path_);
  EXPECT_THAT(text, Not(HasSubstr("\"token\"")));
  EXPECT_THAT(text, Not(HasSubstr(std::string(64, 'a'))));
  const std::string file = dir_ + "/export.json";
  std::ofstream(file, std::ios::binary) << text;
  const absl::StatusOr<ExportInfo> info = CheckExport(file);
  ASSERT_TRUE(info.ok()) << info.status();
  path_ = dir_ + "/copy.db";
  Open();
  ASSERT_TRUE(Write([&](Transaction& w) {
                return w.Import(file, *info, "uid 0",
                                [](const Transaction&) { return absl::OkStatus(); });
              }).ok());
  EXPECT_EQ(text_of(path_), text);
  EXPECT_EQ(TeamOf("alpha"), "Team Blue");
  EXPECT_THAT(TeamsOf(kBob), ElementsAre("Team Blue"));
  EXPECT_THAT(Board(), ElementsAre("Team Blue"));
  EXPECT_EQ(ErrorCodeOf(Try("gamma", 'b')), kBannedCode);
  EXPECT_EQ(ErrorCodeOf(Try("ALPHA", 'b')), "look_alike") << "former names have looks as well";
}

TEST_F(PeopleTest, DamagedRowsAreReportedAndTheRestGoesOn) {
  ASSERT_TRUE(Found("alpha", kAda).ok());
  ASSERT_TRUE(Found("beta", kBob).ok());
  Play(Submit("alpha", 'a'));
  Play(Submit("beta", 'b'));
  const auto damage = [&](const std::string& sql) {
    EXPECT_EQ(SqlError("PRAGMA writable_schema = ON; PRAGMA ignore_check_constraints = ON; "
                       "PRAGMA foreign_keys = OFF; DROP TRIGGER IF EXISTS member_fixed; " + sql),
              "");
  };
  damage("UPDATE team SET merged_into = 99 WHERE name = 'alpha'");
  EXPECT_THAT(Board(), ElementsAre("alpha", "beta")) << "what counts is in the journal";
  EXPECT_TRUE(ExtractDamage(Try("alpha", 'e')).has_value());
  EXPECT_TRUE(Try("beta", 'e').ok());
  EXPECT_THAT(TeamsOf(kAda), IsEmpty()) << "nobody gains rights by damage";
  EXPECT_THAT(TeamsOf(kBob), ElementsAre("beta"));
  Read([&](const Transaction& reader) {
    EXPECT_FALSE(reader.teams.List().damaged.empty());
    EXPECT_TRUE(ExtractDamage(reader.teams.Find("alpha").status()).has_value());
  });
  damage("UPDATE team SET merged_into = NULL, banned = 7 WHERE name = 'alpha'");
  EXPECT_TRUE(ExtractDamage(Try("alpha", 'e')).has_value());
  damage("UPDATE member SET belongs = 7 WHERE person = 'uid 1002'");
  EXPECT_THAT(TeamsOf(kBob), IsEmpty());
}

}  // namespace
}  // namespace myograde::server
