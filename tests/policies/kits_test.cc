// The kits and the bundled policies against a grader that plays by a script,
// over the real bridge and a real bus.
#include <sys/wait.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/policy/channels.h"
#include "protocol/tracks/locomotion/track.h"
#include "protocol/tracks/manipulation/track.h"
#include "protocol/tracks/registry.h"
#include "sim/episode/messages.h"
#include "protocol/bridge/leg_sets_json.h"
#include "tests/protocol/bridge/bridge_world.h"

namespace myograde {
namespace {

using ::testing::Each;
using Values = std::vector<double>;

std::string PoliciesDir() { return MYOGRADE_POLICIES_DIR; }

// The grader's side, one question at a time.
class Grader {
 public:
  // Starts the policy in the folder that it would be submitted as.
  Grader(const std::string& folder, const std::vector<std::string>& command, const TrackKind& track,
         const std::vector<std::string>& options = {}) {
    const std::filesystem::path before = std::filesystem::current_path();
    std::filesystem::current_path(PoliciesDir() + "/" + folder);
    world_.emplace(command, options);
    std::filesystem::current_path(before);
    config_.kind = &track;
    config_.profile = "paper";
    config_.budgets = {};
    config_.budgets.step_s = 1;
    config_.budgets.overtime_s = 60;
  }

  absl::StatusOr<HelloFrame> AwaitHello() { return As<HelloFrame>(world_->Receive(kPatience)); }
  void Welcome(bool accepted = true) {
    sim::WelcomeInfo info;
    info.accepted = accepted;
    info.reason = accepted ? "" : "for a test";
    info.max_steps = 1000;
    Send(messages_.Welcome(config_, info));
  }
  absl::StatusOr<ReadyFrame> Start(int64_t episode, uint64_t seed) {
    Send(messages_.EpisodeStart(episode, seed));
    return As<ReadyFrame>(world_->Receive(kPatience));
  }
  // Asks with an observation whose entries are all `value`.
  void SendObservation(int64_t episode, int64_t step, double value) {
    const int size = ObservationOf(*config_.kind).size();
    for (double& entry : messages_.ObservationValues(size)) entry = value;
    const auto action_size = static_cast<uint32_t>(ActionOf(*config_.kind).size());
    Send(messages_.Observation(episode, step, action_size));
  }
  // True if the policy gives up when it is asked so.
  bool GivesUp(int64_t episode, int64_t step, double value) {
    SendObservation(episode, step, value);
    const absl::StatusOr<GiveUpFrame> frame = As<GiveUpFrame>(world_->Receive(kPatience));
    return frame.ok() && frame->episode == episode && frame->step == step;
  }
  // As after the last episode.
  void HangUp() { world_->HangUp(); }
  // The policy's answer.
  Values Ask(int64_t episode, int64_t step, double value) {
    SendObservation(episode, step, value);
    const absl::StatusOr<ActionFrame> frame = As<ActionFrame>(world_->Receive(kPatience));
    if (!frame.ok()) {
      ADD_FAILURE() << frame.status();
      return {};
    }
    EXPECT_EQ(frame->episode, episode);
    EXPECT_EQ(frame->step, step);
    return Values(frame->values, frame->values + frame->size);
  }
  std::string AwaitFault() {
    const absl::StatusOr<FaultFrame> fault = As<FaultFrame>(world_->Receive(kPatience));
    return fault.ok() ? fault->detail : std::string(fault.status().message());
  }
  // Hello, welcome and the start of episode 0.
  void Begin(uint64_t seed) {
    ASSERT_TRUE(AwaitHello().ok());
    Welcome();
    const absl::StatusOr<ReadyFrame> ready = Start(0, seed);
    ASSERT_TRUE(ready.ok()) << ready.status();
    EXPECT_EQ(ready->episode, 0);
  }

 private:
  static constexpr absl::Duration kPatience = absl::Seconds(20);

  void Send(const PublishFrame& frame) {
    const std::byte* payload = frame.payload;
    world_->Send(frame.channel, frame.expect, frame.episode, frame.step, frame.action_size,
                 {payload, payload + frame.payload_size});
  }
  template <typename F>
  static absl::StatusOr<F> As(absl::StatusOr<BridgeFrame> frame) {
    if (!frame.ok()) return frame.status();
    if (const F* wanted = std::get_if<F>(&*frame)) return *wanted;
    const auto* fault = std::get_if<FaultFrame>(&*frame);
    return absl::InternalError(fault != nullptr ? fault->detail : "another frame");
  }

  std::optional<BridgeWorld> world_;
  sim::Messages messages_;
  TrackConfig config_;
};

class KitsTest : public ::testing::Test {
 protected:
  void SetUp() override {
    static const absl::Status entered = EnterPrivateBus();
    if (!entered.ok()) GTEST_SKIP() << "not on this host: " << entered.message();
    const char* cache = std::getenv("MYOGRADE_CACHE");
    const std::string runtime =
        absl::StrCat(cache != nullptr ? cache : MYOGRADE_DEFAULT_CACHE, "/runtimes/python");
    setenv("PYTHONPATH", runtime.c_str(), 1);
  }
};

struct Bundled {
  std::string folder;
  std::vector<std::string> command;
};

class EveryPolicyTest : public KitsTest, public ::testing::WithParamInterface<Bundled> {};

// Same step asked again: same answer, and the policy has not moved on.
TEST_P(EveryPolicyTest, AnswersTheSameStepTwiceAlikeAndTheNextOnesAsIfNothingWas) {
  for (const TrackKind* kind : AllTracks()) {
    const TrackKind& track = *kind;
    // A scripted policy plays the track of its name, and so does a baseline.
    const std::string& folder = GetParam().folder;
    if ((folder.starts_with("scripted-") || folder.starts_with("baseline-")) &&
        !folder.ends_with("-" + std::string(track.name))) {
      continue;
    }
    std::vector<Values> once;
    {
      Grader grader(GetParam().folder, GetParam().command, track);
      grader.Begin(42);
      for (int step = 0; step < 4; ++step) once.push_back(grader.Ask(0, step, 0.1 * step));
    }
    Grader grader(GetParam().folder, GetParam().command, track);
    grader.Begin(42);
    ASSERT_TRUE(grader.Start(0, 42).ok());
    for (int step = 0; step < 4; ++step) {
      const Values first = grader.Ask(0, step, 0.1 * step);
      EXPECT_EQ(first.size(), static_cast<size_t>(ActionOf(track).size()));
      EXPECT_EQ(grader.Ask(0, step, 0.1 * step), first);
      EXPECT_EQ(first, once[static_cast<size_t>(step)]) << step;
    }
    // The next episode begins afresh.
    ASSERT_TRUE(grader.Start(1, 42).ok());
    EXPECT_EQ(grader.Ask(1, 0, 0), once[0]);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Policies, EveryPolicyTest,
    ::testing::Values(Bundled{"zero", {"./zero"}}, Bundled{"random", {"./random"}},
                      Bundled{"scripted-manipulation", {"./scripted-manipulation"}},
                      Bundled{"scripted-locomotion", {"./scripted-locomotion"}},
                      Bundled{"baseline-locomotion", {"./baseline-locomotion"}},
                      Bundled{"baseline-baoding", {"./baseline-baoding"}},
                      Bundled{"baseline-relocation", {"./baseline-relocation"}},
                      Bundled{"baseline-chasetag", {"./baseline-chasetag"}},
                      Bundled{"baseline-reorientation", {"./baseline-reorientation"}},
                      Bundled{"python-example", {MYOGRADE_PYTHON, "policy.py"}}),
    [](const auto& test) {
      std::string name = test.param.folder;
      std::replace(name.begin(), name.end(), '-', '_');
      return name;
    });

TEST_F(KitsTest, ZeroIsZero) {
  Grader grader("zero", {"./zero"}, ManipulationTrack());
  grader.Begin(1);
  EXPECT_THAT(grader.Ask(0, 0, 0.5), Each(0.0));
}

TEST_F(KitsTest, RandomFollowsItsSeedAndNothingElse) {
  const auto first_action = [](uint64_t seed) {
    Grader grader("random", {"./random"}, LocomotionTrack());
    grader.Begin(seed);
    return grader.Ask(0, 0, 0);
  };
  const Values one = first_action(1);
  EXPECT_EQ(first_action(1), one);
  EXPECT_NE(first_action(2), one);
  for (size_t i = 0; i < 54; ++i) {
    EXPECT_GE(one[i], -1);
    EXPECT_LE(one[i], 1);
  }
}

// The protocol page's complete policy, as a reader would copy it.
TEST_F(KitsTest, TheProtocolPagesExampleCanBeGraded) {
  std::ifstream page(std::string(MYOGRADE_SOURCE_DIR) + "/protocol/README.md");
  const std::string text((std::istreambuf_iterator<char>(page)), {});
  const std::string opening = "```python\n";
  const size_t begin = text.find(opening);
  ASSERT_NE(begin, std::string::npos);
  const size_t code = begin + opening.size();
  const std::string file = ::testing::TempDir() + "/protocol_page_policy.py";
  std::ofstream(file) << text.substr(code, text.find("```\n", code) - code);
  // `import myograde` finds what lcm-gen made, in the kit's folder.
  const std::string path = absl::StrCat(PoliciesDir(), "/kit-python:", std::getenv("PYTHONPATH"));
  setenv("PYTHONPATH", path.c_str(), 1);
  Grader grader("zero", {MYOGRADE_PYTHON, file}, LocomotionTrack());
  grader.Begin(1);
  const Values first = grader.Ask(0, 0, 0.5);
  EXPECT_EQ(first, Values(55, 0.0));
  EXPECT_EQ(grader.Ask(0, 0, 0.5), first);
  EXPECT_EQ(grader.Ask(0, 1, 0.5), first);
  ASSERT_TRUE(grader.Start(1, 2).ok());
  EXPECT_EQ(grader.Ask(1, 0, 0.5), first);
}

TEST_F(KitsTest, ThePoliciesPagesExampleInCppCanBeGraded) {
  Grader grader("zero", {MYOGRADE_DOCUMENTED}, ManipulationTrack());
  grader.Begin(1);
  EXPECT_EQ(grader.Ask(0, 0, 0.5), Values(80, -1.0));
}

// A policy in Python beside the kit, in a folder of its own.
std::vector<std::string> PythonPolicy(const std::string& name, const std::string& text) {
  const std::string file = ::testing::TempDir() + "/" + name + ".py";
  std::ofstream(file) << text;
  const std::string path = absl::StrCat(PoliciesDir(), "/kit-python:", std::getenv("PYTHONPATH"));
  setenv("PYTHONPATH", path.c_str(), 1);
  return {MYOGRADE_PYTHON, file};
}

constexpr char kGivesUp[] = R"(
import myograde

class Impatient(myograde.Policy):
    def reset(self, episode):
        self.asked = 0
    def act(self, observation):
        self.asked += 1
        if observation[0] > 0.5:
            self.give_up()
            return None
        return [float(self.asked)] * self.welcome.action_size

myograde.serve(Impatient())
)";

// Given up is given up however often it is asked, and the next episode is played.
TEST_F(KitsTest, APolicyMayGiveAnEpisodeUp) {
  for (const std::vector<std::string>& command :
       {std::vector<std::string>{MYOGRADE_GIVES_UP}, PythonPolicy("gives_up", kGivesUp)}) {
    Grader grader("zero", command, ManipulationTrack());
    grader.Begin(1);
    EXPECT_EQ(grader.Ask(0, 0, 0.25), Values(80, 1));
    EXPECT_TRUE(grader.GivesUp(0, 1, 0.75));
    EXPECT_TRUE(grader.GivesUp(0, 1, 0.75));
    ASSERT_TRUE(grader.Start(1, 2).ok());
    EXPECT_EQ(grader.Ask(1, 0, 0.25), Values(80, 1));
    EXPECT_EQ(grader.Ask(1, 1, 0.25), Values(80, 2));
  }
}

constexpr char kByName[] = R"(
import myograde

class ByName(myograde.Policy):
    def leg_sets(self):
        return myograde.leg_sets()[1:3]
    def start(self):
        known = myograde.track(self.welcome.track)
        for mine, theirs in ((self.observation_layout, known.observation),
                             (self.action_layout, known.action)):
            assert mine.size == theirs.size
            assert [(part.name, part.offset, part.size, part.unit) for part in mine.values()] == \
                   [(part.name, part.offset, part.size, part.unit) for part in theirs.values()]
    def act(self, observation):
        parts = self.named(observation)
        return self.action_layout.join({"muscles": parts["act"], "leg_set": parts["terrain"]})

myograde.serve(ByName())
)";

// Names are those of the welcome, and the leg's sets arrive as the grader has them.
TEST_F(KitsTest, PartsOfVectorsHaveNames) {
  Grader grader("zero", PythonPolicy("by_name", kByName), LocomotionTrack());
  const absl::StatusOr<HelloFrame> hello = grader.AwaitHello();
  ASSERT_TRUE(hello.ok()) << hello.status();
  const auto sets = LegSetsFromJson(
      nlohmann::json::parse(std::string(hello->parameters.text, hello->parameters.size)));
  ASSERT_TRUE(sets.ok()) << sets.status();
  EXPECT_EQ(sets->present, 0b00110u);
  const LegStateParameters& stairs_up = sets->set[1][0];
  EXPECT_EQ(stairs_up.knee_stiffness, 99.372);
  EXPECT_THAT(stairs_up.threshold_kind, ::testing::ElementsAre(2, 2, 0, 0, 0));
  EXPECT_NEAR(stairs_up.threshold[0], 0.1 * 78.66887849930261 * 9.81, 1e-9);
  grader.Welcome();
  ASSERT_TRUE(grader.Start(0, 1).ok());
  EXPECT_EQ(grader.Ask(0, 0, 0.25), Values(55, 0.25));
}

constexpr char kSaysGoodbye[] = R"(
import atexit, sys
import myograde

class Polite(myograde.Policy):
    def act(self, observation):
        return [0.0] * self.welcome.action_size

atexit.register(lambda: print("goodbye"))
sys.stdout = open(sys.argv[1], "w")  # with a buffer
print("played")
myograde.serve(Polite())
)";

// What stdio and the interpreter still hold is written when the grader asks the process to end.
TEST_F(KitsTest, APolicyEndsInOrderAfterItsLastEpisode) {
  const std::string file = ::testing::TempDir() + "/goodbye.txt";
  std::vector<std::string> python = PythonPolicy("says_goodbye", kSaysGoodbye);
  python.push_back(file);
  for (const std::vector<std::string>& command :
       {std::vector<std::string>{MYOGRADE_GIVES_UP, file}, python}) {
    std::filesystem::remove(file);
    Grader grader("zero", command, ManipulationTrack(), {"--farewell", "20000"});
    grader.Begin(1);
    grader.Ask(0, 0, 0.25);
    grader.HangUp();
    std::ifstream stream(file);
    EXPECT_EQ(std::string((std::istreambuf_iterator<char>(stream)), {}), "played\ngoodbye\n");
  }
}

// Signals that a program handles end no wait for messages, nor does LCM swallow its exceptions.
TEST_F(KitsTest, SignalsDoNotDisturbAndExceptionsReachMain) {
  Grader grader("zero", {MYOGRADE_INTERRUPTED}, ManipulationTrack());
  grader.Begin(1);
  for (int step = 0; step < 5; ++step) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    EXPECT_EQ(grader.Ask(0, step, 0.25), Values(80, 0.0));
  }
  grader.SendObservation(0, 5, 0.75);
  EXPECT_EQ(grader.AwaitFault(), "the policy's process exited with status 5");
}

TEST_F(KitsTest, NoBusIsAnErrorAtOnce) {
  for (const char* url : {"", "udpm://nonsense:1", "udpm://127.0.0.1:7667"}) {
    const std::string command =
        absl::StrCat(kBusUrlVariable, "='", url, "' ", PoliciesDir(), "/zero/zero 2>&1");
    FILE* const output = popen(command.c_str(), "r");
    ASSERT_NE(output, nullptr);
    std::string text;
    for (char piece[256]; std::fgets(piece, sizeof(piece), output) != nullptr;) text += piece;
    EXPECT_EQ(WEXITSTATUS(pclose(output)), 1) << url;
    EXPECT_THAT(text, ::testing::HasSubstr(absl::StrCat("error: no LCM bus at \"", url,
                                                        "\"; set MYOGRADE_LCM_URL")));
  }
}

TEST_F(KitsTest, ARefusedPolicyEndsWithAnError) {
  for (const Bundled& policy : {Bundled{"zero", {"./zero"}},
                                Bundled{"python-example", {MYOGRADE_PYTHON, "policy.py"}}}) {
    Grader grader(policy.folder, policy.command, ManipulationTrack());
    ASSERT_TRUE(grader.AwaitHello().ok());
    grader.Welcome(false);
    EXPECT_EQ(grader.AwaitFault(), "the policy's process exited with status 1");
  }
}

}  // namespace
}  // namespace myograde
