#include "policies/cpp/kit.h"

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>

#include <lcm/lcm-cpp.hpp>

#include "myograde/action_t.hpp"
#include "myograde/episode_ready_t.hpp"
#include "myograde/episode_start_t.hpp"
#include "myograde/give_up_t.hpp"
#include "myograde/hello_t.hpp"
#include "myograde/observation_t.hpp"
#include "protocol/policy/channels.h"

namespace myograde {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kHelloPeriodMs = 100;
constexpr auto kWelcomeDeadline = std::chrono::seconds(60);
// The grader asks every 250 ms at the latest while it waits for this policy,
// and resets and steps in far less than this.
constexpr auto kSilenceDeadline = std::chrono::seconds(600);

volatile std::sig_atomic_t g_asked_to_end = 0;

void CatchEnd() {
  struct sigaction before = {};
  if (::sigaction(SIGTERM, nullptr, &before) != 0 || before.sa_handler != SIG_DFL) return;
  struct sigaction ours = {};
  ours.sa_handler = [](int) { g_asked_to_end = 1; };
  ::sigaction(SIGTERM, &ours, nullptr);
}

// The handler of every subscription. What a message asks for is done once LCM's call has returned:
// an exception of the policy must not pass through LCM, which is C and would abort.
template <typename Message>
void Keep(const lcm::ReceiveBuffer*, const std::string&, const Message* message,
          std::optional<Message>* kept) {
  if (!*kept) *kept = *message;
}

// The policy's side of the conversation.
class Conversation {
 public:
  Conversation(lcm::LCM& bus, Policy& policy) : bus_(bus), policy_(policy) {
    bus_.subscribeFunction(std::string(kWelcomeChannel), &Keep<welcome_t>, &welcome_);
    bus_.subscribeFunction(std::string(kStartChannel), &Keep<episode_start_t>, &start_);
    bus_.subscribeFunction(std::string(kObservationChannel), &Keep<observation_t>, &observation_);
  }
  Conversation(const Conversation&) = delete;
  Conversation& operator=(const Conversation&) = delete;

  // Says hello until welcomed. False: refused, no answer or asked to end; stderr says why.
  bool Greet() {
    hello_t hello;
    hello.protocol_version = kProtocolVersion;
    hello.name = policy_.Name();
    hello.direct = policy_.Direct() ? 1 : 0;
    hello.leg_sets = policy_.LegSets();
    hello.num_leg_sets = static_cast<int32_t>(hello.leg_sets.size());
    const auto deadline = Clock::now() + kWelcomeDeadline;
    while (!welcome_) {
      if (g_asked_to_end != 0) return false;
      if (Clock::now() > deadline) {
        std::fprintf(stderr,
                     "error: no grader answered on the bus for 60 s; check MYOGRADE_LCM_URL\n");
        return false;
      }
      Say(kHelloChannel, hello);
      if (!Hear()) return false;
    }
    if (welcome_->accepted == 0) {
      std::fprintf(stderr, "error: the grader refused this policy: %s\n", welcome_->reason.c_str());
      return false;
    }
    policy_.Start(*welcome_);
    return true;
  }

  // Answers until the grader ends the process (true), or until nothing was heard for
  // kSilenceDeadline or the bus is lost.
  bool Play() {
    heard_ = Clock::now();
    while (g_asked_to_end == 0) {
      if (!Hear()) return false;
      if (Clock::now() - heard_ >= kSilenceDeadline) {
        std::fprintf(stderr, "error: nothing was heard from the grader for 600 s\n");
        return false;
      }
    }
    return true;
  }

 private:
  // Answers one message, or none if none comes for a while. False: the bus is lost.
  bool Hear() {
    // LCM's wait reports a signal that the program handles as an error.
    if (bus_.handleTimeout(kHelloPeriodMs) < 0 && errno != EINTR) {
      std::fprintf(stderr, "error: the bus was lost: %s\n", std::strerror(errno));
      return false;
    }
    if (start_) OnEpisodeStart(*start_);
    if (observation_) OnObservation(*observation_);
    if (start_ || observation_) heard_ = Clock::now();
    start_.reset();
    observation_.reset();
    return true;
  }

  template <typename Message>
  void Say(std::string_view channel, const Message& message) {
    // One that can't be sent counts as lost: the grader asks again, and hello is repeated.
    bus_.publish(std::string(channel), &message);
  }

  void OnEpisodeStart(const episode_start_t& start) {
    if (!welcome_ || start.episode < ready_.episode) return;
    if (start.episode > ready_.episode) {
      policy_.Reset({start.episode, static_cast<uint64_t>(start.policy_seed)});
      ready_.episode = start.episode;
      answer_.step = -1;
    }
    Say(kReadyChannel, ready_);
  }

  void OnObservation(const observation_t& observation) {
    if (observation.episode != ready_.episode || observation.step < answer_.step) return;
    if (observation.step > answer_.step) {
      answer_.episode = observation.episode;
      answer_.step = observation.step;
      answer_.size = welcome_->action_size;
      answer_.values.assign(static_cast<size_t>(answer_.size), 0.0);
      policy_.Act(observation.values, answer_.values);
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

  lcm::LCM& bus_;
  Policy& policy_;
  std::optional<welcome_t> welcome_;
  // What was just heard, until it is answered.
  std::optional<episode_start_t> start_;
  std::optional<observation_t> observation_;
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
};

}  // namespace

int RunPolicy(Policy& policy) {
  const char* variable = std::getenv(kBusUrlVariable);
  const std::string url = variable == nullptr ? "" : variable;
  // LCM would take its default bus for an empty URL, and joins a bus when it is first asked for the
  // descriptor or a subscription, of which the latter can't tell a failure.
  std::optional<lcm::LCM> bus;
  if (!url.empty()) bus.emplace(url);
  if (!bus || !bus->good() || bus->getFileno() < 0) {
    std::fprintf(stderr, "error: no LCM bus at \"%s\"; set MYOGRADE_LCM_URL\n", url.c_str());
    return 1;
  }
  CatchEnd();
  Conversation conversation(*bus, policy);
  return conversation.Greet() && conversation.Play() ? 0 : 1;
}

}  // namespace myograde
