// The fold of acts: what counts on a board at each moment, and acts that say less than their kind
// does.
#include "server/board/board_state.h"

#include <string>

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/base/json_value.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Pair;
using testing::SizeIs;

constexpr char kOld[] = "old";
constexpr char kNew[] = "new";

class BoardStateTest : public testing::Test {
 protected:
  // The time of an act is its number.
  absl::Status TryAct(const std::string& kind, Json content) {
    ++now_;
    return state_.Add({.id = now_, .at = now_, .kind = kind, .who = "uid 0", .entry = now_ - 1,
                       .content = std::move(content)});
  }
  void Do(const std::string& kind, Json content) {
    const absl::Status status = TryAct(kind, std::move(content));
    EXPECT_TRUE(status.ok()) << status;
  }

  void Team(int64_t team) {
    Do(kTeamAct, {{"event", "created"}, {"team_id", team}, {"team", absl::StrCat("team ", team)}});
  }
  void Accept(int64_t submission, int64_t team, const std::string& config = kOld) {
    Do(kAcceptedAct, {{"submission", submission}, {"team_id", team}, {"team", "x"},
                      {"artefact", "a"}, {"track", "arm"}, {"profile", "paper"}, {"phase", nullptr},
                      {"config", config}, {"evaluation", submission + 10}});
  }
  void End(int64_t evaluation, int64_t submission, const std::string& state = "graded",
           const std::string& config = kOld, int64_t rejudge = 0, int64_t repetition = 0) {
    Do(kGradedAct, {{"evaluation", evaluation}, {"submission", submission}, {"state", state},
                    {"results", state == "graded" ? Json("r") : Json()}, {"config", config},
                    {"seeds", "s"}, {"grader", "g"}, {"failed", false},
                    {"rejudge", rejudge == 0 ? Json() : Json(rejudge)},
                    {"repetition", repetition == 0 ? Json() : Json(repetition)}});
  }
  void Rejudge(int64_t id, const std::string& event, const std::string& from = kOld,
               const std::string& to = kNew) {
    RejudgeRow row;
    row.id = id;
    row.from_config = from;
    row.to_config = to;
    Json document = RejudgeKeys(row);
    document.update({{"seeds", "s"}, {"who", "uid 0"}, {"reason", "a vote"}});
    Do(kRejudgeAct, {{"event", event}, {"rejudge", id}, {"document_sha256", "d"},
                     {"signature", "f"}, {"document", document}});
  }
  void Choose(int64_t submission) { Do(kChosenAct, {{"submission", submission}}); }

  // The evaluation of each submission that stands under a config.
  std::map<int64_t, int64_t> Standing(const std::string& config, const BoardMoment& moment = {}) {
    std::map<int64_t, int64_t> standing;
    for (const auto& [submission, result] : state_.InForce(config, moment)) {
      standing[submission] = result->evaluation;
    }
    return standing;
  }

  BoardState state_;
  int64_t now_ = 0;
};

TEST_F(BoardStateTest, ARejudgePutsItsResultsInPlaceAndTakesOffWhatHasNone) {
  Team(1);
  for (const int64_t submission : {1, 2, 3}) Accept(submission, 1);
  for (const int64_t submission : {1, 2, 3}) End(submission + 10, submission);
  Accept(4, 1);
  End(14, 4, "grader_error");
  EXPECT_THAT(Standing(kOld), ElementsAre(Pair(1, 11), Pair(2, 12), Pair(3, 13)));
  EXPECT_THAT(Standing(kNew), IsEmpty());
  Rejudge(1, "created");
  End(21, 1, "graded", kNew, 1, 1);
  End(22, 2, "cancelled", kNew, 1, 1);
  End(23, 3, "graded", kNew, 1, 1);
  End(33, 3, "graded", kNew, 1, 2);  // a repetition decides nothing
  EXPECT_THAT(Standing(kNew), IsEmpty()) << "it is not applied";
  EXPECT_THAT(Standing(kNew, {.assumed_rejudge = 1}), ElementsAre(Pair(1, 21), Pair(3, 23)));
  const int64_t before = now_ + 1;
  Rejudge(1, "applied");
  EXPECT_THAT(Standing(kNew), ElementsAre(Pair(1, 21), Pair(3, 23)));
  EXPECT_THAT(Standing(kNew, {.before_ms = before}), IsEmpty());
  EXPECT_THAT(Standing(kNew, {.ignored_rejudge = 1}), IsEmpty());
  Rejudge(2, "created", kNew, kNew);
  End(41, 1, "graded", kNew, 2, 1);
  Rejudge(2, "applied", kNew, kNew);
  EXPECT_THAT(Standing(kNew), ElementsAre(Pair(1, 41), Pair(3, 23)));
  Rejudge(1, "dropped");
  EXPECT_THAT(Standing(kNew), ElementsAre(Pair(1, 41)));
  EXPECT_TRUE(state_.WasApplied(1));
}

TEST_F(BoardStateTest, ATeamsNewestChoiceStandsEvenWithoutAResult) {
  Team(1);
  Team(2);
  Accept(1, 1);
  Accept(2, 1, "another board's");
  Accept(3, 1);
  Accept(4, 2);
  Choose(1);
  Choose(2);
  EXPECT_THAT(state_.Chosen(kOld), ElementsAre(1));
  Choose(3);
  Choose(4);
  EXPECT_THAT(state_.Chosen(kOld), ElementsAre(3, 4));
  EXPECT_THAT(state_.Chosen(kOld, {.before_ms = now_}), ElementsAre(3));
  Do(kTeamAct, {{"event", "merged"}, {"team_id", 2}, {"team", "team 2"}, {"into", 1}});
  EXPECT_THAT(state_.Chosen(kOld), ElementsAre(4)) << "of the choices of merged teams the newest";
  EXPECT_EQ(state_.TeamOf(4)->name, "team 1");
}

TEST_F(BoardStateTest, AFreezeKeepsResultsBackAndNotMarks) {
  Team(1);
  Accept(1, 1);
  Accept(2, 1);
  End(11, 1);
  const BoardMoment frozen = {.freeze_ms = now_ + 1};
  EXPECT_FALSE(state_.Withholds(kOld, frozen));
  End(12, 2);
  Do(kMarkedAct, {{"submission", 1}, {"mark", "hidden"}, {"set", true}, {"why", "asked"}});
  EXPECT_THAT(Standing(kOld, frozen), ElementsAre(Pair(1, 11)));
  EXPECT_TRUE(state_.Withholds(kOld, frozen));
  EXPECT_TRUE(state_.MarksAt().contains({1, "hidden"}));
  EXPECT_THAT(state_.MarksAt(now_), IsEmpty());
  Do(kMarkedAct, {{"submission", 1}, {"mark", "hidden"}, {"set", false}});
  EXPECT_FALSE(state_.MarksAt().contains({1, "hidden"}));
  EXPECT_THAT(state_.MarkHistory(1), SizeIs(2));
  EXPECT_EQ(state_.ChangedAt(kOld, "", {}), now_);
}

TEST_F(BoardStateTest, ABoardHasItsConfigOfAMoment) {
  const BoardName board = {"", "arm", "paper"};
  EXPECT_EQ(state_.ConfigAt(board), "");
  Team(1);
  Accept(1, 1);
  EXPECT_EQ(state_.ConfigAt(board), kOld);
  EXPECT_EQ(state_.ConfigAt(board, 1), kOld) << "there is no earlier one";
  Do(kConfigAct, {{"phase", nullptr}, {"track", "arm"}, {"profile", "paper"}, {"config", kNew},
                  {"rejudge", nullptr}});
  EXPECT_EQ(state_.ConfigAt(board), kNew);
  EXPECT_EQ(state_.ConfigAt(board, now_), kOld);
  EXPECT_THAT(state_.ConfigsLike("", false), ElementsAre(kNew, kOld));
}

TEST_F(BoardStateTest, AnActThatSaysTooLittleIsToldAndStopsNoOther) {
  Team(1);
  EXPECT_THAT(TryAct(kAcceptedAct, {{"submission", 1}}).message(), HasSubstr("entry 1 lacks"));
  EXPECT_THAT(TryAct(kGradedAct, Json()).message(), HasSubstr("lacks"));
  EXPECT_THAT(TryAct("a vote", {{"submission", 1}}).message(), HasSubstr("not known to this program"));
  EXPECT_THAT(TryAct(kTeamAct, {{"event", "merged"}, {"team_id", 1}, {"team", "x"}}).message(),
              HasSubstr("lacks"));
  Accept(1, 1);
  EXPECT_FALSE(TryAct(kAcceptedAct, {{"submission", 1}, {"team_id", 1}, {"team", "x"},
                                     {"artefact", "b"}, {"track", "arm"}, {"profile", "paper"},
                                     {"phase", nullptr}, {"config", kOld}}).ok());
  End(11, 1);
  EXPECT_THAT(Standing(kOld), ElementsAre(Pair(1, 11)));
  EXPECT_THAT(state_.damaged(), SizeIs(5));
  EXPECT_EQ(state_.submissions().at(1).artefact, "a");
}

TEST_F(BoardStateTest, ARejudgeThatSaysTooLittleLeavesNothingBehind) {
  const Json act = {{"event", "applied"}, {"rejudge", 1}, {"document_sha256", "d"},
                    {"signature", "f"}, {"document", {{"who", "uid 0"}, {"reason", "a vote"}}}};
  EXPECT_THAT(TryAct(kRejudgeAct, act).message(), HasSubstr("lacks"));
  EXPECT_THAT(state_.rejudges(), IsEmpty());
  Rejudge(2, "created");
  Json again = act;
  again["rejudge"] = 2;
  again["document"].erase("reason");
  EXPECT_THAT(TryAct(kRejudgeAct, again).message(), HasSubstr("lacks"));
  EXPECT_EQ(state_.Rejudge(2)->last(), RejudgeEvent::kCreated);
}

TEST_F(BoardStateTest, ABanOfTheTeamThatAnotherWasMergedIntoChangesTheBoard) {
  for (const int64_t team : {1, 2, 3}) Team(team);
  Accept(1, 1);
  End(11, 1);
  Do(kTeamAct, {{"event", "merged"}, {"team_id", 1}, {"team", "team 1"}, {"into", 2}});
  EXPECT_EQ(state_.ChangedAt(kOld, "", {}), now_);
  Do(kTeamAct, {{"event", "banned"}, {"team_id", 2}, {"team", "team 2"}});
  EXPECT_EQ(state_.ChangedAt(kOld, "", {}), now_);
  Do(kTeamAct, {{"event", "banned"}, {"team_id", 3}, {"team", "team 3"}});
  EXPECT_EQ(state_.ChangedAt(kOld, "", {}), now_ - 1) << "it has nothing to do with this board";
}

TEST_F(BoardStateTest, AForgedCircleOfMergesEnds) {
  Team(1);
  Team(2);
  Do(kTeamAct, {{"event", "merged"}, {"team_id", 1}, {"team", "a"}, {"into", 2}});
  Do(kTeamAct, {{"event", "merged"}, {"team_id", 2}, {"team", "b"}, {"into", 1}});
  Accept(1, 1);
  EXPECT_NE(state_.TeamOf(1), nullptr);
}

TEST_F(BoardStateTest, APhaseCommitsToOneSecret) {
  Do(kCommitmentAct, {{"phase", "final"}, {"commitment", "c"}});
  EXPECT_TRUE(state_.HasCommitted("final"));
  EXPECT_THAT(TryAct(kCommitmentAct, {{"phase", "final"}, {"commitment", "d"}}).message(),
              HasSubstr("another secret than entry 0"));
  Do(kCommitmentAct, {{"phase", "public"}, {"commitment", "e"}, {"further", true}});
  EXPECT_FALSE(state_.HasCommitted("public"));
  Do(kPhaseAct, {{"phase", nullptr}, {"event", "paused"}, {"why", "repairs"}});
  Do(kPhaseAct, {{"phase", "final"}, {"event", "revealed"}, {"secret", "ff"}});
  EXPECT_THAT(state_.Phase("final").events, SizeIs(1));
  EXPECT_THAT(state_.Phase("").events, SizeIs(1)) << "those on all submissions";
  EXPECT_EQ(state_.Phase("").Newest(kPausedEvent, kResumedEvent)->why, "repairs");
  EXPECT_EQ(state_.Phase("").Pause()->why, "repairs");
  Do(kPhaseAct, {{"phase", nullptr}, {"event", "resumed"}, {"why", "it works"}});
  EXPECT_EQ(state_.Phase("").Pause(), nullptr);
  EXPECT_EQ(state_.Phase("final").secret, "ff");
}

TEST(ActTest, AnEntryOfARecordIsAnAct) {
  const auto act =
      ActOfEntry(7, {{"at", "2026-11-22T19:20:38.125Z"}, {"kind", "key"}, {"key", "k"}});
  ASSERT_TRUE(act.ok()) << act.status();
  EXPECT_EQ(act->id, 8);
  EXPECT_EQ(TimeText(act->at), "2026-11-22T19:20:38.125Z");
  for (const Json& entry :
       {Json(), Json::array(), Json{{"kind", "key"}}, Json{{"kind", "key"}, {"at", "yesterday"}},
        Json{{"kind", 1}, {"at", 2}}}) {
    EXPECT_FALSE(ActOfEntry(0, entry).ok()) << entry;
  }
}

}  // namespace
}  // namespace myograde::server
