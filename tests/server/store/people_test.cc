// Teams with members, former names, merges and bans.
#include <fstream>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include <SQLiteCpp/SQLiteCpp.h>
#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/server/store/store_fixture.h"

namespace myograde::server {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

constexpr char kAda[] = "uid 1001";
constexpr char kBob[] = "uid 1002";

class PeopleTest : public StoreTest {
 protected:
  absl::Status Write(const std::function<absl::Status(Writer&)>& change) {
    return store_->Write(change);
  }
  absl::Status Create(const std::string& team) {
    return Write([&](Writer& w) { return w.CreateTeam(team, "uid 0", "").status(); });
  }
  absl::Status Found(const std::string& team, const std::string& person, int64_t most = 1) {
    return Write([&](Writer& w) { return w.FoundTeam(team, person, most); });
  }
  absl::Status Rename(const std::string& team, const std::string& name) {
    return Write([&](Writer& w) { return w.RenameTeam(team, name, "uid 0", "asked for").status(); });
  }
  absl::Status Merge(const std::string& team, const std::string& into) {
    return Write([&](Writer& w) { return w.MergeTeams(team, into, "uid 0", "one group"); });
  }
  absl::Status Ban(const std::string& team, bool banned = true) {
    return Write([&](Writer& w) { return w.BanTeam(team, banned, "uid 0", "cheats").status(); });
  }
  absl::Status SetMember(const std::string& team, const std::string& person, bool belongs) {
    return Write([&](Writer& w) { return w.SetMember(team, person, belongs, "uid 0").status(); });
  }
  absl::Status Try(const std::string& team, char artefact = 'a') {
    return TrySubmit(team, artefact, /*ranked=*/true).status();
  }
  std::set<std::string> TeamsOf(const std::string& person) {
    std::set<std::string> teams;
    Read([&](Reader& reader) { teams = reader.TeamsOf(person); });
    return teams;
  }
  std::vector<std::string> MembersOf(const std::string& team) {
    std::vector<std::string> members;
    Read([&](Reader& reader) {
      for (const MemberRow& member : reader.Members(team).rows) members.push_back(member.person);
    });
    return members;
  }
  std::string TeamOf(const std::string& name) {
    std::string team;
    Read([&](Reader& reader) { team = reader.TeamOf(name); });
    return team;
  }
  // Plays a submission to its end, so that it can stand on a board.
  void Play(const Accepted& accepted) {
    for (const size_t lease : {0, 1}) {
      const auto first = static_cast<int64_t>(2 * lease);
      ASSERT_TRUE(Start(accepted.leases[lease], 1).ok());
      ASSERT_TRUE(Record(accepted, first, 1).ok() && Record(accepted, first + 1, 1).ok());
      ASSERT_TRUE(Write([&](Writer& w) {
        return w.FinishLease(accepted.leases[lease], 1, "{}", "daemon");
      }).ok());
    }
    ASSERT_TRUE(Write([&](Writer& w) {
      return w.EndEvaluation(accepted.evaluation, EvaluationState::kDone, "", "x", "daemon");
    }).ok());
  }
  // The teams of the rows that may stand on the board, by submission.
  std::vector<std::string> Board() {
    std::vector<std::string> teams;
    Read([&](Reader& reader) {
      const Listed<StandingRow> listed = reader.Standings(std::string(64, 'c'));
      for (const StandingRow& row : listed.rows) teams.push_back(row.team);
      for (const Damage& damage : listed.damaged) teams.push_back(DamageText(damage));
    });
    return teams;
  }
  int64_t BoardChanges() {
    int64_t changes = 0;
    Read([&](Reader& reader) { changes = reader.BoardChanges(); });
    return changes;
  }
  QuotaUse Quota(const std::string& team) {
    QuotaUse use;
    Read([&](Reader& reader) {
      use = reader.Quota(team, "manipulation", absl::ToUnixMillis(clock_.Now()));
    });
    return use;
  }
  // All rows of tables that no act on a team may change.
  std::string History() {
    SQLite::Database db(path_);
    std::string text;
    for (const char* table : {"submission", "admission", "ledger"}) {
      SQLite::Statement select(db, absl::StrCat("SELECT * FROM ", table, " ORDER BY 1"));
      while (select.executeStep()) {
        for (int i = 0; i < select.getColumnCount(); ++i) {
          absl::StrAppend(&text, select.getColumn(i).getString(), "|");
        }
      }
    }
    return text;
  }
};

std::string Sentence(const absl::Status& status) { return std::string(status.message()); }

TEST_F(PeopleTest, TheFirstWhoSubmitsForATeamFoundsIt) {
  ASSERT_TRUE(Found("alpha", kAda).ok());
  EXPECT_TRUE(Found("alpha", kAda).ok()) << "a member may go on";
  EXPECT_THAT(TeamsOf(kAda), ElementsAre("alpha"));
  EXPECT_THAT(MembersOf("alpha"), ElementsAre(kAda));
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
  Read([&](Reader& reader) {
    const auto events = reader.TeamEvents("alpha").rows;
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
  ASSERT_TRUE(Write([](Writer& w) {
    return w.Grant({"gamma", "manipulation", Budget::kRanked, 1, "early"}, "uid 0");
  }).ok());
  EXPECT_TRUE(Found("gamma", kAda).ok());
}

TEST_F(PeopleTest, AMemberIsAddedAndRemovedOnce) {
  ASSERT_TRUE(Create("alpha").ok());
  const auto set = [&](bool belongs) {
    bool changed = false;
    EXPECT_TRUE(Write([&](Writer& w) {
      const absl::StatusOr<bool> done = w.SetMember("alpha", kAda, belongs, "uid 0");
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
  EXPECT_THAT(MembersOf("alpha"), ElementsAre(kAda));
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
    Read([&](Reader& reader) {
      EXPECT_EQ(reader.Submissions({}).rows.front().team, "Team Blue");
      EXPECT_EQ(reader.Submissions({.team = reader.TeamOf(name)}).rows.size(), 2u);
      EXPECT_EQ(reader.Ledger(name, "", INT64_MAX, 10).rows.size(), 1u);
      EXPECT_EQ(reader.Team(name)->name, "Team Blue");
      EXPECT_THAT(reader.Team(name)->other_names, ElementsAre("alpha"));
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
  Read([&](Reader& reader) {
    EXPECT_THAT(reader.Team("beta")->other_names, ElementsAre("Alpha", "beta"));
    EXPECT_EQ(reader.TeamEvents("alpha").rows.size(), 4u);
  });
  Open();
  EXPECT_EQ(ErrorCodeOf(Try("BETA")), "look_alike") << "after a start too";
}

TEST_F(PeopleTest, UploadsFollowTheirTeamsName) {
  const auto upload = [&](char artefact, const std::string& team) {
    return Write([&](Writer& w) {
      const ArtefactRow row = {std::string(64, artefact), "walker", {"./policy"}, {}, 10, 2};
      absl::Status status = w.AddArtefact(row).status();
      status.Update(w.AddUpload(row, {.uploader = "", .team = team}, {.of_one = 1}));
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

TEST_F(PeopleTest, AMergedTeamCountsAsTheOtherAndNoRowOfThePastChanges) {
  ASSERT_TRUE(Found("alpha", kAda).ok());
  ASSERT_TRUE(Found("beta", kBob).ok());
  const Accepted first = Submit("alpha", 'a');
  const Accepted second = Submit("beta", 'b');
  Play(first);
  Play(second);
  ASSERT_TRUE(TrySubmit("beta", 'e', /*ranked=*/true).ok());
  ASSERT_TRUE(Write([](Writer& w) {
    return w.Grant({"beta", "manipulation", Budget::kRanked, 5, "a broken host"}, "uid 0");
  }).ok());
  const std::string history = History();
  const int64_t changes = BoardChanges();
  ASSERT_TRUE(Merge("beta", "alpha").ok());
  EXPECT_EQ(History(), history);
  EXPECT_GT(BoardChanges(), changes);
  EXPECT_THAT(Board(), ElementsAre("alpha", "alpha"));
  const BudgetUse use = Quota("alpha").total_of(Budget::kRanked);
  EXPECT_EQ(use.charged, 2);
  EXPECT_EQ(use.open, 1);
  EXPECT_EQ(use.granted, 5);
  EXPECT_EQ(use.left(100), 100 + 5 - 2 - 1) << "the limit is there once";
  EXPECT_EQ(Quota("alpha").waiting, 1);
  EXPECT_EQ(TeamOf("beta"), "alpha");
  EXPECT_THAT(TeamsOf(kBob), ElementsAre("alpha"));
  EXPECT_THAT(MembersOf("alpha"), ElementsAre(kAda, kBob));
  Read([&](Reader& reader) {
    EXPECT_EQ(reader.Submissions({.team = "alpha"}).rows.size(), 3u);
    EXPECT_EQ(reader.SubmissionsOf("alpha"), 3);
    EXPECT_EQ(reader.Ledger("alpha", "", INT64_MAX, 10).rows.size(), 3u);
    EXPECT_THAT(reader.Team("beta")->other_names, ElementsAre("beta"));
    const std::vector<TeamRow> teams = reader.Teams().rows;
    ASSERT_EQ(teams.size(), 2u);
    EXPECT_EQ(teams[0].merged_into, "alpha");
    EXPECT_THAT(teams[0].members, IsEmpty());
    EXPECT_THAT(teams[1].members, ElementsAre(kAda, kBob));
    const Listed<TeamRow> page = reader.Teams(teams[0].id, 1);
    ASSERT_EQ(page.rows.size(), 1u);
    EXPECT_EQ(page.last_id, teams[1].id);
    EXPECT_THAT(page.rows[0].members, ElementsAre(kAda, kBob));
  });
  // Its ranked evaluations are those of the other as well.
  const absl::StatusOr<Accepted> again = TrySubmit("alpha", 'b', /*ranked=*/true);
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_TRUE(again->linked);
  EXPECT_EQ(again->submission, second.submission);
  ASSERT_TRUE(SetMember("beta", kBob, false).ok());
  EXPECT_THAT(TeamsOf(kBob), IsEmpty());
}

TEST_F(PeopleTest, OfTheChoicesOfMergedTeamsTheNewerStands) {
  const Accepted first = Submit("alpha", 'a');
  const Accepted second = Submit("beta", 'b');
  Play(first);
  Play(second);
  const auto choose = [&](const Accepted& accepted) {
    bool changed = false;
    EXPECT_TRUE(Write([&](Writer& w) {
      const absl::StatusOr<bool> done = w.Choose(accepted.submission, kAda);
      changed = done.value_or(false);
      return done.status();
    }).ok());
    return changed;
  };
  const auto choices = [&] {
    std::set<int64_t> chosen;
    Read([&](Reader& reader) { chosen = reader.Choices(std::string(64, 'c'), INT64_MAX); });
    return chosen;
  };
  EXPECT_TRUE(choose(second));
  EXPECT_TRUE(choose(first));
  EXPECT_THAT(choices(), ElementsAre(first.submission, second.submission));
  ASSERT_TRUE(Merge("beta", "alpha").ok());
  EXPECT_THAT(choices(), ElementsAre(first.submission));
  EXPECT_TRUE(choose(second)) << "though it is the newest of its own team's";
  EXPECT_THAT(choices(), ElementsAre(second.submission));
  EXPECT_FALSE(choose(second));
}

TEST_F(PeopleTest, ARerunOfABannedTeamIsTheOrganisersAlone) {
  const Accepted accepted = Submit("alpha", 'a');
  Play(accepted);
  ASSERT_TRUE(Rename("alpha", "beta").ok());
  const auto rerun = [&](bool organiser) {
    return Write([&](Writer& w) {
      return w.CheckReruns(accepted.submission, kAda, organiser, RerunLimits());
    });
  };
  EXPECT_TRUE(rerun(false).ok());
  ASSERT_TRUE(Ban("beta").ok());
  EXPECT_EQ(ErrorCodeOf(rerun(false)), kBannedCode);
  EXPECT_TRUE(rerun(true).ok());
}

TEST_F(PeopleTest, AMergeIsRefusedInOneSentence) {
  for (const char* team : {"alpha", "beta", "gamma", "delta"}) ASSERT_TRUE(Create(team).ok());
  EXPECT_THAT(Sentence(Merge("alpha", "alpha")), HasSubstr("can't be merged into itself"));
  EXPECT_THAT(Sentence(Merge("nobody", "alpha")), HasSubstr("there is no team \"nobody\""));
  ASSERT_TRUE(Rename("alpha", "aleph").ok());
  EXPECT_THAT(Sentence(Merge("alpha", "aleph")), HasSubstr("can't be merged into itself"));
  ASSERT_TRUE(Merge("beta", "alpha").ok());
  for (const absl::Status& refused :
       {Merge("beta", "aleph"), Merge("beta", "gamma"), Merge("gamma", "beta"),
        Merge("aleph", "beta")}) {
    EXPECT_TRUE(absl::IsFailedPrecondition(refused));
    EXPECT_THAT(Sentence(refused), HasSubstr("team \"beta\" was merged into team \"aleph\""));
  }
  ASSERT_TRUE(Ban("delta").ok());
  EXPECT_THAT(Sentence(Merge("delta", "gamma")), HasSubstr("\"delta\" is banned"));
  EXPECT_THAT(Sentence(Merge("gamma", "delta")), HasSubstr("\"delta\" is banned"));
  EXPECT_THAT(Sentence(Rename("aleph", "beta")), HasSubstr("the name of a team that was merged"));
  Read([&](Reader& reader) {
    EXPECT_FALSE(reader.CheckMerge("beta", "gamma").ok());
    EXPECT_TRUE(reader.CheckMerge("alpha", "gamma").ok());
  });
  // A chain ends at the last of them.
  ASSERT_TRUE(Merge("alpha", "gamma").ok());
  for (const char* name : {"alpha", "aleph", "beta"}) EXPECT_EQ(TeamOf(name), "gamma");
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
    Read([&](Reader& reader) { EXPECT_EQ(ErrorCodeOf(reader.CheckTeam(name)), kBannedCode); });
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
  ASSERT_TRUE(Write([](Writer& w) {
    return w.AddToken({std::string(64, 'a'), "participant", "gamma", "laptop"}, "uid 0").status();
  }).ok());
  const auto text_of = [](const std::string& store) {
    std::string text;
    EXPECT_TRUE(ReaderPool(store).Read([&](Reader& reader) {
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
  ASSERT_TRUE(Write([&](Writer& w) { return w.Import(file, *info, "uid 0"); }).ok());
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
  const std::vector<std::string> board = Board();
  ASSERT_EQ(board.size(), 2u);
  EXPECT_THAT(board, testing::UnorderedElementsAre("beta", HasSubstr("team 1 of the store can't "
                                                                     "be read")));
  EXPECT_TRUE(DamageOf(Try("alpha", 'e')).has_value());
  EXPECT_TRUE(Try("beta", 'e').ok());
  EXPECT_THAT(TeamsOf(kAda), IsEmpty()) << "nobody gains rights by damage";
  EXPECT_THAT(TeamsOf(kBob), ElementsAre("beta"));
  Read([&](Reader& reader) {
    EXPECT_EQ(reader.Teams().damaged.size(), 1u);
    EXPECT_TRUE(DamageOf(reader.Team("alpha").status()).has_value());
  });
  damage("UPDATE team SET merged_into = NULL, banned = 7 WHERE name = 'alpha'");
  EXPECT_TRUE(DamageOf(Try("alpha", 'e')).has_value());
  EXPECT_THAT(Board(), testing::UnorderedElementsAre(
                           "beta", HasSubstr("its \"banned\" is 7")));
  damage("UPDATE member SET belongs = 7 WHERE person = 'uid 1002'");
  EXPECT_THAT(TeamsOf(kBob), IsEmpty());
}

}  // namespace
}  // namespace myograde::server
