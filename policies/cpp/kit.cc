#include "policies/cpp/kit.h"

#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <thread>

#include <lcm/lcm-cpp.hpp>

#include "myograde/action_t.hpp"
#include "myograde/episode_ready_t.hpp"
#include "myograde/episode_start_t.hpp"
#include "myograde/hello_t.hpp"
#include "myograde/observation_t.hpp"
#include "policies/cpp/own_echo.h"
#include "protocol/channels.h"

namespace myograde {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kHelloPeriodMs = 100;
constexpr auto kWelcomeDeadline = std::chrono::seconds(60);
// The grader asks every 250 ms at the latest while it waits for this policy,
// and resets and steps in far less than this.
constexpr auto kSilenceDeadline = std::chrono::seconds(600);

// The policy's side of the conversation.
class Conversation {
 public:
  Conversation(lcm::LCM& bus, const OwnEcho& echo, Policy& policy)
      : bus_(bus), echo_(echo), policy_(policy) {
    Listen<welcome_t, &Conversation::OnWelcome>(kWelcomeChannel);
    Listen<episode_start_t, &Conversation::OnEpisodeStart>(kStartChannel);
    Listen<observation_t, &Conversation::OnObservation>(kObservationChannel);
  }

  // Says hello until welcomed. False: refused or no answer; stderr says why.
  bool Greet() {
    hello_t hello;
    hello.protocol_version = kProtocolVersion;
    hello.name = policy_.Name();
    hello.direct = policy_.Direct() ? 1 : 0;
    hello.leg_sets = policy_.LegSets();
    hello.num_leg_sets = static_cast<int32_t>(hello.leg_sets.size());
    const auto deadline = Clock::now() + kWelcomeDeadline;
    while (!welcomed_) {
      if (Clock::now() > deadline) {
        std::fprintf(stderr,
                     "error: no grader answered on the bus for 60 s; check MYOGRADE_LCM_URL\n");
        return false;
      }
      if (bus_.publish(std::string(kHelloChannel), &hello) != 0) {
        std::fprintf(stderr, "error: the bus takes no messages; check MYOGRADE_LCM_URL\n");
        return false;
      }
      bus_.handleTimeout(kHelloPeriodMs);
    }
    if (welcome_.accepted == 0) {
      std::fprintf(stderr, "error: the grader refused this policy: %s\n", welcome_.reason.c_str());
      return false;
    }
    echo_.Silence();
    policy_.Start(welcome_);
    return true;
  }

  // Answers until the bus breaks. When nothing was heard for kSilenceDeadline a
  // thread of its own ends the process: a deadline in each wait would cost
  // every step a system call more.
  void Play() {
    *heard_ = Clock::now();
    std::thread(EndInSilence, heard_).detach();
    while (bus_.handle() == 0) {
    }
    std::fprintf(stderr, "error: the bus broke\n");
  }

 private:
  using Heard = std::shared_ptr<std::atomic<Clock::time_point>>;

  [[noreturn]] static void EndInSilence(const Heard& heard) {
    while (true) {
      const auto end = heard->load() + kSilenceDeadline;
      if (Clock::now() >= end) break;
      std::this_thread::sleep_until(end);
    }
    std::fprintf(stderr, "error: nothing was heard from the grader for 600 s\n");
    std::fflush(nullptr);
    std::_Exit(1);
  }

  // LCM's own subscription of methods trips GCC's sanitizer, so functions it is.
  template <typename Message, void (Conversation::*kMethod)(const Message&)>
  void Listen(std::string_view channel) {
    bus_.subscribeFunction<Message, Conversation*>(
        std::string(channel),
        [](const lcm::ReceiveBuffer*, const std::string&, const Message* message,
           Conversation* self) { (self->*kMethod)(*message); },
        this);
  }

  void OnWelcome(const welcome_t& welcome) {
    if (welcomed_) return;
    welcomed_ = true;
    welcome_ = welcome;
  }

  void OnEpisodeStart(const episode_start_t& start) {
    *heard_ = Clock::now();
    if (!welcomed_ || start.episode < ready_.episode) return;
    if (start.episode > ready_.episode) {
      policy_.Reset({start.episode, static_cast<uint64_t>(start.policy_seed)});
      ready_.episode = start.episode;
      answer_.step = -1;
    }
    bus_.publish(std::string(kReadyChannel), &ready_);
  }

  void OnObservation(const observation_t& observation) {
    *heard_ = Clock::now();
    if (observation.episode != ready_.episode || observation.step < answer_.step) return;
    if (observation.step > answer_.step) {
      answer_.episode = observation.episode;
      answer_.step = observation.step;
      answer_.size = welcome_.action_size;
      answer_.values.assign(static_cast<size_t>(welcome_.action_size), 0.0);
      policy_.Act(observation.values, answer_.values);
    }
    bus_.publish(std::string(kActionChannel), &answer_);
  }

  lcm::LCM& bus_;
  const OwnEcho& echo_;
  Policy& policy_;
  bool welcomed_ = false;
  welcome_t welcome_;
  episode_ready_t ready_ = [] {
    episode_ready_t ready;
    ready.episode = -1;
    ready.num_leg_sets = 0;
    return ready;
  }();
  // The last answer, kept so that the same step asked again gets it again.
  action_t answer_ = [] {
    action_t action;
    action.episode = -1;
    action.step = -1;
    action.size = 0;
    return action;
  }();
  const Heard heard_ = std::make_shared<std::atomic<Clock::time_point>>();
};

}  // namespace

int RunPolicy(Policy& policy) {
  const char* url = std::getenv(kBusUrlVariable);
  const OwnEcho echo;
  lcm::LCM bus(url == nullptr ? "" : url);
  if (!bus.good()) {
    std::fprintf(stderr, "error: no LCM bus at \"%s\"; set MYOGRADE_LCM_URL\n",
                 url == nullptr ? "" : url);
    return 1;
  }
  Conversation conversation(bus, echo, policy);
  if (!conversation.Greet()) return 1;
  conversation.Play();
  return 1;
}

}  // namespace myograde
