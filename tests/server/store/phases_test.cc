// Phases in the store: what organisers did to them, their secrets and quotas, and teams' choices.
#include <map>

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>

#include "server/base/error_code.h"
#include "tests/server/store/store_fixture.h"

namespace myograde::server {
namespace {

using ::testing::_;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Pair;

class PhaseStoreTest : public StoreTest {
 protected:
  bool Act(const std::string& phase, const char* event, const std::string& why = "why") {
    absl::StatusOr<bool> changed = false;
    const absl::Status status = store_->Write([&](Transaction& writer) {
      changed = writer.phases.AddEvent(phase, event, "uid 0", why);
      return changed.status();
    });
    EXPECT_TRUE(status.ok()) << status;
    return changed.value_or(false);
  }

  absl::StatusOr<std::string> Secret(const std::string& phase) {
    absl::StatusOr<std::string> secret = "";
    const absl::Status status = store_->Write([&](Transaction& writer) {
      secret = writer.phases.EnsureSecret(phase);
      return secret.status();
    });
    if (!status.ok()) return status;
    return secret;
  }

  // As Submit, to a phase; its config has the phase's first letter as its hash.
  absl::StatusOr<Accepted> SubmitTo(const std::string& phase, char artefact,
                                    const AdmissionRules& rules = kRules,
                                    const std::string& team = "alpha",
                                    absl::Status closed = absl::OkStatus(), bool ranked = true) {
    const std::string hash(64, artefact);
    absl::StatusOr<Accepted> accepted = absl::InternalError("");
    const absl::Status status = store_->Write([&](Transaction& writer) -> absl::Status {
      auto added = writer.content.AddArtefact({{"walker", {"./policy"}}, hash, 10, 2});
      if (!added.ok()) return added.status();
      NewSubmission submission;
      submission.team = team;
      submission.artefact = hash;
      submission.track = "manipulation";
      submission.profile = "paper";
      submission.config = std::string(64, phase.empty() ? 'c' : phase.front());
      submission.config_json = submission.grader_json = "{}";
      submission.seeds = std::string(64, 'd');
      submission.seeds_json = "[1,2]";
      submission.ranked = ranked;
      submission.blocks = {{0, 1}};
      submission.phase = phase;
      submission.closed = std::move(closed);
      accepted = writer.submissions.Accept(submission, rules, "uid 7");
      return accepted.status();
    });
    if (!status.ok()) return status;
    return accepted;
  }

  void Finish(const Accepted& accepted) {
    ASSERT_TRUE(Start(accepted.blocks[0], 1).ok());
    for (const int64_t index : {0, 1}) ASSERT_TRUE(Record(accepted, index, 1).ok());
    const absl::Status status = store_->Write([&](Transaction& writer) {
      absl::Status ended = writer.blocks.Finish(accepted.blocks[0], 1, "{}", "daemon");
      ended.Update(writer.evaluations.End(accepted.evaluation, EvaluationState::kDone, "", "",
                                        "daemon"));
      return ended;
    });
    ASSERT_TRUE(status.ok()) << status;
  }

  absl::StatusOr<bool> Choose(int64_t submission) {
    absl::StatusOr<bool> changed = false;
    const absl::Status status = store_->Write([&](Transaction& writer) {
      changed = writer.journal.Choose(submission, "uid 7");
      return changed.status();
    });
    if (!status.ok()) return status;
    return changed;
  }

  std::set<int64_t> Choices(char config, int64_t before = INT64_MAX) {
    std::set<int64_t> chosen;
    Read([&](const Transaction& reader) {
      chosen = reader.Board().Chosen(std::string(64, config), {.before_ms = before});
    });
    return chosen;
  }

  int64_t Changes() {
    int64_t changes = 0;
    Read([&](const Transaction& reader) { changes = reader.Board().board_changes(); });
    return changes;
  }
};

TEST_F(PhaseStoreTest, AnActIsARowOnlyIfItChangesSomething) {
  const int64_t before = Changes();
  EXPECT_FALSE(Act("final", kResumedEvent));
  EXPECT_TRUE(Act("final", kPausedEvent, "a broken host"));
  EXPECT_FALSE(Act("final", kPausedEvent, "a broken host"));
  EXPECT_TRUE(Act("final", kPausedEvent, "it is repaired"));
  EXPECT_TRUE(Act("", kPausedEvent));
  EXPECT_TRUE(Act("final", kResumedEvent));
  EXPECT_FALSE(Act("final", kResumedEvent));
  EXPECT_TRUE(Act("final", kPublishedEvent));
  EXPECT_FALSE(Act("final", kPublishedEvent, "again"));
  EXPECT_TRUE(Act("warm-up", kPublishedEvent));
  EXPECT_NE(Changes(), before) << "a board is not as it was";
  std::map<int64_t, std::string> seen;
  Read([&](const Transaction& reader) {
    for (const auto& [phase, history] : reader.Board().phases()) {
      for (const PhaseEventRow& event : history.events) {
        seen[event.id] = absl::StrCat(event.phase, " ", event.event);
      }
    }
  });
  EXPECT_THAT(seen, ElementsAre(Pair(_, "final paused"), Pair(_, "final paused"),
                                Pair(_, " paused"), Pair(_, "final resumed"),
                                Pair(_, "final published"), Pair(_, "warm-up published")));
}

TEST_F(PhaseStoreTest, OnlyAPhaseIsPublished) {
  const absl::Status status = store_->Write([&](Transaction& writer) {
    return writer.phases.AddEvent("", kPublishedEvent, "uid 0", "why").status();
  });
  EXPECT_TRUE(absl::IsInvalidArgument(status)) << status;
}

TEST_F(PhaseStoreTest, ActsAndSecretsStayAsTheyAre) {
  ASSERT_TRUE(Secret("final").ok());
  Act("final", kPausedEvent);
  EXPECT_THAT(SqlError("UPDATE journal SET who = 'x'"), HasSubstr("never changed"));
  EXPECT_THAT(SqlError("DELETE FROM journal"), HasSubstr("never deleted"));
  EXPECT_THAT(SqlError("UPDATE phase_secret SET secret = zeroblob(32)"), HasSubstr("never changed"));
}

TEST_F(PhaseStoreTest, ASecretIsDrawnOnce) {
  Read([&](const Transaction& reader) {
    EXPECT_TRUE(absl::IsNotFound(reader.phases.Secret("final").status()));
  });
  const absl::StatusOr<std::string> secret = Secret("final");
  ASSERT_TRUE(secret.ok()) << secret.status();
  EXPECT_EQ(secret->size(), 32u);
  EXPECT_EQ(*Secret("final"), *secret);
  EXPECT_NE(*Secret("other"), *secret);
  Open();
  EXPECT_EQ(*Secret("final"), *secret) << "after a restart";
  Read([&](const Transaction& reader) { EXPECT_EQ(*reader.phases.Secret("final"), *secret); });
}

TEST_F(PhaseStoreTest, ASecretBelongsToOneChallenge) {
  const auto of = [&](const std::string& challenge) {
    absl::StatusOr<std::string> secret = absl::InternalError("");
    const absl::Status status = store_->Write([&](Transaction& writer) {
      secret = writer.phases.EnsureSecret("final", challenge);
      return secret.status();
    });
    return status.ok() ? secret : absl::StatusOr<std::string>(status);
  };
  const auto first = of("");
  ASSERT_TRUE(first.ok()) << first.status();
  EXPECT_EQ(*of("cup"), *first) << "one of an earlier version is the first challenge's";
  EXPECT_EQ(*of("cup"), *first);
  EXPECT_EQ(ErrorCodeOf(of("next-cup").status()), "no_secret");
  EXPECT_THAT(SqlError("UPDATE phase_secret SET challenge = 'x'"), HasSubstr("never changed"));
  Act("final", kRevealedEvent);
  EXPECT_EQ(*of("cup"), *first) << "its board is still shown";
  EXPECT_EQ(ErrorCodeOf(of("next-cup").status()), "phase_revealed");
}

TEST_F(PhaseStoreTest, AUsedPhaseDrawsNoSecret) {
  ASSERT_TRUE(SubmitTo("played", 'a').ok());
  Act("paused", kPausedEvent);
  for (const char* phase : {"played", "paused"}) {
    EXPECT_EQ(ErrorCodeOf(Secret(phase).status()), "no_secret") << phase;
  }
  // Further episodes of a phase with public seeds follow from a secret that is drawn late.
  const absl::Status further = store_->Write([](Transaction& writer) {
    return writer.phases.EnsureSecret("played", "", /*further=*/true).status();
  });
  EXPECT_TRUE(further.ok()) << further;
  ASSERT_TRUE(Secret("final").ok());
  ASSERT_EQ(SqlError("DELETE FROM phase_secret"), "");
  EXPECT_EQ(ErrorCodeOf(Secret("final").status()), "no_secret") << "the record commits to another";
}

TEST_F(PhaseStoreTest, ARevealedPhaseTakesNothing) {
  ASSERT_TRUE(SubmitTo("final", 'a').ok());
  Act("final", kRevealedEvent);
  EXPECT_EQ(ErrorCodeOf(SubmitTo("final", 'b').status()), "phase_revealed");
  EXPECT_TRUE(SubmitTo("other", 'b').ok());
}

TEST_F(PhaseStoreTest, ADamagedSecretIsToldAndNotReplaced) {
  ASSERT_TRUE(Secret("final").ok());
  ASSERT_EQ(SqlError("DROP TRIGGER phase_secret_fixed"), "");
  ASSERT_EQ(SqlError("PRAGMA ignore_check_constraints = 1;"
                     "UPDATE phase_secret SET secret = x'00ff'"), "");
  const absl::Status status = Secret("final").status();
  EXPECT_EQ(ErrorCodeOf(status), kDamagedRowCode) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr("is not 32 bytes"));
}

TEST_F(PhaseStoreTest, APauseRefusesWhatIsNewAndNothingElse) {
  const auto first = SubmitTo("final", 'a');
  ASSERT_TRUE(first.ok()) << first.status();
  Act("final", kPausedEvent, "a broken host");
  const auto refused = SubmitTo("final", 'b');
  EXPECT_EQ(ErrorCodeOf(refused.status()), "paused");
  EXPECT_THAT(std::string(refused.status().message()),
              HasSubstr("phase \"final\" is paused by the organiser: a broken host"));
  const auto again = SubmitTo("final", 'a');
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_TRUE(again->linked);
  EXPECT_TRUE(SubmitTo("other", 'b').ok());
  Finish(*first);
  Act("", kPausedEvent);
  Act("final", kResumedEvent);
  EXPECT_EQ(ErrorCodeOf(SubmitTo("final", 'b').status()), "paused");
  EXPECT_EQ(ErrorCodeOf(SubmitTo("", 'b').status()), "paused");
  Act("", kResumedEvent);
  EXPECT_TRUE(SubmitTo("final", 'b').ok());
}

TEST_F(PhaseStoreTest, WhatIsClosedFindsOnlyWhatItHas) {
  const absl::Status closed = absl::FailedPreconditionError("closed");
  const auto first = SubmitTo("final", 'a');
  ASSERT_TRUE(first.ok()) << first.status();
  EXPECT_EQ(SubmitTo("final", 'b', kRules, "alpha", closed).status(), closed);
  EXPECT_EQ(SubmitTo("final", 'a', kRules, "beta", closed).status(), closed);
  const auto again = SubmitTo("final", 'a', kRules, "alpha", closed);
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_TRUE(again->linked);
  EXPECT_EQ(again->submission, first->submission);
}

TEST_F(PhaseStoreTest, AnArtefactHasOneRankedEvaluationInEachPhase) {
  EXPECT_FALSE(SubmitTo("", 'a')->linked);
  EXPECT_FALSE(SubmitTo("final", 'a')->linked);
  EXPECT_FALSE(SubmitTo("other", 'a')->linked);
  EXPECT_TRUE(SubmitTo("final", 'a')->linked);
}

TEST_F(PhaseStoreTest, EachPhaseCountsItsOwnUnits) {
  AdmissionRules rules = kRules;
  rules.quota.ranked = {1, 1};
  const auto in_final = SubmitTo("final", 'a', rules);
  ASSERT_TRUE(in_final.ok()) << in_final.status();
  const auto refused = SubmitTo("final", 'b', rules);
  EXPECT_EQ(ErrorCodeOf(refused.status()), "quota");
  EXPECT_THAT(std::string(refused.status().message()),
              HasSubstr("1 ranked evaluation of phase \"final\""));
  EXPECT_TRUE(SubmitTo("other", 'b', rules).ok());
  EXPECT_TRUE(SubmitTo("", 'b', rules).ok());
  Finish(*in_final);
  const int64_t now = absl::ToUnixMillis(clock_.Now());
  Read([&](const Transaction& reader) {
    for (const auto& [phase, charged, open] :
         {std::tuple{"final", 1, 0}, std::tuple{"other", 0, 1}, std::tuple{"", 0, 1}}) {
      const QuotaUse use = reader.quotas.CountQuotaUse("alpha", "manipulation", now, phase);
      EXPECT_EQ(use.total_of(Budget::kRanked).charged, charged) << phase;
      EXPECT_EQ(use.total_of(Budget::kRanked).open, open) << phase;
    }
    EXPECT_EQ(reader.quotas.Ledger("alpha", "", INT64_MAX, 9).rows.at(0).phase, "final");
  });
  const absl::Status granted = store_->Write([&](Transaction& writer) {
    return writer.quotas.Grant({"alpha", "manipulation", Budget::kRanked, 1, "why", "final"},
                               "uid 0");
  });
  ASSERT_TRUE(granted.ok()) << granted;
  EXPECT_TRUE(SubmitTo("final", 'b', rules).ok());
  EXPECT_FALSE(SubmitTo("other", 'e', rules).ok());
}

TEST_F(PhaseStoreTest, TheNewestChoiceOfATeamIsInForce) {
  const auto first = SubmitTo("final", 'a');
  const auto second = SubmitTo("final", 'b');
  const auto others = SubmitTo("final", 'a', kRules, "beta");
  const auto elsewhere = SubmitTo("other", 'a');
  for (const auto& each : {first, second, others, elsewhere}) Finish(*each);
  EXPECT_THAT(Choices('f'), IsEmpty());
  EXPECT_TRUE(*Choose(first->submission));
  EXPECT_FALSE(*Choose(first->submission));
  EXPECT_TRUE(*Choose(others->submission));
  EXPECT_TRUE(*Choose(elsewhere->submission));
  const int64_t before = absl::ToUnixMillis(clock_.Now()) + 1;
  clock_.Advance(absl::Seconds(1));
  const int64_t changes = Changes();
  EXPECT_TRUE(*Choose(second->submission));
  EXPECT_NE(Changes(), changes);
  EXPECT_THAT(Choices('f'), ElementsAre(second->submission, others->submission));
  EXPECT_THAT(Choices('f', before), ElementsAre(first->submission, others->submission));
  EXPECT_THAT(Choices('o'), ElementsAre(elsewhere->submission));
  EXPECT_THAT(SqlError("UPDATE journal SET at = 0"), HasSubstr("never changed"));
  EXPECT_THAT(SqlError("DELETE FROM journal"), HasSubstr("never deleted"));
}

TEST_F(PhaseStoreTest, TeamsThatWereMergedHaveOneChoice) {
  const auto first = SubmitTo("final", 'a');
  const auto second = SubmitTo("final", 'b', kRules, "beta");
  for (const auto& each : {first, second}) Finish(*each);
  EXPECT_TRUE(*Choose(second->submission));
  EXPECT_TRUE(*Choose(first->submission));
  const absl::Status merged = store_->Write(
      [](Transaction& writer) { return writer.teams.Merge("beta", "alpha", "uid 0", "why"); });
  ASSERT_TRUE(merged.ok()) << merged;
  EXPECT_THAT(Choices('f'), ElementsAre(first->submission));
  EXPECT_FALSE(*Choose(first->submission));
  EXPECT_TRUE(*Choose(second->submission));
  EXPECT_THAT(Choices('f'), ElementsAre(second->submission));
}

TEST_F(PhaseStoreTest, OnlyWhatIsRankedAndDoneIsChosen) {
  const auto running = SubmitTo("final", 'a');
  EXPECT_TRUE(absl::IsFailedPrecondition(Choose(running->submission).status()));
  EXPECT_TRUE(absl::IsNotFound(Choose(99).status()));
  const auto practice =
      SubmitTo("", 'b', kRules, "alpha", absl::OkStatus(), /*ranked=*/false);
  ASSERT_TRUE(practice.ok()) << practice.status();
  EXPECT_TRUE(absl::IsFailedPrecondition(Choose(practice->submission).status()));
}

TEST_F(PhaseStoreTest, PhasesAreKnownByTheirSubmissions) {
  Read([&](const Transaction& reader) {
    EXPECT_EQ(reader.Board().ConfigOfPhase("final"), "");
    EXPECT_THAT(reader.phases.InUse(), IsEmpty());
  });
  ASSERT_TRUE(SubmitTo("", 'a').ok());
  const auto first = SubmitTo("final", 'a');
  Finish(*first);
  ASSERT_TRUE(SubmitTo("final", 'b').ok());
  Read([&](const Transaction& reader) {
    EXPECT_EQ(reader.Board().ConfigOfPhase("final"), std::string(64, 'f'));
    EXPECT_EQ(reader.Board().ConfigOfPhase(""), "");
    const auto uses = reader.phases.InUse();
    ASSERT_EQ(uses.size(), 1u);
    EXPECT_EQ(uses.front().phase, "final");
    EXPECT_EQ(uses.front().submissions, 2);
    EXPECT_EQ(uses.front().waiting, 1);
    EXPECT_EQ(reader.submissions.List({.phase = "final"}).rows.size(), 2u);
    EXPECT_EQ(reader.submissions.Find(first->submission)->phase, "final");
  });
  // One that can't be read takes no other phase with it.
  ASSERT_TRUE(SubmitTo("warm-up", 'c').ok());
  SQLite::Database(path_, SQLite::OPEN_READWRITE)
      .exec("UPDATE submission SET profile = CAST(x'ff' AS TEXT) WHERE phase = 'warm-up'");
  Read([&](const Transaction& reader) {
    const auto uses = reader.phases.InUse();
    ASSERT_EQ(uses.size(), 1u);
    EXPECT_EQ(uses.front().phase, "final");
  });
}

}  // namespace
}  // namespace myograde::server
