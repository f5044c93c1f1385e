// Speed of a control step against the physics engine alone: one JSON object on standard output.
//
//   step_bench TRACKS_DIR TRACK [--threads N] [--episodes N] [--steps N] [--repetitions N]
//              [--environment-only 1]
//
// Three ways of playing the same episodes (same seeds, same controls, so the same contacts):
//   env     Environment::Step and Observe
//   engine  the engine calls that a control step is defined by: five integrations and the one
//           evaluation of forces that the observation needs, positions and velocities computed once
//   mjstep  five plain mj_step
// Each repetition times all three, one after the other, so that a ratio compares neighbours in
// time. With several threads each plays its own environment, and all start each part together.
// The seeds are spread evenly over those of the track, as some of its episodes cost more than
// others; threads times episodes equal to their number plays each once. A step costs more later in
// an episode (more contacts), so compare only episodes of the same length.
// With --environment-only the other two ways are left out.
// Afterwards one episode is played with MuJoCo's own timers, which cost a little, and are off
// before.
#include <algorithm>
#include <barrier>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <absl/strings/numbers.h>
#include <mujoco/mujoco.h>
#include <nlohmann/json.hpp>

#include "protocol/pinned_maths.h"
#include "protocol/track_config.h"
#include "sim/factory.h"
#include "sim/locomotion/locomotion.h"
#include "sim/manipulation/environment.h"

namespace myograde::sim {
namespace {

constexpr int kSubsteps = 5;
using Seconds = std::chrono::duration<double>;
using Clock = std::chrono::steady_clock;

struct Options {
  std::string tracks_dir, track;
  int threads = 1;
  int episodes = 3;
  int steps = 500;
  int repetitions = 5;
  int environment_only = 0;
};

[[noreturn]] void Fail(const std::string& sentence) {
  std::fprintf(stderr, "error: %s\n", sentence.c_str());
  std::exit(2);
}

Options Parse(int argc, char** argv) {
  if (argc < 3) Fail("usage: step_bench TRACKS_DIR TRACK [--threads N] [--episodes N] ...");
  Options options;
  options.tracks_dir = argv[1];
  options.track = argv[2];
  const std::pair<const char*, int*> flags[] = {{"--threads", &options.threads},
                                                {"--episodes", &options.episodes},
                                                {"--steps", &options.steps},
                                                {"--repetitions", &options.repetitions},
                                                {"--environment-only", &options.environment_only}};
  for (int i = 3; i < argc; i += 2) {
    const auto flag = std::find_if(std::begin(flags), std::end(flags),
                                   [&](const auto& known) { return argv[i] == std::string(known.first); });
    if (flag == std::end(flags) || i + 1 == argc ||
        !absl::SimpleAtoi(argv[i + 1], flag->second) || *flag->second < 1) {
      Fail(std::string("wrong option ") + argv[i] + ": each takes a number from 1 on");
    }
  }
  return options;
}

// An environment with its engine.
struct Player {
  std::unique_ptr<Environment> environment;
  const mjModel* model = nullptr;
  mjData* data = nullptr;
  // Of each episode: steps x nu, as the environment set them.
  std::vector<std::vector<double>> controls;
  std::vector<double> latency;  // s, of each step of the environment
};

Player MakePlayer(const TrackConfig& config, const std::string& cache) {
  auto environment = MakeEnvironment(config, cache);
  if (!environment.ok()) Fail(std::string(environment.status().message()));
  Player player;
  player.environment = *std::move(environment);
  if (auto* arm = dynamic_cast<ManipulationEnvironment*>(player.environment.get())) {
    player.model = &arm->model();
    player.data = &arm->data();
  } else if (auto* leg = dynamic_cast<Locomotion*>(player.environment.get())) {
    player.model = &leg->model();
    player.data = &leg->data();
  }
  return player;
}

// Each plays one episode and returns its seconds, the reset left out.

double PlayEnvironment(Player& player, int episode, uint64_t seed, int steps) {
  Environment& environment = *player.environment;
  const std::vector<double> action(environment.action_size(), 0.0);
  std::vector<double> observation(environment.observation_size());
  environment.Reset(seed);
  std::vector<double>& controls = player.controls[episode];
  controls.clear();
  controls.reserve(static_cast<size_t>(steps) * player.model->nu);
  const auto start = Clock::now();
  auto before = start;
  for (int t = 0; t < steps; ++t) {
    if (environment.Step(action).ended && t + 1 < steps) Fail("an episode ended early");
    environment.Observe(observation);
    controls.insert(controls.end(), player.data->ctrl, player.data->ctrl + player.model->nu);
    const auto now = Clock::now();
    player.latency.push_back(Seconds(now - before).count());
    before = now;
  }
  return Seconds(Clock::now() - start).count();
}

double Replay(Player& player, int episode, uint64_t seed, int steps,
              const std::function<void(const mjModel*, mjData*)>& step) {
  player.environment->Reset(seed);
  const double* control = player.controls[episode].data();
  const auto start = Clock::now();
  for (int t = 0; t < steps; ++t, control += player.model->nu) {
    std::copy_n(control, player.model->nu, player.data->ctrl);
    step(player.model, player.data);
  }
  return Seconds(Clock::now() - start).count();
}

void EngineStep(const mjModel* model, mjData* data) {
  mj_step2(model, data);
  for (int i = 1; i < kSubsteps; ++i) mj_step(model, data);
  mj_forward(model, data);
}

void PlainStep(const mjModel* model, mjData* data) {
  for (int i = 0; i < kSubsteps; ++i) mj_step(model, data);
}

double Quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  return values[static_cast<size_t>(q * static_cast<double>(values.size() - 1))];
}

nlohmann::json Summary(const std::vector<double>& values) {
  return {{"median", Quantile(values, 0.5)},
          {"min", Quantile(values, 0)},
          {"max", Quantile(values, 1)},
          {"values", values}};
}

// Rates in control steps per second of all threads together, one for each repetition.
struct Rates {
  std::vector<double> env, engine, mjstep;
};

// Seconds of one episode of a player.
using Play = std::function<double(Player&, int episode, uint64_t seed)>;

// Every player plays so many episodes on a thread of its own. Returns the rate of all together.
double Together(std::vector<Player>& players, int episodes, const std::vector<uint64_t>& seeds,
                int steps, const Play& play) {
  std::vector<double> seconds(players.size(), 0.0);
  std::barrier together(static_cast<std::ptrdiff_t>(players.size()));
  const size_t all = players.size() * static_cast<size_t>(episodes);
  std::vector<std::jthread> threads;
  for (size_t i = 0; i < players.size(); ++i) {
    threads.emplace_back([&, i] {
      together.arrive_and_wait();
      for (int episode = 0; episode < episodes; ++episode) {
        const size_t place = static_cast<size_t>(episode) * players.size() + i;
        seconds[i] += play(players[i], episode, seeds[place * seeds.size() / all]);
      }
    });
  }
  threads.clear();
  double rate = 0;
  for (const double s : seconds) rate += static_cast<double>(steps) * episodes / s;
  return rate;
}

Rates Measure(std::vector<Player>& players, const Options& options, const TrackConfig& config) {
  Rates rates;
  for (int repetition = -1; repetition < options.repetitions; ++repetition) {
    const bool warm_up = repetition < 0;
    const auto part = [&](const Play& play) {
      return Together(players, warm_up ? 1 : options.episodes, config.seeds, options.steps, play);
    };
    const auto replay = [&](auto step) {
      return part([&, step](Player& player, int episode, uint64_t seed) {
        return Replay(player, episode, seed, options.steps, step);
      });
    };
    // First, as it leaves the controls for the other two.
    const double env = part([&](Player& player, int episode, uint64_t seed) {
      return PlayEnvironment(player, episode, seed, options.steps);
    });
    if (warm_up) {
      for (Player& player : players) player.latency.clear();
    } else {
      rates.env.push_back(env);
    }
    if (options.environment_only != 0) continue;
    const double engine = replay(EngineStep);
    const double mjstep = replay(PlainStep);
    if (warm_up) continue;
    rates.engine.push_back(engine);
    rates.mjstep.push_back(mjstep);
  }
  return rates;
}

std::vector<double> Ratios(const std::vector<double>& over, const std::vector<double>& under) {
  std::vector<double> ratios;
  for (size_t i = 0; i < over.size(); ++i) ratios.push_back(over[i] / under[i]);
  return ratios;
}

mjtNum Seconds64() {
  return Seconds(Clock::now().time_since_epoch()).count();
}

// Seconds of a control step that MuJoCo's own timers tell, by part: sums of the parts' calls.
nlohmann::json Timers(Player& player, uint64_t seed, int steps) {
  mjcb_time = Seconds64;
  const double all = PlayEnvironment(player, 0, seed, steps);
  mjcb_time = nullptr;
  nlohmann::json parts = {{"control_step", all / steps}};
  for (int i = 0; i < mjNTIMER; ++i) {
    parts[mjTIMERSTRING[i]] = player.data->timer[i].duration / steps;
  }
  return parts;
}

int Main(int argc, char** argv) {
  const Options options = Parse(argc, argv);
  const char* cache = std::getenv("MYOGRADE_CACHE");
  if (cache == nullptr) Fail("MYOGRADE_CACHE must name the cache folder; run ./dev setup");
  const auto config = LoadTrackConfig(options.tracks_dir, options.track, "");
  if (!config.ok()) Fail(std::string(config.status().message()));
  std::vector<Player> players;
  for (int i = 0; i < options.threads; ++i) {
    players.push_back(MakePlayer(*config, cache));
    players.back().controls.resize(options.episodes);
  }
  const Rates rates = Measure(players, options, *config);
  std::vector<double> latency;
  for (const Player& player : players) {
    latency.insert(latency.end(), player.latency.begin(), player.latency.end());
  }
  nlohmann::json result = {
      {"track", TrackKindName(config->kind)},
      {"threads", options.threads},
      {"episodes", options.episodes},
      {"steps", options.steps},
      {"env", Summary(rates.env)},
      {"env_step_s",
       {{"p50", Quantile(latency, 0.5)}, {"p99", Quantile(latency, 0.99)}, {"max", Quantile(latency, 1)}}}};
  if (options.environment_only == 0) {
    result["engine"] = Summary(rates.engine);
    result["mjstep"] = Summary(rates.mjstep);
    result["env_over_engine"] = Summary(Ratios(rates.env, rates.engine));
    result["env_over_mjstep"] = Summary(Ratios(rates.env, rates.mjstep));
    result["timers_s"] = Timers(players[0], config->seeds[0], options.steps);
  }
  std::printf("%s\n", result.dump(2).c_str());
  return 0;
}

}  // namespace
}  // namespace myograde::sim

int main(int argc, char** argv) {
  // The same computation as in an evaluation, bit for bit.
  if (const absl::Status status = myograde::PinMaths(argv); !status.ok()) {
    std::fprintf(stderr, "error: %s\n", std::string(status.message()).c_str());
    return 2;
  }
  return myograde::sim::Main(argc, argv);
}
