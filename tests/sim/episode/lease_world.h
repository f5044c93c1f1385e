// The episode loop without physics: an environment that counts, a policy's
// sandbox played by a thread on a socket pair, and a runner played by another.
#pragma once

#include "protocol/tracks/manipulation/track.h"
#include "sim/episode/lease_player.h"

#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "myograde/episode_end_t.hpp"
#include "myograde/episode_start_t.hpp"
#include "myograde/observation_t.hpp"
#include "myograde/welcome_t.hpp"

namespace myograde::sim {

inline std::pair<Fd, Fd> Pair() {
  int ends[2];
  if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends) != 0) std::abort();
  return {Fd(ends[0]), Fd(ends[1])};
}

// Ends after `length` steps; its state is the seed and the actions' sums.
class CountingEnvironment : public Environment {
 public:
  void Reset(uint64_t seed) override {
    resets.push_back(seed);
    state_ = {static_cast<double>(seed), 0, 0};
    facts_ = {};
    sets_stored.clear();
  }
  absl::Status SetParameters(const nlohmann::json& parameters) override {
    if (parameters.contains("4")) return absl::InvalidArgumentError("leg set 4 is out of range");
    uint32_t sets = 0;
    for (const auto& [name, set] : parameters.items()) sets |= 1u << (name[0] - '0');
    sets_stored.push_back(sets);
    return absl::OkStatus();
  }
  void SetConvention(ActionConvention convention) override { convention_used = convention; }
  int observation_size() const override { return 222; }
  int action_size() const override { return 80; }
  void Observe(std::span<double> out) const override {
    std::fill(out.begin(), out.end(), state_[1]);
    out[0] = state_[0];
  }
  StepResult Step(std::span<const double> action) override {
    ++facts_.steps;
    state_[1] += 1;
    state_[2] += action[79];
    std::get<ManipulationFacts>(facts_.track).effort_sum += unstable_at > 0 ? NAN : 0.5;
    facts_.end = EpisodeEnd::kTime;
    StepResult result;
    result.ended = facts_.steps == length;
    result.unstable = facts_.steps == unstable_at;
    result.overflow = facts_.steps == overflow_at;
    return result;
  }
  EpisodeFacts facts() const override { return facts_; }
  std::span<const double> state() const override { return state_; }
  void ObserveExtra(std::span<double> out) const override {
    std::fill(out.begin(), out.end(), 1000 + state_[1]);
  }
  void RewardTerms(std::span<double>) const override {}
  const mjModel_& model() const override { std::abort(); }
  const mjData_& data() const override { std::abort(); }

  int64_t length = 5;
  int64_t unstable_at = 0;
  int64_t overflow_at = 0;
  std::vector<uint64_t> resets;
  std::vector<uint32_t> sets_stored;
  ActionConvention convention_used = ActionConvention::kNormalized;

 private:
  std::array<double, 3> state_ = {};
  EpisodeFacts facts_;
};

// A sandbox as the simulator sees it: answers each question by `script`.
class Sandbox {
 public:
  explicit Sandbox(Fd socket) : socket_(std::move(socket)) {}

  template <typename F>
  void Send(F frame, FrameType type) {
    frame.header = MakeHeader<F>(type);
    (void)!send(socket_.get(), &frame, sizeof(frame), MSG_NOSIGNAL);
  }
  void Hello(uint32_t version = 1, uint32_t sets = 0) {
    HelloFrame frame = {};
    frame.protocol_version = version;
    frame.convention = ActionConvention::kDirect;
    Upload(frame.parameters, sets);
    Send(frame, FrameType::kHello);
  }
  void Ready(int64_t episode, uint32_t sets = 0) {
    ReadyFrame frame = {};
    frame.episode = episode;
    Upload(frame.parameters, sets);
    Send(frame, FrameType::kReady);
  }
  // An object with the numbers of the set bits as keys.
  static void Upload(ParametersText& parameters, uint32_t sets) {
    nlohmann::json json = nlohmann::json::object();
    for (int i = 0; i < 5; ++i) {
      if ((sets >> i & 1u) != 0) json[std::to_string(i)] = i;
    }
    Upload(parameters, json.dump());
  }
  static void Upload(ParametersText& parameters, const std::string& text) {
    parameters.size = static_cast<uint32_t>(text.size());
    text.copy(parameters.text, text.size());
  }
  void Act(const PublishFrame& question, double value = 1) {
    ActionFrame frame = {};
    frame.episode = question.episode;
    frame.step = question.step;
    frame.size = 80;
    std::fill(std::begin(frame.values), std::end(frame.values), value);
    Send(frame, FrameType::kAction);
  }
  void GiveUp(const PublishFrame& question) {
    GiveUpFrame frame = {};
    frame.episode = question.episode;
    frame.step = question.step;
    Send(frame, FrameType::kGiveUp);
  }
  void Fault(BridgeFault kind, int64_t value, const char* text) {
    FaultFrame frame = {};
    frame.fault = kind;
    frame.value = value;
    std::strncpy(frame.detail, text, sizeof(frame.detail) - 1);
    Send(frame, FrameType::kFault);
  }
  // The next question; null when the simulator hung up.
  const PublishFrame* Hear() {
    const ssize_t size = recv(socket_.get(), question_.get(), sizeof(PublishFrame), 0);
    return size > 0 ? question_.get() : nullptr;
  }
  // Answers everything as a good policy would, until hung up.
  void PlayWell() {
    Hello();
    while (const PublishFrame* question = Hear()) Answer(*question);
  }
  void Answer(const PublishFrame& question) {
    if (question.expect == Expect::kReady) Ready(question.episode);
    if (question.expect == Expect::kAction) Act(question);
  }
  // Answers until step `step` of process episode `episode` is asked.
  bool PlayUntil(int64_t episode, int64_t step) {
    Hello();
    while (const PublishFrame* question = Hear()) {
      if (question->expect == Expect::kAction && question->episode == episode &&
          question->step == step) {
        return true;
      }
      Answer(*question);
    }
    return false;
  }
  int fd() const { return socket_.get(); }
  const PublishFrame& question() const { return *question_; }

 private:
  Fd socket_;
  std::unique_ptr<PublishFrame> question_ = std::make_unique<PublishFrame>();
};

using Script = std::function<void(Sandbox&)>;

// What came of a lease.
struct LeaseResult {
  absl::Status status;
  std::vector<EpisodeFacts> episodes;
  std::vector<FaultEvidence> seen;  // as the simulator reported faults
  int sandboxes = 0;
  int64_t progress = 0;
  int64_t readings = 0;  // of CPU time, asked for
  bool done = false;
};

class LeasePlayerTest : public ::testing::Test {
 protected:
  LeasePlayerTest() {
    order_.track.kind = &ManipulationTrack();
    order_.track.profile = "paper";
    Budgets& budgets = order_.track.budgets;
    budgets = {};
    budgets.startup_s = 20;
    budgets.startup_wall_s = 20;
    budgets.step_s = 1;
    budgets.overtime_s = 60;
    budgets.wall_factor = 10;
    budgets.lease_cpu_s = 1000;
    budgets.lease_wall_s = 1000;
    budgets.lease_idle_s = 1000;
    budgets.stray_messages = 50;
    budgets.wrong_answers = 15;
    budgets.restarts = 2;
    for (int64_t i = 0; i < 3; ++i) {
      order_.episodes.push_back({10 + i, static_cast<uint64_t>(100 + i), 7});
    }
  }

  // Plays the order; the n-th sandbox follows scripts[n], later ones the last.
  LeaseResult Play(std::vector<Script> scripts) {
    auto [here, there] = Pair();
    std::optional<LeasePlayer> player;
    player.emplace(order_, environment_, 1000, here.get(), &cpu_, SystemClock(), log_);
    LeaseResult result;
    std::thread runner([&, socket = there.get()] { PlayRunner(socket, scripts, result); });
    result.status = player->Play();
    // As at the process' end: every socket closes.
    player.reset();
    here.reset();
    runner.join();
    return result;
  }

  void PlayRunner(int socket, const std::vector<Script>& scripts, LeaseResult& result) {
    std::vector<std::thread> sandboxes;
    while (true) {
      absl::StatusOr<SimMessage> message = ReceiveSimMessage(socket, absl::Seconds(30));
      if (!message.ok()) break;
      const std::string type = message->json["type"];
      if (type == "need_policy") {
        if (refuse_.has_value()) {
          nlohmann::json refusal = FaultEvidenceToJson(*refuse_);
          refusal["type"] = "no_policy";
          (void)SendSimMessage(socket, refusal);
          ++result.sandboxes;
          continue;
        }
        auto [sim, sandbox] = Pair();
        const size_t n = std::min<size_t>(static_cast<size_t>(result.sandboxes++),
                                          scripts.size() - 1);
        sandboxes.emplace_back(
            [script = scripts[n], end = std::make_shared<Sandbox>(std::move(sandbox))] {
              script(*end);
            });
        (void)SendSimMessage(socket, {{"type", "policy"}}, sim.get());
      } else if (type == "need_cpu") {
        cpu_.cpu_ns = std::max(cpu_.cpu_ns.load(), read_when_asked_.load());
        ++result.readings;
        (void)SendSimMessage(socket, {{"type", "cpu"}});
      } else if (type == "policy_fault") {
        FaultEvidence evidence = *FaultEvidenceFromJson(message->json);
        result.seen.push_back(evidence);
        if (ruling_.has_value()) evidence.outcome = *ruling_;
        nlohmann::json ruling = FaultEvidenceToJson(evidence);
        ruling["type"] = "ruling";
        (void)SendSimMessage(socket, ruling);
      } else if (type == "episode") {
        result.episodes.push_back(*EpisodeFactsFromJson(message->json));
      } else if (type == "progress") {
        ++result.progress;
      } else if (type == "done") {
        result.done = true;
      }
    }
    for (std::thread& thread : sandboxes) thread.join();
  }

  LeaseOrder order_;
  CountingEnvironment environment_;
  CpuPage cpu_ = {0, 1, 0, 0, 0, 0};
  std::atomic<uint64_t> read_when_asked_ = 0;  // ns of CPU time that the page has not yet
  LogWriter* log_ = nullptr;
  std::optional<FaultEvidence> refuse_;
  std::optional<Outcome> ruling_;
};

inline std::vector<Outcome> Outcomes(const LeaseResult& result) {
  std::vector<Outcome> outcomes;
  for (const EpisodeFacts& facts : result.episodes) {
    outcomes.push_back(facts.end == EpisodeEnd::kFault ? facts.fault.outcome : Outcome::kFailure);
  }
  return outcomes;
}

}  // namespace myograde::sim
