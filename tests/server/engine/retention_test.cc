// Which files a policy removes, and what a sweep does with them.
#include "server/engine/retention.h"

#include <atomic>
#include <filesystem>
#include <fstream>
#include <thread>

#include <SQLiteCpp/SQLiteCpp.h>
#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "server/runner/log_keeper.h"

namespace myograde::server {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr int64_t kDay = 24 * 60 * 60 * 1000;

std::vector<std::string> Chosen(std::vector<KeptFile> files, int days, int64_t bytes) {
  std::vector<std::string> names;
  for (const KeptFile& choice : ChooseRemovals(std::move(files), absl::Hours(24 * days), bytes,
                                             /*now_ms=*/100 * kDay)) {
    EXPECT_FALSE(choice.why.empty());
    names.push_back(choice.name);
  }
  return names;
}

TEST(Retention, TheOldGoAndTheNeededStay) {
  const std::vector<KeptFile> files = {{"old", "", 10, 10 * kDay, false},
                                       {"needed", "", 10, 5 * kDay, true},
                                       {"new", "", 10, 95 * kDay, false},
                                       {"older", "", 10, 1 * kDay, false}};
  EXPECT_THAT(Chosen(files, 30, 1000), ElementsAre("older", "old"));
  EXPECT_THAT(Chosen(files, 100, 1000), IsEmpty());
}

TEST(Retention, TheOldestGoUntilTheRestIsSmallEnough) {
  const std::vector<KeptFile> files = {{"c", "", 10, 30 * kDay, false},
                                       {"needed", "", 50, 5 * kDay, true},
                                       {"b", "", 10, 20 * kDay, false},
                                       {"a", "", 10, 20 * kDay, false}};
  EXPECT_THAT(Chosen(files, 365, 80), IsEmpty());
  EXPECT_THAT(Chosen(files, 365, 79), ElementsAre("a"));
  EXPECT_THAT(Chosen(files, 365, 60), ElementsAre("a", "b"));
  EXPECT_THAT(Chosen(files, 365, 1), ElementsAre("a", "b", "c"));
}

TEST(Retention, ALastUseInTheFutureIsNoReasonToGo) {
  EXPECT_THAT(Chosen({{"jumped", "", 10, 900 * kDay, false}}, 1, 1000), IsEmpty());
}

TEST(Retention, OneSweepRemovesFewForTheirAge) {
  std::vector<KeptFile> files;
  for (int i = 0; i < 3000; ++i) files.push_back({absl::StrCat(i), "", 10, 1 * kDay, false});
  EXPECT_EQ(Chosen(files, 30, 1'000'000).size(), 300u);
  files.resize(50);
  EXPECT_EQ(Chosen(files, 30, 1'000'000).size(), 10u);
  EXPECT_EQ(Chosen(files, 30, 10).size(), 49u) << "a limit on bytes holds whatever the clock says";
}

namespace fs = std::filesystem;

// Nothing is played here.
class NoProcesses : public Executor {
 public:
  absl::StatusOr<std::unique_ptr<Runner>> Start(const LeaseOrder&, const LeaseSubject&) override {
    return absl::UnavailableError("nothing is played here");
  }
  void CleanUp(const std::string&) override {}
};

// A calendar clock that is ahead of the files' times by a given amount, or stands still.
class LaterClock : public Clock {
 public:
  absl::Duration Monotonic() const override { return SystemClock().Monotonic() + running; }
  absl::Time Now() const override {
    return still == absl::InfinitePast() ? SystemClock().Now() + ahead : still;
  }
  absl::Duration ahead = absl::ZeroDuration();
  absl::Duration running = absl::ZeroDuration();
  absl::Time still = absl::InfinitePast();
};

class RetentionFolder : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "retention-test-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    dir_ = name;
    for (const char* part : {"artefacts", "logs", "spool"}) fs::create_directory(dir_ + "/" + part);
    store_ = *Store::Open(dir_ + "/store.db", clock_);
    readers_ = std::make_unique<ReaderPool>(dir_ + "/store.db");
    disk_ = std::make_unique<SqliteStoreWriter>(*store_);
    EngineOptions options;
    options.data_dir = dir_;
    options.config.scheduler.slots = 0;
    engine_ = std::make_unique<Engine>(options, *disk_, *readers_, processes_, clock_);
  }
  void TearDown() override {
    StopEngine();
    engine_ = nullptr;
    fs::remove_all(dir_);
  }

  void RunEngine() {
    if (!loop_.joinable()) loop_ = std::thread([this] { (void)engine_->Run(); });
  }
  void StopEngine() {
    engine_->Stop();
    if (loop_.joinable()) loop_.join();
  }

  void MakeArtefact(char letter) {
    const std::string hash(64, letter);
    fs::create_directory(FolderOf(letter));
    ASSERT_TRUE(store_->Write([&](Transaction& writer) {
      return writer.content.AddArtefact({{"walker", {"./policy"}}, hash, 100, 2}).status();
    }).ok());
  }
  std::string FolderOf(char letter) const {
    return absl::StrCat(dir_, "/artefacts/", std::string(64, letter));
  }
  std::string MakeLog(char letter) {
    const std::string path = absl::StrCat(dir_, "/logs/", LogFileName(std::string(64, letter)));
    std::ofstream(path) << std::string(100, 'x');
    return path;
  }

  static NewSubmission SubmissionOf(char artefact) {
    static const TrackConfig config =
        LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", "demo-manipulation", "").value();
    NewSubmission submission;
    submission.team = "alpha";
    submission.artefact = std::string(64, artefact);
    submission.track = config.id;
    submission.profile = config.profile;
    submission.config = config.hash;
    submission.config_json = CanonicalJson(config.effective);
    submission.seeds = Sha256Hex("[1]");
    submission.seeds_json = "[1]";
    submission.ranked = true;
    submission.grader_json = "{}";
    submission.blocks = {{0, 0}};
    return submission;
  }
  // Plays the only episode of a submission, whose evaluation has not ended yet.
  void PlayWithLog(char artefact, bool ranked, const std::string& log) {
    NewSubmission submission = SubmissionOf(artefact);
    submission.ranked = ranked;
    ASSERT_TRUE(store_->Write([&](Transaction& writer) -> absl::Status {
      const auto accepted = writer.submissions.Accept(submission, Rules(), "uid 0");
      if (!accepted.ok()) return accepted.status();
      absl::Status status = writer.blocks.Start(accepted->blocks[0], 1, 0, 99, "daemon");
      status.Update(writer.episodes.Record({accepted->evaluation, 0, accepted->blocks[0], 1, 1,
                                          Outcome::kFailure, FailureReason::kTime,
                                          R"({"log":{"sha256":")" + log + R"("}})",
                                          R"({"time_s":10.0})"}).status());
      return status;
    }).ok());
  }
  static AdmissionRules Rules() {
    return {.quota = {.ranked = {9, 9}, .practice = {9, 9}, .failed = {9, 9}, .waiting = 9}};
  }
  void Accept(char artefact) {
    ASSERT_TRUE((*Store::Open(dir_ + "/store.db", clock_))->Write([&](Transaction& writer) {
      return writer.submissions.Accept(SubmissionOf(artefact), Rules(), "uid 0").status();
    }).ok());
  }

  std::optional<absl::Time> Newest() {
    const auto newest = (*Store::Open(dir_ + "/store.db", clock_))->trusted_time_ms();
    return newest ? std::optional(absl::FromUnixMillis(*newest)) : std::nullopt;
  }

  // Sweeps until `gone` has disappeared.
  void Sweep(RetentionLimits limits, const std::string& gone, int64_t disk_reserve = 0) {
    limits.every = absl::Milliseconds(50);
    RunEngine();
    const Retention retention(limits, disk_reserve, dir_, *engine_, *readers_, clock_, Newest());
    for (int i = 0; i < 3000 && fs::exists(gone); ++i) absl::SleepFor(absl::Milliseconds(10));
    EXPECT_FALSE(fs::exists(gone)) << gone;
    absl::SleepFor(absl::Milliseconds(200));  // for anything that should stay
  }
  RetentionLimits Unlimited() const {
    return {.artefact_age = absl::Hours(24 * 365), .artefact_bytes = INT64_MAX,
            .log_age = absl::Hours(24 * 365), .log_bytes = INT64_MAX, .every = absl::Hours(1),
            .upload_age = absl::Hours(24 * 365)};
  }
  // Makes the artefacts a and b, of which one is submitted 40 days later; the limits let the other go.
  RetentionLimits SubmitOneOfTwoLater(char submitted) {
    MakeArtefact('a');
    MakeArtefact('b');
    clock_.ahead = absl::Hours(24 * 40);
    Accept(submitted);
    RetentionLimits limits = Unlimited();
    limits.artefact_age = absl::Hours(24 * 30);
    return limits;
  }
  std::vector<std::string> Removals() {
    std::vector<std::string> names;
    SQLite::Database db(dir_ + "/store.db");
    SQLite::Statement select(db,
                             "SELECT kind || ' ' || substr(name, 1, 1) FROM removal ORDER BY id");
    while (select.executeStep()) names.push_back(select.getColumn(0).getString());
    return names;
  }

  std::string dir_;
  LaterClock clock_;
  NoProcesses processes_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<ReaderPool> readers_;
  std::unique_ptr<SqliteStoreWriter> disk_;
  std::unique_ptr<Engine> engine_;
  std::thread loop_;
};

TEST_F(RetentionFolder, ArtefactsGoThatNobodyNeedsAndTheNeededStay) {
  Sweep(SubmitOneOfTwoLater('a'), FolderOf('b'));
  EXPECT_TRUE(fs::exists(FolderOf('a')));
  EXPECT_THAT(Removals(), ElementsAre("artefact b"));
  EXPECT_TRUE(fs::is_empty(dir_ + "/spool"));
}

TEST_F(RetentionFolder, WhatIsSubmittedBeforeItsRemovalIsWrittenStays) {
  RetentionLimits limits = SubmitOneOfTwoLater('b');
  const std::string log = MakeLog('1');
  limits.log_bytes = 0;
  std::atomic<bool> sweeping = false;
  std::thread::id loop;
  int reads = 0;
  readers_->SetObserver([&, test = std::this_thread::get_id()](absl::Duration, const absl::Status&) {
    const std::thread::id own = std::this_thread::get_id();
    if (own == test || !sweeping || own == loop) return;
    // The sweep's second read finds the artefacts that nobody needs.
    if (++reads == 2) Accept('a');
  });
  RunEngine();
  loop = loop_.get_id();
  sweeping = true;
  Sweep(limits, log);
  EXPECT_TRUE(fs::exists(FolderOf('a')));
  EXPECT_THAT(Removals(), ElementsAre("log 1"));
}

// A clock that is far ahead of all that the store has seen may be wrong.
TEST_F(RetentionFolder, AWrongClockRemovesNothing) {
  MakeArtefact('a');
  Accept('a');
  MakeArtefact('b');
  MakeArtefact('c');
  const std::optional<absl::Time> newest = Newest();
  RetentionLimits limits = Unlimited();
  limits.artefact_age = limits.upload_age = absl::Hours(24 * 30);
  limits.every = absl::Milliseconds(20);
  RunEngine();
  clock_.ahead = absl::Hours(24 * 400);
  {
    const Retention wrong_at_the_start(limits, 0, dir_, *engine_, *readers_, clock_, newest);
    absl::SleepFor(absl::Milliseconds(300));
  }
  clock_.ahead = absl::ZeroDuration();
  {
    const Retention right(limits, 0, dir_, *engine_, *readers_, clock_, newest);
    absl::SleepFor(absl::Milliseconds(100));
    clock_.ahead = absl::Hours(24 * 400);
    absl::SleepFor(absl::Milliseconds(300));
  }
  // Nor does it if a submission was accepted while it was wrong, and the daemon was started again.
  MakeArtefact('d');
  Accept('d');
  EXPECT_LT(*Newest(), absl::Now() + absl::Hours(24 * 5));
  {
    const Retention again(limits, 0, dir_, *engine_, *readers_, clock_, Newest());
    absl::SleepFor(absl::Milliseconds(300));
  }
  EXPECT_THAT(Removals(), IsEmpty());
}

TEST(TrustedTime, AClockThatStaysAheadIsRightInTheEnd) {
  LaterClock clock;
  const absl::Time before = clock.Now();
  clock.ahead = absl::Hours(24 * 100);
  const TrustedTime time(before, clock);
  EXPECT_LT(time.Now(), before + absl::Hours(49));
  clock.running = absl::Hours(24 * 8);
  EXPECT_GT(time.Now(), clock.Now() - absl::Seconds(60));
}

TEST_F(RetentionFolder, DenialsGoAndActsStay) {
  const auto add = [&] {
    AccessEventRow event;
    event.kind = "act";
    event.who = "uid 0";
    event.action = "mark";
    ASSERT_TRUE(store_->Write([&](Transaction& writer) {
      absl::Status status = writer.callers.AddDenial(event, event);
      status.Update(writer.callers.AddEvent(event));
      return status;
    }).ok());
  };
  add();
  clock_.ahead = absl::Hours(24 * 40);
  add();
  RetentionLimits limits = Unlimited();
  limits.log_bytes = 0;
  const std::string log = MakeLog('1');
  Sweep(limits, log);
  SQLite::Database db(dir_ + "/store.db");
  EXPECT_EQ(db.execAndGet("SELECT count(*) FROM access_event WHERE kind = 'denied'").getInt(), 1);
  EXPECT_EQ(db.execAndGet("SELECT count(*) FROM access_event WHERE kind = 'act'").getInt(), 2);
}

// The row's age comes from the test's clock; the folder was created just now.
TEST_F(RetentionFolder, AFolderThatCameAgainIsNew) {
  clock_.ahead = -absl::Hours(24 * 40);
  MakeArtefact('a');
  MakeArtefact('b');
  fs::remove(FolderOf('b'));
  clock_.ahead = absl::ZeroDuration();
  RetentionLimits limits = Unlimited();
  limits.artefact_age = absl::Hours(24 * 30);
  limits.artefact_bytes = 100;  // missing files take no space
  limits.log_bytes = 0;
  const std::string log = MakeLog('1');
  clock_.ahead = absl::Hours(1);
  Sweep(limits, log);  // artefacts are swept before logs
  EXPECT_TRUE(fs::exists(FolderOf('a')));
  EXPECT_THAT(Removals(), ElementsAre("log 1"));
}

TEST_F(RetentionFolder, LogsGoThatNobodyNeedsAndTheNeededAndTheFreshStay) {
  MakeArtefact('a');
  PlayWithLog('a', /*ranked=*/true, std::string(64, '1'));
  const std::string needed = MakeLog('1');
  absl::SleepFor(absl::Milliseconds(20));  // the needed one is older
  const std::string unneeded = MakeLog('2');
  std::ofstream(dir_ + "/logs/.draft-1") << "in work";
  RetentionLimits limits = Unlimited();
  limits.log_bytes = 100;  // enough for one
  clock_.ahead = absl::Hours(1);
  Sweep(limits, unneeded);
  EXPECT_TRUE(fs::exists(needed));
  EXPECT_TRUE(fs::exists(dir_ + "/logs/.draft-1"));
  EXPECT_THAT(Removals(), ElementsAre("log 2"));
}

// Also those of a practice that still runs, as it may be what fills the disk.
TEST_F(RetentionFolder, LogsOfPracticeGiveWayToTheDisksReserve) {
  MakeArtefact('a');
  MakeArtefact('b');
  PlayWithLog('a', /*ranked=*/false, std::string(64, '1'));
  PlayWithLog('b', /*ranked=*/true, std::string(64, '2'));
  const std::string practice = MakeLog('1');
  const std::string ranked = MakeLog('2');
  const std::string nameless = MakeLog('3');  // its row may be about to be written
  Sweep(Unlimited(), practice, /*disk_reserve=*/INT64_MAX / 2);
  EXPECT_TRUE(fs::exists(ranked));
  EXPECT_TRUE(fs::exists(nameless));
  EXPECT_THAT(Removals(), ElementsAre("log 1"));
}

// The row that needs a log is written after its file.
TEST_F(RetentionFolder, AFreshLogStays) {
  const std::string old = MakeLog('1');
  absl::SleepFor(absl::Milliseconds(50));
  const absl::Time between = SystemClock().Now();
  absl::SleepFor(absl::Milliseconds(50));
  const std::string fresh = MakeLog('2');
  clock_.still = between + absl::Minutes(10);
  RetentionLimits limits = Unlimited();
  limits.log_bytes = 0;
  Sweep(limits, old);
  EXPECT_TRUE(fs::exists(fresh));
  EXPECT_THAT(Removals(), ElementsAre("log 1"));
}

// The files are checked when the row is written, not only before.
TEST_F(RetentionFolder, NothingIsAcceptedWhoseFilesAreGone) {
  MakeArtefact('a');
  MakeArtefact('b');
  Accept('b');
  fs::remove(FolderOf('a'));
  fs::remove(FolderOf('b'));
  RunEngine();
  const auto refused = engine_->Submit(SubmissionOf('a'), Rules(), "uid 0", absl::Minutes(5));
  EXPECT_TRUE(absl::IsNotFound(refused.status())) << refused.status();
  // Of an existing submission, so that only its files are missing.
  const auto rerun = engine_->Rerun({1, std::string(64, 'b'), "{}", {{0, 0}}}, "uid 0", true, {},
                                    absl::Minutes(5));
  EXPECT_TRUE(absl::IsNotFound(rerun.status())) << rerun.status();
  SQLite::Database db(dir_ + "/store.db");
  EXPECT_EQ(db.execAndGet("SELECT count(*) FROM submission").getInt(), 1);
  EXPECT_EQ(db.execAndGet("SELECT count(*) FROM evaluation").getInt(), 1);
}

// Removal and submission meet in one transaction, in either order: there is never an evaluation
// without its files.
TEST_F(RetentionFolder, ARemovalAndASubmissionAtOnceLeaveNoEvaluationWithoutFiles) {
  for (const bool removal_first : {true, false}) {
    const char letter = removal_first ? 'a' : 'b';
    MakeArtefact(letter);
    absl::Status accepted;
    std::vector<std::thread> askers;
    const auto submit = [&] {
      askers.emplace_back([&] {
        accepted =
            engine_->Submit(SubmissionOf(letter), Rules(), "uid 0", absl::Minutes(5)).status();
      });
      absl::SleepFor(absl::Milliseconds(300));  // it waits in the queue
    };
    StopEngine();
    engine_ = nullptr;
    EngineOptions options;
    options.data_dir = dir_;
    options.config.scheduler.slots = 0;
    engine_ = std::make_unique<Engine>(options, *disk_, *readers_, processes_, clock_);
    RetentionLimits limits = Unlimited();
    limits.artefact_bytes = 0;
    limits.every = absl::Milliseconds(10);
    if (!removal_first) submit();
    std::unique_ptr<Retention> retention =
        std::make_unique<Retention>(limits, 0, dir_, *engine_, *readers_, clock_, std::nullopt);
    absl::SleepFor(absl::Milliseconds(300));
    if (removal_first) submit();
    loop_ = std::thread([this] { (void)engine_->Run(); });
    for (std::thread& asker : askers) asker.join();
    retention = nullptr;
    EXPECT_EQ(accepted.ok(), fs::exists(FolderOf(letter))) << accepted;
    StopEngine();
  }
}

}  // namespace
}  // namespace myograde::server
