// Rejudges from their creation to their end: from facts, played, followed, applied and dropped.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/base/config_reader.h"
#include "rejudge_world.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;
using State = RejudgeProgress::State;
using ::testing::ElementsAre;
using ::testing::Field;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const Json kOtherBuild = {{"simulator", "older"}, {"mujoco", "b"}, {"models", Json::object()}};

class RejudgesTest : public RejudgeWorld {
 protected:
  // Only scoring differs: a failure takes twice as long.
  TrackPtr SlowFailures() const {
    return Changed([](Json& config) { config["scoring"]["full_time_s"] = 20; });
  }
  // The environment differs.
  TrackPtr LongerSteps() const {
    return Changed([](Json& config) {
      config["budgets"]["step_s"] = config["budgets"]["step_s"].get<double>() * 2;
    });
  }
  int64_t MustCreate(const NewRejudge& rejudge) {
    const absl::StatusOr<RejudgePlan> created = Create(rejudge);
    EXPECT_TRUE(created.ok()) << created.status();
    return created.ok() ? created->rejudge : 0;
  }
};

TEST_F(RejudgesTest, ComputesFromFactsWhereOnlyScoringDiffers) {
  const int64_t alpha = Played("alpha", today_);
  const int64_t beta = Played("beta", today_);
  Run();
  const absl::StatusOr<RejudgePlan> created = Create(To(SlowFailures()));
  ASSERT_TRUE(created.ok()) << created.status();
  EXPECT_EQ(created->facts, 2);
  EXPECT_EQ(created->play, 0);
  const int64_t id = created->rejudge;
  AwaitComplete(id);
  EXPECT_EQ(playing_.starts, 0);
  const RejudgeProgress progress = Progress(id);
  EXPECT_EQ(progress.state, State::kReady);
  EXPECT_EQ(progress.facts, 2);
  EXPECT_EQ(progress.episodes, 6);
  EXPECT_EQ(progress.episodes_done, 6);
  EXPECT_THAT(progress.without_result, IsEmpty());
  const std::vector<EvaluationRow> items = Items(id);
  ASSERT_EQ(items.size(), 2u);
  EXPECT_EQ(items[0].submission, alpha);
  EXPECT_EQ(items[1].submission, beta);
  Read([&](const Transaction& reader) {
    const std::vector<EpisodeRow> before = *reader.episodes.Of(items[0].source);
    const std::vector<EpisodeRow> after = *reader.episodes.Of(items[0].id);
    ASSERT_EQ(after.size(), before.size());
    for (size_t i = 0; i < after.size(); ++i) {
      EXPECT_EQ(after[i].facts_json, before[i].facts_json);
      const bool failed = after[i].outcome == Outcome::kFailure;
      EXPECT_EQ(Json::parse(after[i].metrics_json)["time_s"] == 20, failed);
    }
    EXPECT_EQ(reader.episodes.Details(items[0].id)->size(), after.size());
    EXPECT_EQ(*reader.episodes.Details(items[0].id),
              *reader.episodes.Details(items[0].source));
    const EvaluationRow source = *reader.evaluations.Find(items[0].source);
    const EvaluationRow row = *reader.evaluations.Find(items[0].id);
    EXPECT_EQ(row.kind, EvaluationKind::kRejudge);
    EXPECT_EQ(row.state, EvaluationState::kDone);
    EXPECT_EQ(row.config, To(SlowFailures()).to_config);
    EXPECT_EQ(row.grader_json, source.grader_json) << "that build measured the facts";
    EXPECT_NE(row.results_hash, source.results_hash);
    EXPECT_EQ(reader.blocks.Of(row.id)->size(), reader.blocks.Of(source.id)->size());
    EXPECT_THAT(reader.evaluations.Done(/*without_standing=*/true), IsEmpty());
    EXPECT_EQ(row.rejudge, id);
    EXPECT_EQ(source.rejudge, 0);
  });
}

TEST_F(RejudgesTest, PlaysWhatTheEnvironmentOrTheBuildChanges) {
  Played("alpha", today_);
  Played("older", kOtherBuild);
  Run();
  const int64_t rules = MustCreate(To(SlowFailures()));
  AwaitComplete(rules);
  EXPECT_EQ(Items(rules)[0].method, RejudgeMethod::kFacts);
  EXPECT_EQ(Items(rules)[1].method, RejudgeMethod::kPlay);
  EXPECT_EQ(playing_.starts, 3);
  const int64_t environment = MustCreate(To(LongerSteps()));
  AwaitComplete(environment);
  EXPECT_EQ(Progress(environment).play, 2);
  EXPECT_EQ(playing_.starts, 9);
  NewRejudge facts = To(SlowFailures());
  facts.method = RejudgeMethod::kFacts;
  const int64_t forced = MustCreate(facts);
  AwaitComplete(forced);
  EXPECT_EQ(Progress(forced).facts, 2);
}

TEST_F(RejudgesTest, WhatCanNotBePlayedIsWithoutResult) {
  const int64_t gone = Played("gone", today_);
  Played("there", today_);
  Read([&](const Transaction& reader) {
    std::filesystem::remove_all(ArtefactFolder(dir_, reader.submissions.Find(gone)->artefact));
  });
  Run();
  const absl::StatusOr<RejudgePlan> created = Create(To(LongerSteps()));
  ASSERT_TRUE(created.ok()) << created.status();
  EXPECT_THAT(created->without_files, ElementsAre(gone));
  const int64_t id = created->rejudge;
  AwaitComplete(id);
  EXPECT_THAT(Progress(id).without_result, ElementsAre(Field(&EvaluationRow::submission, gone)));
  EXPECT_THAT(Items(id)[0].reason, HasSubstr("are no longer on this host"));
  EXPECT_THAT(std::string(Apply(id).status().message()), HasSubstr("no result of these"));
  EXPECT_THAT(std::string(Apply(id, {gone, gone + 1}).status().message()),
              HasSubstr("name exactly these"));
  EXPECT_TRUE(Apply(id, {gone}).ok());
}

TEST_F(RejudgesTest, IsAppliedAndDroppedAsAWhole) {
  Played("alpha", today_);
  Run();
  const TrackPtr rules = SlowFailures();
  const int64_t id = MustCreate(To(rules));
  AwaitComplete(id);
  const absl::StatusOr<RejudgeDone> applied = Apply(id);
  ASSERT_TRUE(applied.ok()) << applied.status();
  EXPECT_EQ(applied->config_before, base_->config.hash);
  EXPECT_EQ(applied->config_after, rules->config.hash);
  EXPECT_THAT(std::string(Apply(id).status().message()), HasSubstr("is applied already"));
  // The board is another one now.
  const int64_t late = MustCreate(To(Changed([](Json& c) { c["scoring"]["full_time_s"] = 30; })));
  AwaitComplete(late);
  EXPECT_THAT(std::string(Apply(late).status().message()), HasSubstr("the board's config is now"));
  const absl::StatusOr<RejudgeDone> dropped = Drop(id);
  ASSERT_TRUE(dropped.ok()) << dropped.status();
  EXPECT_EQ(dropped->config_after, base_->config.hash);
  EXPECT_THAT(std::string(Drop(id).status().message()), HasSubstr("dropped already"));
  EXPECT_EQ(Progress(id).state, State::kDropped);
  EXPECT_TRUE(Apply(id).ok());
  Read([&](const Transaction& reader) {
    const std::vector<RejudgeEventRow> events = reader.rejudges.Find(id)->events;
    std::vector<std::string_view> names;
    for (const RejudgeEventRow& event : events) {
      names.push_back(EnumName(event.event));
      EXPECT_EQ(event.signature.size(), 128u);
    }
    EXPECT_THAT(names, ElementsAre("created", "applied", "dropped", "applied"));
  });
}

TEST_F(RejudgesTest, OnlyTheLatestOfABoardIsDropped) {
  Played("alpha", today_);
  Run();
  const TrackPtr second = Changed([](Json& c) { c["scoring"]["full_time_s"] = 30; });
  const int64_t one = MustCreate(To(SlowFailures()));
  AwaitComplete(one);
  ASSERT_TRUE(Apply(one).ok());
  NewRejudge next = To(second);
  next.from_config = SlowFailures()->config.hash;
  next.from_config_json = CanonicalJson(SlowFailures()->config.effective);
  const int64_t two = MustCreate(next);
  AwaitComplete(two);
  EXPECT_EQ(Items(two)[0].source, Items(one)[0].id) << "what stands under the first";
  ASSERT_TRUE(Apply(two).ok());
  EXPECT_THAT(std::string(Drop(one).status().message()),
              HasSubstr(absl::StrCat("before rejudge ", two)));
  const absl::StatusOr<RejudgeDone> dropped = Drop(two);
  ASSERT_TRUE(dropped.ok()) << dropped.status();
  EXPECT_EQ(dropped->config_after, SlowFailures()->config.hash);
  EXPECT_TRUE(Drop(one).ok());
}

TEST_F(RejudgesTest, FollowsSubmissionsThatEndLater) {
  Played("alpha", today_);
  Run();
  const int64_t id = MustCreate(To(SlowFailures()));
  AwaitComplete(id);
  const Accepted late = Submit("late");
  Await([&] { return Items(id).size() == 2; }, "the late one has its item");
  EXPECT_EQ(Items(id)[1].submission, late.submission);
  AwaitComplete(id);
  ASSERT_TRUE(Apply(id).ok());
  const Accepted later = Submit("later");
  Await([&] { return Items(id).size() == 3; }, "it follows while it is applied");
  AwaitComplete(id);
  ASSERT_TRUE(Drop(id).ok());
  const Accepted last = Submit("last");
  Await([&] { return StateOf(last.evaluation) == "done"; }, "the last one is done");
  EXPECT_EQ(Items(id).size(), 3u);
  EXPECT_THAT(std::string(Apply(id).status().message()), HasSubstr("create a new one"));
}

TEST_F(RejudgesTest, IsPreemptedByLiveSubmissionsWithoutAFault) {
  slots_ = 1;
  const int64_t alpha = Played("alpha", today_);
  Read([&](const Transaction& read) { playing_.held = read.submissions.Find(alpha)->artefact; });
  playing_.hold = true;
  Run();
  const int64_t id = MustCreate(To(LongerSteps()));
  Await([&] { return Plays(id); }, "the rejudge plays");
  const Accepted live = Submit("live");
  Await([&] { return StateOf(live.evaluation) == "done"; }, "the live one is done");
  EXPECT_GE(playing_.ended_early, 1);
  playing_.hold = false;
  AwaitComplete(id);
  Read([&](const Transaction& reader) {
    const std::vector<BlockRow> blocks = *reader.blocks.Of(Items(id)[0].id);
    EXPECT_GE(blocks[0].attempt, 2);
    for (const BlockRow& block : blocks) EXPECT_EQ(block.faults, 0);
    EXPECT_EQ(reader.evaluations.Find(Items(id)[0].id)->state, EvaluationState::kDone);
  });
}

TEST_F(RejudgesTest, ACancelLeavesItAloneAndADropEndsIt) {
  const int64_t alpha = Played("alpha", today_);
  playing_.hold = true;
  Run();
  const int64_t id = MustCreate(To(LongerSteps()));
  Await([&] { return Plays(id); }, "the rejudge plays");
  const auto cancelled = engine_->Cancel(
      {.submission = alpha, .reruns = true, .why = "test", .who = "uid 0"}, absl::Seconds(30));
  EXPECT_THAT(std::string(cancelled.status().message()), HasSubstr("nothing to cancel"));
  EXPECT_TRUE(Plays(id));
  EXPECT_THAT(std::string(Apply(id).status().message()), HasSubstr("can't be applied yet"));
  const absl::StatusOr<RejudgeDone> dropped = Drop(id);
  ASSERT_TRUE(dropped.ok()) << dropped.status();
  EXPECT_THAT(dropped->cancelled, ElementsAre(Items(id)[0].id));
  Await([&] { return engine_->Health().running == 0; }, "nothing runs");
  EXPECT_EQ(Items(id)[0].state, EvaluationState::kCancelled);
  EXPECT_THAT(std::string(Apply(id, {alpha}).status().message()), HasSubstr("dropped"));
}

TEST_F(RejudgesTest, TellsWhichPoliciesAreNotRepeatable) {
  const int64_t steady = Played("steady", today_);
  const int64_t unsteady = Played("unsteady", today_);
  Read([&](const Transaction& reader) {
    playing_.unsteady = reader.submissions.Find(unsteady)->artefact;
  });
  Run();
  NewRejudge rejudge = To(base_);
  rejudge.repeats = 3;
  const int64_t id = MustCreate(rejudge);
  AwaitComplete(id);
  EXPECT_EQ(Items(id).size(), 6u);
  EXPECT_EQ(Progress(id).play, 6) << "facts tell nothing about a repetition";
  Read([&](const Transaction& reader) {
    const auto found = *reader.rejudges.ListUnrepeatable(id);
    EXPECT_FALSE(found.contains(steady));
    ASSERT_TRUE(found.contains(unsteady));
    const std::vector<RepeatRow>& episodes = found.at(unsteady);
    ASSERT_EQ(episodes.size(), 6u) << "three episodes of two repetitions";
    EXPECT_EQ(episodes[0].repetition, 2);
    EXPECT_THAT(episodes[0].differs, ElementsAre("digest"));
  });
  // Once it is applied, what is submitted later has been played like this anyway.
  ASSERT_TRUE(Apply(id).ok());
  const Accepted later = Submit("later");
  Await([&] { return StateOf(later.evaluation) == "done"; }, "the later one is done");
  EXPECT_EQ(Progress(id).missing, 0);
}

TEST_F(RejudgesTest, FurtherEpisodesAreForTheListedOnesAndNeverApplied) {
  Played("first", today_);
  const int64_t second = Played("second", today_);
  Run();
  NewRejudge rejudge = To(Changed([](Json& config) { config["seeds"] = {51, 52, 53, 54, 55}; }));
  rejudge.purpose = RejudgePurpose::kSeeds;
  EXPECT_THAT(std::string(Create(rejudge).status().message()), HasSubstr("list at least one"));
  rejudge.submissions = {second, second + 7};
  EXPECT_THAT(std::string(Create(rejudge).status().message()),
              HasSubstr(absl::StrCat("submission ", second + 7, " can't get")));
  rejudge.submissions = {second};
  const int64_t id = MustCreate(rejudge);
  AwaitComplete(id);
  ASSERT_EQ(Items(id).size(), 1u);
  EXPECT_EQ(Items(id)[0].submission, second);
  EXPECT_EQ(Progress(id).episodes_done, 5);
  EXPECT_THAT(std::string(Apply(id).status().message()), HasSubstr("further episodes"));
}

TEST_F(RejudgesTest, RefusesWhatMakesNoSense) {
  Played("alpha", today_);
  Run();
  const auto message = [&](const NewRejudge& rejudge) {
    return std::string(Create(rejudge).status().message());
  };
  NewRejudge rejudge = To(LongerSteps());
  rejudge.method = RejudgeMethod::kFacts;
  EXPECT_THAT(message(rejudge), HasSubstr("differ in more than \"scoring\""));
  rejudge = To(base_);
  rejudge.repeats = 21;
  EXPECT_THAT(message(rejudge), HasSubstr("1 to 20 repeats"));
  rejudge = To(base_);
  rejudge.why = "";
  EXPECT_THAT(message(rejudge), HasSubstr("needs a reason"));
  rejudge = To(base_);
  rejudge.submissions = {1};
  EXPECT_THAT(message(rejudge), HasSubstr("covers all submissions"));
  rejudge = To(base_);
  rejudge.to_config_json = "{}";
  EXPECT_THAT(message(rejudge), HasSubstr("is not the hash"));
  EXPECT_THAT(std::string(Apply(99).status().message()), HasSubstr("no rejudge 99"));
  Read([&](const Transaction& reader) { EXPECT_THAT(reader.Board().rejudges(), IsEmpty()); });
}

TEST_F(RejudgesTest, KeepsTheFilesThatItMayHaveToPlay) {
  const int64_t failed = Played("failed", today_, /*crashes=*/true);
  std::string artefact;
  Read([&](const Transaction& reader) { artefact = reader.submissions.Find(failed)->artefact; });
  Run();
  const auto removed = [&] {
    bool gone = false;
    EXPECT_TRUE(engine_
                    ->Change(
                        [&](Transaction& writer) -> absl::Status {
                          const absl::StatusOr<bool> row =
                              writer.content.Remove("artefact", artefact, 1, "of no use");
                          gone = row.ok() && *row;
                          return row.status();
                        },
                        absl::Seconds(30))
                    .ok());
    return gone;
  };
  const int64_t id = MustCreate(To(SlowFailures()));
  AwaitComplete(id);
  EXPECT_EQ(Items(id)[0].state, EvaluationState::kFailed) << "by any rules";
  EXPECT_FALSE(removed());
  Read([&](const Transaction& reader) { EXPECT_TRUE(reader.content.ArtefactUses()[0].needed); });
  ASSERT_TRUE(Drop(id).ok());
  Read([&](const Transaction& reader) { EXPECT_FALSE(reader.content.ArtefactUses()[0].needed); });
  EXPECT_TRUE(removed());
}

TEST_F(RejudgesTest, AnExportBringsThemAlong) {
  Played("alpha", today_);
  Run();
  const int64_t id = MustCreate(To(SlowFailures()));
  AwaitComplete(id);
  ASSERT_TRUE(Apply(id).ok());
  Halt();
  const std::string path = dir_ + "/export.json";
  {
    std::ofstream file(path);
    Read([&](const Transaction& reader) {
      EXPECT_TRUE(reader.Export([&](std::string_view text) {
        file << text;
        return true;
      }).ok());
    });
  }
  const absl::StatusOr<ExportInfo> info = CheckExport(path);
  ASSERT_TRUE(info.ok()) << info.status();
  EXPECT_EQ(info->rows.count("delivery"), 0u);
  const auto other = Store::Open(dir_ + "/other.db", SystemClock());
  ASSERT_TRUE(other.ok()) << other.status();
  const absl::Status imported = (*other)->Write(
      [&](Transaction& writer) { return writer.Import(path, *info, "test", CheckReadable); });
  ASSERT_TRUE(imported.ok()) << imported;
  const std::vector<EvaluationRow> items = Items(id);
  EXPECT_TRUE(ReaderPool(dir_ + "/other.db").Read([&](const Transaction& reader) {
    EXPECT_EQ(reader.rejudges.CountProgress(*reader.rejudges.Find(id))->state, State::kApplied);
    const EvaluationRow row = *reader.evaluations.Find(items[0].id);
    EXPECT_EQ(row.config, SlowFailures()->config.hash);
    EXPECT_EQ(row.results_hash, items[0].results_hash);
    return absl::OkStatus();
  }).ok());
}

// Every commit of a daemon's life with a rejudge may be its last.
TEST_F(RejudgesTest, APowerCutAtAnyCommitLosesNothing) {
  for (const char* team : {"a", "b"}) Played(team, today_);
  for (const char* team : {"c", "d"}) Played(team, kOtherBuild);
  Close();
  const std::string prepared = dir_ + "/prepared.db";
  std::filesystem::copy_file(dir_ + "/store.db", prepared);
  std::vector<std::string> expected;
  bool was_cut = true;
  for (int64_t cut = 0; was_cut; ++cut) {
    for (const bool after : {false, true}) {
      SCOPED_TRACE(absl::StrCat("power cut ", after ? "after" : "before", " commit ", cut));
      Close();
      std::filesystem::copy_file(prepared, dir_ + "/store.db",
                                 std::filesystem::copy_options::overwrite_existing);
      Open();
      // The first round has no cut, for what to expect.
      disk_->cut = expected.empty() ? INT64_MAX : cut;
      disk_->after = after;
      Run();
      (void)Create(To(SlowFailures()));
      Await([&] { return disk_->off || (Items(1).size() == 4 && Progress(1).complete); },
            "it is done or cut");
      was_cut = disk_->off || expected.empty();
      Open();
      Run();
      bool there = false;
      Read([&](const Transaction& reader) { there = reader.rejudges.Find(1).ok(); });
      if (!there) {
        ASSERT_TRUE(Create(To(SlowFailures())).ok());
      }
      AwaitComplete(1);
      std::vector<std::string> results;
      for (const EvaluationRow& item : Items(1)) {
        results.push_back(absl::StrCat(item.submission, "/", item.repetition, " ",
                                       std::string(EnumName(item.method)), " ",
                                       std::string(EnumName(item.state)), " ", item.results_hash));
      }
      if (expected.empty()) expected = results;
      ASSERT_EQ(results.size(), 4u);
      ASSERT_EQ(results, expected);
      ASSERT_TRUE(Apply(1).ok());
    }
  }
}

// For the figure of a release build: MYOGRADE_REJUDGE_SUBMISSIONS=300. Under sanitizers on a busy host
// a submission takes a second.
TEST_F(RejudgesTest, FactsOfManySubmissionsTakeSeconds) {
  const char* asked = getenv("MYOGRADE_REJUDGE_SUBMISSIONS");
  const int submissions = asked != nullptr ? atoi(asked) : 10;
  std::vector<uint64_t> seeds;
  for (uint64_t i = 0; i < 100; ++i) seeds.push_back(1000 + i);
  base_ = *MakeTrack(*WithSeeds(base_->config, seeds));
  for (int i = 0; i < submissions; ++i) Played(absl::StrCat("team", i), today_);
  Run();
  const absl::Duration begin = SystemClock().Monotonic();
  const int64_t id = MustCreate(To(SlowFailures()));
  AwaitComplete(id);
  const absl::Duration took = SystemClock().Monotonic() - begin;
  std::cout << submissions << " submissions of 100 episodes: " << took << "\n";
  EXPECT_EQ(Progress(id).facts, submissions);
  EXPECT_LT(took, absl::Seconds(5) +
                      submissions * (asked != nullptr ? absl::Milliseconds(50) : absl::Seconds(5)));
}

}  // namespace
}  // namespace myograde::server
