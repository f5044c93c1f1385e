/* Holds the elbow at its target, in C and without a kit: the whole protocol (protocol/README.md)
 * with the code that lcm-gen makes of myograde.lcm.
 *
 * A grader may ask for the same step again. It must get the same answer, and the policy must not
 * advance, so the last answer is kept. */
#include <lcm/lcm.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "myograde_action_t.h"
#include "myograde_episode_ready_t.h"
#include "myograde_episode_start_t.h"
#include "myograde_hello_t.h"
#include "myograde_observation_t.h"
#include "myograde_welcome_t.h"

enum { kProtocolVersion = 1, kHelloPeriodMs = 100, kGreetings = 600, kExtensors = 3 };

static const double kStiffness = 0.8;   /* 1/rad */
static const double kDampingTime = 0.1; /* s: damping by stiffness */
static const double kIntegral = 4.0;    /* 1/(rad s) */
static const double kNear = 0.3;        /* rad: farther away nothing is summed up */

typedef struct {
  lcm_t *bus;
  myograde_welcome_t *welcome; /* NULL until welcomed */
  int angle, error;            /* places in the observation */
  int muscles, num_muscles;    /* place and number in the action */
  int64_t episode;             /* the current one, -1 before the first */
  double last_angle, summed;   /* rad, rad s */
  myograde_action_t answer;    /* the last one; step -1: none in this episode */
} Policy;

static const myograde_part_t *find_part(const myograde_part_t *parts, int count, const char *name) {
  for (int i = 0; i < count; ++i) {
    if (strcmp(parts[i].name, name) == 0) return &parts[i];
  }
  fprintf(stderr, "error: this track has no part %s; the policy is for tracks of an elbow\n", name);
  exit(1);
}

static void on_welcome(const lcm_recv_buf_t *buffer, const char *channel,
                       const myograde_welcome_t *message, void *user) {
  (void)buffer, (void)channel;
  Policy *policy = user;
  if (policy->welcome != NULL) return;
  if (!message->accepted) {
    fprintf(stderr, "error: the grader refused this policy: %s\n", message->reason);
    exit(1);
  }
  /* The message belongs to LCM, so the policy keeps a copy. */
  const myograde_welcome_t *welcome = policy->welcome = myograde_welcome_t_copy(message);
  const myograde_part_t *parts = welcome->observation_parts;
  policy->angle = find_part(parts, welcome->num_observation_parts, "qpos")->offset;
  policy->error = find_part(parts, welcome->num_observation_parts, "pose_err")->offset;
  const myograde_part_t *muscles =
      find_part(welcome->action_parts, welcome->num_action_parts, "muscles");
  policy->muscles = muscles->offset;
  policy->num_muscles = muscles->size;
  policy->answer.size = welcome->action_size;
  policy->answer.values = calloc((size_t)welcome->action_size, sizeof(double));
  if (policy->answer.values == NULL) exit(1);
}

static void on_episode_start(const lcm_recv_buf_t *buffer, const char *channel,
                             const myograde_episode_start_t *message, void *user) {
  (void)buffer, (void)channel;
  Policy *policy = user;
  if (policy->welcome == NULL || message->episode < policy->episode) return;
  if (message->episode > policy->episode) {
    /* A policy with randomness of its own takes it from message->policy_seed. */
    policy->episode = message->episode;
    policy->answer.step = -1;
    policy->summed = 0;
  }
  const myograde_episode_ready_t ready = {.episode = policy->episode};
  myograde_episode_ready_t_publish(policy->bus, "MYOGRADE_EPISODE_READY", &ready);
}

static double within(double value, double low, double high) {
  return value < low ? low : value > high ? high : value;
}

/* Fills the answer: the excitation of each muscle, 0 to 1. */
static void act(Policy *policy, const myograde_observation_t *observation) {
  const double period = policy->welcome->control_period_s;
  const double angle = observation->values[policy->angle];
  const double error = observation->values[policy->error];
  const double speed = observation->step == 0 ? 0 : (angle - policy->last_angle) / period;
  policy->last_angle = angle;
  if (error > -kNear && error < kNear) policy->summed += error * period;
  const double pull = kStiffness * (error - kDampingTime * speed) + kIntegral * policy->summed;
  for (int i = 0; i < policy->num_muscles; ++i) {
    policy->answer.values[policy->muscles + i] = within(i < kExtensors ? -pull : pull, 0, 1);
  }
}

static void on_observation(const lcm_recv_buf_t *buffer, const char *channel,
                           const myograde_observation_t *message, void *user) {
  (void)buffer, (void)channel;
  Policy *policy = user;
  if (policy->welcome == NULL || message->episode != policy->episode) return;
  if (message->step < policy->answer.step) return;
  if (message->step > policy->answer.step) {
    act(policy, message);
    policy->answer.episode = message->episode;
    policy->answer.step = message->step;
  }
  myograde_action_t_publish(policy->bus, "MYOGRADE_ACTION", &policy->answer);
}

int main(void) {
  const char *url = getenv("MYOGRADE_LCM_URL");
  Policy policy = {.bus = url == NULL ? NULL : lcm_create(url), .episode = -1};
  if (policy.bus == NULL) {
    fprintf(stderr, "error: no LCM bus; the grader sets MYOGRADE_LCM_URL\n");
    return 1;
  }
  myograde_welcome_t_subscribe(policy.bus, "MYOGRADE_WELCOME", on_welcome, &policy);
  myograde_episode_start_t_subscribe(policy.bus, "MYOGRADE_EPISODE_START", on_episode_start,
                                     &policy);
  myograde_observation_t_subscribe(policy.bus, "MYOGRADE_OBSERVATION", on_observation, &policy);

  /* The grader may not be listening yet, so hello is repeated until the welcome arrives. */
  char name[] = "hold-elbow-c";
  const myograde_hello_t hello = {
      .protocol_version = kProtocolVersion, .name = name, .direct = 1};
  for (int i = 0; policy.welcome == NULL; ++i) {
    if (i == kGreetings) {
      fprintf(stderr, "error: no grader answered on the bus for a minute\n");
      return 1;
    }
    myograde_hello_t_publish(policy.bus, "MYOGRADE_HELLO", &hello);
    if (lcm_handle_timeout(policy.bus, kHelloPeriodMs) < 0) return 1;
  }
  /* From now on it only answers. After the last episode the grader ends the program. */
  while (lcm_handle(policy.bus) == 0) {
  }
  fprintf(stderr, "error: the bus was lost\n");
  return 1;
}
