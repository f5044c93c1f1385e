// Quotas: what is charged, refunded and rejected; the limits of one artefact; marks.
#include "server/store/quota.h"

#include <map>

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>

#include "server/base/error_code.h"
#include "tests/server/store/store_fixture.h"

namespace myograde::server {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr char kTrack[] = "manipulation";

AdmissionRules Rules(int64_t per_day, int64_t total, int64_t failed = 100, int64_t waiting = 100) {
  AdmissionRules rules = kRules;
  rules.quota.ranked = {per_day, total};
  rules.quota.failed = {failed, 100};
  rules.quota.waiting = waiting;
  return rules;
}

class QuotaTest : public StoreTest {
 protected:
  QuotaUse Use(const std::string& team = "alpha") {
    QuotaUse use;
    Read([&](const Transaction& reader) {
      use = reader.quotas.CountQuotaUse(team, kTrack, NowMs());
    });
    return use;
  }
  int64_t NowMs() const { return absl::ToUnixMillis(clock_.Now()); }

  std::vector<std::string> Entries(const std::string& team = "alpha") {
    std::vector<std::string> entries;
    Read([&](const Transaction& reader) {
      const std::vector<LedgerRow> rows = reader.quotas.Ledger(team, "", INT64_MAX, 1000).rows;
      for (const LedgerRow& row : rows) {
        entries.insert(entries.begin(), row.entry + " " + row.budget);
      }
    });
    return entries;
  }

  // Records the first episode, as the first block would.
  void PlayFirst(const Accepted& accepted) {
    ASSERT_TRUE(Start(accepted.blocks[0], 1).ok());
    ASSERT_TRUE(Record(accepted, 0, 1).ok());
  }

  void End(const Accepted& accepted, EvaluationState state) {
    const absl::Status status = store_->Write([&](Transaction& writer) {
      absl::Status written;
      for (const int64_t block : accepted.blocks) {
        written.Update(writer.blocks.End(block, BlockState::kCancelled, false, "daemon", "over"));
      }
      written.Update(writer.evaluations.End(accepted.evaluation, state, "", "", "daemon"));
      return written;
    });
    ASSERT_TRUE(status.ok()) << status;
  }

  void Grant(Budget budget, int64_t amount) {
    ASSERT_TRUE(store_->Write([&](Transaction& writer) {
      return writer.quotas.Grant({"alpha", kTrack, budget, amount, "the grid was down"}, "uid 0");
    }).ok());
  }
};

TEST_F(QuotaTest, ASubmissionIsChargedOnceWhenItsFirstEpisodeEnds) {
  const Accepted accepted = Submit();
  EXPECT_EQ(Use().today_of(Budget::kRanked).open, 1);
  EXPECT_THAT(Entries(), IsEmpty());
  PlayFirst(accepted);
  EXPECT_THAT(Entries(), ElementsAre("charge official"));
  ASSERT_TRUE(Record(accepted, 1, 1).ok());
  EXPECT_THAT(Entries(), ElementsAre("charge official"));
  EXPECT_EQ(Use().today_of(Budget::kRanked).open, 0);
  EXPECT_EQ(Use().total_of(Budget::kRanked).charged, 1);
  End(accepted, EvaluationState::kCancelled);
  EXPECT_THAT(Entries(), ElementsAre("charge official")) << "who cancels has seen an episode";
}

TEST_F(QuotaTest, WhatIsCancelledBeforeItsFirstEpisodeCostsNothing) {
  End(Submit(), EvaluationState::kCancelled);
  EXPECT_THAT(Entries(), IsEmpty());
  EXPECT_EQ(Use().total_of(Budget::kRanked).open, 0);
}

TEST_F(QuotaTest, WhereEpisodesAreWithheldACancelCostsOnceABlockHasBegun) {
  const auto cancel = [&](const Accepted& accepted) {
    ASSERT_TRUE(store_->Write([&](Transaction& writer) {
      writer.quotas.ChargeBegun(accepted.evaluation);
      return absl::OkStatus();
    }).ok());
    End(accepted, EvaluationState::kCancelled);
  };
  cancel(Submit());
  EXPECT_THAT(Entries(), IsEmpty()) << "none has begun";
  const Accepted begun = Submit();
  ASSERT_TRUE(Start(begun.blocks[0], 1).ok());
  cancel(begun);
  EXPECT_THAT(Entries(), ElementsAre("charge official"));
}

TEST_F(QuotaTest, TheGradersFaultIsGivenBack) {
  const Accepted accepted = Submit();
  PlayFirst(accepted);
  End(accepted, EvaluationState::kGraderError);
  EXPECT_THAT(Entries(), ElementsAre("charge official", "refund official"));
  EXPECT_EQ(Use().today_of(Budget::kRanked).charged, 0);
  EXPECT_FALSE(Submit().linked) << "the artefact has had no ranked evaluation";
}

TEST_F(QuotaTest, AnArtefactWhoseEveryTryIsTheGradersFaultIsHeldBack) {
  std::string reason;
  for (int i = 0; i < 3; ++i) {
    const Accepted accepted = Submit();
    PlayFirst(accepted);
    ASSERT_TRUE(store_->Write([&](Transaction& writer) {
      reason = writer.submissions.WithHold(accepted.evaluation, "it vanished");
      return absl::OkStatus();
    }).ok());
    EXPECT_EQ(reason == "it vanished", i < 2) << reason;
    End(accepted, EvaluationState::kGraderError);
  }
  EXPECT_THAT(reason, HasSubstr("it vanished; this artefact has ended so 3 times in a row"));
  const absl::Status refused = TrySubmit("beta", 'a', /*ranked=*/false).status();
  EXPECT_EQ(ErrorCodeOf(refused), "held_back") << refused;
  EXPECT_TRUE(TrySubmit("alpha", 'b', /*ranked=*/true).ok()) << "another artefact";
  Read([](const Transaction& reader) {
    EXPECT_THAT(reader.submissions.HeldBack(), ElementsAre(std::string(64, 'a')));
  });
  Accepted rerun;
  ASSERT_TRUE(store_->Write([&](Transaction& writer) {
    const absl::Status own = writer.submissions.CheckReruns(1, "uid 7", /*organiser=*/false, {});
    EXPECT_EQ(ErrorCodeOf(own), "held_back") << own;
    EXPECT_TRUE(writer.submissions.CheckReruns(1, "uid 0", /*organiser=*/true, {}).ok());
    auto added = writer.evaluations.Add(
        {.submission = 1, .kind = EvaluationKind::kRerun, .grader_json = "{}"},
        {{0, 1}, {2, 3}}, "uid 0");
    if (added.ok()) rerun = *added;
    return added.status();
  }).ok());
  clock_.Advance(absl::Seconds(1));
  End(rerun, EvaluationState::kFailed);
  EXPECT_TRUE(TrySubmit("alpha", 'a', /*ranked=*/true).ok());
  Read([](const Transaction& reader) { EXPECT_THAT(reader.submissions.HeldBack(), IsEmpty()); });
}

TEST_F(QuotaTest, AFailedTryGoesToABudgetOfItsOwn) {
  const Accepted accepted = Submit();
  PlayFirst(accepted);
  End(accepted, EvaluationState::kFailed);
  EXPECT_THAT(Entries(), ElementsAre("charge official", "refund official", "charge failed"));
  EXPECT_EQ(Use().today_of(Budget::kRanked).charged, 0);
  EXPECT_EQ(Use().today_of(Budget::kFailed).charged, 1);
  const auto next = TrySubmit("alpha", 'b', true, Rules(5, 5, /*failed=*/1));
  EXPECT_THAT(std::string(next.status().message()), HasSubstr("used up its 1 failed try of"));
  ASSERT_TRUE(store_->Write([&](Transaction& writer) {
    return writer.quotas.ChargeFailure("beta", kTrack, "uid 0", "upload refused: it is empty");
  }).ok());
  EXPECT_THAT(Entries("beta"), ElementsAre("charge failed"));
}

TEST_F(QuotaTest, TheDayAndTheTotalAreLimitedAndADayLaterThereIsMore) {
  ASSERT_TRUE(TrySubmit("alpha", 'a', true, Rules(1, 2)).ok());
  const auto second = TrySubmit("alpha", 'b', true, Rules(1, 2));
  ASSERT_TRUE(absl::IsFailedPrecondition(second.status()));
  EXPECT_EQ(ErrorCodeOf(second.status()), "quota");
  EXPECT_THAT(std::string(second.status().message()),
              HasSubstr("its 1 ranked evaluation of track \"manipulation\" (1 of them waits or "
                        "runs) for 2023-11-14 (UTC); the next day begins at 2023-11-15T00:00:00Z"));
  EXPECT_TRUE(TrySubmit("alpha", 'b', false, Rules(1, 2)).ok()) << "practice is another budget";
  EXPECT_TRUE(TrySubmit("beta", 'b', true, Rules(1, 2)).ok()) << "another team";
  clock_.Advance(absl::Hours(24));
  EXPECT_TRUE(TrySubmit("alpha", 'b', true, Rules(1, 2)).ok());
  clock_.Advance(absl::Hours(24));
  const auto third = TrySubmit("alpha", 'e', true, Rules(1, 2));
  EXPECT_THAT(std::string(third.status().message()), HasSubstr("only a grant"));
  Grant(Budget::kRanked, 1);
  EXPECT_TRUE(TrySubmit("alpha", 'e', true, Rules(1, 2)).ok());
  EXPECT_EQ(Use().total_of(Budget::kRanked).granted, 1);
}

TEST_F(QuotaTest, OnlySoManyMayWait) {
  ASSERT_TRUE(TrySubmit("alpha", 'a', true, Rules(9, 9, 9, /*waiting=*/1)).ok());
  const auto second = TrySubmit("alpha", 'b', true, Rules(9, 9, 9, /*waiting=*/1));
  EXPECT_THAT(std::string(second.status().message()), HasSubstr("1 evaluation of track"));
}

// However the clock is set, each day gives its allowance once.
TEST_F(QuotaTest, NoSettingOfTheClockMakesQuota) {
  const AdmissionRules rules = Rules(1, 100);
  char artefact = '0';
  std::map<int64_t, int> accepted;  // by the calendar's day
  for (const int hours : {0, -20, 20, 1, -1, -240, 240, 24, 24, -72, 72, -1, 1}) {
    clock_.Jump(absl::Hours(hours));
    for (int i = 0; i < 2; ++i) {
      const bool ok = TrySubmit("alpha", artefact++, true, rules).ok();
      accepted[NowMs() / absl::ToInt64Milliseconds(absl::Hours(24))] += ok;
    }
  }
  for (const auto& [day, count] : accepted) EXPECT_LE(count, 1) << day;
}

TEST_F(QuotaTest, AClockThatWasFarAheadHoldsNobodyUp) {
  const AdmissionRules rules = Rules(1, 100);
  ASSERT_TRUE(TrySubmit("alpha", 'a', true, rules).ok());
  clock_.Jump(absl::Hours(24 * 400));
  ASSERT_TRUE(TrySubmit("alpha", 'b', true, rules).ok());
  ASSERT_TRUE(TrySubmit("beta", 'c', true, rules).ok());
  clock_.Jump(absl::Hours(-24 * 400));
  EXPECT_FALSE(TrySubmit("alpha", 'd', true, rules).ok()) << "today's is used";
  EXPECT_TRUE(TrySubmit("beta", 'e', true, rules).ok());
  EXPECT_EQ(Use("beta").total_of(Budget::kRanked).open, 2) << "in all, both count";
  clock_.Advance(absl::Hours(24));
  EXPECT_TRUE(TrySubmit("alpha", 'f', true, rules).ok());
  // A little ahead, as around midnight: the next day begins early, and once.
  clock_.Jump(absl::Hours(24));
  EXPECT_TRUE(TrySubmit("alpha", 'g', true, rules).ok());
  clock_.Jump(absl::Hours(-24));
  EXPECT_FALSE(TrySubmit("alpha", 'h', true, rules).ok());
  clock_.Advance(absl::Hours(48));
  clock_.Jump(absl::Hours(24));
  EXPECT_TRUE(TrySubmit("alpha", 'i', true, rules).ok());
  clock_.Jump(absl::Hours(-24));
  EXPECT_FALSE(TrySubmit("alpha", 'j', true, rules).ok()) << "a day that has begun goes on";
  clock_.Advance(absl::Hours(48));
  EXPECT_TRUE(TrySubmit("alpha", 'k', true, rules).ok());
}

TEST_F(QuotaTest, AnArtefactHasOneOfficialEvaluation) {
  const Accepted first = Submit("alpha");
  const Accepted again = Submit("alpha");
  EXPECT_TRUE(again.linked);
  EXPECT_EQ(again.submission, first.submission);
  EXPECT_EQ(again.evaluation, first.evaluation);
  EXPECT_FALSE(TrySubmit("alpha", 'a', false)->linked) << "practice is free";
  EXPECT_FALSE(Submit("beta").linked);
  AdmissionRules everyone = kRules;
  everyone.one_for_everyone = true;
  const auto refused = TrySubmit("gamma", 'a', true, everyone);
  EXPECT_EQ(ErrorCodeOf(refused.status()), "same_artefact");
  EXPECT_TRUE(TrySubmit("alpha", 'a', true, everyone)->linked);
  Read([&](const Transaction& reader) {
    EXPECT_EQ(reader.evaluations.Unfinished().rows.size(), 3u);
    EXPECT_THAT(reader.evaluations.Transitions("submission", 3)->front().why,
                HasSubstr("the same artefact as submission 1 of team \"alpha\""));
  });
}

// Another config is a separate competition, and practice is not ranked.
TEST_F(QuotaTest, TheOneOfficialEvaluationIsOfOneConfigAndNotOfPractice) {
  ASSERT_FALSE(TrySubmit("alpha", 'a', /*ranked=*/false)->linked);
  const Accepted official = Submit("alpha", 'a');
  EXPECT_FALSE(official.linked);
  ASSERT_EQ(SqlError("INSERT INTO config SELECT replace(hash, 'c', 'e'), content_json "
                     "FROM config; "
                     "UPDATE submission SET config = replace(config, 'c', 'e')"), "");
  EXPECT_FALSE(Submit("alpha", 'a').linked);
}

TEST_F(QuotaTest, NothingIsAcceptedUnderContentThatIsNotWhatItsHashSays) {
  for (const char* damage :
       {"DROP TRIGGER config_fixed; UPDATE config SET content_json = '[]'",
        "DROP TRIGGER seed_list_fixed; UPDATE seed_list SET content_json = '[1,2,3,5]'"}) {
    store_.reset();
    std::filesystem::remove(path_);
    Open();
    Submit("alpha", 'a');
    ASSERT_EQ(SqlError(damage), "");
    const absl::Status status = TrySubmit("beta", 'b', true).status();
    ASSERT_TRUE(ExtractDamage(status)) << status;
    EXPECT_EQ(ErrorCodeOf(status), kDamagedRowCode);
    Read([&](const Transaction& reader) {
      EXPECT_EQ(reader.evaluations.Unfinished().rows.size(), 1u);
    });
  }
}

TEST_F(QuotaTest, ADamagedAccountIsNamedAndStopsNoDay) {
  PlayFirst(Submit());
  const int64_t today = Use().day;
  ASSERT_EQ(SqlError("DROP TRIGGER ledger_fixed; DROP TRIGGER submission_fixed; "
                     "PRAGMA ignore_check_constraints = ON; "
                     "UPDATE ledger SET amount = 9000000000000000000, day = 9000000000000000000; "
                     "UPDATE submission SET day = 9000000000000000000"), "");
  EXPECT_EQ(Use().day, today);
  EXPECT_EQ(Use().total_of(Budget::kRanked).charged, 0);
  EXPECT_TRUE(TrySubmit("alpha", 'b', true, Rules(1, 1)).ok());
  Read([&](const Transaction& reader) {
    const Listed<LedgerRow> ledger = reader.quotas.Ledger("alpha", "", INT64_MAX, 10);
    EXPECT_THAT(ledger.rows, IsEmpty());
    ASSERT_EQ(ledger.damaged.size(), 1u);
    EXPECT_EQ(ledger.damaged[0].table, "ledger");
    EXPECT_EQ(ledger.damaged[0].key, "1");
  });
}

TEST_F(QuotaTest, AnAmountOutsideItsRangeCountsForNothing) {
  Grant(Budget::kRanked, kMostUnits);
  EXPECT_EQ(Use().total_of(Budget::kRanked).granted, kMostUnits);
  for (const int64_t amount : {int64_t{-5}, int64_t{0}, kMostUnits + 1}) {
    ASSERT_EQ(SqlError(absl::StrCat("DROP TRIGGER IF EXISTS ledger_fixed; "
                                    "PRAGMA ignore_check_constraints = ON; "
                                    "UPDATE ledger SET amount = ", amount)), "");
    EXPECT_EQ(Use().total_of(Budget::kRanked).granted, 0) << amount;
  }
}

TEST_F(QuotaTest, CancellingIsNoWayToASecondTry) {
  const Accepted seen = Submit("alpha", 'a');
  PlayFirst(seen);
  End(seen, EvaluationState::kCancelled);
  EXPECT_TRUE(Submit("alpha", 'a').linked);
  End(Submit("alpha", 'b'), EvaluationState::kCancelled);
  EXPECT_FALSE(Submit("alpha", 'b').linked) << "nothing of it was seen";
}

TEST_F(QuotaTest, MarksAreRowsAndTheNewestIsInForce) {
  const Accepted accepted = Submit();
  const auto mark = [&](const char* name, bool set, const char* why) {
    bool changed = false;
    const absl::Status status = store_->Write([&](Transaction& writer) -> absl::Status {
      auto marked = writer.journal.Mark(accepted.submission, name, set, "uid 0", why);
      if (marked.ok()) changed = *marked;
      return marked.status();
    });
    EXPECT_TRUE(status.ok()) << status;
    return changed;
  };
  EXPECT_FALSE(mark("hidden", false, "")) << "it is not hidden";
  EXPECT_TRUE(mark("hidden", true, "wrong file"));
  EXPECT_FALSE(mark("hidden", true, "wrong file"));
  EXPECT_TRUE(mark("hidden", true, "another reason"));
  EXPECT_TRUE(mark("disqualified", true, "reads the seeds"));
  EXPECT_TRUE(mark("hidden", false, ""));
  Read([&](const Transaction& reader) {
    EXPECT_EQ(reader.Board().MarkHistory(accepted.submission).size(), 4u);
    const Marks marks = reader.Board().MarksAt();
    ASSERT_EQ(marks.size(), 1u);
    EXPECT_EQ(marks.at({accepted.submission, "disqualified"}).why, "reads the seeds");
    EXPECT_EQ(marks.at({accepted.submission, "disqualified"}).who, "uid 0");
  });
}

TEST_F(QuotaTest, TheSchemaRefusesToRewriteAccounts) {
  const Accepted accepted = Submit();
  PlayFirst(accepted);
  ASSERT_TRUE(store_->Write([&](Transaction& writer) {
    return writer.journal.Mark(accepted.submission, "hidden", true, "uid 0", "").status();
  }).ok());
  const std::pair<const char*, const char*> attempts[] = {
      {"UPDATE ledger SET amount = 0", "never changed"},
      {"DELETE FROM ledger", "never deleted"},
      {"INSERT INTO ledger SELECT NULL, at, day, team_id, track, budget, entry, amount, submission,"
       " who, why, phase FROM ledger", "UNIQUE"},
      {"INSERT INTO ledger SELECT NULL, at, day, team_id, track, budget, 'refund', 2, submission,"
       " who, why, phase FROM ledger", "gives back one charge"},
      {"UPDATE journal SET at = 0", "never changed"},
      {"DELETE FROM journal", "never deleted"},
      {"UPDATE submission SET day = 0", "never changed"},
      {"UPDATE submission SET track = 'x'", "never changed"},
      {"DELETE FROM submission", "never deleted"},
  };
  for (const auto& [sql, error] : attempts) EXPECT_THAT(SqlError(sql), HasSubstr(error)) << sql;
}

TEST_F(QuotaTest, APartThatFailsLeavesTheOthers) {
  const absl::Status status = store_->Write([&](Transaction& writer) {
    const auto grant = [](int64_t amount) {
      return [amount](Transaction& part) {
        return part.quotas.Grant({"alpha", kTrack, Budget::kRanked, amount, "why"}, "uid 0");
      };
    };
    EXPECT_TRUE(writer.Part(grant(1)).ok());
    EXPECT_FALSE(writer.Part([&](Transaction& part) {
      EXPECT_TRUE(grant(10)(part).ok());
      return absl::InvalidArgumentError("no");
    }).ok());
    EXPECT_TRUE(writer.Part(grant(100)).ok());
    return absl::OkStatus();
  });
  ASSERT_TRUE(status.ok()) << status;
  EXPECT_EQ(Use().total_of(Budget::kRanked).granted, 101);
}

}  // namespace
}  // namespace myograde::server
