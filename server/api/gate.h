// The gate before the workers: one thread that accepts connections, collects
// requests and sends what workers left unsent, so that workers only ever have
// whole requests to do. Connections that do nothing, dribble or do not read cost
// a descriptor and at most some hundred kilobytes, have deadlines, a least speed
// and limits per peer, and give way to newcomers where there is no room (places.h).
// A newcomer that finds everybody busy waits in line (waiting_line.h); whoever has
// its answer then gives way to it, whatever else it has asked for.
#pragma once

#include <atomic>
#include <functional>
#include <set>
#include <vector>

#include <absl/time/time.h>

#include "protocol/base/fd.h"
#include "protocol/base/mutex.h"
#include "server/api/arrival_rate.h"
#include "server/api/connection.h"
#include "server/api/door.h"
#include "server/api/places.h"
#include "server/api/waiting_line.h"
#include "server/api/work_queue.h"
#include "server/config/server_config.h"

namespace myograde::server {

class Gate {
 public:
  struct Options {
    HttpLimits limits;
    SpoolOptions spool;
    std::function<BodyRule(const Request&)> rule_of;
    std::function<void(int http)> on_refusal = {};  // of a request that no handler sees; may be empty
  };
  // `queue` must outlive it.
  Gate(Options options, WorkQueue& queue);
  ~Gate();

  // Accepts from `listeners`, 1 to 8 of them, until Stop. For one thread.
  void Run(std::vector<Listener> listeners);
  // Any thread: a worker is done with a connection that it had of the queue;
  // `next` of it says what to do.
  void Return(Connection* connection);
  // Any thread, and signal handlers too: bodies are refused from now on.
  void Drain();
  // Any thread: Run hangs up on everybody whom no worker has, and returns.
  void Stop();

 private:
  using State = Connection::State;
  using Next = Connection::Next;

  void Watch(int fd, uint64_t id);
  void WatchListeners();
  void SeeEvents(int timeout_ms, std::set<const Listener*>& knocked);
  void Accept(const Listener& listener);
  // Whether `peer` may have one connection more, now.
  bool MakeRoom(const Peer& peer);
  // Gives the newcomer a place, or has it wait for one.
  void Receive(Newcomer newcomer);
  void Admit(Newcomer newcomer);
  void LetWaitingIn();
  // Those that have had an answer go on with their next request, if they still have their place.
  void GoOn();
  void HangUpOnAll();
  void TakeReturned();

  void OnReady(Connection& connection);
  void Do(Connection& connection, Next next);
  void Lend(Connection& connection, WorkKind work);
  // Sends what is left of an answer, then goes on with the next request.
  void Answer(Connection& connection);
  // Waits until the next part of a stream is due.
  void Follow(Connection& connection);
  void Refuse(Connection& connection, bool read_on);
  void DrainOne(Connection& connection);
  void Wait(Connection& connection, bool to_send);
  void Enter(Connection& connection, State state);
  // False: its peer has too many, and it was refused.
  bool CountBody(Connection& connection, bool receiving);
  void CountUnsent(Connection& connection);
  void Close(Connection& connection);
  void LookAtClocks();
  bool TooSlow(Connection& connection, absl::Duration now);
  void Wake();

  const Options options_;
  WorkQueue& queue_;
  Fd epoll_;
  Fd wake_;
  std::vector<Listener> listeners_;
  Door door_;
  ArrivalRate arrivals_;            // from the network
  Places places_;
  WaitingLine line_;                // for places
  std::vector<uint64_t> answered_;  // connections to go on with
  absl::Duration accept_again_;     // not before
  bool accepting_ = true;
  absl::Duration looked_at_;        // the clocks
  std::atomic<bool> draining_ = false;
  std::atomic<bool> stop_ = false;
  Mutex mutex_;
  std::vector<Connection*> returned_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace myograde::server
