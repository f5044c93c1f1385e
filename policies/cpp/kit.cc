#include "policies/cpp/kit.h"

#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <optional>
#include <utility>

#include "myograde/action_t.hpp"
#include "myograde/episode_ready_t.hpp"
#include "myograde/episode_start_t.hpp"
#include "myograde/give_up_t.hpp"
#include "myograde/hello_t.hpp"
#include "myograde/observation_t.hpp"
#include "protocol/bridge/bus.h"
#include "protocol/policy/channels.h"

namespace myograde {
namespace {

using Clock = std::chrono::steady_clock;

constexpr auto kHelloPeriod = std::chrono::milliseconds(100);
constexpr auto kWelcomeDeadline = std::chrono::seconds(60);
// The grader asks every 250 ms at the latest while it waits for this policy,
// and resets and steps in far less than this.
constexpr auto kSilenceDeadline = std::chrono::seconds(600);

volatile std::sig_atomic_t g_asked_to_end = 0;

void CatchEnd() {
  struct sigaction before = {};
  if (::sigaction(SIGTERM, nullptr, &before) != 0 || before.sa_handler != SIG_DFL) return;
  struct sigaction ours = {};
  ours.sa_handler = [](int) { g_asked_to_end = 1; };  // no SA_RESTART: a wait shall return
  ::sigaction(SIGTERM, &ours, nullptr);
}

template <typename Message>
bool Decode(const Datagram& datagram, Message& message) {
  return message.decode(datagram.payload.data(), 0,
                        static_cast<int>(datagram.payload.size())) >= 0;
}

// The policy's side of the conversation.
class Conversation {
 public:
  Conversation(Bus bus, Policy& policy) : bus_(std::move(bus)), policy_(policy) {}

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
      if (g_asked_to_end != 0) return false;
      if (Clock::now() > deadline) {
        std::fprintf(stderr,
                     "error: no grader answered on the bus for 60 s; check MYOGRADE_LCM_URL\n");
        return false;
      }
      Say(kHelloChannel, hello);
      Hear();
    }
    if (welcome_.accepted == 0) {
      std::fprintf(stderr, "error: the grader refused this policy: %s\n", welcome_.reason.c_str());
      return false;
    }
    policy_.Start(welcome_);
    return true;
  }

  // Answers until the grader ends the process (true) or nothing was heard for kSilenceDeadline.
  bool Play() {
    heard_ = Clock::now();
    while (g_asked_to_end == 0 && (Hear() || Clock::now() - heard_ < kSilenceDeadline)) {
    }
    if (g_asked_to_end != 0) return true;
    std::fprintf(stderr, "error: nothing was heard from the grader for 600 s\n");
    return false;
  }

 private:
  // Waits for one message and answers it. False: nothing came for a while.
  bool Hear() {
    const std::span<const std::byte> bytes = bus_.Await();
    if (bytes.empty()) return false;
    const std::optional<Datagram> datagram = ParseDatagram(bytes);
    if (!datagram) return true;
    if (datagram->channel == kObservationChannel) {
      if (Decode(*datagram, observation_)) OnObservation();
    } else if (datagram->channel == kStartChannel) {
      if (Decode(*datagram, start_)) OnEpisodeStart();
    } else if (datagram->channel == kWelcomeChannel && !welcomed_) {
      welcomed_ = Decode(*datagram, welcome_);
    }
    return true;
  }

  template <typename Message>
  void Say(std::string_view channel, const Message& message) {
    encoded_.resize(static_cast<size_t>(message.getEncodedSize()));
    message.encode(encoded_.data(), 0, static_cast<int>(encoded_.size()));
    bus_.Send(channel, encoded_);
  }

  void OnEpisodeStart() {
    heard_ = Clock::now();
    if (!welcomed_ || start_.episode < ready_.episode) return;
    if (start_.episode > ready_.episode) {
      policy_.Reset({start_.episode, static_cast<uint64_t>(start_.policy_seed)});
      ready_.episode = start_.episode;
      answer_.step = -1;
    }
    Say(kReadyChannel, ready_);
  }

  void OnObservation() {
    heard_ = Clock::now();
    if (observation_.episode != ready_.episode || observation_.step < answer_.step) return;
    if (observation_.step > answer_.step) {
      answer_.episode = observation_.episode;
      answer_.step = observation_.step;
      answer_.size = welcome_.action_size;
      answer_.values.assign(static_cast<size_t>(welcome_.action_size), 0.0);
      policy_.Act(observation_.values, answer_.values);
      gives_up_ = policy_.TakeGivingUp();
    }
    if (gives_up_) {
      give_up_.episode = answer_.episode;
      give_up_.step = answer_.step;
      Say(kGiveUpChannel, give_up_);
    } else {
      Say(kActionChannel, answer_);
    }
  }

  Bus bus_;
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
  bool gives_up_ = false;  // the last answer is give_up_, of the same step
  give_up_t give_up_;
  Clock::time_point heard_;
  // Kept, so that a step takes no memory anew.
  observation_t observation_;
  episode_start_t start_;
  std::vector<std::byte> encoded_;
};

}  // namespace

int RunPolicy(Policy& policy) {
  const char* url = std::getenv(kBusUrlVariable);
  std::string problem;
  std::optional<Bus> bus = Bus::Open(url == nullptr ? "" : url, kHelloPeriod, problem);
  if (!bus) {
    std::fprintf(stderr, "error: %s; set MYOGRADE_LCM_URL\n", problem.c_str());
    return 1;
  }
  CatchEnd();
  Conversation conversation(*std::move(bus), policy);
  return conversation.Greet() && conversation.Play() ? 0 : 1;
}

}  // namespace myograde
