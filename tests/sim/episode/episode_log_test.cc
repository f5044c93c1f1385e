// Logs as the lease loop writes them, through a pipe, and as they are replayed.
#include <fcntl.h>
#include <sys/mman.h>

#include <thread>

#include "protocol/base/file.h"
#include "protocol/log/packed_log.h"
#include "tests/sim/episode/lease_world.h"
#include "sim/episode/replay_player.h"

namespace myograde::sim {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

// The other end of a log writer's pipe.
class Pipe {
 public:
  Pipe() {
    int ends[2];
    if (pipe2(ends, O_CLOEXEC | O_NONBLOCK) != 0) std::abort();
    read_ = Fd(ends[0]);
    write_ = Fd(ends[1]);
    reader_ = std::thread([this] { Empty(); });
  }
  ~Pipe() { Join(); }
  int fd() const { return write_.get(); }
  // All that was written.
  std::string Join() {
    write_.reset();
    if (reader_.joinable()) reader_.join();
    return bytes_;
  }

 private:
  void Empty() {
    fcntl(read_.get(), F_SETFL, 0);
    char buffer[4096];
    for (ssize_t n; (n = read(read_.get(), buffer, sizeof(buffer))) > 0;) {
      bytes_.append(buffer, static_cast<size_t>(n));
    }
  }
  Fd read_;
  Fd write_;
  std::string bytes_;
  std::thread reader_;
};

Fd FileOf(const std::string& bytes) {
  Fd file(memfd_create("log", MFD_CLOEXEC));
  if (write(file.get(), bytes.data(), bytes.size()) != std::ssize(bytes)) std::abort();
  lseek(file.get(), 0, SEEK_SET);
  return file;
}

absl::StatusOr<EpisodeLog> Parse(const std::string& packed) {
  const absl::StatusOr<std::string> bytes = ReadPackedLog(FileOf(packed).get());
  if (!bytes.ok()) return bytes.status();
  return ParseEpisodeLog(*bytes);
}

class EpisodeLogTest : public LeasePlayerTest {
 protected:
  EpisodeLogTest() {
    const std::string tracks = std::string(MYOGRADE_SOURCE_DIR) + "/configs/tracks";
    order_.track = *LoadTrackConfig(tracks, "manipulation", "");
  }

  LeaseResult PlayLogged(Script script, int64_t budget = 1 << 20) {
    Pipe pipe;
    LogWriter writer(pipe.fd(), budget, 0.01);
    log_ = &writer;
    const LeaseResult result = Play({std::move(script)});
    log_ = nullptr;
    const std::string all = pipe.Join();
    size_t at = 0;
    for (const EpisodeFacts& facts : result.episodes) {
      packed_.push_back(all.substr(at, static_cast<size_t>(facts.log.packed_bytes)));
      at += packed_.back().size();
    }
    EXPECT_EQ(at, all.size()) << "every byte belongs to a log";
    return result;
  }

  std::vector<std::string> packed_;  // of each episode
};

TEST_F(EpisodeLogTest, HoldsEveryActionAndDigest) {
  const LeaseResult result = PlayLogged([](Sandbox& sandbox) { sandbox.PlayWell(); });
  ASSERT_TRUE(result.status.ok()) << result.status;
  ASSERT_EQ(result.episodes.size(), 3u);
  for (size_t i = 0; i < 3; ++i) {
    const EpisodeFacts& facts = result.episodes[i];
    const absl::StatusOr<std::string> bytes = ReadPackedLog(FileOf(packed_[i]).get());
    ASSERT_TRUE(bytes.ok()) << bytes.status();
    EXPECT_EQ(Sha256Hex(*bytes), facts.log.sha256);
    EXPECT_EQ(std::ssize(*bytes), facts.log.bytes);
    const absl::StatusOr<EpisodeLog> log = ParseEpisodeLog(*bytes);
    ASSERT_TRUE(log.ok()) << log.status();
    EXPECT_EQ(log->header.seed, 100 + i);
    EXPECT_EQ(log->header.first, i == 0);
    EXPECT_EQ(log->header.config, order_.track.hash);
    EXPECT_THAT(log->header.track.seeds, ElementsAre(100 + i)) << "a log tells no other seed";
    EXPECT_EQ(log->steps(), 5);
    EXPECT_EQ(facts.log.steps, 5);
    EXPECT_EQ(log->action(4)[79], 1);
    EXPECT_EQ(log->end.digest, facts.digest);
    EXPECT_EQ(ToHex(log->states.back()), facts.digest.substr(0, 16)) << "the chain ends there";
    EXPECT_EQ(log->end.end, "time");
  }
}

TEST_F(EpisodeLogTest, EqualEpisodesHaveEqualLogs) {
  const auto play = [&] { return PlayLogged([](Sandbox& sandbox) { sandbox.PlayWell(); }); };
  const LeaseResult first = play();
  const LeaseResult second = play();
  for (size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(first.episodes[i].log.sha256, second.episodes[i].log.sha256);
    EXPECT_EQ(first.episodes[i].actions_digest, second.episodes[i].actions_digest);
  }
}

TEST_F(EpisodeLogTest, AFaultEndsItsLogAndTheNextOnesAreEmpty) {
  order_.track.budgets.restarts = 0;
  const LeaseResult result = PlayLogged([](Sandbox& sandbox) { sandbox.PlayUntil(1, 2); });
  ASSERT_EQ(result.episodes.size(), 3u);
  const auto broken = Parse(packed_[1]);
  ASSERT_TRUE(broken.ok()) << broken.status();
  EXPECT_EQ(broken->steps(), 2);
  EXPECT_EQ(broken->end.end, "crash");
  const auto none = Parse(packed_[2]);
  ASSERT_TRUE(none.ok()) << none.status();
  EXPECT_FALSE(none->header.begun);
  EXPECT_FALSE(none->start.has_value());
  EXPECT_EQ(none->steps(), 0);
}

TEST_F(EpisodeLogTest, ABudgetIsKept) {
  Pipe pipe;
  LogWriter writer(pipe.fd(), LogWriter::kMinBudget, 0.01);
  LogHeader header;
  header.track = *WithSeeds(order_.track, {1});
  writer.Begin(header);
  writer.Start({});
  std::vector<double> action(80);
  uint64_t noise = 1;
  for (int64_t step = 0; step < 4000; ++step) {  // 2.5 MB that can't be packed
    for (double& value : action) {
      noise = noise * 6364136223846793005u + 1442695040888963407u;
      value = static_cast<double>(noise >> 11) * 0x1p-53;
    }
    writer.Step(action, Shorten(Sha256Of(std::to_string(step))), Shorten(Sha256Of("")));
  }
  const absl::StatusOr<EpisodeLogInfo> info = writer.End({4000, 0, "time", "d"});
  ASSERT_TRUE(info.ok()) << info.status();
  const std::string packed = pipe.Join();
  EXPECT_EQ(std::ssize(packed), info->packed_bytes);
  EXPECT_LE(info->packed_bytes, LogWriter::kMinBudget);
  EXPECT_GT(info->packed_bytes, LogWriter::kMinBudget * 3 / 4) << "what fits is kept";
  EXPECT_LT(info->steps, 4000);
  const auto log = Parse(packed);
  ASSERT_TRUE(log.ok()) << log.status();
  EXPECT_EQ(log->steps(), info->steps);
  EXPECT_EQ(log->end.steps, 4000);
}

TEST_F(EpisodeLogTest, ReplaysEqual) {
  PlayLogged([](Sandbox& sandbox) { sandbox.PlayWell(); });
  for (const std::string& packed : packed_) {
    const auto log = Parse(packed);
    ASSERT_TRUE(log.ok());
    const auto record = ReplayLog(*log, environment_, [](int64_t) {});
    ASSERT_TRUE(record.ok());
    EXPECT_TRUE(record->equal) << record->detail;
    EXPECT_EQ(record->steps, 5);
  }
}

// Writes down what it is told, and is too large if `fails`.
class CountingRecorder final : public EpisodeRecorder {
 public:
  explicit CountingRecorder(bool fails = false) : fails_(fails) {}
  void Begin() override { seen_ += "begin"; }
  void AfterStep() override { seen_ += " step"; }
  absl::StatusOr<std::string> Finish() override {
    if (fails_) return absl::ResourceExhaustedError("too large");
    return seen_ + " end";
  }

 private:
  const bool fails_;
  std::string seen_;
};

// What a replay's runner hears, and what is in the memory file for the trajectory.
struct HeardReplay {
  absl::Status status;
  std::vector<nlohmann::json> messages;
  std::string trajectory;
};

class RecordedReplay : public EpisodeLogTest {
 protected:
  // Replays the packed logs; the last one is recorded.
  HeardReplay Replay(const MakeEpisodeRecorder& recorders) {
    order_.replay = std::vector<std::string>(packed_.size(), "log");
    order_.trajectory = "/trajectory";
    auto [ours, theirs] = Pair();
    const Fd memory(memfd_create("trajectory", MFD_CLOEXEC));
    EXPECT_EQ(ftruncate(memory.get(), 4096), 0);
    HeardReplay heard;
    std::thread runner([&, ours = ours.get()] {
      size_t next = 0;
      while (true) {
        const auto message = ReceiveSimMessage(ours, absl::Seconds(30));
        if (!message.ok()) return;
        heard.messages.push_back(message->json);
        if (message->json["type"] == "done") return;
        if (message->json["type"] != "need_log") continue;
        const Fd log = FileOf(packed_[next++]);
        if (!SendSimMessage(ours, {{"type", "log"}}, log.get()).ok()) return;
      }
    });
    heard.status = ReplayPlayer(order_, environment_, theirs.get(), SystemClock(), recorders,
                                memory.get())
                       .Play();
    theirs.reset();
    runner.join();
    lseek(memory.get(), 0, SEEK_SET);
    heard.trajectory = *ReadAll(memory.get(), "trajectory");
    heard.trajectory.erase(std::min(heard.trajectory.find('\0'), heard.trajectory.size()));
    return heard;
  }
};

TEST_F(RecordedReplay, SendsTheLastEpisodesTrajectoryBeforeItsRecord) {
  PlayLogged([](Sandbox& sandbox) { sandbox.PlayWell(); });
  const HeardReplay heard = Replay([](const EpisodeLog& log) {
    EXPECT_EQ(log.header.seed, 102) << "the last one";
    return std::make_unique<CountingRecorder>();
  });
  ASSERT_TRUE(heard.status.ok()) << heard.status;
  EXPECT_EQ(heard.trajectory, "begin step step step step step end");
  ASSERT_GE(heard.messages.size(), 3u);
  const nlohmann::json& told = heard.messages[heard.messages.size() - 3];
  EXPECT_EQ(told["type"], "trajectory");
  EXPECT_EQ(told["bytes"], heard.trajectory.size());
  EXPECT_EQ(heard.messages[heard.messages.size() - 2]["equal"], true);
}

TEST_F(RecordedReplay, HasNoTrajectoryOfWhatDiffersOrIsTooLarge) {
  PlayLogged([](Sandbox& sandbox) { sandbox.PlayWell(); });
  HeardReplay heard = Replay(
      [](const EpisodeLog&) { return std::make_unique<CountingRecorder>(/*fails=*/true); });
  ASSERT_TRUE(heard.status.ok()) << heard.status;
  EXPECT_EQ(heard.trajectory, "");
  EXPECT_THAT(heard.messages[heard.messages.size() - 2]["differs"], ElementsAre("log"));
  EXPECT_EQ(heard.messages[heard.messages.size() - 2]["detail"], "too large");
  environment_.length = 4;
  heard = Replay([](const EpisodeLog&) { return std::make_unique<CountingRecorder>(); });
  ASSERT_TRUE(heard.status.ok()) << heard.status;
  EXPECT_EQ(heard.trajectory, "");
  EXPECT_EQ(heard.messages[heard.messages.size() - 2]["equal"], false);
}

TEST_F(EpisodeLogTest, AnEpisodeThatWasGivenUpReplaysEqual) {
  const LeaseResult result = PlayLogged([](Sandbox& sandbox) {
    sandbox.Hello();
    while (const PublishFrame* question = sandbox.Hear()) {
      if (question->expect == Expect::kAction && question->step == question->episode * 2) {
        sandbox.GiveUp(*question);
      } else {
        sandbox.Answer(*question);
      }
    }
  });
  ASSERT_EQ(result.episodes.size(), 3u);
  for (size_t i = 0; i < 3; ++i) {
    auto log = Parse(packed_[i]);
    ASSERT_TRUE(log.ok()) << log.status();
    EXPECT_EQ(log->end.end, "given-up");
    EXPECT_EQ(log->end.steps, static_cast<int64_t>(2 * i));
    auto record = ReplayLog(*log, environment_, [](int64_t) {});
    ASSERT_TRUE(record.ok());
    EXPECT_TRUE(record->equal) << record->detail;
    EXPECT_EQ(record->steps, static_cast<int64_t>(2 * i));
  }
  // A log that claims so of an episode which had ended by then is not believed.
  auto log = Parse(packed_[2]);
  environment_.length = 4;
  EXPECT_THAT(ReplayLog(*log, environment_, [](int64_t) {})->differs, ElementsAre("end"));
}

TEST_F(EpisodeLogTest, AReplayNamesTheFirstStepThatDiffers) {
  PlayLogged([](Sandbox& sandbox) { sandbox.PlayWell(); });
  auto log = Parse(packed_[0]);
  ASSERT_TRUE(log.ok());
  log->actions[3 * 80 + 79] += 1;  // the environment sums the last entries
  auto record = ReplayLog(*log, environment_, [](int64_t) {});
  EXPECT_FALSE(record->equal);
  EXPECT_EQ(record->step, 3);
  EXPECT_EQ(record->steps, 3);
  EXPECT_THAT(record->differs, ElementsAre("state"));

  log = Parse(packed_[0]);
  log->header.seed += 1;
  record = ReplayLog(*log, environment_, [](int64_t) {});
  EXPECT_EQ(record->step, 0);
  EXPECT_THAT(record->differs, ElementsAre("observation", "state"));

  log = Parse(packed_[0]);
  environment_.length = 4;
  record = ReplayLog(*log, environment_, [](int64_t) {});
  EXPECT_EQ(record->step, 4);
  EXPECT_THAT(record->differs, ElementsAre("steps"));
  environment_.length = 6;
  record = ReplayLog(*log, environment_, [](int64_t) {});
  EXPECT_THAT(record->differs, ElementsAre("end"));
}

TEST_F(EpisodeLogTest, DamagedFilesAreNamed) {
  PlayLogged([](Sandbox& sandbox) { sandbox.PlayWell(); });
  std::string cut = packed_[0];
  cut.resize(cut.size() / 2);
  EXPECT_THAT(std::string(ReadPackedLog(FileOf(cut).get()).status().message()), HasSubstr("cut"));
  std::string altered = packed_[0];
  altered[altered.size() / 2] = static_cast<char>(altered[altered.size() / 2] ^ 0x10);
  EXPECT_FALSE(Parse(altered).ok());
  EXPECT_FALSE(Parse("").ok());
}

}  // namespace
}  // namespace myograde::sim
